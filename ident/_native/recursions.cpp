// The Python module ident._native._recursions: recursions over samples that NumPy cannot take in one step.
// Called by ident/effects/compliance.py, which checks shapes and does the same in NumPy where this was not built.
#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <cmath>
#include <cstdint>

namespace {

struct Buffer {
    Py_buffer view{};
    bool held = false;
    ~Buffer() { if (held) PyBuffer_Release(&view); }
    double* take(PyObject* object, int64_t count, int flags) {
        if (PyObject_GetBuffer(object, &view, PyBUF_C_CONTIGUOUS | flags) < 0) return nullptr;
        held = true;
        if (count >= 0 && view.len == 8 * count) return (double*)view.buf;
        PyErr_SetString(PyExc_ValueError, "springs: an array has the wrong size");
        return nullptr;
    }
};

// Springs with play, `lanes` of them, over `samples`: position and velocity from the force at each sample, linear in between and
// cut into `parts` steps. coefficients: a11 a12 a21 a22 b10 b11 b20 b21, each (samples, lanes); half: half the play;
// the first row of position and velocity is where they start. On a flank each step is exact, and so it is in between.
void springs(const double* force, const double* coefficients, const double* half, double h, int parts, int64_t samples, int64_t lanes,
             double* position, double* velocity) {
    const int64_t size = samples * lanes;
    for (int64_t k = 0; k + 1 < samples; ++k) {
        for (int64_t l = 0; l < lanes; ++l) {
            const int64_t at = k * lanes + l;
            const double* c = coefficients + at;
            double x = position[at], v = velocity[at], f0 = force[at];
            const double rise = (force[at + lanes] - f0) / parts, gap = half[l];
            for (int p = 0; p < parts; ++p) {
                const double f1 = f0 + rise;
                if (gap > 0.0 && std::fabs(x) <= gap) {
                    x += v * h + (2.0 * f0 + f1) * (h * h / 6.0);
                    v += 0.5 * (f0 + f1) * h;
                } else {
                    const double flank = std::copysign(gap, x), y = x - flank;
                    x = c[0] * y + c[size] * v + c[4 * size] * f0 + c[5 * size] * f1 + flank;
                    v = c[2 * size] * y + c[3 * size] * v + c[6 * size] * f0 + c[7 * size] * f1;
                }
                f0 = f1;
            }
            position[at + lanes] = x;
            velocity[at + lanes] = v;
        }
    }
}

PyObject* call_springs(PyObject*, PyObject* args) {
    PyObject *force, *coefficients, *half, *position, *velocity;
    double h;
    int parts;
    Py_ssize_t samples, lanes;
    if (!PyArg_ParseTuple(args, "OOOdinnOO", &force, &coefficients, &half, &h, &parts, &samples, &lanes, &position, &velocity)) return nullptr;
    Buffer f, c, g, x, v;
    const int64_t size = samples < 0 || lanes < 0 ? -1 : (int64_t)samples * lanes;
    const double* force_at = f.take(force, size, 0);
    const double* coefficients_at = force_at ? c.take(coefficients, 8 * size, 0) : nullptr;
    const double* half_at = coefficients_at ? g.take(half, lanes, 0) : nullptr;
    double* position_at = half_at ? x.take(position, size, PyBUF_WRITABLE) : nullptr;
    double* velocity_at = position_at ? v.take(velocity, size, PyBUF_WRITABLE) : nullptr;
    if (!velocity_at) return nullptr;
    Py_BEGIN_ALLOW_THREADS
    springs(force_at, coefficients_at, half_at, h, parts < 1 ? 1 : parts, samples, lanes, position_at, velocity_at);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

PyMethodDef methods[] = {{"springs", call_springs, METH_VARARGS, "See recursions.cpp."}, {nullptr, nullptr, 0, nullptr}};
PyModuleDef module = {PyModuleDef_HEAD_INIT, "_recursions", nullptr, -1, methods, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__recursions() { return PyModule_Create(&module); }
