// A contiguous buffer of numbers that Python lends for the length of a call; for the small modules beside the kernel.
#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <cstdint>

struct Buffer {
    Py_buffer view{};
    bool held = false;
    Buffer() = default;
    Buffer(const Buffer&) = delete;
    ~Buffer() { if (held) PyBuffer_Release(&view); }

    // Null, with an exception set, unless it holds as many bytes (any number where `bytes` is negative).
    void* take(PyObject* object, int64_t bytes, int flags) {
        if (PyObject_GetBuffer(object, &view, PyBUF_C_CONTIGUOUS | flags) < 0) return nullptr;
        held = true;
        if (bytes < 0 || view.len == bytes) return view.buf;
        PyErr_SetString(PyExc_ValueError, "an array has the wrong size");
        return nullptr;
    }
};
