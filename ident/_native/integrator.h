// Motion of driven plants in time: classical Runge-Kutta steps between events, events where a friction contact stops, turns or breaks
// loose. The method is that of ident/simulation/integrator.py, dynamics.py and contact.py, step for step; here for plants whose forces
// beside the rigid body are linear in position and speed, or dry friction of constant level. Runs whose contacts all slide go lane by
// lane; a run with a contact at rest, or an event within the step, goes alone.

// One run: coordinates, speeds, modes of its contacts (1 and -1: sliding, 0: held), and what follows from them at the start of a step:
// accelerations, levels of held contacts in units of what they can hold, generalised dry friction.
struct Phase { double *y, *v, *modes, *a, *level, *friction; };

struct Carve {   // parts of a piece of memory
    double* at;
    double* take(size_t count) { double* part = at; at += count; return part; }
};

static inline double dot(int n, const double* a, const double* b) {
    double sum = 0.0;
    for (int e = 0; e < n; ++e) sum += a[e] * b[e];
    return sum;
}
static inline void copy(int64_t n, const double* from, double* to) { memcpy(to, from, (size_t)n * sizeof *from); }

struct One {
    const Tree& t;
    const Drive& d;
    Scratch<double>& m;
    const int n, c;
    double *middle, *end, *here, *at, *y2, *v2, *v3, *v4, *a2, *a3, *a4, *trial_y, *trial_v, *unused, *free, *pulled, *M, *W, *A, *b, *x, *s, *kept;
    int failure = NONE;

    One(const Tree& tree, const Drive& drive, Scratch<double>& scratch, Carve& memory) : t(tree), d(drive), m(scratch), n(tree.nv), c(drive.contacts) {
        double** const parts[] = {&middle, &end, &here, &at, &y2, &v2, &v3, &v4, &a2, &a3, &a4, &trial_y, &trial_v, &unused, &free};
        for (double** part : parts) *part = memory.take(n + c);
        pulled = memory.take((size_t)(c + 1) * n), M = memory.take((size_t)n * n), W = memory.take((size_t)c * c), A = memory.take((size_t)c * c);
        b = memory.take(c), x = memory.take(c), s = memory.take(c), kept = memory.take(c);
    }

    static size_t numbers(size_t n, size_t c) { return 15 * (n + c) + (c + 1) * n + n * n + 2 * c * c + 4 * c; }

    void speeds(const double* v, double* out) const {
        for (int i = 0; i < c; ++i) out[i] = 0.0;
        for (int e = 0; e < d.touches; ++e) out[d.touch[e].contact] += d.touch[e].direction * v[d.touch[e].coordinate];
    }
    double speed(const double* v, int i) const { return dot(n, d.direction + (size_t)i * n, v); }
    bool locked(const double* modes) const {
        for (int i = 0; i < c; ++i)
            if (modes[i] != 0.0) return false;
        return d.complete;
    }
    const double* between(const double* first, const double* last, double share, double* out) const {
        if (first == last) return first;
        for (int e = 0; e < n; ++e) out[e] = first[e] + share * (last[e] - first[e]);
        return out;
    }

    void solved(const double* right, double* out) {   // out = M^-1 right
        copy((int64_t)n * n, m.M, M);
        copy(n, right, out);
        if (solve(n, M, out, m.diagonal, m.lu) >= 0) failure = all_finite(m.M, (int64_t)n * n) ? SINGULAR : DIVERGED;
    }

    // Accelerations under a force and friction that do not ask for the state; leaves the mass matrix to `solved` where nothing is solved yet.
    void forces(const double* y, const double* v, const double* drive, const double* friction, double* a) {
        terms(t, d.inertia, y, v, m);
        for (int r = 0; r < n; ++r) a[r] = drive[r] - d.offset[r] - friction[r] - m.tau[r];
        for (int e = 0; e < d.entries; ++e) {
            const Entry& entry = d.entry[e];
            a[entry.row] -= entry.position * y[entry.column] + entry.speed * v[entry.column];
            if (entry.column <= entry.row) m.M[entry.row * n + entry.column] += entry.acceleration;
        }
    }
    void slide(const double* y, const double* v, const double* drive, const double* friction, double* a) {   // all contacts slide
        forces(y, v, drive, friction, a);
        if (solve(n, m.M, a, m.diagonal, m.lu) >= 0) failure = all_finite(m.M, (int64_t)n * n) ? SINGULAR : DIVERGED;
    }
    int held_of(const double* modes) const {
        int held = 0;
        for (int i = 0; i < c; ++i) held += modes[i] == 0.0;
        return held;
    }

    // Levels that keep `held` contacts from accelerating, or, `breaking`, levels within what they can hold (2 and -2: breaks loose).
    void respond(const double* y, const double* v, const double* drive, const double* modes, bool breaking, double* a, double* level, double* friction) {
        for (int r = 0; r < n; ++r) friction[r] = 0.0;
        for (int e = 0; e < d.touches; ++e) friction[d.touch[e].coordinate] += modes[d.touch[e].contact] * d.touch[e].level;
        for (int i = 0; i < c; ++i) level[i] = 0.0;
        const int p = held_of(modes);
        if (p == 0) return slide(y, v, drive, friction, a);   // the usual case, without a copy
        forces(y, v, drive, friction, free);
        solved(free, pulled);
        int row = 0;
        for (int i = 0; i < c; ++i)
            if (modes[i] == 0.0) solved(d.level + (size_t)i * n, pulled + (size_t)++row * n);
        row = 0;
        for (int i = 0; i < c; ++i) {
            if (modes[i] != 0.0) continue;
            b[row] = speed(pulled, i);
            for (int e = 0; e < p; ++e) W[row * p + e] = speed(pulled + (size_t)(e + 1) * n, i);
            ++row;
        }
        if (breaking) {
            if (!pivot(p)) failure = UNFIT;
        } else {
            copy((int64_t)p * p, W, A), copy(p, b, s);
            if (!eliminate(p, A, s)) failure = UNFIT;
        }
        copy(n, pulled, a);
        row = 0;
        for (int i = 0; i < c; ++i) {
            if (modes[i] != 0.0) continue;
            level[i] = breaking && x[row] != 0.0 ? 2.0 * x[row] : s[row];
            const double held = s[row] > 1.0 ? 1.0 : s[row] < -1.0 ? -1.0 : s[row];
            for (int e = 0; e < n; ++e) a[e] -= s[row] * pulled[(size_t)(row + 1) * n + e], friction[e] += held * d.level[i * n + e];
            ++row;
        }
    }

    // Levels s in [-1, 1] with z = b - W s, z > 0 only at s = 1 and z < 0 only at s = -1, and which of p contacts slide (x: 1, -1, or 0);
    // block principal pivoting as in contact.py. False where it does not apply or end.
    bool pivot(int p) {
        double largest = 1e-300, tolerance = 1e-300;
        for (int i = 0; i < p; ++i) {
            if (!(W[i * p + i] > 0.0)) return false;
            tolerance = std::fabs(b[i]) > tolerance ? std::fabs(b[i]) : tolerance;
            for (int e = 0; e < p; ++e) largest = std::fabs(W[i * p + e]) > largest ? std::fabs(W[i * p + e]) : largest;
        }
        for (int i = 0; i < p; ++i) W[i * p + i] += 1e-13 * largest, x[i] = 0.0;
        tolerance *= 1e-12;
        int best = p + 1, patience = 10;
        for (int round = 0; round < 60 + 20 * p; ++round) {
            int held = 0;
            for (int i = 0; i < p; ++i) {
                s[i] = x[i];
                if (x[i] != 0.0) continue;
                int column = 0;
                kept[held] = b[i];
                for (int e = 0; e < p; ++e)
                    if (x[e] != 0.0) kept[held] -= W[i * p + e] * x[e];
                    else A[held * p + column++] = W[i * p + e];
                ++held;
            }
            for (int i = 1; i < held; ++i) memmove(A + i * held, A + i * p, (size_t)held * sizeof *A);
            if (held && !eliminate(held, A, kept)) return false;
            for (int i = 0, e = 0; i < p; ++i)
                if (x[i] == 0.0) s[i] = kept[e++];
            int wrong = 0, first = -1;
            for (int i = 0; i < p; ++i) {
                const bool bad = x[i] == 0.0 ? std::fabs(s[i]) > 1 + 1e-12 : x[i] * (b[i] - dot(p, W + i * p, s)) < -tolerance;
                kept[i] = bad;
                if (bad && !wrong++) first = i;
            }
            if (!wrong) {
                for (int i = 0; i < p; ++i) s[i] = s[i] > 1.0 ? 1.0 : s[i] < -1.0 ? -1.0 : s[i];
                return true;
            }
            if (wrong < best) best = wrong, patience = 10;
            else --patience;
            for (int i = 0; i < p; ++i)
                if (patience > 0 ? kept[i] != 0.0 : i == first) x[i] = x[i] != 0.0 ? 0.0 : s[i] > 0.0 ? 1.0 : -1.0;
        }
        return false;
    }

    // Contacts at rest hold on or break loose, all together.
    void settle(const Phase& p, const double* drive) {
        respond(p.y, p.v, drive, p.modes, true, p.a, p.level, p.friction);
        for (int i = 0; i < c; ++i)
            if (p.modes[i] == 0.0 && std::fabs(p.level[i]) == 2.0) p.modes[i] = p.level[i] > 0.0 ? 1.0 : -1.0;
    }
    void respond(const Phase& p, const double* drive) { respond(p.y, p.v, drive, p.modes, false, p.a, p.level, p.friction); }
    bool overloaded(const double* modes, const double* level) const {
        for (int i = 0; i < c; ++i)
            if (modes[i] == 0.0 && std::fabs(level[i]) > 1 + 1e-10) return true;
        return false;
    }

    void start(const Phase& p, const double* drive) {
        bool still = false;
        for (int i = 0; i < c; ++i) {
            double size = 0.0;
            for (int e = 0; e < n; ++e) size += std::fabs(p.v[e] * d.direction[i * n + e]);
            const double now = speed(p.v, i);
            p.modes[i] = std::fabs(now) <= 1e-14 + 1e-12 * size ? 0.0 : now > 0.0 ? 1.0 : -1.0;
            still |= p.modes[i] == 0.0;
        }
        if (still) settle(p, drive);
    }
    void begin(const Phase& p, const double* drive) {
        respond(p, drive);
        if (!overloaded(p.modes, p.level)) return;
        settle(p, drive);
        respond(p, drive);
    }

    void step(const Phase& p, const double* first, const double* last, double length, double h, double* y, double* v) {
        if (locked(p.modes)) {
            copy(n, p.y, y), copy(n, p.v, v);
            return;
        }
        const double half = 0.5 * h, sixth = h / 6.0;
        const double *mid = between(first, last, half / length, middle), *to = between(first, last, h / length, end);
        const bool sliding = held_of(p.modes) == 0;   // then friction is that of the start throughout
        const auto accelerate = [&](const double* speed, const double* drive, double* a) {
            if (sliding) slide(y2, speed, drive, p.friction, a);
            else respond(y2, speed, drive, p.modes, false, a, unused + n, unused);
        };
        for (int e = 0; e < n; ++e) y2[e] = p.y[e] + half * p.v[e], v2[e] = p.v[e] + half * p.a[e];
        accelerate(v2, mid, a2);
        for (int e = 0; e < n; ++e) y2[e] = p.y[e] + half * v2[e], v3[e] = p.v[e] + half * a2[e];
        accelerate(v3, mid, a3);
        for (int e = 0; e < n; ++e) y2[e] = p.y[e] + h * v3[e], v4[e] = p.v[e] + h * a3[e];
        accelerate(v4, to, a4);
        for (int e = 0; e < n; ++e) {
            y[e] = p.y[e] + sixth * (p.v[e] + 2.0 * (v2[e] + v3[e]) + v4[e]);
            v[e] = p.v[e] + sixth * (p.a[e] + 2.0 * (a2[e] + a3[e]) + a4[e]);
        }
    }

    // The least of the speeds of sliding contacts in their direction and of what held ones have left; negative beyond an event.
    double margin(const Phase& p, const double* y, const double* v, const double* drive) {
        double least = HUGE_VAL;
        bool still = false;
        speeds(v, s);
        for (int i = 0; i < c; ++i) {
            const double own = s[i] * p.modes[i];
            still |= p.modes[i] == 0.0;
            if (p.modes[i] != 0.0 && own < least) least = own;
        }
        if (!still) return least;
        respond(y, v, drive, p.modes, false, a2, unused + n, unused);
        for (int i = 0; i < c; ++i)
            if (p.modes[i] == 0.0) least = std::fmin(least, 1.0 + 1e-10 - std::fabs(unused[n + i]));
        return least;
    }

    void hold_still(double* v, const double* modes) {
        const int p = held_of(modes);
        if (p == 0) return;
        if (locked(modes)) {
            for (int e = 0; e < n; ++e) v[e] = 0.0;
            return;
        }
        for (int i = 0, row = 0; i < c; ++i) {   // v - G' (G G')^-1 G v
            if (modes[i] != 0.0) continue;
            s[row] = speed(v, i);
            for (int j = 0, column = 0; j < c; ++j)
                if (modes[j] == 0.0) A[row * p + column++] = dot(n, d.direction + (size_t)i * n, d.direction + (size_t)j * n);
            ++row;
        }
        if (!eliminate(p, A, s)) failure = UNFIT;
        for (int i = 0, row = 0; i < c; ++i) {
            if (modes[i] != 0.0) continue;
            for (int e = 0; e < n; ++e) v[e] -= s[row] * d.direction[i * n + e];
            ++row;
        }
    }

    // A step with its events; the phase has its response at the start. `tried`: trial_y, trial_v have the step as if there were none, its
    // margin is `end_margin`.
    void advance(const Phase& p, const double* first, const double* last, double h, bool tried = false, double end_margin = 0.0) {
        double done = 0.0;
        for (int event = 0; event < 24 && !failure; ++event) {
            const double* from = between(first, last, done / h, here);
            const double rest = h - done;
            if (!tried) {
                step(p, from, last, rest, rest, trial_y, trial_v);
                end_margin = margin(p, trial_y, trial_v, last);
            }
            tried = false;
            if (!(end_margin < 0.0)) return accept(p);
            done += locate(p, from, last, rest, end_margin);
            if (done > h) done = h;
            const double* now = between(first, last, done / h, at);
            for (int i = 0; i < c; ++i) {   // every contact that is at rest there
                const double was = std::fabs(speed(p.v, i)), reach = std::fabs(speed(p.a, i));
                if (speed(trial_v, i) * p.modes[i] <= 1e-9 * (was + 1e-3 * reach) + 1e-14) p.modes[i] = 0.0;
            }
            accept(p);
            settle(p, now);
            respond(p, now);
            if (done >= h) return;
        }
        // Events without end in a finite time: hold what is at rest.
        for (int i = 0; i < c; ++i)
            if (std::fabs(speed(p.v, i)) <= 1e-9) p.modes[i] = 0.0;
        hold_still(p.v, p.modes);
        const double* now = between(first, last, done / h, at);
        respond(p, now);
        step(p, now, last, h - done, h - done, trial_y, trial_v);
        accept(p);
    }
    void accept(const Phase& p) {
        copy(n, trial_y, p.y), copy(n, trial_v, p.v);
        hold_still(p.v, p.modes);
    }

    // Time until the first event, and the state there in trial_y, trial_v: Chandrupatla's method on the margin (inverse quadratic
    // interpolation where it is safe, bisection elsewhere), which is `at_high` after the whole length.
    double locate(const Phase& p, const double* first, const double* last, double length, double at_high) {
        const auto reach = [&](double step_length) {
            step(p, first, last, length, step_length, trial_y, trial_v);
            return margin(p, trial_y, trial_v, between(first, last, step_length / length, at));
        };
        double low = 0.0, high = length, at_low = margin(p, p.y, p.v, first);
        const double scale = std::fabs(at_low) + std::fabs(at_high);
        if (at_low <= 1e-13 * scale) {   // a contact that has just let go stands at zero: step off before looking for its return
            double off = length;
            at_low = std::fmin(at_low, 0.0);
            while (at_low <= 0.0) {
                off *= 0.1;
                if (off < 1e-12 * length) {
                    copy(n, p.y, trial_y), copy(n, p.v, trial_v);
                    return 0.0;
                }
                at_low = reach(off);
                if (at_low <= 0.0) high = off, at_high = at_low;
                else low = off;
            }
        }
        double share = at_low / (at_low - at_high);   // of the way from low to high, of opposite signs
        for (int round = 0; round < 60; ++round) {
            const double next = low + share * (high - low), value = reach(next);
            if (std::fabs(value) <= 1e-13 * scale || std::fabs(high - low) <= 1e-14 * length) return next;
            double third = low, at_third = at_low;
            if ((value > 0.0) != (at_low > 0.0)) third = high, at_third = at_high, high = low, at_high = at_low;
            low = next, at_low = value;
            const double x = (low - high) / (third - high), f = (at_low - at_high) / (at_third - at_high);
            share = 0.5;
            if (f * f < x && (1.0 - f) * (1.0 - f) < 1.0 - x)
                share = at_low / (at_high - at_low) * at_third / (at_high - at_third) +
                        (third - low) / (high - low) * at_low / (at_third - at_low) * at_high / (at_third - at_high);
            share = std::fmin(std::fmax(share, 1e-15), 1.0 - 1e-15);
        }
        return low;
    }
};

// Runs side by side, one a lane.
struct Team {
    const Tree& t;
    const Drive& d;
    const Runs& x;
    Scratch<Lanes>& m;
    One& one;
    const int n, c;
    const size_t stride;
    Lanes *a1, *a2, *a3, *a4, *y, *v, *y2, *v2, *v3, *v4, *dry, *first_a;
    Lanes least;
    double* runs;   // of each run: y v a friction, forces now and next, at the step's start and end, modes, levels

    Team(const Tree& tree, const Drive& drive, const Runs& work, Scratch<Lanes>& scratch, One& single, Carve memory)
        : t(tree), d(drive), x(work), m(scratch), one(single), n(tree.nv), c(drive.contacts), stride(8 * (size_t)n + 2 * c) {
        Lanes* at = (Lanes*)aligned((char*)memory.at);
        Lanes** const parts[] = {&a1, &a2, &a3, &a4, &y, &v, &y2, &v2, &v3, &v4, &dry, &first_a};
        for (Lanes** part : parts) *part = at, at += n;
        runs = (double*)at;
    }
    static size_t numbers(int n, int c) { return (size_t)LANES * (20 * n + 2 * c + 8); }

    Phase run(int l) const {
        double* r = runs + l * stride;
        return Phase{r, r + n, r + 8 * n, r + 2 * n, r + 8 * n + c, r + 3 * n};
    }
    double* force(int l, int part) const { return runs + l * stride + (4 + part) * n; }
    // Number e of a part of all runs (of the first one), and back.
    template <class V> V across(int part, int64_t e) const { return strided<V>(runs + (size_t)part * n + e, (int64_t)stride); }
    template <class V> void spread(V value, int part, int64_t e) const {
        for (int l = 0; l < Width<V>::value; ++l) runs[l * stride + (size_t)part * n + e] = lane(value, l);
    }

    // Torque on the controller's side at instant k, and the force on the coordinates that it is, as that part of the runs' forces.
    template <class V> void command(int64_t k, int64_t from, int width, V* scratch, int part) {
        V *u = scratch, *position = u + n, *rate = position + n, *out = rate + n;
        const int64_t place = k * x.lanes + from;
        for (int e = 0; e < n; ++e) u[e] = gather<V>(x.forward, place, n, e, width), out[e] = position[e] = rate[e] = V();
        if (d.kp) {
            for (int e = 0; e < d.ratios; ++e) {
                const Entry& ratio = d.ratio[e];
                position[ratio.row] += ratio.position * (across<V>(0, ratio.column) - d.zero[ratio.column]);
                rate[ratio.row] += ratio.position * across<V>(1, ratio.column);
            }
            for (int e = 0; e < n; ++e)
                u[e] += d.kp[e] * (gather<V>(x.desired_q, place, n, e, width) - position[e]) +
                        d.kd[e] * (gather<V>(x.desired_dq, place, n, e, width) - rate[e]);
        }
        for (int e = 0; d.limit && e < n; ++e)
            u[e] = u[e] > d.limit[e] ? V() + d.limit[e] : u[e] < -d.limit[e] ? V() - d.limit[e] : u[e];
        for (int e = 0; e < d.ratios; ++e) out[d.ratio[e].column] += d.ratio[e].position * u[d.ratio[e].row];
        for (int e = 0; e < n; ++e) {
            for (int l = 0; l < width; ++l) x.torque[(place + l) * n + e] = lane(u[e], l);
            spread(out[e], 4 + part, e);
        }
    }
    void command(int64_t k, int64_t from, int width, int part) {
        if (width == 1) command<double>(k, from, 1, one.y2, part);
        else command<Lanes>(k, from, width, a1, part);
    }

    // Accelerations in `a`, which comes with the forces that do not depend on the state.
    int slide(const Lanes* at, const Lanes* rate, Lanes* a) {
        terms(t, d.inertia, at, rate, m);
        for (int r = 0; r < n; ++r) a[r] -= m.tau[r];
        for (int e = 0; e < d.entries; ++e) {
            const Entry& entry = d.entry[e];
            a[entry.row] -= entry.position * at[entry.column] + entry.speed * rate[entry.column];
            if (entry.column <= entry.row) m.M[entry.row * n + entry.column] += entry.acceleration;
        }
        if (solve(n, m.M, a, m.diagonal, m.lu) < 0) return NONE;
        return all_finite((const double*)m.M, (int64_t)n * n * LANES) ? SINGULAR : DIVERGED;
    }
    int slide_first() {
        for (int e = 0; e < n; ++e) y[e] = across<Lanes>(0, e), v[e] = across<Lanes>(1, e), dry[e] = Lanes();
        for (int e = 0; e < d.touches; ++e) dry[d.touch[e].coordinate] += across<Lanes>(8, d.touch[e].contact) * d.touch[e].level;
        for (int e = 0; e < n; ++e) {
            const Lanes taken = dry[e] + d.offset[e];
            a1[e] = across<Lanes>(6, e) - taken, a4[e] = across<Lanes>(7, e) - taken;
            a2[e] = a3[e] = x.linear ? 0.5 * (a1[e] + a4[e]) : a1[e];
        }
        return slide(y, v, a1);
    }
    // The rest of the step: leaves the state after it in y2, v2, and the least speed of a contact in its direction in `least`.
    int slide_on() {
        const double h = x.h, half = 0.5 * h, sixth = h / 6.0;
        for (int e = 0; e < n; ++e) y2[e] = y[e] + half * v[e], v2[e] = v[e] + half * a1[e];
        if (const int failure = slide(y2, v2, a2)) return failure;
        for (int e = 0; e < n; ++e) y2[e] = y[e] + half * v2[e], v3[e] = v[e] + half * a2[e];
        if (const int failure = slide(y2, v3, a3)) return failure;
        for (int e = 0; e < n; ++e) y2[e] = y[e] + h * v3[e], v4[e] = v[e] + h * a3[e];
        if (const int failure = slide(y2, v4, a4)) return failure;
        for (int e = 0; e < n; ++e) {
            y2[e] = y[e] + sixth * (v[e] + 2.0 * (v2[e] + v3[e]) + v4[e]);
            v2[e] = v[e] + sixth * (a1[e] + 2.0 * (a2[e] + a3[e]) + a4[e]);
        }
        least = Lanes() + HUGE_VAL;
        Lanes* speed = a1;   // not needed any more; there are at most as many contacts as joints
        for (int i = 0; i < c; ++i) speed[i] = Lanes();
        for (int e = 0; e < d.touches; ++e) speed[d.touch[e].contact] += d.touch[e].direction * v2[d.touch[e].coordinate];
        for (int i = 0; i < c; ++i) {
            const Lanes own = speed[i] * across<Lanes>(8, i);
            least = own < least ? own : least;
        }
        return NONE;
    }

    int keep(int64_t k, int64_t lane, const Phase& p) {
        const int64_t row = k / x.every * x.lanes + lane;
        bool finite = true;
        for (int e = 0; e < n; ++e) {
            const int64_t at = row * n + e;
            x.kept_q[at] = p.y[e], x.kept_dq[at] = p.v[e], x.kept_ddq[at] = p.a[e], x.kept_friction[at] = p.friction[e];
            finite &= std::fabs(p.v[e]) <= 1.7e308;
        }
        for (int i = 0; i < c; ++i) x.kept_modes[row * c + i] = p.modes[i];
        return finite ? NONE : DIVERGED;
    }

    // `width` runs from `from` on, all periods; lanes beyond are copies of the first. `period`: the one in which it stopped.
    int integrate(int64_t from, int width, int64_t& period) {
        for (int l = 0; l < LANES; ++l) {
            const int64_t lane = from + (l < width ? l : 0);
            copy(n, x.q + lane * n, run(l).y), copy(n, x.dq + lane * n, run(l).v), copy(c, x.modes + lane * c, run(l).modes);
            for (int e = 0; e < 4 * n; ++e) force(l, 0)[e] = 0.0;
        }
        for (int64_t k = 0; k < x.periods; ++k) {
            period = k;
            if (!x.linear || k == 0) command(k, from, width, 0);
            else
                for (int l = 0; l < width; ++l) copy(n, force(l, 1), force(l, 0));
            if (x.linear) command(k + 1 < x.periods ? k + 1 : k, from, width, 1);
            for (int l = 0; k == 0 && x.fresh && l < width; ++l) one.start(run(l), force(l, 0));
            for (int64_t i = 0; i < x.substeps; ++i) {
                if (const int failure = advance(k, i, from, width)) return failure;
                if (k + 1 == x.periods && x.ends) break;
            }
        }
        for (int l = 0; l < width; ++l) {
            const Phase p = run(l);
            copy(n, p.y, x.q + (from + l) * n), copy(n, p.v, x.dq + (from + l) * n), copy(c, p.modes, x.modes + (from + l) * c);
        }
        return NONE;
    }

    // Step i of period k, for all runs.
    int advance(int64_t k, int64_t i, int64_t from, int width) {
        bool alone[LANES], together = false;
        for (int l = 0; l < width; ++l) {
            const double *now = force(l, 0), *next = force(l, 1);
            double *first = force(l, 2), *last = force(l, 3);
            for (int e = 0; e < n; ++e) {
                first[e] = x.linear ? now[e] + (double)i / x.substeps * (next[e] - now[e]) : now[e];
                last[e] = x.linear ? now[e] + (double)(i + 1) / x.substeps * (next[e] - now[e]) : now[e];
            }
            alone[l] = width == 1;
            for (int e = 0; e < c && !alone[l]; ++e) alone[l] = run(l).modes[e] == 0.0;
            together |= !alone[l];
        }
        if (const int failure = together ? slide_first() : NONE) return failure;
        const bool logged = i == 0 && k % x.every == 0;
        for (int e = 0; together && e < n; ++e) {
            first_a[e] = a1[e];
            if (logged) spread(a1[e], 2, e), spread(dry[e], 3, e);
        }
        for (int l = 0; l < width; ++l) {
            if (alone[l]) one.begin(run(l), force(l, 2));
            if (one.failure) return one.failure;
            if (logged && keep(k, from + l, run(l))) return DIVERGED;
        }
        if (k + 1 == x.periods && x.ends) return NONE;
        if (const int failure = together ? slide_on() : NONE) return failure;
        for (int l = 0; l < width; ++l) {
            const Phase p = run(l);
            const double* last = x.linear ? force(l, 3) : force(l, 2);
            const bool event = !alone[l] && least[l] < 0.0;
            if (!alone[l]) {
                double *y_to = event ? one.trial_y : p.y, *v_to = event ? one.trial_v : p.v;
                for (int e = 0; e < n; ++e) y_to[e] = y2[e][l], v_to[e] = v2[e][l];
            }
            for (int e = 0; event && e < n; ++e) p.a[e] = first_a[e][l], p.friction[e] = dry[e][l];
            if (alone[l] || event) one.advance(p, force(l, 2), last, x.h, event, least[l]);
            if (one.failure) return one.failure;
        }
        return NONE;
    }
};

static size_t simulation_memory(const Tree& t, const Drive& d) {
    return workspace(t, nullptr) + sizeof(double) * (One::numbers(t.nv, d.contacts) + Team::numbers(t.nv, d.contacts));
}

// Runs lo ... hi-1. Returns -1, or 4 periods + failure.
static int64_t simulate(const Tree& t, const Drive& d, const Runs& x, int64_t lo, int64_t hi, char* memory) {
    Scratch<Lanes> lanes(t, memory);
    Scratch<double> scratch(t, (char*)lanes.tile);
    scratch.lanes = &lanes;
    Carve rest{(double*)scratch.tile};
    One one(t, d, scratch, rest);
    Team team(t, d, x, lanes, one, rest);
    for (int64_t from = lo, width; from < hi; from += width) {
        width = hi - from >= LANES ? LANES : hi - from > LANES / 4 ? hi - from : 1;   // a few by lanes are faster than one by one
        int64_t period = 0;
        if (const int failure = team.integrate(from, (int)width, period)) return 4 * period + failure;
    }
    return -1;
}
