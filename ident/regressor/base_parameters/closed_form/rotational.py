"""Theorem 2.3.1: open chains of revolute joints whose successive axes are parallel or perpendicular (Yoshida 1995, corrected)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..base_form import BaseForm, make_form
from .frames import AxisFrames, Chain, axis_frames, link_change, read_chain, refuse_oblique, unsupported
from .linear_forms import LinkForms, point_inertia, point_moment

if TYPE_CHECKING:
    from ....robots.robot import Robot

Array = np.ndarray
_THEOREM = "theorem 2.3.1 (revolute joints, parallel or perpendicular axes)"


def rotational(robot: Robot) -> BaseForm:
    """Base parameters J_iz, R_ix, ... of an open chain of revolute joints with parallel or perpendicular successive axes.

    Raises UnsupportedError for any other structure."""
    chain, frames = revolute_chain(robot, _THEOREM)
    refuse_oblique(robot, _THEOREM, frames, robot.joint_names, "closed_form.oblique(robot) or ")
    M, R, J = sums(chain, frames)
    del M
    N, L = frames.count, frames.length
    clusters = frames.clusters()
    ends = {run[-1]: d for d, run in enumerate(clusters)}
    within = {i: run for run in clusters for i in run}
    nothing = np.zeros(R.shape[-1])

    def RZ(i: int) -> Array:
        return R[[j - 1 for j in within[i] if j > i], 2].sum(axis=0)

    def after(i: int) -> list[int]:
        """Links of the next cluster, if i ends one."""
        d = ends.get(i, len(clusters))
        return clusters[d + 1] if d + 1 < len(clusters) else []

    def RZB(i: int) -> Array:
        return sum((R[j - 1, 2] for j in after(i)), start=nothing)

    def JYB(i: int) -> Array:
        return sum((J[j - 1, 1, 1] + 2 * L[j - 1, 2] * RZ(j) for j in after(i)), start=nothing)

    beta = len(clusters[0])
    Q = hidden_moments(chain, frames, beta)
    rows: list[tuple[str, Array]] = []
    for i in range(1, N + 1):
        Ri, Ji, (Lx, _, Lz) = R[i - 1], J[i - 1], L[i - 1]
        rows.append((f"J{i}z", Ji[2, 2] + JYB(i)))
        if i > beta:
            rows += [
                (f"J{i}(x-y)", Ji[0, 0] - Ji[1, 1] + JYB(i)),
                (f"J{i}xy", Ji[0, 1] + Lx * RZB(i)),
                (f"J{i}xz", Ji[0, 2] - Lx * RZ(i)),
                (f"J{i}yz", Ji[1, 2] + Lz * RZB(i)),
            ]
        if i > Q:
            rows += [(f"R{i}x", Ri[0]), (f"R{i}y", Ri[1] - RZB(i))]
    formula = f"7N - 4 beta_1 - 2Q = 7*{N} - 4*{beta} - 2*{Q} = {7 * N - 4 * beta - 2 * Q}"
    return make_form(robot, "rotational", tuple(n for n, _ in rows), np.array([r for _, r in rows]), formula)


def revolute_chain(robot: Robot, theorem: str) -> tuple[Chain, AxisFrames]:
    """Read an open chain of revolute joints."""
    chain = read_chain(robot, theorem)
    for joint in robot.joints:
        if joint.prismatic:
            raise unsupported(robot, theorem, f"joint {joint.name!r} is prismatic", "closed_form.mixed(robot) or ")
    return chain, axis_frames(chain.points, chain.axes, chain.zero_length)


def sums(chain: Chain, frames: AxisFrames) -> tuple[Array, Array, Array]:
    """M_i (N, w), R_i (N, 3, w), J_i (N, 3, 3, w): link quantities with the masses beyond lumped at the end of the link."""
    N = frames.count
    changes = {i: link_change(chain.poses[i], frames.rotation[i], frames.origin[i]) for i in range(N)}
    forms = LinkForms(changes, N)
    M = np.array([forms.masses(range(i, N)) for i in range(N + 1)])
    R = np.array([forms.moment(i) + point_moment(M[i + 1], frames.length[i]) for i in range(N)])
    J = np.array([forms.inertia(i) + point_inertia(M[i + 1], frames.length[i]) for i in range(N)])
    return M, R, J


def hidden_moments(chain: Chain, frames: AxisFrames, beta: int) -> int:
    """Q: the number of first links whose R_x, R_y stay hidden, because their axes are along gravity and nothing else moves them."""
    if not chain.along_gravity(frames.rotation[0, :, 2]):
        return 0
    N = frames.count
    for q in range(1, beta + 1):
        if (q == beta and beta < N) or (q < beta and frames.length[q - 1, 0] != 0.0):
            return q
    return N
