// The Python module ident._native._text: lines of delimited numbers into arrays, for plain text only. Whatever is not plain (quotes, a
// wrong number of fields, a field that is no number) is refused as a whole, and a reader that can explain it takes over.
// Called by ident/streaming/text.py.
#include "buffer.h"

#include <charconv>
#include <cmath>
#include <cstring>
#include <vector>

namespace {

// Where the values of a field go: array (-1: nowhere) and column of it.
struct Target { int32_t array, column; };
struct Output { double* values; int64_t width; };

inline bool is_digit(char c) { return c >= '0' && c <= '9'; }

// A number, or nothing (NaN: a missing value), between blanks; the place behind it, or null where it is something else.
inline const char* number(const char* s, const char* end, char delimiter, double& value) {
    const auto blank = [=](const char* p) { return p < end && (*p == ' ' || (*p == '\t' && delimiter != '\t')); };
    while (blank(s)) ++s;
    if (s == end || *s == delimiter || *s == '\n' || *s == '\r') {
        value = NAN;
        return s;
    }
    if (end - s >= 3 && (s[0] == 'n' || s[0] == 'N') && (s[1] == 'a' || s[1] == 'A') && s[2] == s[0]) {
        value = NAN;
        s += 3;
    } else {
        // What the library would also take, such as "inf", is left to the other readers.
        const char* first = s + (*s == '-');
        if (first == end || !(is_digit(*first) || *first == '.')) return nullptr;
        const auto found = std::from_chars(s, end, value);
        if (found.ec != std::errc()) return nullptr;
        s = found.ptr;
    }
    while (blank(s)) ++s;
    return s;
}

// Rows of `text`, or -1 where it is not plain.
int64_t parse(const char* s, const char* end, char delimiter, const Target* targets, int64_t fields, const std::vector<Output>& out, int64_t most) {
    int64_t row = 0;
    while (s < end) {
        if (*s == '\n') { ++s; continue; }
        if (*s == '\r' && s + 1 < end && s[1] == '\n') { s += 2; continue; }
        if (row == most) return -1;
        for (int64_t f = 0; f < fields; ++f) {
            if (targets[f].array < 0) {
                while (s < end && *s != delimiter && *s != '\n' && *s != '\r') if (*s++ == '"') return -1;
            } else {
                double value;
                if (!(s = number(s, end, delimiter, value))) return -1;
                const Output& to = out[targets[f].array];
                to.values[row * to.width + targets[f].column] = value;
            }
            if (f + 1 < fields) {
                if (s == end || *s != delimiter) return -1;
                ++s;
            }
        }
        ++row;
        if (s < end && *s == '\r') ++s;
        if (s == end) break;
        if (*s++ != '\n') return -1;
    }
    return row;
}

// parse(text, delimiter, targets, arrays, widths, room): `targets` (fields, 2) int32; `arrays`: float64, C-contiguous, `room` rows each of
// `widths` numbers; returns the rows read, or -1.
PyObject* call_parse(PyObject*, PyObject* args) {
    PyObject *text, *targets, *arrays, *widths;
    int delimiter;
    Py_ssize_t most;
    if (!PyArg_ParseTuple(args, "OiOO!O!n", &text, &delimiter, &targets, &PyTuple_Type, &arrays, &PyTuple_Type, &widths, &most)) return nullptr;
    const Py_ssize_t count = PyTuple_Size(arrays);
    if (PyTuple_Size(widths) != count || most < 0) {
        PyErr_SetString(PyExc_ValueError, "parse: one width an array");
        return nullptr;
    }
    Buffer source, table;
    const char* first = (const char*)source.take(text, -1, 0);
    const Target* target = first ? (const Target*)table.take(targets, -1, 0) : nullptr;
    if (!target) return nullptr;
    const int64_t fields = table.view.len / (int64_t)sizeof(Target);
    std::vector<Buffer> buffers(count);
    std::vector<Output> out(count);
    for (Py_ssize_t i = 0; i < count; ++i) {
        const Py_ssize_t width = PyLong_AsSsize_t(PyTuple_GetItem(widths, i));
        if (PyErr_Occurred()) return nullptr;
        void* values = buffers[i].take(PyTuple_GetItem(arrays, i), 8 * (int64_t)most * width, PyBUF_WRITABLE);
        if (!values) return nullptr;
        out[i] = {(double*)values, width};
    }
    for (int64_t f = 0; f < fields; ++f)
        if (target[f].array >= count || (target[f].array >= 0 && (target[f].column < 0 || target[f].column >= out[target[f].array].width))) {
            PyErr_SetString(PyExc_ValueError, "parse: a field's target is outside its array");
            return nullptr;
        }
    int64_t rows = -1;
    Py_BEGIN_ALLOW_THREADS
    if (fields > 0) rows = parse(first, first + source.view.len, (char)delimiter, target, fields, out, most);
    Py_END_ALLOW_THREADS
    return PyLong_FromLongLong(rows);
}

// lines(text): how many lines there are, the last one counted whether it ends or not.
PyObject* call_lines(PyObject*, PyObject* text) {
    Buffer source;
    const char* s = (const char*)source.take(text, -1, 0);
    if (!s) return nullptr;
    const char* const end = s + source.view.len;
    int64_t count = 1;
    Py_BEGIN_ALLOW_THREADS
    while ((s = (const char*)memchr(s, '\n', end - s))) ++s, ++count;
    Py_END_ALLOW_THREADS
    return PyLong_FromLongLong(count);
}

PyMethodDef methods[] = {{"parse", call_parse, METH_VARARGS, "See text.cpp."}, {"lines", call_lines, METH_O, "See text.cpp."}, {nullptr, nullptr, 0, nullptr}};
PyModuleDef module = {PyModuleDef_HEAD_INIT, "_text", nullptr, -1, methods, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__text() { return PyModule_Create(&module); }
