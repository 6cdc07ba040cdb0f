// The functions of one instruction set: loops over samples around dynamics.h and rows.h. The including file defines LANES and
// INSTRUCTIONS (the name of its namespace), and sets the compiler's target.

namespace ident {
namespace INSTRUCTIONS {
#include "lanes.h"
#include "dynamics.h"
#include "rows.h"

static inline char* aligned(char* memory) { return (char*)(((uintptr_t)memory + 63) & ~(uintptr_t)63); }

// Scratch for one group of samples.
template <class V> struct Scratch {
    V *q, *dq, *ddq, *tau;
    Link<V>* links;
    Vec<V>* wrench;
    V *composite, *M, *diagonal, *twists;
    double* lu;
    Lanes* tile;

    Scratch(const Tree& t, char* memory) {
        char* at = aligned(memory);
        const auto take = [&at](size_t numbers) {
            V* part = (V*)at;
            at += numbers * sizeof(V);
            return part;
        };
        q = take(t.nq), dq = take(t.nv), ddq = take(t.nv), tau = take(t.nv);
        links = (Link<V>*)take(t.nb * (sizeof(Link<V>) / sizeof(V)));
        wrench = (Vec<V>*)take(6 * t.nb);
        composite = take(PARAMETERS * t.nb), M = take((size_t)t.nv * t.nv), diagonal = take(2 * t.nv), twists = take(6 * t.nb);
        lu = (double*)take((size_t)t.nv * t.nv + t.nv);
        tile = (Lanes*)aligned(at);
    }

    // count: samples from s on that exist; lanes beyond repeat the first.
    void load(const Tree& t, const Arrays& x, int64_t s, int count = Width<V>::value) {
        for (int j = 0; j < t.nq; ++j) q[j] = gather<V>(x.q, s, t.nq, j, count);
        if (x.dq)
            for (int j = 0; j < t.nv; ++j) dq[j] = gather<V>(x.dq, s, t.nv, j, count);
        if (x.ddq)
            for (int j = 0; j < t.nv; ++j) ddq[j] = gather<V>(x.ddq, s, t.nv, j, count);
    }
};

// Groups of samples in a tile: the widest row takes at most 384 KB, which a second-level cache of 512 KB holds.
static int tile_groups(const Plan& plan) {
    const int groups = 49152 / LANES / (plan.widest > 0 ? plan.widest : 1);
    const int most = 256 / LANES, least = 32 / LANES;
    return groups > most ? most : groups < least ? least : groups;
}

// Columns start on an odd number of registers, so that they do not all fall into the same sets of the cache.
static int tile_stride(const Plan& plan) { return tile_groups(plan) | 1; }

static size_t tile_size(const Plan& plan, int r) { return (size_t)plan.row[r].padded * tile_stride(plan); }

// Rows from `from` on whose tiles fit the cache together; they are filled together, so that the motion is computed once for them.
static int batch_end(const Plan& plan, int from) {
    size_t used = tile_size(plan, from);
    int r = from + 1;
    while (r < plan.rows && (used += tile_size(plan, r)) <= (size_t)98304 / LANES) ++r;
    return r;
}

static size_t workspace(const Tree& t, const Plan* plan) {
    size_t numbers = t.nq + 6 * (size_t)t.nv + 2 * (size_t)t.nv * t.nv;
    numbers += t.nb * (sizeof(Link<Lanes>) / sizeof(Lanes) + 12 + PARAMETERS);
    size_t largest = 0;
    for (int r = 0; plan && r < plan->rows;) {
        size_t tiles = 0;
        for (const int end = batch_end(*plan, r); r < end; ++r) tiles += tile_size(*plan, r);
        largest = tiles > largest ? tiles : largest;
    }
    return (numbers + largest) * sizeof(Lanes) + 192;
}

template <class V> struct Regressor {
    static int run(const Tree& t, const Plan* plan, const Arrays& x, int64_t s, Scratch<V>& m) {
        m.load(t, x, s);
        pose(t, m.q, m.links);
        motion(t, m.dq, m.ddq, m.links);
        V* tile = m.composite;
        for (int r = 0; r < plan->rows; ++r) {
            fill(t, plan->row[r], m.links, V() + 1.0, m.twists, tile, 1);
            for (int e = 0; e < plan->row[r].steps; ++e) {
                const int64_t at = PARAMETERS * plan->row[r].step[e].body;
                for (int l = 0; l < Width<V>::value; ++l) {
                    double* out = x.out + ((s + l) * t.nv + r) * PARAMETERS * t.nb + at;
                    for (int c = 0; c < PARAMETERS; ++c) out[c] = lane(tile[at + c], l);
                }
            }
        }
        return -1;
    }
};

// Inverse dynamics, mass matrix, both (bias and mass matrix), or forward dynamics.
template <class V, bool with_torque, bool with_mass, bool solved> static inline int dynamics(const Tree& t, const Arrays& x, int64_t s, Scratch<V>& m) {
    int stop = -1;
    m.load(t, x, s);
    pose(t, m.q, m.links);
    if (with_torque) {
        motion(t, m.dq, x.ddq ? m.ddq : (V*)nullptr, m.links);
        torques(t, x.inertia, m.links, m.wrench, m.tau);
    }
    if (with_mass) masses(t, x.inertia, m.links, m.composite, m.M);
    for (int r = 0; solved && r < t.nv; ++r) {
        m.tau[r] = gather<V>(x.tau, s, t.nv, r) - m.tau[r];
        for (int c = 0; x.added && c <= r; ++c) m.M[r * t.nv + c] += x.added[r * t.nv + c];
    }
    if (solved) stop = solve(t.nv, m.M, m.tau, m.diagonal, m.lu);
    const int64_t all = (int64_t)t.nv * t.nv;
    for (int r = 0; r < t.nv; ++r) {
        if (with_torque) scatter(m.tau[r], x.out, s, t.nv, r);
        for (int c = 0; with_mass && !solved && c <= r; ++c) {
            scatter(m.M[r * t.nv + c], x.mass, s, all, r * t.nv + c);
            scatter(m.M[r * t.nv + c], x.mass, s, all, c * t.nv + r);
        }
    }
    return stop;
}
template <class V> struct Inverse {
    static int run(const Tree& t, const Plan*, const Arrays& x, int64_t s, Scratch<V>& m) { return dynamics<V, true, false, false>(t, x, s, m); }
};
template <class V> struct Mass {
    static int run(const Tree& t, const Plan*, const Arrays& x, int64_t s, Scratch<V>& m) { return dynamics<V, false, true, false>(t, x, s, m); }
};
template <class V> struct Terms {
    static int run(const Tree& t, const Plan*, const Arrays& x, int64_t s, Scratch<V>& m) { return dynamics<V, true, true, false>(t, x, s, m); }
};
template <class V> struct Forward {
    static int run(const Tree& t, const Plan*, const Arrays& x, int64_t s, Scratch<V>& m) { return dynamics<V, true, true, true>(t, x, s, m); }
};

// Full groups by lanes, the samples left over one by one. `run` returns a lane to stop at, or -1.
template <template <class> class Work>
static int64_t by_groups(const Tree& t, const Plan* plan, const Arrays& x, int64_t lo, int64_t hi, char* memory) {
    int64_t s = lo;
    Scratch<Lanes> lanes(t, memory);
    for (; s + LANES <= hi; s += LANES) {
        const int stop = Work<Lanes>::run(t, plan, x, s, lanes);
        if (stop >= 0) return s + stop;
    }
    Scratch<double> one(t, memory);
    for (; s < hi; ++s)
        if (Work<double>::run(t, plan, x, s, one) >= 0) return s;
    return -1;
}

// Weights of a group of samples in one row; zero where the row is not used, and beyond the last sample.
static inline Lanes row_weight(const Plan& plan, const Arrays& x, int64_t s, int count, int r) {
    Lanes weight = Lanes() + 1.0;
    if (count == LANES && !x.valid && !x.weight) return weight;
    for (int i = 0; i < LANES; ++i) {
        const int64_t at = (s + i) * plan.rows + r;
        weight[i] = i < count && (!x.valid || x.valid[at]) ? (x.weight ? x.weight[at] : 1.0) : 0.0;
    }
    return weight;
}

// Torque and extra columns of a row. What is not used may hold anything, NaN too: it becomes zero.
static inline void fill_rest(const Plan& plan, const Row& row, const Arrays& x, int64_t s, int count, int r, Lanes weight, Lanes* tile, int stride) {
    const auto used = weight != 0.0;
    const Lanes zero = {};
    const Lanes torque = gather<Lanes>(x.tau, s, plan.rows, r, count) * weight;
    tile[(row.width - 1) * stride] = used ? torque : zero;
    for (int e = 0; e < row.extras; ++e) {
        const Extra& extra = row.extra[e];
        const Lanes value = plan.dense ? gather<Lanes>(x.extra, s, plan.rows * plan.extras, r * plan.extras + extra.index, count)
                                       : gather<Lanes>(x.extra, s, plan.extras, extra.index, count) * extra.factor;
        const Lanes weighted = value * weight;
        tile[extra.column * stride] = used ? weighted : zero;
    }
}

// The next samples of a call's arrays, all finite? They also come into the cache in one go. (Torques are only looked at where used.)
static bool samples_finite(const Tree& t, const Plan& plan, const Arrays& x, int64_t s, int64_t count) {
    const int64_t beside = plan.extras * (plan.dense ? plan.rows : 1);
    return all_finite(x.q + s * t.nq, count * t.nq) & all_finite(x.dq + s * t.nv, count * t.nv) & all_finite(x.ddq + s * t.nv, count * t.nv) &
           (beside == 0 || all_finite(x.extra + s * beside, count * beside));
}

// Stops with NaN in the first factor where a sample is not finite.
static void information(const Tree& t, const Plan& plan, const Arrays& x, int64_t lo, int64_t hi, char* memory, double* const* factors) {
    Scratch<Lanes> m(t, memory);
    const int groups = tile_groups(plan), stride = tile_stride(plan);
    for (int64_t first = lo; first < hi; first += (int64_t)groups * LANES) {
        const int64_t rest = (hi - first + LANES - 1) / LANES;
        const int used = rest < groups ? (int)rest : groups;
        const int64_t last = first + (int64_t)used * LANES;
        if (!samples_finite(t, plan, x, first, (last < hi ? last : hi) - first)) {
            factors[0][0] = NAN;
            return;
        }
        for (int from = 0, end; from < plan.rows; from = end) {
            end = batch_end(plan, from);
            for (int g = 0; g < used; ++g) {
                const int64_t s = first + (int64_t)g * LANES;
                const int count = hi - s < LANES ? (int)(hi - s) : LANES;
                m.load(t, x, s, count);
                pose(t, m.q, m.links);
                motion(t, m.dq, m.ddq, m.links);
                Lanes* tile = m.tile + g;
                for (int r = from; r < end; ++r) {
                    const Row& row = plan.row[r];
                    const Lanes weight = row_weight(plan, x, s, count, r);
                    fill(t, row, m.links, weight, m.twists, tile, stride);
                    fill_rest(plan, row, x, s, count, r, weight, tile, stride);
                    for (int64_t c = row.width; c < row.padded; ++c) tile[c * stride] = Lanes();
                    tile += tile_size(plan, r);
                }
            }
            Lanes* tile = m.tile;
            for (int r = from; r < end; ++r) {
                (plan.gram ? add_gram : add_triangle)(tile, stride, used, (int)plan.row[r].width, (int)plan.row[r].padded, factors[r]);
                tile += tile_size(plan, r);
            }
        }
    }
}

// Add the factors of other samples to `into`: the rows of a triangle are samples like any others.
static void merge(const Plan& plan, char* memory, double* const* into, const double* const* from) {
    Lanes* tile = (Lanes*)aligned(memory);
    const int groups = tile_groups(plan), stride = tile_stride(plan);
    for (int r = 0; r < plan.rows; ++r) {
        const int n = (int)plan.row[r].padded;
        if (plan.gram) {
            for (int e = 0; e < n * n; ++e) into[r][e] += from[r][e];
            continue;
        }
        for (int first = 0; first < n; first += groups * LANES) {
            const int count = n - first < groups * LANES ? n - first : groups * LANES;
            const int used = (count + LANES - 1) / LANES;
            for (int c = 0; c < n; ++c)
                for (int i = 0; i < used * LANES; ++i)
                    tile[c * stride + i / LANES][i % LANES] = i < count && first + i <= c ? from[r][(first + i) * n + c] : 0.0;
            add_triangle(tile, stride, used, n, n, into[r]);
        }
    }
}
}  // namespace INSTRUCTIONS

#define TABLE_NAME(name) kernel_##name
#define TABLE(name) TABLE_NAME(name)
#define TEXT_OF(name) #name
#define TEXT(name) TEXT_OF(name)
extern const Kernel TABLE(INSTRUCTIONS) = {
    TEXT(INSTRUCTIONS),
    LANES,
    INSTRUCTIONS::workspace,
    {INSTRUCTIONS::by_groups<INSTRUCTIONS::Regressor>, INSTRUCTIONS::by_groups<INSTRUCTIONS::Inverse>, INSTRUCTIONS::by_groups<INSTRUCTIONS::Mass>,
     INSTRUCTIONS::by_groups<INSTRUCTIONS::Terms>, INSTRUCTIONS::by_groups<INSTRUCTIONS::Forward>},
    INSTRUCTIONS::information,
    INSTRUCTIONS::merge};
}  // namespace ident
