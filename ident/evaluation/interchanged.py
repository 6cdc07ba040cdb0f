"""Columns of a log that were taken for another joint's, or in the opposite direction: mistakes without a size, found by correcting them.

A reversed or exchanged column leaves a residual that a zero, a tilt or a clock seems to explain in part. Each correction is fitted, and
named only where all joints together are then fitted far better."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby

import numpy as np

Array = np.ndarray
#: So many joints, the worst fitted ones, are looked at for exchanged columns: pairs of more would take longer than the fit.
_WORST = 8


@dataclass(frozen=True)
class Interchange:
    """Where joint j's position and torque really are: `position_of[j]` and `torque_of[j]`, each times its sign. `told`: a clause, what
    seems to be wrong; `remedy`: a sentence, what to look at."""

    position_of: tuple[int, ...]
    position_sign: tuple[float, ...]
    torque_of: tuple[int, ...]
    torque_sign: tuple[float, ...]
    told: str
    remedy: str

    @property
    def positions(self) -> tuple[tuple[int, ...], tuple[float, ...]]:
        """What it does to the motion."""
        return self.position_of, self.position_sign

    def motion(self, x: Array) -> Array:
        """Positions, velocities or accelerations (N, n) as they should have been read."""
        return x[:, self.position_of] * self.position_sign

    def torque(self, tau: Array) -> Array:
        """Torques (M, n) as they should have been read."""
        return tau[:, self.torque_of] * self.torque_sign


def as_read(n: int) -> Interchange:
    """Nothing is interchanged."""
    return Interchange(tuple(range(n)), (1.0,) * n, tuple(range(n)), (1.0,) * n, "", "")


def interchanges(names: Sequence[str], errors: Array) -> Iterator[list[Interchange]]:
    """All that are looked for, those with the same motion together. `errors` (n,): relative error of each joint as the log was read."""
    found = [*_reversals(names), *_swaps(names, sorted(np.argsort(-errors)[:_WORST].tolist()))]
    for _, group in groupby(sorted(found, key=lambda one: one.positions), key=lambda one: one.positions):
        yield list(group)


def _reversals(names: Sequence[str]) -> Iterator[Interchange]:
    """Position, torque, or both of one joint count in the direction opposite to the URDF's axis."""
    n = len(names)
    same = tuple(range(n))
    plain = (1.0,) * n
    for j, name in enumerate(names):
        turned = tuple(-1.0 if k == j else 1.0 for k in range(n))
        yield Interchange(
            same, plain, same, turned, f"torque of {name} seems to have the opposite sign",
            "Check its sign and side in the log ([drive] measured), the sign of its ratio, and the joint's axis in the URDF.",
        )  # fmt: skip
        yield Interchange(
            same, turned, same, plain, f"the position of {name} seems to count in the opposite direction",
            "Check the direction of that encoder and the sign of its ratio (scale = -1 under [columns] reverses a column).",
        )  # fmt: skip
        yield Interchange(
            same, turned, same, turned, f"position and torque of {name} seem to count in the direction opposite to the axis in the URDF",
            "Check that axis, or reverse both columns (scale = -1 under [columns]).",
        )  # fmt: skip


def _swaps(names: Sequence[str], worst: Sequence[int]) -> Iterator[Interchange]:
    """Positions, torques, or both of two joints are exchanged."""
    n = len(names)
    same, plain = tuple(range(n)), (1.0,) * n
    remedy = "Check the order of the columns ([columns] maps them; `ident check --log FILE` shows how they were read)."
    for a, b in combinations(worst, 2):
        order = tuple(b if k == a else a if k == b else k for k in range(n))
        both = f"{names[a]} and {names[b]} seem to be exchanged"
        yield Interchange(order, plain, same, plain, f"the positions of {both}", remedy)
        yield Interchange(same, plain, order, plain, f"the torques of {both}", remedy)
        yield Interchange(order, plain, order, plain, f"positions and torques of {both}", remedy)
