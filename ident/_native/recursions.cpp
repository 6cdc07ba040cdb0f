// The Python module ident._native._recursions: recursions over samples that NumPy cannot take in one step.
// Called by ident/effects/flexing.py, which checks shapes and does the same in NumPy where this was not built.
#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

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

// Springs, `lanes` of them, over `samples`: position and velocity from the force at each sample, linear in between.
// coefficients: a11 a12 a21 a22 b10 b11 b20 b21, each (samples, lanes), of the exact step; the first row of position and velocity
// is where they start.
void springs(const double* force, const double* coefficients, int64_t samples, int64_t lanes, double* position, double* velocity) {
    const int64_t size = samples * lanes;
    for (int64_t at = 0; at + lanes < size; ++at) {
        const double* c = coefficients + at;
        const double x = position[at], v = velocity[at], f0 = force[at], f1 = force[at + lanes];
        position[at + lanes] = c[0] * x + c[size] * v + c[4 * size] * f0 + c[5 * size] * f1;
        velocity[at + lanes] = c[2 * size] * x + c[3 * size] * v + c[6 * size] * f0 + c[7 * size] * f1;
    }
}

PyObject* call_springs(PyObject*, PyObject* args) {
    PyObject *force, *coefficients, *position, *velocity;
    Py_ssize_t samples, lanes;
    if (!PyArg_ParseTuple(args, "OOnnOO", &force, &coefficients, &samples, &lanes, &position, &velocity)) return nullptr;
    Buffer f, c, x, v;
    const int64_t size = samples < 0 || lanes < 0 ? -1 : (int64_t)samples * lanes;
    const double* force_at = f.take(force, size, 0);
    const double* coefficients_at = force_at ? c.take(coefficients, 8 * size, 0) : nullptr;
    double* position_at = coefficients_at ? x.take(position, size, PyBUF_WRITABLE) : nullptr;
    double* velocity_at = position_at ? v.take(velocity, size, PyBUF_WRITABLE) : nullptr;
    if (!velocity_at) return nullptr;
    Py_BEGIN_ALLOW_THREADS
    springs(force_at, coefficients_at, samples, lanes, position_at, velocity_at);
    Py_END_ALLOW_THREADS
    Py_RETURN_NONE;
}

PyMethodDef methods[] = {{"springs", call_springs, METH_VARARGS, "See recursions.cpp."}, {nullptr, nullptr, 0, nullptr}};
PyModuleDef module = {PyModuleDef_HEAD_INIT, "_recursions", nullptr, -1, methods, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__recursions() { return PyModule_Create(&module); }
