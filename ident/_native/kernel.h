// The functions of one instruction set: loops over samples around dynamics.h, rows.h and information.h. The including file defines LANES and
// INSTRUCTIONS (the name of its namespace), and sets the compiler's target.

namespace ident {
namespace INSTRUCTIONS {
#include "lanes.h"

static inline char* aligned(char* memory) { return (char*)(((uintptr_t)memory + 63) & ~(uintptr_t)63); }

#include "dynamics.h"
#include "rows.h"

// Scratch for one group of samples.
template <class V> struct Scratch {
    V *q, *dq, *ddq, *tau;
    Link<V>* links;
    Vec<V>* wrench;
    V *composite, *M, *diagonal, *twists;
    double* lu;
    Lanes* tile;                        // what is left of the memory
    Scratch<Lanes>* lanes = nullptr;    // of a single sample: where the lanes help

    Scratch(const Tree& t, char* memory) {
        char* at = aligned(memory);
        const auto take = [&at](size_t numbers) {
            V* part = (V*)at;
            at += numbers * sizeof(V);
            return part;
        };
        q = take(t.nq), dq = take(t.nv), ddq = take(t.nv), tau = take(t.nv);   // in this order: `terms` takes them as one
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

// Mass matrix (lower triangle of m.M) and bias torque (m.tau) at q, dq. A single sample's come from lanes where they are wide enough to
// be worth it.
template <class V> static inline void terms(const Tree& t, const double* inertia, const V* q, const V* dq, Scratch<V>& m) {
    pose(t, q, m.links);
    motion(t, dq, (V*)nullptr, m.links);
    torques(t, inertia, m.links, m.wrench, m.tau);
    masses(t, inertia, m.links, m.composite, m.M);
}
#if LANES > 2
template <> inline void terms<double>(const Tree& t, const double* inertia, const double* q, const double* dq, Scratch<double>& m) {
    terms_of_one(t, inertia, q, dq, m.lanes->links, m.lanes->wrench, m.lanes->q, m.M, m.tau);
}
#endif

// Inverse dynamics, mass matrix, both (bias and mass matrix), or forward dynamics.
template <class V, bool with_torque, bool with_mass, bool solved> static inline int dynamics(const Tree& t, const Arrays& x, int64_t s, Scratch<V>& m) {
    int stop = -1;
    m.load(t, x, s);
    if (with_torque && with_mass) {
        terms(t, x.inertia, m.q, m.dq, m);
    } else {
        pose(t, m.q, m.links);
        if (with_torque) {
            motion(t, m.dq, x.ddq ? m.ddq : (V*)nullptr, m.links);
            torques(t, x.inertia, m.links, m.wrench, m.tau);
        }
        if (with_mass) masses(t, x.inertia, m.links, m.composite, m.M);
    }
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
    Scratch<double> one(t, (char*)lanes.tile);
    one.lanes = &lanes;
    for (; s < hi; ++s)
        if (Work<double>::run(t, plan, x, s, one) >= 0) return s;
    return -1;
}

#include "information.h"
#include "integrator.h"
#include "series.h"
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
    INSTRUCTIONS::row_columns,
    INSTRUCTIONS::merge,
    INSTRUCTIONS::simulation_memory,
    INSTRUCTIONS::simulate,
    INSTRUCTIONS::average,
    INSTRUCTIONS::recursion,
    INSTRUCTIONS::whitening_memory,
    INSTRUCTIONS::whiten,
    INSTRUCTIONS::lattice,
    INSTRUCTIONS::respond};
}  // namespace ident
