"""The dissertation's judgements on a grid of positions: leading principal minors, and trailing pivots (chapter 4).

H is positive definite where all its leading principal minors are positive; they need every joint but the first. Eliminated from the tip
instead, the pivot of joint i needs only the positions of the joints after it, so most impossible sets are rejected after few positions.
Neither says anything of positions between those of the grid: see `judge_possible` for a judgement that does."""

from __future__ import annotations

import time
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

from ..errors import ConfigurationError
from .structure import InertiaStructure

Array = np.ndarray

#: Positions evaluated together.
_CHUNK = 20_000


class GridTest(StrEnum):
    """MINORS: leading principal minors at every position. PIVOTS: trailing pivots, joint by joint from the tip."""

    MINORS = "minors"
    PIVOTS = "pivots"


@dataclass(frozen=True, eq=False)
class GridJudgement:
    """Verdict on a grid: `possible`, `certified` only where it is not.

    `share`: of the positions looked at, those where H is not positive definite. `order`: of the first leading minor, or the joint (1 =
    first) of the pivot, that failed at `worst_configuration`, 0 for none; `min_eigenvalue`: smallest eigenvalue there, kg m^2;
    `evaluations`: positions looked at."""

    possible: bool
    certified: bool
    share: float
    order: int
    min_eigenvalue: float
    worst_configuration: dict[str, float]
    method: str
    evaluations: int
    seconds: float

    def text(self) -> str:
        """A line for people."""
        where = ", ".join(f"{k} {v:.3f}" for k, v in self.worst_configuration.items())
        if self.possible:
            return (
                f"possible on the grid of {self.evaluations} positions by {self.method} (not a proof):"
                f" smallest eigenvalue {self.min_eigenvalue:.4g} kg m^2 at {where}"
            )
        return (
            f"not possible by {self.method} {self.order}: smallest eigenvalue {self.min_eigenvalue:.4g} kg m^2 at {where}"
            f" ({100 * self.share:.0f} % of the {self.evaluations} positions looked at)"
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "possible": self.possible,
            "certified": self.certified,
            "share": self.share,
            "order": self.order,
            "min_eigenvalue": self.min_eigenvalue,
            "worst_configuration": dict(self.worst_configuration),
            "method": self.method,
            "evaluations": self.evaluations,
            "seconds": self.seconds,
        }


def judge_on_grid(
    structure: InertiaStructure,
    values: Array,
    *,
    test: GridTest | str = GridTest.MINORS,
    points: int = 8,
    limits: bool = False,
    most: int = 3_000_000,
) -> GridJudgement:
    """Judge base values (b,) on `points` positions of every joint that matters.

    Raises ConfigurationError where the grid has more than `most` positions, or the test does not apply (pivots under a loop closure)."""
    start = time.perf_counter()
    values, test = structure.check_values(values), GridTest(test)
    joints = np.flatnonzero(structure.relevant)
    if points < 1:
        raise ConfigurationError(f"a grid needs at least one position of every joint, not {points}.")
    if points ** len(joints) > most:
        raise ConfigurationError(
            f"a grid of {points} positions of {len(joints)} joints has {float(points) ** len(joints):.2g} points (at most {most:.2g});"
            " give fewer points, or judge by the smallest eigenvalue, which needs no grid."
        )
    if test == GridTest.PIVOTS and structure.has_loop:
        raise ConfigurationError("trailing pivots do not nest under a loop closure; use the leading minors, or the smallest eigenvalue.")
    lower, upper, _ = structure.ranges(limits)
    axes = [np.linspace(lower[j], upper[j], points, endpoint=not _whole_turn(structure, lower, upper, j)) for j in range(structure.n)]
    if test == GridTest.MINORS:
        found = _sweep(structure, values, axes, joints, 0, reverse=False)
    else:
        found = None
        floating = structure.nv - structure.n
        for i in reversed(range(structure.nv)):
            after = joints[joints + floating > i]
            stage = _sweep(structure, values, axes, after, i, reverse=True)
            found = stage if found is None else (stage[0], stage[1], min(found[2], stage[2]), stage[3], found[4] + stage[4], stage[5])
            if stage[0]:
                break
    assert found is not None
    bad, order, _, q, looked, _ = found
    eigenvalue = float(np.linalg.eigvalsh(structure.inertia_matrix(values, q[None])[0])[0])
    return GridJudgement(
        possible=bad == 0,
        certified=bad > 0,
        share=bad / found[5],
        order=order,
        min_eigenvalue=eigenvalue,
        worst_configuration={structure.joint_names[j]: float(q[j]) for j in joints},
        method="leading principal minor" if test == GridTest.MINORS else "trailing pivot of joint",
        evaluations=looked,
        seconds=time.perf_counter() - start,
    )


def _whole_turn(structure: InertiaStructure, lower: Array, upper: Array, joint: int) -> bool:
    return bool(not structure.prismatic[joint] and upper[joint] - lower[joint] >= 2 * np.pi - 1e-9)


def _sweep(
    structure: InertiaStructure, values: Array, axes: list[Array], joints: Array, start: int, reverse: bool
) -> tuple[int, int, float, Array, int, int]:
    """The block H[start:, start:] over a grid: (positions that fail, order, lowest eigenvalue, worst position, positions, positions)."""
    middle = np.array([axis[len(axis) // 2] for axis in axes])
    counts = [len(axes[j]) for j in joints]
    total = int(np.prod(counts)) if counts else 1
    bad, order, lowest, worst = 0, 0, np.inf, middle
    for first in range(0, total, _CHUNK):
        index = np.unravel_index(np.arange(first, min(first + _CHUNK, total)), counts) if counts else (np.zeros(1, int),)
        q = np.tile(middle, (len(index[0]), 1))
        for j, place in zip(joints, index, strict=False):
            q[:, j] = axes[j][place]
        H = structure.inertia_matrix(values, q)[:, start:, start:]
        failed = first_failure(H[:, ::-1, ::-1] if reverse else H)
        bad += int(np.count_nonzero(failed))
        eigenvalues = np.linalg.eigvalsh(H)[:, 0]
        k = int(np.argmin(eigenvalues))
        if eigenvalues[k] < lowest:
            lowest, worst = float(eigenvalues[k]), q[k]
            order = 0 if not failed[k] else (structure.nv - int(failed[k]) + 1 if reverse else int(failed[k]))
    return bad, order, lowest, worst, total, total


def first_failure(H: Array) -> Array:
    """For matrices (N, n, n) the order of the first leading principal minor that is not positive, 0 where all are: (N,).

    By elimination without exchange: the minor of order k is the product of the first k pivots."""
    A = H.copy()
    n = A.shape[1]
    failed = np.zeros(len(A), int)
    for k in range(n):
        pivot = A[:, k, k]
        failed[(pivot <= 0) & (failed == 0)] = k + 1
        safe = np.where(pivot > 0, pivot, 1.0)
        A[:, k + 1 :, k + 1 :] -= A[:, k + 1 :, k, None] * A[:, k, None, k + 1 :] / safe[:, None, None]
    return failed
