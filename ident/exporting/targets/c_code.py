"""Plain C: one function without memory of its own, for a controller."""

from __future__ import annotations

import numpy as np

from ..._utils.version import __version__
from ...robots.transmission import Side
from ..identified import Identified
from ..target import ExportOptions, ExportTarget, WrittenFile, register_target
from ..torque_code import TorqueCode, TorqueTerm

Array = np.ndarray


@register_target
class CTarget(ExportTarget):
    """C99, math.h alone; compile it with -O2 and link with -lm."""

    name = "c"
    title = "feed-forward torque as plain C"
    suffixes = (".c",)
    bodies = False

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        code = TorqueCode.of(found)
        return WrittenFile(
            c_text(code), (*found.notes, f"void {code.name}_feedforward(const double *, const double *, const double *, double *)")
        )


def c_text(code: TorqueCode) -> str:
    """The whole file."""
    robot = code.robot
    tables = [f"static const double {name}{_size(values)} = {text};" for name, text, values in code.tables(_braces)]
    parents = ", ".join(str(int(p)) for p in robot.tree.parent)
    slides = ", ".join(str(int(p)) for p in robot.tree.prismatic)
    load = ["    mapped(load_m, LOAD_MOTOR, load);"] if code.loads else ["    (void)load_m;"]
    body = [
        *_added("load", code.side(Side.JOINT, link=True)),
        *_added("own_m", code.side(Side.MOTOR, link=True)),
        *(_link_motors() if code.side(Side.MOTOR, link=True) else []),
        *load,
        "    for (i = 0; i < N; ++i) own[i] = load[i];",
        *_added("own", code.side(Side.JOINT, link=False)),
        *_added("own_m", code.side(Side.MOTOR, link=False)),
    ]
    return _FILE.format(
        name=code.name, robot=robot.name, version=__version__, n=robot.n, nb=robot.tree.nb, parents=parents, slides=slides,
        joints=", ".join(robot.joint_names), measured=robot.transmission.measured.value, tables="\n".join(tables), body="\n".join(body),
    )  # fmt: skip


def _link_motors() -> list[str]:
    # Springs on the motor side load the links, too.
    return [
        "    for (i = 0; i < N; ++i)",
        "        for (j = 0; j < N; ++j) load[i] += MOTOR[j][i] * own_m[j];",
        "    for (i = 0; i < N; ++i) own_m[i] = 0.0;",
    ]


def _added(where: str, terms: list[TorqueTerm]) -> list[str]:
    return [f"    {where}[{term.j}] += {term.text('pow({0}, {1})').replace('abs(', 'fabs(')};" for term in terms]


def _size(values: Array) -> str:
    return "".join(f"[{k}]" for k in values.shape)


def _braces(values: Array) -> str:
    if values.ndim == 1:
        return "{" + ", ".join(repr(float(x)) for x in values) + "}"
    return "{\n    " + ",\n    ".join(_braces(row) for row in values) + "}"


_FILE = """/* Feed-forward torque of {robot}, written by ident {version}.
 *
 * void {name}_feedforward(const double q[{n}], const double dq[{n}], const double ddq[{n}], double tau[{n}]);
 *
 * q, dq, ddq: joint side, rad (m), in the order {joints}.
 * tau: N m (N) on the {measured} side. C99; needs nothing but math.h, keeps nothing between calls. */

#include <math.h>

#define N {n}
#define BODIES {nb}

static const int PARENT[BODIES] = {{{parents}}};
static const int SLIDES[BODIES] = {{{slides}}};
{tables}

static double sgn(double x) {{ return (double)((x > 0.0) - (x < 0.0)); }}

static void cross(double out[3], const double a[3], const double b[3]) {{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}}

static double dot(const double a[3], const double b[3]) {{ return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }}

static void mapped(double out[N], const double map[N][N], const double x[N]) {{
    int i, j;
    for (i = 0; i < N; ++i) {{
        out[i] = 0.0;
        for (j = 0; j < N; ++j) out[i] += map[i][j] * x[j];
    }}
}}

/* E: rotation of a body's frame in its parent's, r: its origin there, at joint position q. */
static void place(double E[9], double r[3], int i, double q) {{
    const double *R = ROTATION[i], *u = AXIS[i];
    int a, b, k;
    for (a = 0; a < 3; ++a) r[a] = TRANSLATION[i][a];
    if (SLIDES[i]) {{
        for (a = 0; a < 9; ++a) E[a] = R[a];
        for (a = 0; a < 3; ++a) r[a] += q * dot(R + 3 * a, u);
        return;
    }}
    {{
        const double c = cos(q), s = sin(q), v = 1.0 - c;
        const double T[9] = {{c + u[0] * u[0] * v,        u[0] * u[1] * v - u[2] * s, u[0] * u[2] * v + u[1] * s,
                             u[1] * u[0] * v + u[2] * s, c + u[1] * u[1] * v,        u[1] * u[2] * v - u[0] * s,
                             u[2] * u[0] * v - u[1] * s, u[2] * u[1] * v + u[0] * s, c + u[2] * u[2] * v}};
        for (a = 0; a < 3; ++a)
            for (b = 0; b < 3; ++b) {{
                E[3 * a + b] = 0.0;
                for (k = 0; k < 3; ++k) E[3 * a + b] += R[3 * a + k] * T[3 * k + b];
            }}
    }}
}}

/* Recursive Newton-Euler pass: torque of the tree's joints. */
static void links(const double q[BODIES], const double dq[BODIES], const double ddq[BODIES], double tau[BODIES]) {{
    double E[BODIES][9], r[BODIES][3], w[BODIES][3], dw[BODIES][3], lift[BODIES][3], f[BODIES][3], n[BODIES][3];
    double x[3], y[3], z[3];
    int i, a;
    for (i = 0; i < BODIES; ++i) {{
        static const double still[3] = {{0.0, 0.0, 0.0}};
        const int up = PARENT[i];
        const double *u = AXIS[i], *L = LINK[i], *h = LINK[i] + 1, *wp = up < 0 ? still : w[up], *dwp = up < 0 ? still : dw[up];
        double Iw[3], Idw[3];
        place(E[i], r[i], i, q[i]);
        cross(x, dwp, r[i]);
        cross(y, wp, r[i]);
        cross(z, wp, y);
        for (a = 0; a < 3; ++a) x[a] += z[a] + (up < 0 ? -GRAVITY[a] : lift[up][a]);
        for (a = 0; a < 3; ++a) {{
            w[i][a] = E[i][a] * wp[0] + E[i][3 + a] * wp[1] + E[i][6 + a] * wp[2];
            dw[i][a] = E[i][a] * dwp[0] + E[i][3 + a] * dwp[1] + E[i][6 + a] * dwp[2];
            lift[i][a] = E[i][a] * x[0] + E[i][3 + a] * x[1] + E[i][6 + a] * x[2];
        }}
        cross(x, w[i], u);
        for (a = 0; a < 3; ++a)
            if (SLIDES[i]) {{
                lift[i][a] += 2.0 * dq[i] * x[a] + ddq[i] * u[a];
            }} else {{
                dw[i][a] += dq[i] * x[a] + ddq[i] * u[a];
            }}
        if (!SLIDES[i])
            for (a = 0; a < 3; ++a) w[i][a] += dq[i] * u[a];
        cross(x, dw[i], h);
        cross(y, w[i], h);
        cross(z, w[i], y);
        for (a = 0; a < 3; ++a) f[i][a] = L[0] * lift[i][a] + x[a] + z[a];
        Iw[0] = L[4] * w[i][0] + L[5] * w[i][1] + L[7] * w[i][2];
        Iw[1] = L[5] * w[i][0] + L[6] * w[i][1] + L[8] * w[i][2];
        Iw[2] = L[7] * w[i][0] + L[8] * w[i][1] + L[9] * w[i][2];
        Idw[0] = L[4] * dw[i][0] + L[5] * dw[i][1] + L[7] * dw[i][2];
        Idw[1] = L[5] * dw[i][0] + L[6] * dw[i][1] + L[8] * dw[i][2];
        Idw[2] = L[7] * dw[i][0] + L[8] * dw[i][1] + L[9] * dw[i][2];
        cross(x, h, lift[i]);
        cross(y, w[i], Iw);
        for (a = 0; a < 3; ++a) n[i][a] = Idw[a] + x[a] + y[a];
    }}
    for (i = BODIES - 1; i >= 0; --i) {{
        const int up = PARENT[i];
        tau[i] = dot(AXIS[i], SLIDES[i] ? f[i] : n[i]);
        if (up < 0) continue;
        for (a = 0; a < 3; ++a) x[a] = dot(E[i] + 3 * a, f[i]);
        cross(y, r[i], x);
        for (a = 0; a < 3; ++a) {{
            f[up][a] += x[a];
            n[up][a] += dot(E[i] + 3 * a, n[i]) + y[a];
        }}
    }}
}}

void {name}_feedforward(const double q[N], const double dq[N], const double ddq[N], double tau[N]);

void {name}_feedforward(const double q[N], const double dq[N], const double ddq[N], double tau[N]) {{
    double tree[3][BODIES], torque[BODIES], q_m[N], dq_m[N], ddq_m[N];
    double load[N] = {{0.0}}, load_m[N], own[N], own_m[N] = {{0.0}};
    int i, j;
    for (i = 0; i < BODIES; ++i) {{
        tree[0][i] = TREE_ZERO[i];
        tree[1][i] = tree[2][i] = 0.0;
        for (j = 0; j < N; ++j) {{
            tree[0][i] += TREE[i][j] * q[j];
            tree[1][i] += TREE[i][j] * dq[j];
            tree[2][i] += TREE[i][j] * ddq[j];
        }}
    }}
    links(tree[0], tree[1], tree[2], torque);
    for (i = 0; i < BODIES; ++i)
        for (j = 0; j < N; ++j) load[j] += TREE[i][j] * torque[i];
    mapped(q_m, MOTOR, q);
    mapped(dq_m, MOTOR, dq);
    mapped(ddq_m, MOTOR, ddq);
    for (i = 0; i < N; ++i) q_m[i] -= MOTOR_ZERO[i];
    (void)q_m;
    (void)dq_m;
    (void)ddq_m;
    (void)sgn;
{body}
    for (i = 0; i < N; ++i) {{
        tau[i] = 0.0;
        for (j = 0; j < N; ++j) tau[i] += JOINT_MEASURED[i][j] * own[j] + MOTOR_MEASURED[i][j] * own_m[j];
    }}
}}
"""
