// Rows of the regression equation, and what least squares needs from them. A tile holds one row of some hundred samples:
// column after column, `stride` Lanes apart; it stays in the cache and is reduced to a triangle or a Gram matrix.

// Columns of one body for the unit twist (l, x y z): its power against the wrench of unit parameters. The branches on wanted
// columns follow the same pattern for every group of samples, so they cost little; a base keeps seven of ten columns.
template <class V> static inline void columns(const Link<V>& k, const Vec<V>& l, V x, V y, V z, V* tile, int64_t stride, const int64_t* at) {
    const auto put = [=](int parameter, V value) { tile[at[parameter] * stride] = value; };
    const Vec<V> X = k.B(0), Y = k.B(1), Z = k.B(2), a = k.a, b = k.b;
    const V yz = k.P[0], xz = k.P[1], xy = k.P[2];
    if (at[0] >= 0) put(0, l[0] * b[0] + l[1] * b[1] + l[2] * b[2]);
    if (at[1] >= 0) put(1, X[0] * l[0] + X[1] * l[1] + X[2] * l[2] + b[1] * z - b[2] * y);
    if (at[2] >= 0) put(2, Y[0] * l[0] + Y[1] * l[1] + Y[2] * l[2] + b[2] * x - b[0] * z);
    if (at[3] >= 0) put(3, Z[0] * l[0] + Z[1] * l[1] + Z[2] * l[2] + b[0] * y - b[1] * x);
    if (at[4] >= 0) put(4, a[0] * x + xz * y - xy * z);
    if (at[5] >= 0) put(5, Y[2] * y + (X[0] - Y[1]) * z - X[2] * x);
    if (at[6] >= 0) put(6, a[1] * y + xy * z - yz * x);
    if (at[7] >= 0) put(7, X[1] * x + (Z[2] - X[0]) * y - Z[1] * z);
    if (at[8] >= 0) put(8, (Y[1] - Z[2]) * x + Z[0] * z - Y[0] * y);
    if (at[9] >= 0) put(9, a[2] * z + yz * x - xz * y);
}

// The same for an angular velocity f about z alone.
template <class V> static inline void own_columns(const Link<V>& k, V f, V* tile, int64_t stride, const int64_t* at) {
    const auto put = [=](int parameter, V value) { tile[at[parameter] * stride] = value; };
    if (at[0] >= 0) put(0, V());
    if (at[1] >= 0) put(1, k.b[1] * f);
    if (at[2] >= 0) put(2, -(k.b[0] * f));
    if (at[3] >= 0) put(3, V());
    if (at[4] >= 0) put(4, -(k.P[2] * f));
    if (at[5] >= 0) put(5, (k.Q[0] - k.Q[1]) * f);
    if (at[6] >= 0) put(6, k.P[2] * f);
    if (at[7] >= 0) put(7, (k.a[0] - k.P[0]) * f);
    if (at[8] >= 0) put(8, (k.a[1] + k.P[1]) * f);
    if (at[9] >= 0) put(9, k.a[2] * f);
}

// One row over all its bodies, into tile columns `stride` apart. `weight` scales it; twists: 6 nb of scratch.
template <class V> static inline void fill(const Tree& t, const Row& row, const Link<V>* links, V weight, V* twists, V* tile, int64_t stride) {
    for (int64_t e = 0; e < row.steps; ++e) {
        const Step& step = row.step[e];
        const Body& body = t.bodies[step.body];
        const Link<V>& k = links[step.body];
        Vec<V> l, w;
        if (step.starts) {
            for (int c = 0; c < 3; ++c) l[c] = weight * step.twist[c], w[c] = weight * step.twist[3 + c];
        } else {
            // The parent's twist in permuted components, moved to the body's origin, then turned.
            const V* up = twists + 6 * body.parent;
            const int64_t* axes = body.axes;
            const V x = up[3 + axes[0]], y = up[3 + axes[1]], z = up[3 + axes[2]];
            V lx = up[axes[0]], ly = up[axes[1]], lz = up[axes[2]];
            if (body.sparse) {
                const double* p = body.lever;
                const V* R = k.R;
                if (body.shifted) lx += y * p[2] - z * p[1], ly += z * p[0] - x * p[2], lz += x * p[1] - y * p[0];
                l = {{R[0] * lx + R[1] * ly, R[2] * lx + R[3] * ly, body.sign[2] * lz}};
                w = {{R[0] * x + R[1] * y, R[2] * x + R[3] * y, body.sign[2] * z}};
            } else {
                const Vec<V> angular{{x, y, z}};
                l = into(body, k, Vec<V>{{lx, ly, lz}} + cross(angular, k.p));
                w = into(body, k, angular);
            }
            if (step.joins)
                for (int c = 0; c < 3; ++c) l[c] += weight * step.twist[c], w[c] += weight * step.twist[3 + c];
        }
        if (step.leads)
            for (int c = 0; c < 3; ++c) twists[6 * step.body + c] = l[c], twists[6 * step.body + 3 + c] = w[c];
        if (step.own) own_columns(k, w[2], tile, stride, step.column);
        else if (step.shows) columns(k, l, w[0], w[1], w[2], tile, stride, step.column);
    }
}

// Products of R rows of numbers `a(i, group)` with C columns of a tile, kept in registers; `use` takes their sums over all samples.
template <int R, int C, bool triangular = false, class A, class Use> static inline void products_of(A a, const Lanes* b, int b_stride, int used, Use use) {
    constexpr int N = (R * C + LANES - 1) / LANES * LANES;   // lane_sums takes LANES at a time
    Lanes sum[N];
    for (int i = 0; i < N; ++i) sum[i] = Lanes();
    for (int g = 0; g < used; ++g)
        for (int i = 0; i < R; ++i)
            for (int j = triangular ? i : 0; j < C; ++j) sum[C * i + j] += a(i, g) * b[j * b_stride + g];
    double total[N];
    for (int i = 0; i < N; i += LANES) lane_sums(sum + i, total + i);
    use(total);
}
template <int R, int C, bool triangular = false, class Use> static inline void products(const Lanes* a, int a_stride, const Lanes* b, int b_stride, int used, Use use) {
    products_of<R, C, triangular>([=](int i, int g) { return a[i * a_stride + g]; }, b, b_stride, used, use);
}

// Call `block.run<C>(column)` for blocks of C = 4 columns from `first` on, and for the rest.
template <class Block> static inline void by_columns(int first, int width, Block block) {
    int c = first;
    for (; c + 4 <= width; c += 4) block.template run<4>(c);
    switch (width - c) {
        case 3: return block.template run<3>(c);
        case 2: return block.template run<2>(c);
        case 1: return block.template run<1>(c);
    }
}

// Rows of a block of products: with four columns, as many sums as there are registers for beside their factors (32 with AVX-512 and NEON,
// 16 else).
#if LANES == 8 || defined(__aarch64__)
constexpr int GRAM_ROWS = 4;
#else
constexpr int GRAM_ROWS = 2;
#endif

template <int R> struct GramBlocks {
    const Lanes* tile;
    int stride, used, padded, row;
    double* G;
    template <int C> void run(int c) {
        const auto add = [&](const double* total) {
            for (int i = 0; i < R; ++i)
                for (int j = 0; j < C; ++j) G[(row + i) * padded + c + j] += total[C * i + j];
        };
        if (c == row) products<R, C, true>(tile + row * stride, stride, tile + c * stride, stride, used, add);
        else products<R, C>(tile + row * stride, stride, tile + c * stride, stride, used, add);
    }
};

// Gram matrix of a tile, added to the upper triangle of G (leading dimension `padded`).
static void add_gram(Lanes* tile, int stride, int used, int width, int padded, double* G) {
    constexpr int R = GRAM_ROWS;
    int r = 0;
    for (; r + R <= width; r += R) by_columns(r, width, GramBlocks<R>{tile, stride, used, padded, r, G});
    for (; r < width; ++r) by_columns(r, width, GramBlocks<1>{tile, stride, used, padded, r, G});
}

// Products of the tile's first `split` columns with the others alone, added to their block of G.
static void add_mixed(Lanes* tile, int stride, int used, int width, int padded, int split, double* G) {
    constexpr int R = GRAM_ROWS;
    int r = 0;
    for (; r + R <= split; r += R) by_columns(split, width, GramBlocks<R>{tile, stride, used, padded, r, G});
    for (; r < split; ++r) by_columns(split, width, GramBlocks<1>{tile, stride, used, padded, r, G});
}

// Householder triangularisation of [R; tile], R upper triangular (leading dimension `padded`), by panels of four columns in compact
// WY form (Schreiber and Van Loan 1989). The part of a reflector in R is a unit vector; its part in the tile is stored over the
// columns it annihilates.
constexpr int PANEL = 4;

struct Trailing {
    const Lanes* panel;
    Lanes* tile;
    int stride, used, padded;
    double *R, (*T)[PANEL];
    template <int C> void run(int c) {
        Lanes* a = tile + c * stride;
        double z[PANEL][C];
        products<PANEL, C>(panel, stride, a, stride, used, [&](double* w) {
            for (int i = 0; i < PANEL; ++i)
                for (int j = 0; j < C; ++j) w[C * i + j] += R[i * padded + c + j];
            for (int i = 0; i < PANEL; ++i)   // z = T' w
                for (int j = 0; j < C; ++j) {
                    z[i][j] = 0.0;
                    for (int e = 0; e <= i; ++e) z[i][j] += T[e][i] * w[C * e + j];
                    R[i * padded + c + j] -= z[i][j];
                }
        });
        for (int g = 0; g < used; ++g)
            for (int j = 0; j < C; ++j) {
                Lanes value = a[j * stride + g];
                for (int i = 0; i < PANEL; ++i) value -= z[i][j] * panel[i * stride + g];
                a[j * stride + g] = value;
            }
    }
};

static void add_triangle(Lanes* tile, int stride, int used, int width, int padded, double* R) {
    for (int first = 0; first < width; first += PANEL) {
        Lanes* panel = tile + first * stride;
        double T[PANEL][PANEL] = {};
        bool any = false;
        for (int j = 0; j < PANEL; ++j) {
            // x = column j: products with the panel's reflectors (before j) and columns (from j on), in one pass.
            Lanes* x = panel + j * stride;
            double* Rj = R + (first + j) * padded + first;
            double dot[PANEL];
            products<1, PANEL>(x, stride, panel, stride, used, [&](const double* total) { memcpy(dot, total, sizeof dot); });
            if (dot[j] == 0.0) continue;   // nothing to annihilate: tau = 0, and the column is zero (NaN goes on, to be seen)
            any = true;
            const double norm = std::sqrt(Rj[j] * Rj[j] + dot[j]);
            const double beta = Rj[j] > 0.0 ? -norm : norm;
            const double tau = (beta - Rj[j]) / beta, scale = 1.0 / (Rj[j] - beta);
            Rj[j] = beta;
            double factor[PANEL] = {};
            for (int c = j + 1; c < PANEL; ++c) {
                const double w = tau * (Rj[c] + scale * dot[c]);
                Rj[c] -= w;
                factor[c] = w * scale;
            }
            for (int g = 0; g < used; ++g) {
                const Lanes v = x[g];
                for (int c = j + 1; c < PANEL; ++c) panel[c * stride + g] -= factor[c] * v;
                x[g] = v * scale;
            }
            T[j][j] = tau;
            for (int i = 0; i < j; ++i)
                for (int e = i; e < j; ++e) T[i][j] -= tau * scale * T[i][e] * dot[e];
        }
        if (any) by_columns(first + PANEL, width, Trailing{panel, tile, stride, used, padded, R + first * padded, T});
    }
}
