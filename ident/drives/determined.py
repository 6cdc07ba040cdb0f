"""What a log determines: unknowns with an interval, sums and ratios of those that it cannot tell apart, and what it does not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from .uncertainty import Precision
from .unknowns import Unknown

Array = np.ndarray
#: A value whose standard deviation is more than this share of it is not determined.
SHARE = 0.3
#: Where unknowns trade with each other, these are held first: what stays is then named after the physics, not after the drive.
_HELD_FIRST = (
    "feed_forward", "kd", "kp", "torque_scale", "back_emf", "delay_s", "joint_damping", "joint_stiffness", "slow_speed", "gear_loss_slow",
    "gear_loss_square", "gear_loss", "spring", "excess", "load", "effort_limit", "offset", "armature", "viscous", "dry", "link",
)  # fmt: skip
#: Coefficients that differ from a round one by less than this are that one.
_ROUND = 0.03
#: A member of a sum whose usual size moves its value by less than this share is left out of it.
_PART = 0.05
_SCALES = ("kp", "torque_scale")


class Standing(StrEnum):
    """Of one unknown: has a value; has one together with others only; shows too little for a value of its own."""

    DETERMINED = "determined"
    CONFOUNDED = "confounded"
    UNSEEN = "unseen"


@dataclass(frozen=True)
class Combination:
    """What is determined of several unknowns together. `members`: their names; `separated_by`: the log that would tell them apart."""

    expression: str
    value: float
    std: float
    unit: str
    members: tuple[str, ...]
    separated_by: str


@dataclass(frozen=True, eq=False)
class Determination:
    """Standing and standard deviation (inf where not determined) of each unknown, what is determined together, and bounds on the unseen."""

    verdicts: tuple[Standing, ...]
    std: Array
    below: Array
    combinations: tuple[Combination, ...]


def determination(unknowns: Sequence[Unknown], values: Array, precision: Precision, period: float) -> Determination:
    """Decide by intervals: round-off would call what is merely badly conditioned determined.

    `values` (p,); `period`: seconds between samples, of which a delay is to be known to a third."""
    everything = list(range(len(values)))
    allowed = SHARE * np.abs(values)
    for i, unknown in enumerate(unknowns):
        if unknown.place == "delay_s":
            allowed[i] = max(allowed[i], SHARE * period)
    std = _std(precision, np.array(everything))
    alone = np.array([_std(precision, np.array([i]))[0] for i in everything])
    open_ = std > allowed
    unseen = open_ & (alone > allowed)
    held: list[int] = []
    left = [i for i in everything if open_[i] and not unseen[i]]
    while left and not _settled(precision, allowed, held, left):
        held.append(_next(unknowns, precision, allowed, held, left))
        left = [i for i in left if i not in held]
    free = np.array([i for i in everything if i not in held])
    conditional = np.full(len(values), np.inf)
    conditional[free] = _std(precision, free)
    combinations, grouped = _combinations(unknowns, values, precision, free, held, open_ & ~unseen, conditional, allowed)
    verdicts = [
        Standing.DETERMINED if not open_[i] else Standing.CONFOUNDED if i in grouped or (i in held and not unseen[i]) else Standing.UNSEEN
        for i in everything
    ]
    # Of what no combination holds: up to where the interval reaches while the confounded are held.
    reach = np.where(np.isfinite(conditional), conditional, alone)
    below = np.abs(values) + 2.0 * np.maximum(reach, 0.0)
    return Determination(tuple(verdicts), np.where(open_, np.inf, std), below, combinations)


def _std(precision: Precision, free: Array) -> Array:
    return precision.scale[free] * np.sqrt(np.maximum(np.diag(precision.covariance(free)), 0.0))


def _settled(precision: Precision, allowed: Array, held: list[int], left: list[int]) -> bool:
    """Whether what is left is determined once the held are known."""
    free = np.array([i for i in range(len(allowed)) if i not in held])
    std = dict(zip(free.tolist(), _std(precision, free), strict=True))
    return bool(held) and all(std[i] <= allowed[i] for i in left)


def _next(unknowns: Sequence[Unknown], precision: Precision, allowed: Array, held: list[int], left: list[int]) -> int:
    """Which of the undetermined is held next: that which leaves the fewest undetermined, then the first in the order of preference."""

    def cost(i: int) -> tuple[float, int]:
        free = np.array([k for k in range(len(allowed)) if k not in held and k != i])
        std = dict(zip(free.tolist(), _std(precision, free), strict=True))
        # A step of the search that helps a little counts as well where nothing is settled by one alone.
        still = [min(float(std[k] / max(allowed[k], 1e-300)), 1e3) for k in left if k != i and std[k] > allowed[k]]
        return float(len(still)), _HELD_FIRST.index(unknowns[i].place)

    return min(left, key=cost)


def _combinations(
    unknowns: Sequence[Unknown],
    values: Array,
    precision: Precision,
    free: Array,
    held: list[int],
    asked: Array,
    conditional: Array,
    allowed: Array,
) -> tuple[tuple[Combination, ...], set[int]]:
    if not held:
        return (), set()
    share = precision.regrouped(free, np.array(held))
    # A member whose value happens to be next to nothing belongs to a sum as well: it might be another.
    reach = np.maximum(precision.scale, allowed)
    found, grouped = [], set[int]()
    for row, i in zip(share, free, strict=True):
        if not asked[i]:
            continue
        terms, divisor = [], -1
        for amount, h in zip(row, held, strict=True):
            coefficient = float(amount) * precision.scale[i] / precision.scale[h]
            part = coefficient * values[h] / values[i] if values[i] else 0.0
            if unknowns[h].place in _SCALES and abs(part + 1.0) < 0.1:
                divisor = h
            elif abs(coefficient) * reach[h] > _PART * abs(values[i]) and _alike(unknowns[i], unknowns[h]):
                plain = unknowns[h].unit == unknowns[i].unit and abs(coefficient - 1.0) < _ROUND
                terms.append((h, 1.0 if plain else coefficient))
        if not terms and divisor < 0:
            continue
        members = [i, *(h for h, _ in terms), *([divisor] if divisor >= 0 else [])]
        grouped |= {int(m) for m in members}
        value = values[i] + sum(c * values[h] for h, c in terms)
        scale = values[divisor] if divisor >= 0 else 1.0
        named = [unknowns[m] for m in members]
        unit = unknowns[i].unit if divisor < 0 else f"{unknowns[i].unit} / ({unknowns[divisor].unit})"
        text, names = _expression(unknowns, int(i), terms, divisor), tuple(u.name for u in named)
        std = float(conditional[i] / abs(scale))
        found.append(Combination(text, float(value / scale), std, unit, names, separated_by(named)))
    return tuple(found), grouped


def _alike(one: Unknown, other: Unknown) -> bool:
    """Whether two unknowns can stand in one sum: of one joint, or of all."""
    return one.joint == other.joint or min(one.joint, other.joint) < 0


def _expression(unknowns: Sequence[Unknown], i: int, terms: list[tuple[int, float]], divisor: int) -> str:
    text = unknowns[i].expression or unknowns[i].name
    for h, coefficient in terms:
        sign = "+" if coefficient > 0 else "-"
        size = "" if abs(coefficient) == 1.0 else f"{abs(coefficient):.3g} "
        text += f" {sign} {size}{unknowns[h].name}"
    if divisor < 0:
        return text
    return f"({text}) / {unknowns[divisor].name}" if " " in text else f"{text} / {unknowns[divisor].name}"


def separated_by(members: Sequence[Unknown]) -> str:
    """The further log or number that would tell the members of a combination apart."""
    places = {u.place for u in members}
    advice = []
    if {"kd", "viscous"} <= places or ("kd" in places and not places & {"viscous"}):
        advice.append("kd from the drive's settings, a log with another kd, or a log in which the velocity command dq_cmd varies")
    if places & set(_SCALES):
        advice.append("kp from the drive's settings, a log with a known mass added, or one with current or torque")
    if {"back_emf", "viscous"} <= places:
        advice.append("free swings with the torque switched off (torque_enable 0)")
    if "delay_s" in places:
        advice.append("step commands, or commands of a wider bandwidth")
    if "offset" in places or "link" in places:
        advice.append("motion in other postures")
    return "; ".join(advice) or "faster and slower motion, steps, and other postures"
