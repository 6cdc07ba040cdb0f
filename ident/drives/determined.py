"""What a log determines: unknowns with an interval, sums and ratios of those that it cannot tell apart, and what it does not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from .combinations import SHARE, Combination, Joined
from .uncertainty import RESOLUTION, Precision
from .unknowns import Unknown

Array = np.ndarray
#: Where unknowns trade with each other, these are held first: what stays is then named after the physics, not after the drive.
_HELD_FIRST = (
    "integral_start", "feed_forward", "deadband", "kd", "kp", "ki", "torque_scale", "back_emf", "command_lag_s", "delay_s", "joint_damping",
    "joint_stiffness", "slow_speed", "gear_loss_slow", "gear_loss_square", "gear_loss", "spring", "excess", "load", "no_load_speed",
    "effort_limit", "offset", "armature", "viscous", "dry", "link",
)  # fmt: skip
#: What bounds the torque, and is not seen where it is large.
_LIMITS = ("effort_limit", "no_load_speed")


class Standing(StrEnum):
    """Of one unknown: has a value; has one, or a bound, together with others only; shows too little for a value."""

    DETERMINED = "determined"
    CONFOUNDED = "confounded"
    UNSEEN = "unseen"


@dataclass(frozen=True, eq=False)
class Determination:
    """Standing and standard deviation (inf where not determined) of each unknown, a bound on each (inf: none), what is determined
    together, and sums of which there is a bound only (`bounded`)."""

    verdicts: tuple[Standing, ...]
    std: Array
    below: Array
    combinations: tuple[Combination, ...]
    bounded: tuple[Combination, ...] = ()


def determination(unknowns: Sequence[Unknown], values: Array, precision: Precision, period: float) -> Determination:
    """Decide by intervals: round-off would call what is merely badly conditioned determined. A combination is decided as a single unknown
    is, by its own value: in a difference of two that are nearly alike, a share of either is more than all of it.

    `values` (p,); `period`: seconds between samples, of which a delay is to be known to a third."""
    everything = np.arange(len(values))
    floor = np.array([SHARE * period if u.place == "delay_s" else 0.0 for u in unknowns])
    allowed = np.maximum(SHARE * np.abs(values), floor)
    std = _std(precision, everything)
    alone = np.array([_std(precision, everything[[i]])[0] for i in everything])
    open_ = std > allowed
    # Too little by itself, whatever the others are, if this is its value. It need not be where others take from it what it gains.
    faint = open_ & (alone > allowed)
    held = _held(unknowns, precision, allowed, open_, open_ & ~faint)
    free = np.setdiff1d(everything, held)
    sizes = np.maximum(precision.scale, allowed)
    joined = Joined(unknowns, values, sizes, std, floor, free, np.array(held, int), _std(precision, free))
    found = joined.combinations(precision, open_)
    little = {u.name for u, f in zip(unknowns, faint, strict=True) if f}
    kept = [c for c in found if c.members[0] not in little or (c.determined and c.adds)]
    grouped = {name for c in kept for name in c.members}
    verdicts = tuple(
        Standing.DETERMINED if not o else Standing.CONFOUNDED if u.name in grouped else Standing.UNSEEN
        for u, o in zip(unknowns, open_, strict=True)
    )
    # What trades with others is bounded as far as they are: an interval beside numbers that nobody knows bounds nothing.
    bound = np.where(std < alone / RESOLUTION, np.abs(values) + 2.0 * std, np.inf)
    # A limit that is never reached might be any larger one.
    bound[[u.place in _LIMITS for u in unknowns]] = np.inf
    together, others = (tuple(c for c in kept if c.determined == known) for known in (True, False))
    return Determination(verdicts, np.where(open_, np.inf, std), bound, together, others)


def _std(precision: Precision, free: Array) -> Array:
    return precision.scale[free] * np.sqrt(np.maximum(np.diag(precision.covariance(free)), 0.0))


def _held(unknowns: Sequence[Unknown], precision: Precision, allowed: Array, open_: Array, settled: Array) -> Array:
    """Which of the undetermined (p,) are held, so that those to be `settled` (p,) are determined beside them."""
    held: list[int] = []
    left = np.flatnonzero(settled).tolist()
    while left:
        if held and not _unsettled(precision, allowed, held, left):
            break
        held.append(_next(unknowns, precision, allowed, held, left, np.flatnonzero(open_).tolist()))
        left = [i for i in left if i not in held]
    return np.array(held, int)


def _unsettled(precision: Precision, allowed: Array, held: Sequence[int], left: Sequence[int]) -> int:
    """How many of those left are not determined beside the held."""
    free = np.setdiff1d(np.arange(len(allowed)), held)
    std = dict(zip(free.tolist(), _std(precision, free), strict=True))
    return sum(bool(std[i] > allowed[i]) for i in left if i not in held)


def _next(unknowns: Sequence[Unknown], precision: Precision, allowed: Array, held: list[int], left: list[int], among: list[int]) -> int:
    """Which is held next: that which leaves the fewest undetermined, then the first in the order of preference. One that is left is always
    settled by holding it, so that another is held only where it settles one as well."""

    def cost(i: int) -> tuple[int, int]:
        return _unsettled(precision, allowed, [*held, i], left), _HELD_FIRST.index(unknowns[i].place)

    return min((i for i in among if i not in held), key=cost)
