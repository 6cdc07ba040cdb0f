"""NumPy: one function for one state or many, which needs nothing but NumPy."""

from __future__ import annotations

import numpy as np

from ..._utils.version import __version__
from ...robots.transmission import Side
from ..identified import Identified
from ..target import ExportOptions, ExportTarget, WrittenFile, register_target
from ..torque_code import TorqueCode, TorqueTerm

Array = np.ndarray


@register_target
class NumpyTarget(ExportTarget):
    """A module with `feedforward(q, dq, ddq)`; the arrays may have any leading axes."""

    name = "numpy"
    title = "feed-forward torque as NumPy code"
    suffixes = (".py",)
    bodies = False

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        return WrittenFile(numpy_text(TorqueCode.of(found)), found.notes)


def numpy_text(code: TorqueCode) -> str:
    """The whole file."""
    robot = code.robot
    tables = [f"{name} = np.array({text})" for name, text, _ in code.tables(lambda values: repr(values.tolist()))]
    body = [
        *_added("load", code.side(Side.JOINT, link=True)),
        *_added("own_m", code.side(Side.MOTOR, link=True)),
        *(["    load, own_m = load + own_m @ MOTOR, np.zeros_like(q)"] if code.side(Side.MOTOR, link=True) else []),
        *(["    load_m = load @ LOAD_MOTOR.T"] if code.loads else []),
        "    own = load.copy()",
        *_added("own", code.side(Side.JOINT, link=False)),
        *_added("own_m", code.side(Side.MOTOR, link=False)),
    ]
    return _FILE.format(
        robot=robot.name, version=__version__, n=robot.n, joints=", ".join(robot.joint_names), tables="\n".join(tables),
        measured=robot.transmission.measured.value, parents=robot.tree.parent.tolist(), slides=robot.tree.prismatic.tolist(),
        body="\n".join(body),
    )  # fmt: skip


def _added(where: str, terms: list[TorqueTerm]) -> list[str]:
    def place(text: str) -> str:
        # Joints are the last axis.
        return text.replace("[", "[..., ")

    return [f"    {where}[..., {term.j}] += {place(term.text('({0} ** {1})'))}" for term in terms]


_FILE = '''"""Feed-forward torque of {robot}, written by ident {version}; needs NumPy alone.

Joints in the order {joints}; torque on the {measured} side, N m (N).
"""

import numpy as np
from numpy import abs, cos, exp, sin, sqrt, tanh  # noqa: A004, F401
from numpy import sign as sgn  # noqa: F401

PARENT = {parents}
SLIDES = {slides}
{tables}


def feedforward(q, dq, ddq):
    """Torque (..., {n}) at joint positions, velocities and accelerations (..., {n}), rad (m)."""
    q, dq, ddq = (np.asarray(x, float) for x in (q, dq, ddq))
    load = _links(q @ TREE.T + TREE_ZERO, dq @ TREE.T, ddq @ TREE.T) @ TREE
    q_m, dq_m, ddq_m = q @ MOTOR.T - MOTOR_ZERO, dq @ MOTOR.T, ddq @ MOTOR.T
    own_m = np.zeros_like(q_m + dq_m + ddq_m)
{body}
    return own @ JOINT_MEASURED.T + own_m @ MOTOR_MEASURED.T


def _links(q, dq, ddq):
    """Recursive Newton-Euler pass: torque (..., bodies) of the tree's joints."""
    still = np.zeros((*q.shape[:-1], 3))
    place, w, dw, lift, force, moment = [], [], [], [], [], []
    for i, up in enumerate(PARENT):
        u, R = AXIS[i], ROTATION[i].reshape(3, 3)
        at, rate, rise = q[..., i, None], dq[..., i, None], ddq[..., i, None]
        if SLIDES[i]:
            E, r = np.broadcast_to(R, (*still.shape, 3)), TRANSLATION[i] + at * (R @ u)
        else:
            X = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
            turn = np.eye(3) + np.sin(at)[..., None] * X + (1.0 - np.cos(at))[..., None] * (X @ X)
            E, r = R @ turn, TRANSLATION[i] + still
        wp, dwp, ap = (still, still, still - GRAVITY) if up < 0 else (w[up], dw[up], lift[up])
        a = ap + np.cross(dwp, r) + np.cross(wp, np.cross(wp, r))
        wi, dwi, a = _back(E, wp), _back(E, dwp), _back(E, a)
        if SLIDES[i]:
            a = a + 2.0 * rate * np.cross(wi, u) + rise * u
        else:
            dwi = dwi + rate * np.cross(wi, u) + rise * u
            wi = wi + rate * u
        m, h, v = LINK[i][0], LINK[i][1:4], LINK[i][4:]
        inertia = np.array([[v[0], v[1], v[3]], [v[1], v[2], v[4]], [v[3], v[4], v[5]]])
        force.append(m * a + np.cross(dwi, h) + np.cross(wi, np.cross(wi, h)))
        moment.append(np.cross(h, a) + dwi @ inertia + np.cross(wi, wi @ inertia))
        place.append((E, r))
        w.append(wi)
        dw.append(dwi)
        lift.append(a)
    torque = np.zeros_like(q)
    for i in reversed(range(len(PARENT))):
        torque[..., i] = (force[i] if SLIDES[i] else moment[i]) @ AXIS[i]
        if PARENT[i] >= 0:
            E, r = place[i]
            f = (E @ force[i][..., None])[..., 0]
            force[PARENT[i]] = force[PARENT[i]] + f
            moment[PARENT[i]] = moment[PARENT[i]] + (E @ moment[i][..., None])[..., 0] + np.cross(r, f)
    return torque


def _back(E, x):
    """Vectors in a body's frame from those in its parent's."""
    return (np.swapaxes(E, -1, -2) @ x[..., None])[..., 0]
'''
