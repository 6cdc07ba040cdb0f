// The Python module ident._native._kernel: buffers in and out, choice of the instruction set, threads over chunks of samples.
// Only the stable interface of CPython 3.11 is used. Arrays come through the buffer protocol, checked for type and size here and
// for content in ident/regressor/native.py; shapes follow from the tree and the number of samples.
#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <memory>
#include <new>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "tree.h"

using namespace ident;

namespace {

const Kernel* active = &kernel_baseline;

std::vector<const Kernel*> supported() {
    std::vector<const Kernel*> found = {&kernel_baseline};
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) found.push_back(&kernel_avx2);
    if (found.size() == 2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl"))
        found.push_back(&kernel_avx512);
#endif
    return found;
}

struct Refused : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// A contiguous buffer of doubles, or of any records, released at the end of the call. None gives a null pointer.
struct Buffer {
    Py_buffer view{};
    bool held = false;
    Buffer() = default;
    Buffer(const Buffer&) = delete;
    ~Buffer() { if (held) PyBuffer_Release(&view); }

    void* take(PyObject* object, int64_t bytes, int flags, const char* what) {
        if (object == Py_None) return nullptr;
        if (PyObject_GetBuffer(object, &view, PyBUF_C_CONTIGUOUS | flags) < 0) {
            PyErr_Clear();
            throw Refused(std::string(what) + ": not a contiguous array");
        }
        held = true;
        if (bytes >= 0 && view.len != bytes) throw Refused(std::string(what) + ": expected " + std::to_string(bytes) + " bytes, given " + std::to_string(view.len));
        return view.buf;
    }
    double* doubles(PyObject* object, int64_t count, int flags, const char* what) {
        void* found = take(object, 8 * count, flags | PyBUF_FORMAT, what);
        if (found && strcmp(view.format, "d") != 0) throw Refused(std::string(what) + ": not an array of float64");
        return (double*)found;
    }
    const double* numbers(PyObject* object, int64_t count, const char* what) { return doubles(object, count, 0, what); }
    double* room(PyObject* object, int64_t count, const char* what) { return doubles(object, count, PyBUF_WRITABLE, what); }
};

struct OwnedTree : Tree {
    std::vector<Body> kept;
};

struct OwnedPlan : Plan {
    std::vector<Row> rows_kept;
    std::vector<Step> steps_kept;
    std::vector<Extra> extras_kept;
    int bodies = 0;
};

template <class T> T* unwrap(PyObject* capsule, const char* name) {
    void* held = PyCapsule_GetPointer(capsule, name);
    if (!held) {
        PyErr_Clear();
        throw Refused(std::string("expected a ") + name);
    }
    return (T*)held;
}
template <class T> void destroy(PyObject* capsule) { delete (T*)PyCapsule_GetPointer(capsule, PyCapsule_GetName(capsule)); }

int64_t integer(PyObject* object) {
    const long long value = PyLong_AsLongLong(object);
    if (value == -1 && PyErr_Occurred()) {
        PyErr_Clear();
        throw Refused("expected an integer");
    }
    return value;
}

void require(bool holds, const char* what) {
    if (!holds) throw Refused(what);
}

// Memory of the calling thread, kept between calls: a single state must not wait for an allocation.
struct Memory {
    std::unique_ptr<char[]> block;
    size_t size = 0;
    char* get(size_t wanted) {
        if (wanted > size) block.reset(new char[wanted]), size = wanted;
        return block.get();
    }
};

// work(thread, lo, hi, memory) over `count` samples cut evenly into multiples of `block` (fewer are not worth a thread), the same way for
// the same number of threads. The GIL is released unless there is next to nothing to do; `long_ones`: a sample is much.
template <class Work>
void over_samples(int64_t count, int64_t threads, size_t memory, Work work, int64_t block = 2048, bool long_ones = false) {
    static thread_local Memory own;
    const int64_t blocks = (count + block - 1) / block;
    if (threads > blocks) threads = blocks;
    if (threads <= 1) {
        char* at = own.get(memory);
        if (count < 32 && !long_ones) return work(0, 0, count, at);
        Py_BEGIN_ALLOW_THREADS
        work(0, 0, count, at);
        Py_END_ALLOW_THREADS
        return;
    }
    std::vector<std::unique_ptr<char[]>> blocks_of_memory;
    for (int64_t i = 0; i < threads; ++i) blocks_of_memory.emplace_back(new char[memory]);
    std::vector<std::thread> team;
    team.reserve((size_t)threads);
    const auto part = [&](int64_t i) {
        const int64_t lo = blocks * i / threads * block, hi = blocks * (i + 1) / threads * block;
        work((int)i, lo, hi < count ? hi : count, blocks_of_memory[(size_t)i].get());
    };
    Py_BEGIN_ALLOW_THREADS
    for (int64_t i = 1; i < threads; ++i) {
        try {
            team.emplace_back(part, i);
        } catch (const std::exception&) {   // no more threads to be had: do it here
            part(i);
        }
    }
    part(0);
    for (std::thread& member : team) member.join();
    Py_END_ALLOW_THREADS
}

// make_tree(bodies: bytes of Body records, nv, nq, gravity (3))
PyObject* make_tree(PyObject* const* a) {
    auto tree = std::make_unique<OwnedTree>();
    Buffer records, gravity;
    const int64_t nv = integer(a[1]), nq = integer(a[2]);
    const int64_t nb = nv == nq ? nv : nv - 5;
    require(nb >= 0, "tree: fewer than no bodies");
    const Body* body = (const Body*)records.take(a[0], nb * (int64_t)sizeof(Body), 0, "bodies");
    tree->kept.assign(body, body + nb);
    tree->nb = (int)nb, tree->nv = (int)nv, tree->nq = (int)nq, tree->bodies = tree->kept.data();
    memcpy(tree->gravity, gravity.numbers(a[3], 3, "gravity"), sizeof tree->gravity);
    for (int i = 0; i < nb; ++i) {
        const Body& b = tree->bodies[i];
        const int d = b.kind == FREE ? 6 : 1;
        require(b.parent >= -1 && b.parent < i && b.kind >= REVOLUTE && b.kind <= FREE && b.row >= 0 && b.row + d <= nv && b.position >= 0 &&
                    b.position + d + (b.kind == FREE) <= nq, "tree: a body is out of range");
        for (int64_t axis : b.axes) require(axis >= 0 && axis < 3, "tree: an axis is out of range");
    }
    return PyCapsule_New(tree.release(), "tree", destroy<OwnedTree>);
}

// make_plan(tree, R, rows: int64 (R, 4) of steps, extras, width, padded; steps: Step records; extras: Extra records;
// columns of extra; dense)
PyObject* make_plan(PyObject* const* a) {
    const OwnedTree* tree = unwrap<OwnedTree>(a[0], "tree");
    auto plan = std::make_unique<OwnedPlan>();
    Buffer rows, steps, extras;
    const int64_t count = integer(a[1]);
    const int64_t* row = (const int64_t*)rows.take(a[2], 32 * count, 0, "rows");
    int64_t total_steps = 0, total_extras = 0, widest = 0;
    for (int64_t r = 0; r < count; ++r) {
        const int64_t* v = row + 4 * r;
        require(count > 0 && v[0] >= 0 && v[0] <= tree->nb && v[1] >= 0 && v[2] >= 1 && v[3] >= v[2] && v[3] % 4 == 0 && v[3] < 100000, "plan: a row is out of range");
        total_steps += v[0], total_extras += v[1], widest = v[3] > widest ? v[3] : widest;
    }
    const Step* step = (const Step*)steps.take(a[3], total_steps * (int64_t)sizeof(Step), 0, "steps");
    const Extra* extra = (const Extra*)extras.take(a[4], total_extras * (int64_t)sizeof(Extra), 0, "extras");
    plan->steps_kept.assign(step, step + total_steps);
    plan->extras_kept.assign(extra, extra + total_extras);
    plan->extras = (int)integer(a[5]);
    plan->dense = integer(a[6]) != 0;
    plan->rows = (int)count, plan->widest = (int)widest, plan->gram = false, plan->split = nullptr, plan->taps = nullptr, plan->bodies = tree->nb;
    step = plan->steps_kept.data(), extra = plan->extras_kept.data();
    for (int64_t r = 0; r < count; ++r, row += 4) {
        plan->rows_kept.push_back({row[0], row[1], row[2], row[3], step, extra});
        for (int64_t e = 0; e < row[0]; ++e, ++step) {
            require(step->body >= 0 && step->body < tree->nb && (step->starts || tree->bodies[step->body].parent >= 0), "plan: a step is out of range");
            for (int64_t c : step->column) require(c >= -1 && c < row[3], "plan: a column is out of range");
        }
        for (int64_t e = 0; e < row[1]; ++e, ++extra)
            require(extra->index >= 0 && extra->index < plan->extras && extra->column >= 0 && extra->column < row[3], "plan: an extra is out of range");
    }
    plan->row = plan->rows_kept.data();
    return PyCapsule_New(plan.release(), "plan", destroy<OwnedPlan>);
}

// compute(task, tree, plan, inertia, added, n, threads, q, dq, ddq, tau, out, mass) -> first sample with a singular matrix, -1 for none,
// -2 for input of forward dynamics that is not finite. What a task does not need is None.
PyObject* compute(PyObject* const* a) {
    const int64_t task = integer(a[0]), n = integer(a[5]), threads = integer(a[6]);
    const Tree& t = *unwrap<OwnedTree>(a[1], "tree");
    require(task >= 0 && task < TASKS && n >= 0, "compute: unknown task");
    const OwnedPlan* plan = a[2] == Py_None ? nullptr : unwrap<OwnedPlan>(a[2], "plan");
    require(!plan || (plan->rows == t.nv && plan->bodies == t.nb && plan->widest <= PARAMETERS * t.nb + 4), "plan: not the plan of the whole tree");
    Buffer held[9];
    Arrays x{};
    x.inertia = held[0].numbers(a[3], PARAMETERS * t.nb, "inertia"), x.added = held[1].numbers(a[4], t.nv * t.nv, "added");
    x.q = held[2].numbers(a[7], n * t.nq, "q"), x.dq = held[3].numbers(a[8], n * t.nv, "dq");
    x.ddq = held[4].numbers(a[9], n * t.nv, "ddq"), x.tau = held[5].numbers(a[10], n * t.nv, "tau");
    x.out = held[6].room(a[11], n * t.nv * (task == REGRESSOR ? PARAMETERS * t.nb : 1), "out");
    x.mass = held[7].room(a[12], n * t.nv * t.nv, "mass");
    const bool rates = task != MASS, motion = task == REGRESSOR || task == INVERSE;
    require(x.q && (x.dq || !rates) && (x.out || !rates) && (x.inertia || task == REGRESSOR) && (plan || task != REGRESSOR) &&
                (x.ddq || task != REGRESSOR) && (!x.ddq || motion) && (x.tau || task != FORWARD) && (x.mass || (task != MASS && task != TERMS)),
            "compute: an array is missing, or one too many");
    if (task == FORWARD) {
        double sum = 0.0;
        for (int64_t e = 0; e < n * t.nq; ++e) sum += x.q[e];
        for (int64_t e = 0; e < n * t.nv; ++e) sum += x.dq[e] + x.tau[e];
        if (!std::isfinite(sum)) return PyLong_FromLong(-2);
    }
    std::vector<int64_t> stops(threads > 1 ? (size_t)threads : 1, -1);
    over_samples(n, threads, active->workspace(t, nullptr), [&](int i, int64_t lo, int64_t hi, char* memory) {
        stops[(size_t)i] = active->task[task](t, plan, x, lo, hi, memory);
    });
    for (int64_t stop : stops)
        if (stop >= 0) return PyLong_FromLongLong(stop);
    return PyLong_FromLong(-1);
}

// A plan with the filter of one call, and its samples. a: taps or None, factor, q, dq, ddq, tau, valid, weight, extra (each None for none).
struct Samples {
    Plan plan;
    Arrays x{};
    int64_t n, count;   // samples, and rows: as many, or with taps as many as have full support
    Buffer taps, q, dq, ddq, tau, valid, weight, extra;

    Samples(const Tree& t, const OwnedPlan& owned, int64_t samples, PyObject* const* a) : plan(owned), n(samples) {
        const int64_t factor = integer(a[1]);
        plan.taps = (const double*)taps.take(a[0], -1, 0, "taps");
        const int64_t tap_count = plan.taps ? taps.view.len / 8 : 0;
        require(owned.bodies == t.nb && n >= 0, "plan: of another tree");
        require(factor >= 1 && factor < 1000000 && tap_count < 10000000 && (plan.taps != nullptr) == (tap_count > 0), "taps: out of range");
        plan.tap_count = (int)tap_count, plan.factor = (int)factor;
        count = !plan.taps ? n : n < tap_count ? 0 : (n - tap_count) / factor + 1;
        x.q = q.numbers(a[2], n * t.nq, "q"), x.dq = dq.numbers(a[3], n * t.nv, "dq"), x.ddq = ddq.numbers(a[4], n * t.nv, "ddq");
        x.tau = tau.numbers(a[5], count * plan.rows, "tau"), x.valid = (const uint8_t*)valid.take(a[6], count * plan.rows, 0, "valid");
        x.weight = weight.numbers(a[7], count * plan.rows, "weight");
        x.extra = extra.numbers(a[8], n * plan.extras * (plan.dense ? plan.rows : 1), "extra");
        require(x.q && x.dq && x.ddq && (x.extra || !plan.extras), "information: an array is missing");
    }
    int64_t block() const { return plan.factor > 8 ? 256 : 2048; }   // rows worth a thread
};

// row_columns(tree, plan, n, threads, taps or None, factor, q, dq, ddq, extra or None, out) -> whether all samples are finite.
// `out`: for each row of n samples (with taps, of as many as have full support) the columns of all rows of the equation, one after the other.
PyObject* row_columns(PyObject* const* a) {
    const Tree& t = *unwrap<OwnedTree>(a[0], "tree");
    PyObject* const given[] = {a[4], a[5], a[6], a[7], a[8], Py_None, Py_None, Py_None, a[9]};
    Samples samples(t, *unwrap<OwnedPlan>(a[1], "plan"), integer(a[2]), given);
    const Plan& plan = samples.plan;
    const int64_t threads = integer(a[3]);
    int64_t across = 0;
    for (int r = 0; r < plan.rows; ++r) across += plan.row[r].width - 1;
    Buffer out;
    samples.x.out = out.room(a[10], samples.count * across, "out");
    require(samples.x.out, "row_columns: an array is missing");
    std::vector<char> finite(threads > 1 ? (size_t)threads : 1, 1);
    const auto work = [&](int i, int64_t lo, int64_t hi, char* at) { finite[(size_t)i] = active->row_columns(t, plan, samples.x, lo, hi, at); };
    over_samples(samples.count, threads, active->workspace(t, &plan), work, samples.block());
    for (char each : finite)
        if (!each) Py_RETURN_FALSE;
    Py_RETURN_TRUE;
}

// information(tree, plan, gram, n, threads, taps or None, factor, q, dq, ddq, tau, valid or None, weight or None, extra or None, out):
// n samples, whose rows number n, or with taps as many as have full support. `out` holds the factors of all rows one after the other,
// each padded x padded, and is added to.
PyObject* accumulate(PyObject* const* a, PyObject* split) {
    const Tree& t = *unwrap<OwnedTree>(a[0], "tree");
    Samples samples(t, *unwrap<OwnedPlan>(a[1], "plan"), integer(a[3]), a + 5);
    Plan& plan = samples.plan;
    const Arrays& x = samples.x;
    const int64_t threads = integer(a[4]);
    Buffer out, splits;
    plan.split = (const int64_t*)splits.take(split, 8 * (int64_t)plan.rows, 0, "split");
    plan.gram = plan.split || integer(a[2]) != 0;
    for (int r = 0; plan.split && r < plan.rows; ++r)
        require(plan.split[r] >= 0 && plan.split[r] < plan.row[r].width, "information: a split is out of range");
    int64_t size = 0;
    for (int r = 0; r < plan.rows; ++r) size += plan.row[r].padded * plan.row[r].padded;
    double* into = out.room(a[14], size, "out");
    require(x.tau && into, "information: an array is missing");

    const size_t memory = active->workspace(t, &plan);
    std::vector<std::vector<double>> others;   // factors of the threads but the first
    for (int64_t i = 1; i < threads; ++i) others.emplace_back((size_t)size, 0.0);
    const auto factors = [&](int i) {
        std::vector<double*> rows;
        double* at = i ? others[(size_t)i - 1].data() : into;
        for (int r = 0; r < plan.rows; ++r) rows.push_back(at), at += plan.row[r].padded * plan.row[r].padded;
        return rows;
    };
    std::vector<std::vector<double*>> places;
    for (int64_t i = 0; i < threads || i == 0; ++i) places.push_back(factors((int)i));
    const auto work = [&](int i, int64_t lo, int64_t hi, char* at) { active->information(t, plan, x, lo, hi, at, places[(size_t)i].data()); };
    over_samples(samples.count, threads, memory, work, samples.block());
    std::unique_ptr<char[]> scratch(places.size() > 1 ? new char[memory] : nullptr);   // not for a single thread: a live sample must not wait
    for (size_t i = 1; i < places.size(); ++i) active->merge(plan, scratch.get(), places[0].data(), places[i].data());
    Py_RETURN_NONE;
}
PyObject* information(PyObject* const* a) { return accumulate(a, Py_None); }
// split_information(… as information, split: int64 (R), columns of each row that are instruments).
PyObject* split_information(PyObject* const* a) { return accumulate(a, a[15]); }

// simulate(tree, lanes, periods, substeps, every, h, linear, ends, fresh, complete, threads, (inertia, offset, direction, level, zero),
// (entries, ratios, touches), (kp, kd, limit), (forward, desired q, desired dq), (q, dq, modes), (q, dq, ddq, friction, modes, torque) to keep):
// -1, or 4 periods + Failure. Records of Entry as bytes, all else float64; what is not used is None.
PyObject* simulate(PyObject* const* a) {
    const Tree& t = *unwrap<OwnedTree>(a[0], "tree");
    const int n = t.nv;
    require(t.nq == n, "simulate: the tree floats");
    Buffer held[23];
    int used = 0;
    const auto item = [](PyObject* tuple, int i) {
        PyObject* found = PyTuple_GetItem(tuple, i);
        if (!found) PyErr_Clear();
        require(found != nullptr, "simulate: expected a longer tuple");
        return found;
    };
    Runs x{};
    x.lanes = integer(a[1]), x.periods = integer(a[2]), x.substeps = integer(a[3]), x.every = integer(a[4]), x.h = PyFloat_AsDouble(a[5]);
    x.linear = integer(a[6]) != 0, x.ends = integer(a[7]) != 0, x.fresh = integer(a[8]) != 0;
    require(x.lanes >= 0 && x.periods >= 0 && x.substeps >= 1 && x.every >= 1 && x.h > 0, "simulate: out of range");
    Drive d{};
    d.complete = integer(a[9]) != 0;
    const auto numbers = [&](PyObject* tuple, int i, int64_t count, const char* what) { return held[used++].numbers(item(tuple, i), count, what); };
    d.inertia = numbers(a[11], 0, PARAMETERS * t.nb, "inertia"), d.offset = numbers(a[11], 1, n, "offset");
    d.level = numbers(a[11], 3, -1, "level");
    require(d.inertia && d.offset && d.level && n, "simulate: an array is missing");
    const int64_t c = held[2].view.len / 8 / n;
    require(c <= n, "simulate: more contacts than coordinates");
    d.contacts = (int)c;
    d.direction = numbers(a[11], 2, c * n, "direction"), d.zero = numbers(a[11], 4, n, "zero");
    require(held[2].view.len == 8 * c * n, "level: not rows of n");
    const auto records = [&](int i, size_t size, int& count) {
        Buffer& buffer = held[used++];
        const void* found = buffer.take(item(a[12], i), -1, 0, "records");
        count = found ? (int)(buffer.view.len / (int64_t)size) : 0;
        return found;
    };
    const auto within = [&](int64_t row, int64_t rows, int64_t column) {
        require(row >= 0 && row < rows && column >= 0 && column < n, "simulate: a record is out of range");
    };
    d.entry = (const Entry*)records(0, sizeof(Entry), d.entries), d.ratio = (const Entry*)records(1, sizeof(Entry), d.ratios);
    d.touch = (const Touch*)records(2, sizeof(Touch), d.touches);
    for (int e = 0; e < d.entries; ++e) within(d.entry[e].row, n, d.entry[e].column);
    for (int e = 0; e < d.ratios; ++e) within(d.ratio[e].row, n, d.ratio[e].column);
    for (int e = 0; e < d.touches; ++e) within(d.touch[e].contact, c, d.touch[e].coordinate);
    d.kp = numbers(a[13], 0, n, "kp"), d.kd = numbers(a[13], 1, n, "kd"), d.limit = numbers(a[13], 2, n, "limit");
    const int64_t given = x.periods * x.lanes * n, logged = (x.periods + x.every - 1) / x.every * x.lanes;
    x.forward = numbers(a[14], 0, given, "forward"), x.desired_q = numbers(a[14], 1, given, "desired q"), x.desired_dq = numbers(a[14], 2, given, "desired dq");
    const auto room = [&](PyObject* tuple, int i, int64_t count, const char* what) { return held[used++].room(item(tuple, i), count, what); };
    x.q = room(a[15], 0, x.lanes * n, "q"), x.dq = room(a[15], 1, x.lanes * n, "dq"), x.modes = room(a[15], 2, x.lanes * c, "modes");
    double** kept[] = {&x.kept_q, &x.kept_dq, &x.kept_ddq, &x.kept_friction};
    for (int i = 0; i < 4; ++i) *kept[i] = room(a[16], i, logged * n, "kept");
    x.kept_modes = room(a[16], 4, logged * c, "kept modes"), x.torque = room(a[16], 5, given, "torque");
    require(d.direction && d.zero && x.forward && x.q && x.dq && x.modes && x.kept_q && x.kept_dq && x.kept_ddq && x.kept_friction && x.kept_modes && x.torque &&
                (d.kp == nullptr) == (d.kd == nullptr) && (!d.kp || (x.desired_q && x.desired_dq)),
            "simulate: an array is missing");
    const int64_t threads = integer(a[10]);
    std::vector<int64_t> stops(threads > 1 ? (size_t)threads : 1, -1);
    const auto work = [&](int i, int64_t lo, int64_t hi, char* memory) { stops[(size_t)i] = active->simulate(t, d, x, lo, hi, memory); };
    over_samples(x.lanes, threads, active->simulation_memory(t, d), work, active->lanes, x.periods * x.substeps >= 4);
    int64_t worst = -1;   // the first to stop; one that does not fit concerns all
    for (int64_t stop : stops)
        if (stop >= 0 && (worst < 0 || stop % 4 == UNFIT || (worst % 4 != UNFIT && stop < worst))) worst = stop;
    return PyLong_FromLongLong(worst);
}

// filter_rows(recursive, polynomial (order + 1,), width, count, x, y): every column of rows of `width` numbers, a multiple of 8, filtered along
// time. Not recursive: x (order + count, width) to y (count, width), y[t] = a[0] x[t] + ...; recursive: x (count, width) to
// y (order + count, width), whose first rows are the results before, y[t] = x[t] - a[1] y[t - 1] - ...
PyObject* filter_rows(PyObject* const* a) {
    const bool recursive = integer(a[0]) != 0;
    const int64_t width = integer(a[2]), count = integer(a[3]);
    Buffer given, from, to;
    const double* polynomial = given.numbers(a[1], -1, "polynomial");
    const int64_t order = polynomial ? given.view.len / 8 - 1 : -1;
    require(order >= 0 && order < 100000 && width >= 0 && width % 8 == 0 && count >= 0 && width < (1LL << 31) && count < (1LL << 40), "filter_rows: out of range");
    const double* x = from.numbers(a[4], (count + (recursive ? 0 : order)) * width, "x");
    double* y = to.room(a[5], (count + (recursive ? order : 0)) * width, "y");
    require(x && y, "filter_rows: an array is missing");
    std::vector<double> padded((size_t)order + 7, 0.0);
    memcpy(padded.data() + 3, polynomial, (size_t)(order + 1) * sizeof(double));
    Py_BEGIN_ALLOW_THREADS
    (recursive ? active->recursion : active->average)(padded.data() + 3, (int)order, x, width, count, y);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

// whiten(predictors (order + 1, order + 7), width, past (order, width), age, count, parts, valid, its stride, its column, out or None, products or
// None, rows): see Whitening in tree.h. `parts`: of (array, its row's length, first column, columns), tuples. Returns the rows since the last gap.
PyObject* whiten(PyObject* const* a) {
    Whitening w{};
    w.width = integer(a[1]);
    const int64_t age = integer(a[3]), count = integer(a[4]);
    Buffer held[Whitening::PARTS + 5];
    w.predictors = held[0].numbers(a[0], -1, "predictors");
    const int64_t size = w.predictors ? held[0].view.len / 8 : 0;
    while ((w.order + 1) * (w.order + 7) < size) ++w.order;
    require(size && (w.order + 1) * (w.order + 7) == size && w.order < 100000 && w.width >= 0 && w.width % 8 == 0 && w.width < (1LL << 24) &&
                count >= 0 && count < (1LL << 40) && age >= 0 && age <= w.order, "whiten: out of range");
    w.past = held[1].room(a[2], w.order * w.width, "past");
    w.parts = (int)PyTuple_Size(a[5]);
    require(w.past && w.parts >= 0 && w.parts <= Whitening::PARTS, "whiten: too many parts, or no past");
    int64_t wide = 0;
    for (int i = 0; i < w.parts; ++i) {
        PyObject* given[4];
        for (int k = 0; k < 4; ++k) {
            given[k] = PyTuple_GetItem(PyTuple_GetItem(a[5], i), k);
            if (!given[k]) PyErr_Clear();
            require(given[k] != nullptr, "whiten: a part is not a tuple of four");
        }
        Part& part = w.part[i];
        const int64_t first = integer(given[2]);
        part.stride = integer(given[1]), part.count = integer(given[3]);
        require(part.stride >= 0 && part.stride < (1LL << 31) && part.count >= 0 && first >= 0 && first + part.count <= part.stride, "whiten: a part is out of range");
        part.from = held[2 + i].numbers(given[0], count * part.stride, "part");
        require(part.from, "whiten: an array is missing");
        part.from += first, wide += part.count;
    }
    require(wide <= w.width, "whiten: the parts are wider than the rows");
    Buffer* rest = held + 2 + Whitening::PARTS;
    w.valid_stride = integer(a[7]);
    const int64_t column = integer(a[8]);
    require(column >= 0 && column < w.valid_stride && w.valid_stride < (1LL << 31), "whiten: valid is out of range");
    w.valid = (const uint8_t*)rest[0].take(a[6], count * w.valid_stride, 0, "valid");
    if (w.valid) w.valid += column;
    w.out = rest[1].room(a[9], count * w.width, "out");
    w.products = rest[2].room(a[10], w.width * w.width, "products");
    w.rows = integer(a[11]);
    require(w.rows >= 0 && w.rows <= w.width && w.rows % 8 == 0, "whiten: rows out of range");
    static thread_local Memory own;
    char* memory = own.get(active->whitening_memory(w));
    int64_t after = 0;
    Py_BEGIN_ALLOW_THREADS
    after = active->whiten(w, count, age, memory);
    Py_END_ALLOW_THREADS
    return PyLong_FromLongLong(after);
}

// lattice(ahead (count), behind (count), count, stretches: int64 (S, 2) within them, shift, reflection) -> (squares, products); see series.h.
PyObject* lattice(PyObject* const* a) {
    Buffer held[3];
    const int64_t count = integer(a[2]), shift = integer(a[4]);
    double *ahead = held[0].room(a[0], count, "ahead"), *behind = held[1].room(a[1], count, "behind"), sums[2];
    const int64_t* stretches = (const int64_t*)held[2].take(a[3], -1, 0, "stretches");
    require(count >= 0 && ahead && behind && stretches && held[2].view.len % 16 == 0 && shift >= 0 && shift < (1LL << 40), "lattice: an array is missing, or out of range");
    const int64_t many = held[2].view.len / 16;
    for (int64_t c = 0; c < many; ++c)
        require(stretches[2 * c] >= 0 && stretches[2 * c] <= stretches[2 * c + 1] && stretches[2 * c + 1] <= count, "lattice: a stretch is out of range");
    const double reflection = PyFloat_AsDouble(a[5]);
    Py_BEGIN_ALLOW_THREADS
    active->lattice(ahead, behind, stretches, many, shift, reflection, sums);
    Py_END_ALLOW_THREADS
    return Py_BuildValue("(dd)", sums[0], sums[1]);
}

// respond(inertia (count, n, n), force (count, n), map (n, n), scale (n), least, count, n, out (count, n), sound: bytes (count)): see Response.
PyObject* respond(PyObject* const* a) {
    const int64_t count = integer(a[5]), n = integer(a[6]);
    require(count >= 0 && n >= 1 && n < 1000, "respond: out of range");
    Buffer held[6];
    Response r{};
    r.inertia = held[0].numbers(a[0], count * n * n, "inertia"), r.force = held[1].numbers(a[1], count * n, "force");
    r.map = held[2].numbers(a[2], n * n, "map"), r.scale = held[3].numbers(a[3], n, "scale");
    r.least = PyFloat_AsDouble(a[4]);
    r.out = held[4].room(a[7], count * n, "out"), r.sound = (uint8_t*)held[5].take(a[8], count, PyBUF_WRITABLE, "sound");
    require(r.inertia && r.force && r.map && r.scale && r.out && r.sound, "respond: an array is missing");
    static thread_local Memory own;
    char* memory = own.get((size_t)(3 * n * n + n) * (size_t)active->lanes * sizeof(double) + 64);
    Py_BEGIN_ALLOW_THREADS
    active->respond((int)n, count, r, memory);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

// drive(tree, inertia, contacts, count, terms, q, dq, ddq or None, tau or None, out) -> as `compute`: torque of a motion (tau None), or acceleration at a
// torque (ddq None), of a robot with the terms of its drives. tau = T rnea(q, dq, ddq) + c + P q + V dq + A ddq + D sign(S dq); `terms`, one after
// the other: T, P, V, A, B = T^-1, B A (n x n each), c (n), S (contacts x n), D (n x contacts).
PyObject* drive(PyObject* const* a) {
    const Tree& t = *unwrap<OwnedTree>(a[0], "tree");
    const int64_t n = t.nv, contacts = integer(a[2]), count = integer(a[3]), square = n * n;
    require(t.nq == n && contacts >= 0 && contacts < 100000 && count >= 0, "drive: out of range");
    Buffer held[7];
    Arrays x{};
    x.inertia = held[0].numbers(a[1], PARAMETERS * t.nb, "inertia");
    const double* terms = held[1].numbers(a[4], 6 * square + n + 2 * contacts * n, "terms");
    x.q = held[2].numbers(a[5], count * n, "q"), x.dq = held[3].numbers(a[6], count * n, "dq");
    x.ddq = held[4].numbers(a[7], count * n, "ddq");
    const double* tau = held[5].numbers(a[8], count * n, "tau");
    x.out = held[6].room(a[9], count * n, "out");
    require(x.inertia && terms && x.q && x.dq && x.out && (x.ddq == nullptr) == (tau != nullptr), "drive: an array is missing, or one too many");
    const double *T = terms, *P = T + square, *V = P + square, *A = V + square, *B = A + square, *c = B + 2 * square, *S = c + n, *D = S + contacts * n;
    double sum = 0.0;
    for (int64_t e = 0; e < count * n; ++e) sum += x.q[e] + x.dq[e] + (tau ? tau[e] : x.ddq[e]);
    if (!std::isfinite(sum)) return PyLong_FromLong(-2);
    // What the drives ask for beside the links, A ddq left out.
    const auto beside = [&](const double* q, const double* dq, double* sign, double* out) {
        for (int64_t k = 0; k < contacts; ++k) {
            double speed = 0.0;
            for (int64_t j = 0; j < n; ++j) speed += S[k * n + j] * dq[j];
            sign[k] = (double)(speed > 0.0) - (double)(speed < 0.0);
        }
        for (int64_t i = 0; i < n; ++i) {
            double own = c[i];
            for (int64_t j = 0; j < n; ++j) own += P[i * n + j] * q[j] + V[i * n + j] * dq[j];
            for (int64_t k = 0; k < contacts; ++k) own += D[i * contacts + k] * sign[k];
            out[i] = own;
        }
    };
    static thread_local std::vector<double> room, forces;
    room.resize((size_t)(2 * n + contacts));
    double *own = room.data(), *turned = own + n, *sign = turned + n;
    if (tau) {
        forces.resize((size_t)(count * n));
        for (int64_t s = 0; s < count; ++s) {
            beside(x.q + s * n, x.dq + s * n, sign, own);
            for (int64_t i = 0; i < n; ++i) {
                double force = 0.0;
                for (int64_t j = 0; j < n; ++j) force += B[i * n + j] * (tau[s * n + j] - own[j]);
                forces[(size_t)(s * n + i)] = force;
            }
        }
        x.tau = forces.data(), x.added = B + square;
    }
    int64_t stop = -1;
    over_samples(count, 1, active->workspace(t, nullptr),
                 [&](int, int64_t lo, int64_t hi, char* memory) { stop = active->task[tau ? FORWARD : INVERSE](t, nullptr, x, lo, hi, memory); });
    for (int64_t s = 0; !tau && s < count; ++s) {
        double* out = x.out + s * n;
        beside(x.q + s * n, x.dq + s * n, sign, own);
        for (int64_t i = 0; i < n; ++i) {
            double total = own[i];
            for (int64_t j = 0; j < n; ++j) total += T[i * n + j] * out[j] + A[i * n + j] * x.ddq[s * n + j];
            turned[i] = total;
        }
        memcpy(out, turned, (size_t)n * sizeof(double));
    }
    return PyLong_FromLongLong(stop);
}

PyObject* instruction_sets(PyObject* const*) {
    std::string names;
    for (const Kernel* kernel : supported()) names += std::string(names.empty() ? "" : " ") + kernel->name;
    return PyUnicode_FromString(names.c_str());
}

PyObject* use(PyObject* const* a) {
    for (const Kernel* kernel : supported())
        if (PyUnicode_CompareWithASCIIString(a[0], kernel->name) == 0) {
            active = kernel;
            return PyLong_FromLong(kernel->lanes);
        }
    throw Refused("this processor does not have that instruction set");
}

// A Python function of `count` arguments around `function`; C++ exceptions become Python's.
template <PyObject* (*function)(PyObject* const*), int count> PyObject* call(PyObject*, PyObject* const* arguments, Py_ssize_t given) {
    if (given != count) return PyErr_Format(PyExc_TypeError, "expected %d arguments, given %zd", count, given);
    try {
        return function(arguments);
    } catch (const Refused& refused) {
        PyErr_SetString(PyExc_ValueError, refused.what());
    } catch (const std::bad_alloc&) {
        PyErr_NoMemory();
    }
    return nullptr;
}

#define METHOD(name, count) {#name, (PyCFunction)(void (*)())call<name, count>, METH_FASTCALL, nullptr}
PyMethodDef methods[] = {METHOD(make_tree, 4),    METHOD(make_plan, 7),        METHOD(compute, 13), METHOD(information, 15), METHOD(split_information, 16),   METHOD(row_columns, 11),
                         METHOD(simulate, 17),    METHOD(filter_rows, 6),      METHOD(whiten, 12),      METHOD(lattice, 6), METHOD(respond, 9),      METHOD(drive, 10),   METHOD(instruction_sets, 0), METHOD(use, 1),
                         {nullptr, nullptr, 0, nullptr}};
PyModuleDef definition = {PyModuleDef_HEAD_INIT, "_kernel", "Compiled rigid-body kernels.", -1, methods, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__kernel() {
    active = supported().back();
    return PyModule_Create(&definition);
}
