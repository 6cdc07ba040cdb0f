"""Theorem 2.4.1: open chains of revolute and prismatic joints (Yoshida 1995, corrected).

Frames are numbered (n, t): n counts the revolute joints, t the prismatic ones that follow revolute joint n (n = 0: before the
first). Prismatic joints do not turn, so all links (n, t) share the orientation of frame n; their origins are put at o_n at the
reference position, which leaves only one length per revolute joint."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..base_form import BaseForm, make_form
from .frames import ANGLE, AxisFrames, Chain, axis_frames, link_change, read_chain, refuse_oblique
from .linear_forms import LinkForms, point_inertia, point_moment

if TYPE_CHECKING:
    from ....robots.robot import Robot

Array = np.ndarray
_THEOREM = "theorem 2.4.1 (revolute and prismatic joints)"


def mixed(robot: Robot) -> BaseForm:
    """Base parameters of an open chain of revolute and prismatic joints; successive axes of rotation parallel or perpendicular,
    prismatic axes in any direction. Raises UnsupportedError for any other structure."""
    chain = read_chain(robot, _THEOREM)
    group = _Groups.read(robot)
    turning = [bodies[0] for bodies in group.revolute]
    names = [robot.joints[i].name for i in turning]
    N = len(turning)
    frames = axis_frames(chain.points[turning], chain.axes[turning], chain.zero_length) if N else None
    if frames is None:
        return _translations_only(robot, group)
    refuse_oblique(robot, _THEOREM, frames, names, "")
    sums = _sums(chain, frames, group)
    clusters = frames.clusters()
    b1 = len(clusters[0])
    Q = _hidden(chain, frames, group, b1)
    rows: list[tuple[str, Array]] = [(f"M0,{t}", sums.M[body]) for t, body in enumerate(group.before, start=1)]
    slides_along = 0
    for n in range(1, N + 1):
        rows += _rotation_rows(n, frames, sums, b1, Q)
        for t, body in enumerate(group.revolute[n - 1][1:], start=1):
            rows.append((f"M{n},{t}", sums.M[body]))
            axis = frames.rotation[n - 1].T @ chain.axes[body]
            moved = sums.RC[body] + np.array([np.zeros_like(sums.RCZ[n - 1]), -sums.RCZB[n - 1], sums.RCZ[n - 1]])
            found = _slide_rows(n, t, axis, moved, n <= b1)
            slides_along += n <= b1 and not found
            rows += found
    T = [len(bodies) - 1 for bodies in group.revolute]
    early, late, T0 = sum(T[:b1]), sum(T[b1:]), len(group.before)
    count = 7 * N - 4 * b1 - 2 * Q + T0 + sum(T) + 3 * late + 2 * (early - slides_along)
    formula = (
        "7N - 4 b(1) - 2Q + T + 3 T_late + 2 (T_early - W)"
        f" = 7*{N} - 4*{b1} - 2*{Q} + {T0 + sum(T)} + 3*{late} + 2*({early} - {slides_along}) = {count}"
    )
    return make_form(robot, "mixed", tuple(n for n, _ in rows), np.array([r for _, r in rows]), formula)


@dataclass(frozen=True)
class _Groups:
    """Bodies of a chain: `before` the first revolute joint, then for each revolute joint its body and those sliding on it."""

    before: list[int]
    revolute: list[list[int]]

    @classmethod
    def read(cls, robot: Robot) -> _Groups:
        before: list[int] = []
        revolute: list[list[int]] = []
        for body, prismatic in enumerate(robot.tree.prismatic):
            if not prismatic:
                revolute.append([body])
            elif revolute:
                revolute[-1].append(body)
            else:
                before.append(body)
        return cls(before, revolute)


@dataclass(frozen=True, eq=False)
class _Sums:
    """M (nb, w): mass of a body and everything after; RC (nb, 3, w) per body, in its revolute joint's frame; J (N, 3, 3, w);
    RCZ, RCZB, JY (N, w)."""

    M: Array
    RC: Array
    J: Array
    RCZ: Array
    RCZB: Array
    JY: Array
    RCn: Array


def _sums(chain: Chain, frames: AxisFrames, group: _Groups) -> _Sums:
    nb, N = chain.robot.tree.nb, frames.count
    changes: dict[int, Array] = {}
    for n, bodies in enumerate(group.revolute):
        changes |= {body: link_change(chain.poses[body], frames.rotation[n], frames.origin[n]) for body in bodies}
    changes |= {body: link_change(chain.poses[body], chain.poses[body][:3, :3], chain.points[body]) for body in group.before}
    forms = LinkForms(changes, nb)
    M = np.array([forms.masses(range(body, nb)) for body in range(nb + 1)])
    RC, J = np.zeros((nb, 3, 10 * nb)), np.zeros((N, 3, 3, 10 * nb))
    for n, bodies in enumerate(group.revolute):
        beyond, L = M[bodies[-1] + 1], frames.length[n]
        total = point_moment(beyond, L)
        for body in reversed(bodies):
            total = total + forms.moment(body)
            RC[body] = total
        J[n] = sum((forms.inertia(body) for body in bodies), start=point_inertia(beyond, L))
    RCn = RC[[bodies[0] for bodies in group.revolute]]
    clusters = frames.clusters()
    RCZ, RCZB, JY = np.zeros((N, 10 * nb)), np.zeros((N, 10 * nb)), np.zeros((N, 10 * nb))
    for run in clusters:
        for n in run:
            RCZ[n - 1] = RCn[n : run[-1], 2].sum(axis=0)
    for run, following in pairwise(clusters):
        last = run[-1] - 1
        RCZB[last] = sum(RCn[i - 1, 2] for i in following)
        JY[last] = sum(J[i - 1, 1, 1] + 2 * frames.length[i - 1, 2] * RCZ[i - 1] for i in following)
    return _Sums(M, RC, J, RCZ, RCZB, JY, RCn)


def _rotation_rows(n: int, frames: AxisFrames, sums: _Sums, b1: int, Q: int) -> list[tuple[str, Array]]:
    J, R, (Lx, _, Lz) = sums.J[n - 1], sums.RCn[n - 1], frames.length[n - 1]
    RCZ, RCZB, JY = sums.RCZ[n - 1], sums.RCZB[n - 1], sums.JY[n - 1]
    rows = [(f"J{n}z", J[2, 2] + JY)]
    if n > b1:
        rows += [
            (f"J{n}(x-y)", J[0, 0] - J[1, 1] + JY),
            (f"J{n}xy", J[0, 1] + Lx * RCZB),
            (f"J{n}xz", J[0, 2] - Lx * RCZ),
            (f"J{n}yz", J[1, 2] + Lz * RCZB),
        ]
    if n > Q:
        rows += [(f"R{n}x", R[0]), (f"R{n}y", R[1] - RCZB)]
    return rows


def _slide_rows(n: int, t: int, axis: Array, moved: Array, early: bool) -> list[tuple[str, Array]]:
    """First moments of what slides on link n along `axis` (in frame n). In the first cluster only two of them show, none along z_n."""
    A = _with_third_column(axis)
    hat = np.tensordot(A.T, moved, axes=1)
    name = f"R{n},{t}"
    if not early:
        return [(f"{name}x", hat[0]), (f"{name}y", hat[1]), (f"{name}z", hat[2])]
    if np.hypot(axis[0], axis[1]) < ANGLE:
        return []
    A31, A32, A33 = A[2]
    return [
        (f"{name}h", A32 * hat[0] - A31 * hat[1]),
        (f"{name}v", hat[2] - A33 * (A31 * hat[0] + A32 * hat[1] + A33 * hat[2])),
    ]


def _with_third_column(axis: Array) -> Array:
    """A rotation whose third column is `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=-1)


def _hidden(chain: Chain, frames: AxisFrames, group: _Groups, b1: int) -> int:
    """Q: the number of first revolute links whose R_x, R_y stay hidden."""
    if not chain.along_gravity(frames.rotation[0, :, 2]) or any(not chain.along_gravity(chain.axes[b]) for b in group.before):
        return 0
    N = frames.count
    for q in range(1, b1 + 1):
        offset = q < b1 and frames.length[q - 1, 0] != 0.0
        slides = any(not chain.along_gravity(chain.axes[body]) for body in group.revolute[q - 1][1:])
        if offset or slides or (q == b1 and b1 < N):
            return q
    return N


def _translations_only(robot: Robot, group: _Groups) -> BaseForm:
    """A Cartesian chain: each joint shows the mass it carries."""
    nb = robot.tree.nb
    matrix = np.zeros((nb, 10 * nb))
    for row in range(nb):
        matrix[row, 10 * row :: 10] = 1.0
    names = tuple(f"M0,{t}" for t in range(1, len(group.before) + 1))
    return make_form(robot, "mixed", names, matrix, f"T = {nb}")
