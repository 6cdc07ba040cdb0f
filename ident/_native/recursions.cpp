// The Python module ident._native._recursions: recursions over samples that NumPy cannot take in one step.
// Called by ident/effects/flexing.py and ident/drives/simulate.py, which check shapes and do the same in NumPy where this was not built.
#define Py_LIMITED_API 0x030B0000
#define PY_SSIZE_T_CLEAN
#include <Python.h>

#include <cmath>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

namespace {

struct Buffer {
    Py_buffer view{};
    bool held = false;
    ~Buffer() { if (held) PyBuffer_Release(&view); }
    double* take(PyObject* object, int64_t count, int flags) {
        if (PyObject_GetBuffer(object, &view, PyBUF_C_CONTIGUOUS | flags) < 0) return nullptr;
        held = true;
        if (count >= 0 && view.len == 8 * count) return (double*)view.buf;
        PyErr_SetString(PyExc_ValueError, "an array has the wrong size");
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

// One step of many joints' drives, as `simulated` of ident/drives/simulate.py has it: implicit midpoint rule, dry friction by projected
// Gauss-Seidel. `lanes` sets of `n` joints, in blocks of `block` joints that act on each other. All arrays (lanes, n), row by row.
struct DriveStep {
    int64_t lanes, n, block, sweeps;
    double h;
    const double *inertia, *bias;                          // (lanes, n, n), (lanes, n)
    const double *armature, *viscous, *dry, *load_share, *excess, *fall, *offset, *kp, *kd, *limit, *back_emf;
    const double *spring, *loss, *loss_square, *loss_slow, *slow;  // dry friction grows with the drive's own torque
    const double *target, *strength;                       // strength: null where it is 1
    double *q, *dq, *before, *friction, *load;             // state
    double *ahead_q, *ahead_dq, *out;
    const double *ki, *wanted;                             // of drives that integrate their error: gain, position command
    double* wound;                                         // their integral's part of the command; null where none integrates
    const double* droop;                                   // by which the limit falls with speed along the motion; null where it does not
    const double* band;                                    // errors of position below it are none; null where there is none, else with `wanted`

    // What is not finite stays so, and its lane is lost.
    static double within(double x, double level) { return x > level ? level : x < -level ? -level : x; }

    // Gauss-Jordan with pivots; a singular matrix gives what is not finite, and its lane is lost.
    template <int M>
    static void invert(int64_t several, double* __restrict A, double* __restrict X) {
        const int64_t m = M ? M : several;
        for (int64_t i = 0; i < m; ++i)
            for (int64_t j = 0; j < m; ++j) X[i * m + j] = i == j ? 1.0 : 0.0;
        for (int64_t k = 0; k < m; ++k) {
            int64_t best = k;
            for (int64_t i = k + 1; i < m; ++i)
                if (std::fabs(A[i * m + k]) > std::fabs(A[best * m + k])) best = i;
            for (int64_t j = 0; best != k && j < m; ++j) {
                std::swap(A[k * m + j], A[best * m + j]);
                std::swap(X[k * m + j], X[best * m + j]);
            }
            const double pivot = 1.0 / A[k * m + k];
            for (int64_t j = 0; j < m; ++j) A[k * m + j] *= pivot, X[k * m + j] *= pivot;
            for (int64_t i = 0; i < m; ++i) {
                const double share = A[i * m + k];
                if (i == k || share == 0.0) continue;
                for (int64_t j = k + 1; j < m; ++j) A[i * m + j] -= share * A[k * m + j];
                for (int64_t j = 0; j < m; ++j) X[i * m + j] -= share * X[k * m + j];
            }
        }
    }

    template <int M>
    void advance(int64_t lane, int64_t first, std::vector<double>& memory) const {
        const int64_t m = M ? M : block, at = lane * n + first;
        double *A = memory.data(), *R = A + m * m, *pulled = R + m * m, *level = pulled + m, *speed = level + m;
        const double* H = inertia + lane * n * n + first * n + first;
        const double half = 0.5 * h;
        for (int64_t i = 0; i < m; ++i) {
            const int64_t e = at + i;
            double p = kp[e], d = kd[e], whole = target[e];
            if (wound) p += half * ki[e], whole += wound[e] + half * ki[e] * wanted[e];
            double pull = whole - p * q[e];
            if (band) {
                // Decided by where the middle of the step will be: what is asked has no jump at the edge.
                const double error = wanted[e] - q[e] - half * dq[e];
                const bool inside = std::fabs(error) < band[e];
                pull -= p * (inside ? wanted[e] - q[e] : error > 0 ? band[e] : -band[e]);
                if (inside) p = 0.0;
            }
            const double asked = pull - (p * half + d) * dq[e];
            if (droop && droop[e] != 0.0) {
                const double along = dq[e] > 0 ? 1.0 : -1.0;
                if (along * asked > limit[e] - droop[e] * std::fabs(dq[e])) pull = along * limit[e], p = 0.0, d = droop[e];
                else if (along * asked < -limit[e]) pull = -along * limit[e], p = d = 0.0;
            } else if (std::fabs(asked) > limit[e]) pull = asked > 0 ? limit[e] : -limit[e], p = d = 0.0;
            double damping = p * half + d;
            if (strength) {
                damping = strength[e] * damping + (strength[e] > 0 ? back_emf[e] : 0.0) + viscous[e];
                pull *= strength[e];
            } else damping += back_emf[e] + viscous[e];
            const double motor = std::fabs(pull - (damping - viscous[e]) * dq[e]);
            pull -= spring[e] * q[e], damping += half * spring[e];
            double momentum = armature[e] * dq[e];
            for (int64_t j = 0; j < m; ++j) A[i * m + j] = H[i * n + j], momentum += H[i * n + j] * dq[at + j];
            A[i * m + i] += armature[e] + half * damping;
            pulled[i] = momentum + half * (pull - offset[e] - bias[e]);
            const double low = excess[e] != 0.0 ? excess[e] * std::exp(-(dq[e] / fall[e]) * (dq[e] / fall[e])) : 0.0;
            double share = loss[e] + loss_square[e] * motor;
            if (loss_slow[e] != 0.0) share += loss_slow[e] * std::exp(-(dq[e] / slow[e]) * (dq[e] / slow[e]));
            level[i] = dry[e] + load_share[e] * std::fabs(load[e]) + low + share * motor;
        }
        invert<M>(m, A, R);
        double* f = friction + at;
        for (int64_t i = 0; i < m; ++i) {
            speed[i] = -dq[at + i];
            for (int64_t j = 0; j < m; ++j) speed[i] += 2.0 * R[i * m + j] * pulled[j];
        }
        if (n == 1) {
            f[0] = within(speed[0] / (h * R[0]), level[0]);
            speed[0] -= h * R[0] * f[0];
        } else rub<M>(m, R, level, f, speed);
        for (int64_t i = 0; i < m; ++i) {
            double sum = bias[at + i];
            for (int64_t j = 0; j < m; ++j) sum += H[i * n + j] * (speed[j] - dq[at + j]) / h;
            load[at + i] = sum;
        }
        for (int64_t i = 0; i < m; ++i) {
            const int64_t e = at + i;
            if (wound) wind(e, speed[i]);
            q[e] += half * (dq[e] + speed[i]);
            before[e] = dq[e];
            dq[e] = speed[i];
        }
    }

    // The integral over a step to the speed `after`, but for the share of it in which the limit holds and the error would wind it further; a
    // drive that is off keeps nothing.
    void wind(int64_t e, double after) const {
        const double moved = 0.5 * h * (dq[e] + after), error = wanted[e] - q[e];
        double change = h * ki[e] * (error - 0.5 * moved);
        double asked = target[e] + wound[e] - kp[e] * q[e] - kd[e] * dq[e], then = asked - kp[e] * moved - kd[e] * (after - dq[e]);
        if (band) {
            const double width = std::fabs(band[e]);
            change -= h * ki[e] * within(error - 0.5 * moved, width);
            asked -= kp[e] * within(error, width), then -= kp[e] * within(error - moved, width);
        }
        const double side = change > 0 ? 1.0 : -1.0;
        double first = side * asked - limit[e], last = side * then - limit[e];
        if (droop) {
            if (side * dq[e] > 0.0) first += droop[e] * side * dq[e];
            if (side * after > 0.0) last += droop[e] * side * after;
        }
        const double high = first > last ? first : last, low = first > last ? last : first;
        const double held = !(high > 0.0) ? 0.0 : low >= 0.0 ? 1.0 : high / (high - low);
        wound[e] += (1.0 - held) * change;
        if (strength && !(strength[e] > 0.0)) wound[e] = 0.0;
    }

    template <int M>
    void rub(int64_t several, const double* __restrict R, const double* __restrict level, double* __restrict f,
             double* __restrict speed) const {
        const int64_t m = M ? M : several;
        for (int64_t i = 0; i < m; ++i) f[i] = within(f[i], level[i]);
        for (int64_t i = 0; i < m; ++i)
            for (int64_t j = 0; j < m; ++j) speed[i] -= h * R[i * m + j] * f[j];
        for (int64_t sweep = 0; sweep < sweeps; ++sweep)
            for (int64_t k = 0; k < m; ++k) {
                const double next = within(f[k] + speed[k] / (h * R[k * m + k]), level[k]), change = h * (next - f[k]);
                for (int64_t i = 0; i < m; ++i) speed[i] -= R[i * m + k] * change;
                f[k] = next;
            }
        for (int64_t i = 0; i < m; ++i)
            if (std::fabs(f[i]) < level[i]) speed[i] = 0.0;
    }

    // M joints in a block, 0: any number. Loops whose length is known when this is compiled take a quarter less time.
    void run(double beyond, std::vector<double>& memory) const {
        switch (block) {
            case 1: return run_blocks<1>(beyond, memory);
            case 2: return run_blocks<2>(beyond, memory);
            case 3: return run_blocks<3>(beyond, memory);
            case 4: return run_blocks<4>(beyond, memory);
            case 5: return run_blocks<5>(beyond, memory);
            case 6: return run_blocks<6>(beyond, memory);
            case 7: return run_blocks<7>(beyond, memory);
            case 8: return run_blocks<8>(beyond, memory);
            default: return run_blocks<0>(beyond, memory);
        }
    }

    template <int M>
    void run_blocks(double beyond, std::vector<double>& memory) const {
        for (int64_t lane = 0; lane < lanes; ++lane) {
            for (int64_t first = 0; first < n; first += block) advance<M>(lane, first, memory);
            bool lost = false;
            for (int64_t e = lane * n; e < (lane + 1) * n; ++e) lost |= !(std::fabs(dq[e]) < beyond);
            for (int64_t e = lane * n; e < (lane + 1) * n; ++e) {
                if (lost) q[e] = dq[e] = before[e] = friction[e] = load[e] = 0.0;
                if (lost && wound) wound[e] = 0.0;
                out[e] = lost ? NAN : q[e];
                ahead_q[e] = q[e] + 0.5 * h * dq[e];
                ahead_dq[e] = 1.5 * dq[e] - 0.5 * before[e];
            }
        }
    }
};

// Where the constants (16, lanes, n) stand, in their order.
void place(DriveStep& d, const double* c, int64_t size) {
    const double** const parts[] = {&d.armature, &d.viscous, &d.dry,      &d.load_share, &d.excess, &d.fall,        &d.offset,    &d.kp,
                                    &d.kd,       &d.limit,   &d.back_emf, &d.spring,     &d.loss,   &d.loss_square, &d.loss_slow, &d.slow};
    for (const double** part : parts) *part = c, c += size;
}

// drive_single(H (lanes, n, n), sine, cosine, stiffness, twist (lanes), constants (16, lanes, n), target (K, lanes, n), strength or None,
//              state (5, lanes, n), out (K, lanes, n), lanes, n, K, h, beyond[, ki (lanes, n), wanted (K, lanes, n), wound (lanes, n)
//              or None each[, droop (lanes, n) or None[, band (lanes, n)]]]):
//              one joint from beginning to end, its link's bias torque sine sin q + cosine cos q. n is 1, or 2 where motor and link hang
//              together by a spring of that stiffness and damping. The last: of drives that integrate their error, of
//              limits that fall, and of drives to which small errors are none (with ki 0 where they do not integrate).
PyObject* call_drive_single(PyObject*, PyObject* args) {
    PyObject* given[15] = {};
    Py_ssize_t lanes, n, count;
    double h, beyond;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOOnnndd|OOOOO", given, given + 1, given + 2, given + 3, given + 4, given + 5, given + 6, given + 7,
                          given + 8, given + 9, &lanes, &n, &count, &h, &beyond, given + 10, given + 11, given + 12,
                          given + 13, given + 14))
        return nullptr;
    if (lanes < 0 || count < 0 || n < 1 || n > 2) {
        PyErr_SetString(PyExc_ValueError, "drive_single: sizes are none of one joint");
        return nullptr;
    }
    Buffer buffers[15];
    const int64_t size = (int64_t)lanes * n;
    DriveStep d{};
    d.lanes = lanes, d.n = d.block = n, d.sweeps = 2, d.h = h;
    const double *c, *of_link[4], *wanted, *share = nullptr, *sent = nullptr;
    double *s, *to;
    bool good = (d.inertia = buffers[0].take(given[0], size * n, 0)) != nullptr;
    for (int i = 0; good && i < 4; ++i) good = (of_link[i] = buffers[1 + i].take(given[1 + i], lanes, 0)) != nullptr;
    if (!good || !(c = buffers[5].take(given[5], 16 * size, 0)) || !(wanted = buffers[6].take(given[6], count * size, 0)) ||
        (given[7] != Py_None && !(share = buffers[7].take(given[7], count * size, 0))) ||
        !(s = buffers[8].take(given[8], 5 * size, PyBUF_WRITABLE)) || !(to = buffers[9].take(given[9], count * size, PyBUF_WRITABLE)) ||
        (given[13] && given[13] != Py_None && !(d.droop = buffers[13].take(given[13], size, 0))) ||
        (given[12] && given[12] != Py_None && (!(d.ki = buffers[10].take(given[10], size, 0)) || !(sent = buffers[11].take(given[11], count * size, 0)) ||
                                  !(d.wound = buffers[12].take(given[12], size, PyBUF_WRITABLE)))) ||
        (given[14] && d.wound && !(d.band = buffers[14].take(given[14], size, 0))))
        return nullptr;
    place(d, c, size);
    d.q = s, d.dq = s + size, d.before = s + 2 * size, d.friction = s + 3 * size, d.load = s + 4 * size;
    std::vector<double> memory((size_t)(2 * n * n + 3 * n)), ahead((size_t)(3 * size));
    double* bias = ahead.data() + 2 * size;
    d.ahead_q = ahead.data(), d.ahead_dq = d.ahead_q + size, d.bias = bias;
    for (int64_t i = 0; i < size; ++i) d.ahead_q[i] = d.q[i] + 0.5 * h * d.dq[i], d.ahead_dq[i] = d.dq[i];
    for (Py_ssize_t k = 0; k < count; ++k) {
        for (int64_t i = 0; i < lanes; ++i) {
            const double *q = d.ahead_q + i * n, *dq = d.ahead_dq + i * n, link = q[n - 1];
            bias[i * n + n - 1] = of_link[0][i] * std::sin(link) + of_link[1][i] * std::cos(link);
            if (n == 1) continue;
            const double spring = of_link[2][i] * (q[0] - q[1]) + of_link[3][i] * (dq[0] - dq[1]);
            bias[i * n] = spring, bias[i * n + 1] -= spring;
        }
        d.target = wanted + k * size, d.strength = share ? share + k * size : nullptr, d.out = to + k * size;
        d.wanted = sent ? sent + k * size : nullptr;
        d.run(beyond, memory);
    }
    Py_RETURN_NONE;
}

// drive_step(H, bias, constants (16, lanes, n), target, strength or None, state (5, lanes, n), ahead (2, lanes, n), out,
//            lanes, n, block, sweeps, h, beyond[, ki, wanted, wound or None each[, droop or None[, band]]])
PyObject* call_drive_step(PyObject*, PyObject* args) {
    PyObject *inertia, *bias, *constants, *target, *strength, *state, *ahead, *out, *ki = nullptr, *wanted = nullptr, *wound = nullptr, *droop = nullptr;
    PyObject* band = nullptr;
    Py_ssize_t lanes, n, block, sweeps;
    double h, beyond;
    if (!PyArg_ParseTuple(args, "OOOOOOOOnnnndd|OOOOO", &inertia, &bias, &constants, &target, &strength, &state, &ahead, &out, &lanes, &n,
                          &block, &sweeps, &h, &beyond, &ki, &wanted, &wound, &droop, &band))
        return nullptr;
    if (lanes < 0 || n < 1 || block < 1 || n % block != 0) {
        PyErr_SetString(PyExc_ValueError, "drive_step: joints are not in blocks of one size");
        return nullptr;
    }
    Buffer buffers[13];
    const int64_t size = (int64_t)lanes * n;
    DriveStep d{};
    d.lanes = lanes, d.n = n, d.block = block, d.sweeps = sweeps, d.h = h;
    const double* c;
    double *s, *next;
    if (!(d.inertia = buffers[0].take(inertia, size * n, 0)) || !(d.bias = buffers[1].take(bias, size, 0)) ||
        !(c = buffers[2].take(constants, 16 * size, 0)) || !(d.target = buffers[3].take(target, size, 0)) ||
        (strength != Py_None && !(d.strength = buffers[4].take(strength, size, 0))) ||
        !(s = buffers[5].take(state, 5 * size, PyBUF_WRITABLE)) || !(next = buffers[6].take(ahead, 2 * size, PyBUF_WRITABLE)) ||
        !(d.out = buffers[7].take(out, size, PyBUF_WRITABLE)) ||
        (droop && droop != Py_None && !(d.droop = buffers[11].take(droop, size, 0))) ||
        (wound && wound != Py_None && (!(d.ki = buffers[8].take(ki, size, 0)) || !(d.wanted = buffers[9].take(wanted, size, 0)) ||
                              !(d.wound = buffers[10].take(wound, size, PyBUF_WRITABLE)))) ||
        (band && d.wound && !(d.band = buffers[12].take(band, size, 0))))
        return nullptr;
    place(d, c, size);
    double** const moved[] = {&d.q, &d.dq, &d.before, &d.friction, &d.load};
    for (double** part : moved) *part = s, s += size;
    d.ahead_q = next, d.ahead_dq = next + size;
    std::vector<double> memory((size_t)(2 * block * block + 3 * block));
    d.run(beyond, memory);
    Py_RETURN_NONE;
}

// Joints behind springs (m), each one of n; null with an error set where they are not.
const int64_t* elastic_joints(Buffer& buffer, PyObject* elastic, Py_ssize_t lanes, Py_ssize_t n, Py_ssize_t m) {
    const int64_t* of = lanes < 0 || n < 1 || m < 0 ? nullptr : (const int64_t*)buffer.take(elastic, m, 0);
    bool good = of != nullptr;
    for (Py_ssize_t k = 0; good && k < m; ++k) good = of[k] >= 0 && of[k] < n;
    if (good) return of;
    if (!PyErr_Occurred()) PyErr_SetString(PyExc_ValueError, "elastic joints are none of the robot");
    return nullptr;
}

// links_ahead(q, dq (lanes, n + m), elastic (m), out (2, lanes, n), lanes, n, m): states of n links, those of the elastic joints behind m
//             springs: they stand after the n motors. `elastic`: which joints, 64-bit integers.
PyObject* call_links_ahead(PyObject*, PyObject* args) {
    PyObject *q, *dq, *elastic, *out;
    Py_ssize_t lanes, n, m;
    if (!PyArg_ParseTuple(args, "OOOOnnn", &q, &dq, &elastic, &out, &lanes, &n, &m)) return nullptr;
    Buffer buffers[4];
    const double* from[2] = {};
    double* to = nullptr;
    const int64_t* of = elastic_joints(buffers[0], elastic, lanes, n, m);
    if (!of || !(from[0] = buffers[1].take(q, (int64_t)lanes * (n + m), 0)) || !(from[1] = buffers[2].take(dq, (int64_t)lanes * (n + m), 0)) ||
        !(to = buffers[3].take(out, 2 * (int64_t)lanes * n, PyBUF_WRITABLE)))
        return nullptr;
    for (const double* x : from)
        for (Py_ssize_t lane = 0; lane < lanes; ++lane, x += n + m, to += n) {
            for (Py_ssize_t j = 0; j < n; ++j) to[j] = x[j];
            for (Py_ssize_t k = 0; k < m; ++k) to[of[k]] = x[n + k];
        }
    Py_RETURN_NONE;
}

// behind_springs(H (lanes, n, n), bias (lanes, n), q, dq (lanes, n + m), elastic (m), stiffness, twist (lanes, m), inertia (lanes, n + m,
//                n + m), out (lanes, n + m), lanes, n, m): inertia and bias torque of motors and links, from those of the links. Where the
//                links have no part `inertia` is zero and stays so.
PyObject* call_behind_springs(PyObject*, PyObject* args) {
    PyObject *inertia, *bias, *q, *dq, *elastic, *stiffness, *twist, *whole, *out;
    Py_ssize_t lanes, n, m;
    if (!PyArg_ParseTuple(args, "OOOOOOOOOnnn", &inertia, &bias, &q, &dq, &elastic, &stiffness, &twist, &whole, &out, &lanes, &n, &m)) return nullptr;
    Buffer buffers[9];
    const int64_t* of = elastic_joints(buffers[0], elastic, lanes, n, m);
    const int64_t w = (int64_t)n + m;
    const double *H, *c, *x, *v, *k, *d;
    double *M, *b;
    if (!of || !(H = buffers[1].take(inertia, (int64_t)lanes * n * n, 0)) || !(c = buffers[2].take(bias, (int64_t)lanes * n, 0)) ||
        !(x = buffers[3].take(q, lanes * w, 0)) || !(v = buffers[4].take(dq, lanes * w, 0)) ||
        !(k = buffers[5].take(stiffness, (int64_t)lanes * m, 0)) || !(d = buffers[6].take(twist, (int64_t)lanes * m, 0)) ||
        !(M = buffers[7].take(whole, lanes * w * w, PyBUF_WRITABLE)) || !(b = buffers[8].take(out, lanes * w, PyBUF_WRITABLE)))
        return nullptr;
    std::vector<int64_t> along((size_t)n);
    for (int64_t j = 0; j < n; ++j) along[(size_t)j] = j;
    for (int64_t i = 0; i < m; ++i) along[(size_t)of[i]] = n + i;
    for (Py_ssize_t lane = 0; lane < lanes; ++lane, H += n * n, c += n, x += w, v += w, k += m, d += m, M += w * w, b += w) {
        for (int64_t i = 0; i < n; ++i) {
            b[along[(size_t)i]] = c[i];
            for (int64_t j = 0; j < n; ++j) M[along[(size_t)i] * w + along[(size_t)j]] = H[i * n + j];
        }
        for (int64_t i = 0; i < m; ++i) {
            const double spring = k[i] * (x[of[i]] - x[n + i]) + d[i] * (v[of[i]] - v[n + i]);
            b[of[i]] = spring, b[n + i] -= spring;
        }
    }
    Py_RETURN_NONE;
}

PyMethodDef methods[] = {{"springs", call_springs, METH_VARARGS, "See recursions.cpp."},
                         {"links_ahead", call_links_ahead, METH_VARARGS, "See recursions.cpp."},
                         {"behind_springs", call_behind_springs, METH_VARARGS, "See recursions.cpp."},
                         {"drive_step", call_drive_step, METH_VARARGS, "See recursions.cpp."},
                         {"drive_single", call_drive_single, METH_VARARGS, "See recursions.cpp."},
                         {nullptr, nullptr, 0, nullptr}};
PyModuleDef module = {PyModuleDef_HEAD_INIT, "_recursions", nullptr, -1, methods, nullptr, nullptr, nullptr, nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__recursions() { return PyModule_Create(&module); }
