// The kinematic tree and the work to be done on it, as plain data shared by the kernels of all instruction sets. The records are
// filled in Python (ident/regressor/native.py), member by member in this order, int64 before double.
// Nothing here has code: an inline function compiled for AVX-512 must never be the one that another file links to.
#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>

namespace ident {

enum Kind : int64_t { REVOLUTE, PRISMATIC, FREE };

// One moving body. The axes of its frame are renamed cyclically, such that a joint about a principal axis turns about z.
struct Body {
    int64_t parent;          // -1: the base
    int64_t position, row;   // first position and velocity coordinate
    int64_t kind;
    int64_t sparse;          // revolute about +-z behind a constant rotation that only permutes axes: 5 products instead of 9
    int64_t shifted;         // p is not zero, or not constant
    int64_t axes[3];         // sparse: component j of R0' v is sign[j] * v[axes[j]]; else 0 1 2
    double sign[3];
    double lever[3];         // sparse: p in permuted components, negative for an odd permutation, so that (w x p)[axes] = w[axes] x lever
    double turn;             // sparse: +1 or -1, the sense of the rotation about z
    double R0[9], p[3], u[3];               // constant placement in the parent's frame, unit axis
    double fixed[9], cosine[9], sine[9];    // R = fixed + cos q cosine + sin q sine (Rodrigues behind R0)
};

struct Tree {
    int nb, nv, nq;
    double gravity[3];
    Body* bodies;
};

constexpr int PARAMETERS = 10;   // m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz of a body

// One body in one row of the regression equation. The row is the power of the motion in which velocity v_j is T[row, j]:
// the body's unit twist (linear, angular) follows from its parent's, plus `twist` where its own joint takes part.
struct Step {
    int64_t body;
    int64_t starts;  // no body before it takes part: the twist is `twist` alone
    int64_t own;     // ... and it is an angular velocity about z of size twist[5]
    int64_t joins;   // its own joint takes part too
    int64_t shows;   // some of its parameters have a column
    int64_t leads;   // some body after it has a step
    int64_t column[PARAMETERS];  // tile column of each parameter, -1 if not wanted
    double twist[6];
};

struct Extra {
    int64_t index;    // column of `extra`
    int64_t column;   // tile column
    double factor;
};

// One row of the regression equation: its live columns, the last of them the torque, padded to a multiple of four.
struct Row {
    int64_t steps, extras, width, padded;
    const Step* step;
    const Extra* extra;
};

struct Plan {
    int rows, widest, extras;   // widest: greatest padded width; extras: columns of `extra`
    bool dense;                 // extra is (N, rows, extras), not (N, extras)
    bool gram;
    const int64_t* split;       // of a Gram matrix: how many columns of each row are instruments, whose products with the others are wanted
    const double* taps;         // of the filter of the rows, or null
    int tap_count, factor;      // factor: samples a row
    Row* row;
};

// Arrays of one call, samples first. Unused ones are null.
struct Arrays {
    const double *inertia, *added;   // inertia in renamed frames
    const double *q, *dq, *ddq, *tau, *extra, *weight;
    const uint8_t* valid;
    double *out, *mass;
};

// What can be had of each sample. TERMS: mass matrix and bias together.
enum Task { REGRESSOR, INVERSE, MASS, TERMS, FORWARD, TASKS };

// How a force depends on a coordinate, its speed and its acceleration.
struct Entry {
    int64_t row, column;
    double position, speed, acceleration;
};

// A part of a friction contact: its speed is the sum of direction times that of the coordinate; sliding forwards it takes `level` there.
struct Touch {
    int64_t contact, coordinate;
    double direction, level;
};

// A plant to integrate, n coordinates: a tree with forces `offset` + entries, and dry friction on contacts (`touch`, and the same as
// matrices `direction` and `level`, contacts x n). `ratio` (positions only): from coordinates less `zero` to the side on which torque is
// given and a controller acts, if there is one.
struct Drive {
    int contacts, entries, ratios, touches;
    bool complete;                       // holding all contacts holds everything
    const Entry *entry, *ratio;
    const Touch* touch;
    const double *inertia, *offset, *direction, *level, *zero;
    const double *kp, *kd, *limit;       // (n); null: no feedback, no limit
};

// Runs of a plant: `forward` torque at each instant, and the desired motion on the controller's side, (periods, lanes, n); states (lanes, n)
// and modes (lanes, contacts), updated in place; what is kept of every `every`-th instant, and torque of all.
struct Runs {
    int64_t lanes, periods, substeps, every;
    double h;
    bool linear, ends, fresh;            // torque runs straight to the next; nothing follows the last instant; modes are not known yet
    const double *forward, *desired_q, *desired_dq;
    double *q, *dq, *modes, *kept_q, *kept_dq, *kept_ddq, *kept_friction, *kept_modes, *torque;
};

// Accelerations `out` (count, n) of inertia matrices (count, n, n) under `force` (count, n), both carried by `map` (n, n) and divided by a `scale`
// (n) for each coordinate; the symmetric part counts. `sound` (count): no eigenvalue of the scaled matrix is below `least`.
struct Response {
    const double *inertia, *force, *map, *scale;
    double least, *out;
    uint8_t* sound;
};

// Numbers of each of some rows, which stand `stride` apart.
struct Part {
    const double* from;
    int64_t stride, count;
};

// Rows of one joint, gathered from parts, that go through the predictor of the order which the rows since the last gap allow. `predictors`: of
// order 0 ... `order`, `order` + 7 numbers each, three zeros before the first; `past` (order, width): the last rows, updated; what is not
// `valid` becomes zero; `out` (count, width), or null; `products` (width, width), or null: added to, of the first `rows` numbers (a multiple of 8).
struct Whitening {
    static constexpr int PARTS = 4;
    const double* predictors;
    int64_t order, width, rows, valid_stride;
    int parts;
    Part part[PARTS];
    const uint8_t* valid;
    double *past, *out, *products;
};

// Why a simulation stops. UNFIT: not for this integrator (friction that feeds power in).
enum Failure { NONE, SINGULAR, DIVERGED, UNFIT };

// What one instruction set offers. Every function handles the samples lo ... hi-1 with memory that the caller owns.
struct Kernel {
    const char* name;
    int lanes;
    size_t (*workspace)(const Tree&, const Plan*);
    int64_t (*task[TASKS])(const Tree&, const Plan*, const Arrays&, int64_t lo, int64_t hi, char* memory);   // first sample that fails, or -1
    // factors: per row `padded` x `padded`, updated in place
    void (*information)(const Tree&, const Plan&, const Arrays&, int64_t lo, int64_t hi, char* memory, double* const* factors);
    bool (*row_columns)(const Tree&, const Plan&, const Arrays&, int64_t lo, int64_t hi, char* memory);   // into `out`; false: not finite
    void (*merge)(const Plan&, char* memory, double* const* into, const double* const* from);
    size_t (*simulation_memory)(const Tree&, const Drive&);
    int64_t (*simulate)(const Tree&, const Drive&, const Runs&, int64_t lo, int64_t hi, char* memory);   // -1, or 4 periods + Failure
    // Filters along time over rows of `width` numbers (series.h): `a` (order + 1) has three zeros on either side.
    void (*average)(const double* a, int order, const double* x, int64_t width, int64_t count, double* y);
    void (*recursion)(const double* a, int order, const double* x, int64_t width, int64_t count, double* y);
    size_t (*whitening_memory)(const Whitening&);
    int64_t (*whiten)(const Whitening&, int64_t count, int64_t age, char* memory);
    void (*lattice)(double* ahead, double* behind, const int64_t* stretches, int64_t count, int64_t shift, double reflection, double* sums);
    void (*respond)(int n, int64_t count, const Response&, char* memory);
};

extern const Kernel kernel_baseline;
extern const Kernel kernel_avx2;
extern const Kernel kernel_avx512;

}  // namespace ident
