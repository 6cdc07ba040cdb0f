// Rigid-body dynamics of a tree on lanes of samples. V is either Lanes or double (one sample: tails, single states).
// All quantities of a body are in its own (renamed) frame: w angular velocity, a angular acceleration, b acceleration of the frame's
// origin less gravity, B = [a]x + [w]x[w]x. Force and moment about the origin: f = m b + B h, n = h x b + I a + w x I w,
// h the first moment. Nothing is divided by a mass.

template <class V> struct Vec {
    V c[3];
    V& operator[](int i) { return c[i]; }
    const V& operator[](int i) const { return c[i]; }
};
template <class A, class B> static inline auto operator+(const Vec<A>& x, const Vec<B>& y) -> Vec<decltype(A() + B())> {
    return {{x[0] + y[0], x[1] + y[1], x[2] + y[2]}};
}
template <class A, class B> static inline auto cross(const Vec<A>& x, const Vec<B>& y) -> Vec<decltype(A() * B())> {
    return {{x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]}};
}
template <class V> static inline Vec<V> product(const V* M, const Vec<V>& x) {  // M 3 x 3, row by row
    return {{M[0] * x[0] + M[1] * x[1] + M[2] * x[2], M[3] * x[0] + M[4] * x[1] + M[5] * x[2], M[6] * x[0] + M[7] * x[1] + M[8] * x[2]}};
}
static inline Vec<double> constant(const double* x) { return {{x[0], x[1], x[2]}}; }

template <class V> struct Link {
    V R[9];     // rotation to the parent's frame; of a sparse body only the four products that turn about z
    Vec<V> p;   // origin in the parent's frame; of a sparse body it is constant, and only in Body
    Vec<V> w, a, b;
    V P[3], Q[3];   // products (wy wz, wx wz, wx wy), and the diagonal of B

    // Column j of B.
    Vec<V> B(int j) const {
        const int y = (j + 1) % 3, z = (j + 2) % 3;
        Vec<V> column;
        column[j] = Q[j];
        column[y] = P[z] + a[z];
        column[z] = P[y] - a[y];
        return column;
    }
};

template <class V> static inline Vec<V> origin(const Body& body, const Link<V>& k) {
    const V zero = V();
    return body.sparse ? Vec<V>{{zero + body.p[0], zero + body.p[1], zero + body.p[2]}} : k.p;
}

// B x.
template <class V, class X> static inline Vec<V> turn(const Link<V>& k, const Vec<X>& x) {
    const Vec<V> u = k.B(0), v = k.B(1), w = k.B(2);
    return {{u[0] * x[0] + v[0] * x[1] + w[0] * x[2], u[1] * x[0] + v[1] * x[1] + w[1] * x[2], u[2] * x[0] + v[2] * x[1] + w[2] * x[2]}};
}

template <class V> static inline Vec<V> permuted(const Vec<V>& v, int64_t first, int64_t second) {
    switch (3 * first + second) {
        case 1: return v;
        case 2: return {{v[0], v[2], v[1]}};
        case 3: return {{v[1], v[0], v[2]}};
        case 5: return {{v[1], v[2], v[0]}};
        case 6: return {{v[2], v[0], v[1]}};
        default: return {{v[2], v[1], v[0]}};
    }
}

// R' v: from the parent's frame into the body's.
template <class V> static inline Vec<V> into(const Body& body, const Link<V>& k, const Vec<V>& v) {
    const V* R = k.R;
    if (body.sparse) {
        const Vec<V> x = permuted(v, body.axes[0], body.axes[1]);
        return {{R[0] * x[0] + R[1] * x[1], R[2] * x[0] + R[3] * x[1], body.sign[2] * x[2]}};
    }
    return {{R[0] * v[0] + R[3] * v[1] + R[6] * v[2], R[1] * v[0] + R[4] * v[1] + R[7] * v[2], R[2] * v[0] + R[5] * v[1] + R[8] * v[2]}};
}

// R v: back into the parent's frame.
template <class V> static inline Vec<V> out_of(const Body& body, const Link<V>& k, const Vec<V>& v) {
    const V* R = k.R;
    if (!body.sparse) return product(R, v);
    const Vec<V> x{{R[0] * v[0] + R[2] * v[1], R[1] * v[0] + R[3] * v[1], body.sign[2] * v[2]}};
    switch (3 * body.axes[0] + body.axes[1]) {
        case 1: return x;
        case 2: return {{x[0], x[2], x[1]}};
        case 3: return {{x[1], x[0], x[2]}};
        case 5: return {{x[2], x[0], x[1]}};
        case 6: return {{x[1], x[2], x[0]}};
        default: return {{x[2], x[1], x[0]}};
    }
}

// Force and moment about a body's origin, carried into its parent's frame and to its origin.
template <class V> static inline void carry(const Body& body, const Link<V>& k, Vec<V>& force, Vec<V>& moment) {
    force = out_of(body, k, force);
    moment = out_of(body, k, moment);
    if (body.shifted) moment = moment + cross(origin(body, k), force);
}

// Lanes beyond `count` repeat the first sample: they are finite, and the caller weighs them with zero.
template <class V> static inline V gather(const double* array, int64_t sample, int width, int column, int count = Width<V>::value) {
    const double* at = array + sample * width + column;
    if (count == Width<V>::value) return strided<V>(at, width);
    V x = V();
    for (int i = 0; i < Width<V>::value; ++i) set_lane(x, i, at[i < count ? (int64_t)i * width : 0]);
    return x;
}
template <class V> static inline void scatter(V x, double* array, int64_t sample, int64_t width, int64_t column) {
    for (int i = 0; i < Width<V>::value; ++i) array[(sample + i) * width + column] = lane(x, i);
}

// Placement of a body's frame in its parent's, from its position coordinates and, of a revolute joint, their sine and cosine.
template <class V> static inline void place(const Body& body, const V* at, V s, V c, Link<V>& k) {
    const V zero = V();
    if (!body.sparse) k.p = {{zero + body.p[0], zero + body.p[1], zero + body.p[2]}};
    if (body.kind == REVOLUTE) {
        if (body.sparse) {
            k.R[0] = c * body.sign[0], k.R[1] = s * body.sign[1];
            k.R[2] = s * -body.sign[0], k.R[3] = c * body.sign[1];
        } else {
            for (int e = 0; e < 9; ++e) k.R[e] = body.fixed[e] + c * body.cosine[e] + s * body.sine[e];
        }
    } else if (body.kind == PRISMATIC) {
        for (int e = 0; e < 9; ++e) k.R[e] = zero + body.R0[e];
        for (int r = 0; r < 3; ++r)
            k.p[r] += at[0] * (body.R0[3 * r] * body.u[0] + body.R0[3 * r + 1] * body.u[1] + body.R0[3 * r + 2] * body.u[2]);
    } else {
        const V norm = 1.0 / square_root(at[3] * at[3] + at[4] * at[4] + at[5] * at[5] + at[6] * at[6]);
        const V x = at[3] * norm, y = at[4] * norm, z = at[5] * norm, w = at[6] * norm;
        const V Q[9] = {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w),       2.0 * (x * z + y * w),
                        2.0 * (x * y + z * w),       1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
                        2.0 * (x * z - y * w),       2.0 * (y * z + x * w),       1.0 - 2.0 * (x * x + y * y)};
        for (int r = 0; r < 3; ++r) {
            for (int e = 0; e < 3; ++e)
                k.R[3 * r + e] = body.R0[3 * r] * Q[e] + body.R0[3 * r + 1] * Q[3 + e] + body.R0[3 * r + 2] * Q[6 + e];
            k.p[r] += body.R0[3 * r] * at[0] + body.R0[3 * r + 1] * at[1] + body.R0[3 * r + 2] * at[2];
        }
    }
}

template <class V> static void pose(const Tree& t, const V* q, Link<V>* links) {
    for (int i = 0; i < t.nb; ++i) {
        const Body& body = t.bodies[i];
        const V* at = q + body.position;
        V s = V(), c = V();
        if (body.kind == REVOLUTE) sine_cosine(body.sparse ? at[0] * body.turn : at[0], s, c);
        place(body, at, s, c, links[i]);
    }
}

// Motion of all bodies, base first. ddq may be null: no acceleration. lift: acceleration of the base less gravity.
template <class V> static void motion(const Tree& t, const Vec<V>& lift, const V* dq, const V* ddq, Link<V>* links) {
    const V zero = V();
    for (int i = 0; i < t.nb; ++i) {
        const Body& body = t.bodies[i];
        Link<V>& k = links[i];
        Vec<V> w{{zero, zero, zero}}, a = w, b;
        if (body.parent < 0) {
            b = into(body, k, lift);
        } else {
            const Link<V>& up = links[body.parent];
            w = into(body, k, up.w);
            a = into(body, k, up.a);
            b = into(body, k, body.shifted ? up.b + turn(up, origin(body, k)) : up.b);
        }
        const V* rate = dq + body.row;
        const V* acceleration = ddq ? ddq + body.row : nullptr;
        const Vec<double> u = constant(body.u);
        if (body.kind == REVOLUTE) {
            const V s = rate[0], ds = acceleration ? acceleration[0] : zero;
            if (body.sparse) {
                a = {{a[0] + w[1] * (body.turn * s), a[1] - w[0] * (body.turn * s), a[2] + body.turn * ds}};
                w[2] += body.turn * s;
            } else {
                const Vec<V> c = cross(w, u);
                for (int e = 0; e < 3; ++e) a[e] += c[e] * s + u[e] * ds, w[e] += u[e] * s;
            }
        } else if (body.kind == PRISMATIC) {
            const V s = 2.0 * rate[0], ds = acceleration ? acceleration[0] : zero;
            const Vec<V> c = cross(w, u);
            for (int e = 0; e < 3; ++e) b[e] += c[e] * s + u[e] * ds;
        } else {
            w = {{rate[3], rate[4], rate[5]}};
            b = b + cross(w, Vec<V>{{rate[0], rate[1], rate[2]}});
            if (acceleration) {
                a = {{acceleration[3], acceleration[4], acceleration[5]}};
                b = b + Vec<V>{{acceleration[0], acceleration[1], acceleration[2]}};
            }
        }
        const V xx = w[0] * w[0], yy = w[1] * w[1], zz = w[2] * w[2], yz = w[1] * w[2], xz = w[0] * w[2], xy = w[0] * w[1];
        k.w = w, k.a = a, k.b = b;
        k.P[0] = yz, k.P[1] = xz, k.P[2] = xy;
        k.Q[0] = -(yy + zz), k.Q[1] = -(xx + zz), k.Q[2] = -(xx + yy);
    }
}

template <class V> static void motion(const Tree& t, const V* dq, const V* ddq, Link<V>* links) {
    const V zero = V();
    motion(t, Vec<V>{{zero - t.gravity[0], zero - t.gravity[1], zero - t.gravity[2]}}, dq, ddq, links);
}

// Component d of a wrench along joint d of a body.
template <class V> static inline V along(const Body& body, int d, const Vec<V>& force, const Vec<V>& moment) {
    if (body.kind == FREE) return d < 3 ? force[d] : moment[d - 3];
    if (body.sparse) return body.turn * moment[2];
    const Vec<V>& x = body.kind == PRISMATIC ? force : moment;
    return body.u[0] * x[0] + body.u[1] * x[1] + body.u[2] * x[2];
}

static inline int freedoms(const Body& body) { return body.kind == FREE ? 6 : 1; }

// I x for the six entries xx xy yy xz yz zz.
template <class E, class V> static inline Vec<V> inertia_times(const E* I, const Vec<V>& x) {
    return {{I[0] * x[0] + I[1] * x[1] + I[3] * x[2], I[1] * x[0] + I[2] * x[1] + I[4] * x[2], I[3] * x[0] + I[4] * x[1] + I[5] * x[2]}};
}

// Recursive Newton-Euler: joint torques (nv) from links with their motion. wrench: 2 nb vectors of scratch.
template <class V> static void torques(const Tree& t, const double* inertia, const Link<V>* links, Vec<V>* wrench, V* tau) {
    for (int i = 0; i < t.nb; ++i) {
        const Link<V>& k = links[i];
        const double* parameter = inertia + PARAMETERS * i;
        const Vec<double> h = constant(parameter + 1);
        const Vec<V> gyroscopic = cross(k.w, inertia_times(parameter + 4, k.w));
        const Vec<V> turning = inertia_times(parameter + 4, k.a);
        const Vec<V> lever = cross(h, k.b), spin = turn(k, h);
        for (int e = 0; e < 3; ++e) {
            wrench[2 * i][e] = parameter[0] * k.b[e] + spin[e];
            wrench[2 * i + 1][e] = lever[e] + turning[e] + gyroscopic[e];
        }
    }
    for (int i = t.nb - 1; i >= 0; --i) {
        const Body& body = t.bodies[i];
        for (int d = 0; d < freedoms(body); ++d) tau[body.row + d] = along(body, d, wrench[2 * i], wrench[2 * i + 1]);
        if (body.parent < 0) continue;
        Vec<V> force = wrench[2 * i], moment = wrench[2 * i + 1];
        carry(body, links[i], force, moment);
        wrench[2 * body.parent] = wrench[2 * body.parent] + force;
        wrench[2 * body.parent + 1] = wrench[2 * body.parent + 1] + moment;
    }
}

// Composite-rigid-body algorithm: lower triangle of the mass matrix in M (nv x nv). composite: 10 nb of scratch.
template <class V> static void masses(const Tree& t, const double* inertia, const Link<V>* links, V* composite, V* M) {
    const V zero = V();
    for (int e = 0; e < t.nv * t.nv; ++e) M[e] = zero;
    for (int e = 0; e < PARAMETERS * t.nb; ++e) composite[e] = zero + inertia[e];
    for (int i = t.nb - 1; i >= 0; --i) {
        const Body& body = t.bodies[i];
        const V* C = composite + PARAMETERS * i;
        const Vec<V> h{{C[1], C[2], C[3]}};
        for (int d = 0; d < freedoms(body); ++d) {
            // Wrench that moves everything from this body on with unit acceleration of its joint.
            Vec<V> force, moment;
            if (body.sparse) {
                force = {{-body.turn * h[1], body.turn * h[0], zero}};
                moment = {{body.turn * C[7], body.turn * C[8], body.turn * C[9]}};
            } else {
                const bool linear = body.kind == PRISMATIC || (body.kind == FREE && d < 3);
                Vec<double> s = constant(body.u);
                if (body.kind == FREE) s = {{double(d % 3 == 0), double(d % 3 == 1), double(d % 3 == 2)}};
                const Vec<V> unit{{zero + s[0], zero + s[1], zero + s[2]}};
                force = linear ? Vec<V>{{C[0] * s[0], C[0] * s[1], C[0] * s[2]}} : cross(s, h);
                moment = linear ? cross(h, s) : inertia_times(C + 4, unit);
            }
            for (int j = i;; j = t.bodies[j].parent) {
                const Body& other = t.bodies[j];
                for (int e = 0; e < (j == i ? d + 1 : freedoms(other)); ++e)
                    M[(body.row + d) * t.nv + other.row + e] = along(other, e, force, moment);
                if (other.parent < 0) break;
                carry(other, links[j], force, moment);
            }
        }
        if (body.parent < 0) continue;
        // To the parent's origin: h' = R h, I' = R I R' + 2 (h'.p) E - h'p' - p h'' + m (p.p E - p p').
        const Link<V>& k = links[i];
        const Vec<V> g = out_of(body, k, h);
        const Vec<V> rows[3] = {out_of(body, k, Vec<V>{{C[4], C[5], C[7]}}), out_of(body, k, Vec<V>{{C[5], C[6], C[8]}}),
                                out_of(body, k, Vec<V>{{C[7], C[8], C[9]}})};
        const Vec<V> x = out_of(body, k, Vec<V>{{rows[0][0], rows[1][0], rows[2][0]}});
        const Vec<V> y = out_of(body, k, Vec<V>{{rows[0][1], rows[1][1], rows[2][1]}});
        const Vec<V> z = out_of(body, k, Vec<V>{{rows[0][2], rows[1][2], rows[2][2]}});
        V* U = composite + PARAMETERS * body.parent;
        U[0] += C[0];
        U[4] += x[0], U[5] += x[1], U[6] += y[1], U[7] += x[2], U[8] += y[2], U[9] += z[2];
        if (!body.shifted) {
            for (int e = 0; e < 3; ++e) U[1 + e] += g[e];
            continue;
        }
        const Vec<V> p = origin(body, k);
        const Vec<V> r{{g[0] + C[0] * p[0], g[1] + C[0] * p[1], g[2] + C[0] * p[2]}};  // first moment about the parent's origin
        const V trace = r[0] * p[0] + r[1] * p[1] + r[2] * p[2] + g[0] * p[0] + g[1] * p[1] + g[2] * p[2];
        for (int e = 0; e < 3; ++e) U[1 + e] += r[e];
        U[4] += trace - (r[0] * p[0] + g[0] * p[0]);
        U[5] -= r[0] * p[1] + g[1] * p[0];
        U[6] += trace - (r[1] * p[1] + g[1] * p[1]);
        U[7] -= r[0] * p[2] + g[2] * p[0];
        U[8] -= r[1] * p[2] + g[2] * p[1];
        U[9] += trace - (r[2] * p[2] + g[2] * p[2]);
    }
}

#if LANES > 2
static inline Lanes unit(int64_t place) {   // zeros, and a one in that lane if there is one
    Bits number;
    for (int l = 0; l < LANES; ++l) number[l] = l;
    return number == place ? Lanes() + 1.0 : Lanes();
}

// Mass matrix (lower triangle of M, n x n) and bias torque of a single state, a lane a column. The torque of a unit acceleration, at rest
// and without gravity, is a column of the matrix; one more lane has the speeds, gravity and no acceleration. x: 3 n + nq of scratch.
static void terms_of_one(const Tree& t, const double* inertia, const double* q, const double* dq, Link<Lanes>* links, Vec<Lanes>* wrench, Lanes* x,
                         double* M, double* bias) {
    const int n = t.nv;
    Lanes *rate = x, *acceleration = x + n, *torque = x + 2 * n, *at = x + 3 * n;
    for (int i = 0; i < t.nq; ++i) at[i] = Lanes() + q[i];
    for (int first = 0; first < t.nb; first += LANES) {   // sines of several joints at once
        const int count = t.nb - first < LANES ? t.nb - first : LANES;
        double angles[LANES] = {}, sines[LANES], cosines[LANES];
        for (int i = 0; i < count; ++i) {
            const Body& body = t.bodies[first + i];
            if (body.kind == REVOLUTE) angles[i] = body.sparse ? q[body.position] * body.turn : q[body.position];
        }
        Lanes angle, s, c;
        memcpy(&angle, angles, sizeof angle);
        sine_cosine(angle, s, c);
        memcpy(sines, &s, sizeof s), memcpy(cosines, &c, sizeof c);
        for (int i = 0; i < count; ++i) {
            const Body& body = t.bodies[first + i];
            place(body, at + body.position, Lanes() + sines[i], Lanes() + cosines[i], links[first + i]);
        }
    }
    for (int first = 0; first <= n; first += LANES) {
        const Lanes moving = unit(n - first);
        for (int i = 0; i < n; ++i) rate[i] = moving * dq[i], acceleration[i] = unit(i - first);
        motion(t, Vec<Lanes>{{moving * -t.gravity[0], moving * -t.gravity[1], moving * -t.gravity[2]}}, rate, acceleration, links);
        torques(t, inertia, links, wrench, torque);
        const double* found = (const double*)torque;
        for (int r = first; r < n; ++r)
            for (int c = first; c <= r && c < first + LANES; ++c) M[r * n + c] = found[r * LANES + c - first];
        for (int r = 0; n - first < LANES && r < n; ++r) bias[r] = found[r * LANES + n - first];
    }
}
#endif

static inline bool none(Lanes x) {
    const Bits b = x != 0.0;
    return !some(b);
}
static inline bool none(double x) { return x == 0.0; }
static inline bool positive(Lanes x) { return !some(~(x > 0.0)); }
static inline bool positive(double x) { return x > 0.0; }

// LU with partial pivoting for one sample, A (n x n) row by row; false if a pivot is zero.
static bool eliminate(int n, double* A, double* x) {
    for (int c = 0; c < n; ++c) {
        int best = c;
        for (int r = c + 1; r < n; ++r)
            if (std::fabs(A[r * n + c]) > std::fabs(A[best * n + c])) best = r;
        if (!(std::fabs(A[best * n + c]) > 0.0)) return false;
        if (best != c) {
            for (int e = c; e < n; ++e) {
                const double kept = A[c * n + e];
                A[c * n + e] = A[best * n + e], A[best * n + e] = kept;
            }
            const double kept = x[c];
            x[c] = x[best], x[best] = kept;
        }
        for (int r = c + 1; r < n; ++r) {
            const double factor = A[r * n + c] / A[c * n + c];
            for (int e = c + 1; e < n; ++e) A[r * n + e] -= factor * A[c * n + e];
            x[r] -= factor * x[c];
        }
    }
    for (int r = n - 1; r >= 0; --r) {
        for (int e = r + 1; e < n; ++e) x[r] -= A[r * n + e] * x[e];
        x[r] /= A[r * n + r];
    }
    return true;
}

// Solve M x = x for symmetric M (lower triangle given, n x n). M = L'DL from the tip to the base, which keeps the zeros of a tree
// (Featherstone 2008, ch. 6); exact as long as all pivots are positive. Lanes where they are not go through LU with pivoting.
// Returns the first lane whose matrix is singular, or -1. scratch: n^2 + n doubles.
template <class V> static int solve(int n, V* M, V* x, V* diagonal, double* scratch) {
    bool definite = true;
    for (int r = 0; r < n; ++r) {
        diagonal[r] = M[r * n + r];
        for (int c = 0; c < r; ++c) M[c * n + r] = M[r * n + c];   // kept for LU
    }
    V* right = diagonal + n;
    for (int r = 0; r < n; ++r) right[r] = x[r];
    for (int k = n - 1; k >= 0; --k) {
        V* row = M + k * n;
        definite &= positive(row[k]);
        const V inverse = 1.0 / row[k];
        for (int i = k - 1; i >= 0; --i) {
            if (none(row[i])) continue;
            const V factor = row[i] * inverse;
            for (int j = 0; j <= i; ++j) M[i * n + j] -= factor * row[j];
            x[i] -= factor * x[k];
            row[i] = factor;   // column i of row k is not read again: rows above used columns up to i only
        }
        x[k] *= inverse;
    }
    for (int k = 0; k < n; ++k)
        for (int i = 0; i < k; ++i) x[k] -= M[k * n + i] * x[i];
    if (__builtin_expect(definite, 1)) return -1;
    for (int l = 0; l < Width<V>::value; ++l) {
        double* A = scratch;
        double* y = scratch + n * n;
        for (int r = 0; r < n; ++r) {
            for (int c = 0; c < n; ++c) A[r * n + c] = r == c ? lane(diagonal[r], l) : lane(M[(r < c ? r : c) * n + (r < c ? c : r)], l);
            y[r] = lane(right[r], l);
        }
        if (!eliminate(n, A, y)) return l;
        for (int r = 0; r < n; ++r) set_lane(x[r], l, y[r]);
    }
    return -1;
}

// Elimination without pivots of a symmetric matrix (n x n, its lower triangle, destroyed), and of x (n, or null) beside it: x becomes the
// solution. Whether all pivots are positive.
static inline Bits eliminate_symmetric(int n, Lanes* A, Lanes* x) {
    Bits sound = ~Bits{};
    for (int j = 0; j < n; ++j) {
        sound &= A[j * n + j] > 0.0;
        const Lanes inverse = 1.0 / A[j * n + j];
        for (int i = j + 1; i < n; ++i) {
            const Lanes factor = A[i * n + j] * inverse;
            for (int k = j + 1; k <= i; ++k) A[i * n + k] -= factor * A[k * n + j];
            if (x) x[i] -= factor * x[j];
        }
    }
    for (int j = n - 1; x && j >= 0; --j) {
        Lanes rest = x[j];
        for (int i = j + 1; i < n; ++i) rest -= A[i * n + j] * x[i];
        x[j] = rest / A[j * n + j];
    }
    return sound;
}

// See Response in tree.h. `memory`: 3 n^2 + n Lanes and what aligns them.
static void respond(int n, int64_t count, const Response& r, char* memory) {
    Lanes* J = (Lanes*)aligned(memory);
    Lanes *M = J + n * n, *A = M + n * n, *x = A + n * n;
    for (int64_t s = 0; s < count; s += LANES) {
        const int here = count - s < LANES ? (int)(count - s) : LANES;
        for (int e = 0; e < n * n; ++e) M[e] = gather<Lanes>(r.inertia, s, n * n, e, here);
        for (int i = 0; i < n; ++i) x[i] = gather<Lanes>(r.force, s, n, i, here);
        for (int e = 0; e < n * n; ++e) J[e] = Lanes();
        for (int i = 0; i < n; ++i) {
            Lanes force = Lanes();
            for (int k = 0; k < n; ++k) {
                const double share = r.map[i * n + k];
                if (share == 0.0) continue;
                force += share * x[k];
                for (int c = 0; c < n; ++c) J[i * n + c] += share * M[k * n + c];
            }
            A[i] = force / r.scale[i];
        }
        for (int i = 0; i < n; ++i) x[i] = A[i];
        for (int i = 0; i < n; ++i)
            for (int c = 0; c <= i; ++c) M[i * n + c] = A[i * n + c] = (J[i * n + c] + J[c * n + i]) / (2.0 * (r.scale[i] * r.scale[c]));
        for (int i = 0; i < n; ++i) A[i * n + i] -= r.least;
        const Bits sound = eliminate_symmetric(n, A, nullptr);
        eliminate_symmetric(n, M, x);
        for (int i = 0; i < n; ++i) x[i] /= r.scale[i];
        for (int l = 0; l < here; ++l) {
            r.sound[s + l] = sound[l] != 0;
            for (int i = 0; i < n; ++i) r.out[(s + l) * n + i] = x[i][l];
        }
    }
}
