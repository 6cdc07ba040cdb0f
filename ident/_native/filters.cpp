// The Python module ident._native._filters: recursive filters and differences of many signals at once, sample by sample.
// Operations and their order are those of ident/filters.py without it (SciPy's sosfiltfilt, NumPy), so that results are equal bit by
// bit; hence it is built without contraction of products and sums. Called by ident/filters.py, which checks shapes.
#include "buffer.h"

#include <cstring>
#include <new>
#include <vector>

namespace {

constexpr int MOST_SECTIONS = 5;

// A section b0 b1 b2 a1 a2 in transposed direct form II, and its state for a step of one.
struct Section { double b0, b1, b2, a1, a2, z0, z1; };

template <int W> struct alignas(16) Values {
    double v[W];
};

// `S` sections over `count` samples of W signals: from `x`, a step of `x_step` numbers a sample, to `y`. The state starts settled to `x`.
template <int S, int W> void cascade(const Section* section, const double* x, int64_t x_step, double* y, int64_t y_step, int64_t count) {
    Values<W> z0[S], z1[S];
    for (int s = 0; s < S; ++s)
        for (int i = 0; i < W; ++i) z0[s].v[i] = section[s].z0 * x[i], z1[s].v[i] = section[s].z1 * x[i];
    for (int64_t n = 0; n < count; ++n, x += x_step, y += y_step) {
        Values<W> now;
        for (int i = 0; i < W; ++i) now.v[i] = x[i];
        for (int s = 0; s < S; ++s) {
            const Section& c = section[s];
            for (int i = 0; i < W; ++i) {
                const double in = now.v[i], out = c.b0 * in + z0[s].v[i];
                z0[s].v[i] = c.b1 * in - c.a1 * out + z1[s].v[i];
                z1[s].v[i] = c.b2 * in - c.a2 * out;
                now.v[i] = out;
            }
        }
        for (int i = 0; i < W; ++i) y[i] = now.v[i];
    }
}

typedef void (*Cascade)(const Section*, const double*, int64_t, double*, int64_t, int64_t);
template <int W> Cascade of_width(int sections) {
    constexpr Cascade found[MOST_SECTIONS] = {cascade<1, W>, cascade<2, W>, cascade<3, W>, cascade<4, W>, cascade<5, W>};
    return found[sections - 1];
}
// Recursions wait for their own last value: as many signals side by side as there are, up to eight.
Cascade (*const of_widths[8])(int) = {of_width<1>, of_width<2>, of_width<3>, of_width<4>, of_width<5>, of_width<6>, of_width<7>, of_width<8>};

// Forwards, then backwards, over `count` samples of `width` signals, continued at both ends by `pad` samples turned about the end.
void zero_phase(const Section* section, int sections, const double* x, int64_t count, int64_t width, int64_t pad, double* out) {
    const int64_t total = count + 2 * pad;
    std::vector<double> room(total * width);
    double* y = room.data();
    memcpy(y + pad * width, x, count * width * sizeof(double));
    const double *first = x, *last = x + (count - 1) * width;
    for (int64_t k = 1; k <= pad; ++k)
        for (int64_t i = 0; i < width; ++i) {
            y[(pad - k) * width + i] = 2 * first[i] - first[k * width + i];
            y[(pad + count - 1 + k) * width + i] = 2 * last[i] - last[-k * width + i];
        }
    for (int64_t at = 0; at < width; at += 8) {
        const Cascade run = of_widths[width - at < 8 ? width - at - 1 : 7](sections);
        double* mine = y + at;
        run(section, mine, width, mine, width, total);
        double* end = mine + (total - 1) * width;
        run(section, end, -width, end, -width, total);
    }
    memcpy(out, y + pad * width, count * width * sizeof(double));
}

// First and second central differences over `reach` neighbours on either side, weights w1 and w2.
void differences(const double* q, int64_t count, int64_t width, int reach, const double* w1, const double* w2, double* __restrict first,
                 double* __restrict second) {
    const double* middle = q + reach * width;
    for (int64_t i = 0; i < count * width; ++i) {
        double a = 0.0, b = 0.0;
        for (int k = 1; k <= reach; ++k) {
            const double before = middle[i - k * width], after = middle[i + k * width];
            a += w1[k - 1] * (after - before);
            b += w2[k - 1] * ((after - middle[i]) - (middle[i] - before));
        }
        first[i] = a;
        second[i] = b;
    }
}

// zero_phase(sections, x, count, width, pad, out): sections (s, 7), the numbers of `Section`; x and out (count, width).
PyObject* call_zero_phase(PyObject*, PyObject* args) {
    PyObject *sections, *x, *out;
    Py_ssize_t count, width, pad;
    if (!PyArg_ParseTuple(args, "OOnnnO", &sections, &x, &count, &width, &pad, &out)) return nullptr;
    Buffer s, from, to;
    const auto* section = (const Section*)s.take(sections, -1, 0);
    const auto* values = section ? (const double*)from.take(x, 8 * (int64_t)count * width, 0) : nullptr;
    auto* found = values ? (double*)to.take(out, 8 * (int64_t)count * width, PyBUF_WRITABLE) : nullptr;
    if (!found) return nullptr;
    const int64_t number = s.view.len / (int64_t)sizeof(Section);
    if (number < 1 || number > MOST_SECTIONS || count < 1 || width < 1 || pad < 0 || pad >= count) {
        PyErr_SetString(PyExc_ValueError, "zero_phase: 1 to 5 sections, and fewer padded samples than there are");
        return nullptr;
    }
    bool room = true;
    Py_BEGIN_ALLOW_THREADS
    try {
        zero_phase(section, (int)number, values, count, width, pad, found);
    } catch (const std::bad_alloc&) {
        room = false;
    }
    Py_END_ALLOW_THREADS
    if (!room) return PyErr_NoMemory();
    Py_RETURN_NONE;
}

// differences(q, count, width, w1, w2, first, second): q (count + 2 reach, width), weights (reach,), results (count, width).
PyObject* call_differences(PyObject*, PyObject* args) {
    PyObject *q, *w1, *w2, *first, *second;
    Py_ssize_t count, width;
    if (!PyArg_ParseTuple(args, "OnnOOOO", &q, &count, &width, &w1, &w2, &first, &second)) return nullptr;
    Buffer weights[2], from, to[2];
    const auto* a = (const double*)weights[0].take(w1, -1, 0);
    const int64_t reach = a ? weights[0].view.len / 8 : 0;
    const auto* b = a ? (const double*)weights[1].take(w2, 8 * reach, 0) : nullptr;
    const auto* values = b ? (const double*)from.take(q, 8 * (int64_t)(count + 2 * reach) * width, 0) : nullptr;
    auto* d1 = values ? (double*)to[0].take(first, 8 * (int64_t)count * width, PyBUF_WRITABLE) : nullptr;
    auto* d2 = d1 ? (double*)to[1].take(second, 8 * (int64_t)count * width, PyBUF_WRITABLE) : nullptr;
    if (!d2) return nullptr;
    Py_BEGIN_ALLOW_THREADS
    switch (reach) {   // known to the compiler, the inner loop is unrolled
        case 1: differences(values, count, width, 1, a, b, d1, d2); break;
        case 2: differences(values, count, width, 2, a, b, d1, d2); break;
        case 3: differences(values, count, width, 3, a, b, d1, d2); break;
        case 4: differences(values, count, width, 4, a, b, d1, d2); break;
        default: differences(values, count, width, (int)reach, a, b, d1, d2);
    }
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

PyMethodDef methods[] = {{"zero_phase", call_zero_phase, METH_VARARGS, "See filters.cpp."},
                         {"differences", call_differences, METH_VARARGS, "See filters.cpp."},
                         {nullptr, nullptr, 0, nullptr}};
PyModuleDef module = {PyModuleDef_HEAD_INIT, "_filters", nullptr, -1, methods, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__filters() {
    PyObject* found = PyModule_Create(&module);
    if (found) PyModule_AddIntConstant(found, "MOST_SECTIONS", MOST_SECTIONS);
    return found;
}
