"""Open chains of revolute joints with any twist angles: the formulas of theorem 2.5.1 without its parallelogram (Yoshida 1995)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..base_form import BaseForm, make_form
from .frames import AxisFrames, refuse_nearly_parallel
from .rotational import hidden_moments, revolute_chain, sums

if TYPE_CHECKING:
    from ....robots.robot import Robot

Array = np.ndarray
_FORM = "the closed form for revolute chains with any twist"


def oblique(robot: Robot) -> BaseForm:
    """Base parameters of an open chain of revolute joints with axes at any angles. Raises UnsupportedError for other structures."""
    chain, frames = revolute_chain(robot, _FORM)
    refuse_nearly_parallel(robot, _FORM, frames, robot.joint_names)
    _, R, J = sums(chain, frames)
    N, K = frames.count, len(frames.clusters()[0])
    Q = hidden_moments(chain, frames, K)
    RZ = distal_moments(frames, R, R[:, 2])
    tilted = [tilted_inertia(J[n], frames.length[n], next_twist(frames, n + 1), RZ[n]) for n in range(N)]
    rows = chain_rows(frames, R, tilted, RZ, Q, K)
    formula = f"7N - 4K - 2Q = 7*{N} - 4*{K} - 2*{Q} = {7 * N - 4 * K - 2 * Q}"
    return make_form(robot, "oblique", tuple(n for n, _ in rows), np.array([r for _, r in rows]), formula)


def next_twist(frames: AxisFrames, n: int) -> float:
    """alpha_{n+1} for the 1-based number n, 0 after the last joint."""
    return float(frames.twist[n]) if n < frames.count else 0.0


def distal_moments(frames: AxisFrames, R: Array, first: Array) -> list[Array]:
    """RZ(n) = first_{n+1} + sum_{i>=n+2} (prod_{j=n+2}^{i} cos alpha_j) R_i^z, for n = 1..N. `first` (N, w): the leading terms."""

    def later(i: int) -> Array:
        return R[i, 2]

    return [_distal(frames, n, first[n] if n < frames.count else np.zeros(R.shape[-1]), later, 1) for n in range(1, frames.count + 1)]


def _distal(frames: AxisFrames, n: int, start: Array, term: Callable[[int], Array], power: int) -> Array:
    """start + sum over i >= n+2 of prod cos^power alpha_j times term(i) (0-based body i - 1)."""
    total, factor = start.copy(), 1.0
    for i in range(n + 2, frames.count + 1):
        factor *= cosine(frames.twist[i - 1]) ** power
        total += factor * term(i - 1)
    return total


def tilted_inertia(J: Array, L: Array, a: float, RZ: Array) -> Array:
    """J with the terms of the distal first moment RZ that look like inertia across a twist a (3, 3, w)."""
    s, c = sine(a), cosine(a)
    out = J.copy()
    for axis in (0, 1):
        out[axis, axis] = out[axis, axis] + 2 * L[2] * c * RZ
    for (row, column), term in {(0, 1): L[0] * s, (0, 2): -L[0] * c, (1, 2): L[2] * s}.items():
        out[row, column] = out[row, column] + term * RZ
        out[column, row] = out[row, column]
    return out


def chain_rows(
    frames: AxisFrames, R: Array, inertia: list[Array], RZ: list[Array], Q: int, K: int, hidden: int = 0
) -> list[tuple[str, Array]]:
    """Base parameters of the chain. `hidden`: the 1-based number of a link whose R_x, R_y are left out, 0 for none."""
    N = frames.count
    rows: list[tuple[str, Array]] = []
    for n in range(1, N + 1):
        a = next_twist(frames, n)
        s, c = sine(a), cosine(a)
        J, nothing = inertia[n - 1], np.zeros(R.shape[-1])
        JY = _distal(frames, n, inertia[n][1, 1], lambda i: inertia[i][1, 1], 2) if n < N else nothing
        rows.append((f"J{n}z", J[2, 2] + s * s * JY))
        if n > K:
            rows += [
                (f"J{n}(x-y)", J[0, 0] - J[1, 1] + s * s * JY),
                (f"J{n}xy", J[0, 1]),
                (f"J{n}xz", J[0, 2]),
                (f"J{n}yz", J[1, 2] + s * c * JY),
            ]
        if n > Q and n != hidden:
            rows += [(f"R{n}x", R[n - 1, 0]), (f"R{n}y", R[n - 1, 1] - s * RZ[n - 1])]
    return rows


def sine(angle: float) -> float:
    """Exactly one at a right angle."""
    return 1.0 if angle == np.pi / 2 else float(np.sin(angle))


def cosine(angle: float) -> float:
    """Exactly zero at a right angle: zeros of the theorem are not rounding."""
    return 0.0 if angle == np.pi / 2 else float(np.cos(angle))
