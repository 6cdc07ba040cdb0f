"""Sums and ratios of unknowns that a log cannot tell apart: which of them it determines, and how they are written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .uncertainty import Precision
from .unknowns import Unknown, follows_torque

Array = np.ndarray
#: A value whose standard deviation is more than this share of it is not determined.
SHARE = 0.3
#: Coefficients that differ from a round one by less than this are that one.
_ROUND = 0.03
#: A member whose usual size moves the value of a sum by less than this share is left out of it.
_PART = 0.05
#: Units of a scale of torque that is the torque of a voltage.
_PER_VOLT = ("N m/V", "N/V")


@dataclass(frozen=True)
class Combination:
    """Several unknowns together. `members`: their names; `separated_by`: the log that would tell them apart; `determined`: whether the
    logs tell its value, and not only a bound on it; `adds`: whether it is a sum, all of which its first member could be."""

    expression: str
    value: float
    std: float
    unit: str
    members: tuple[str, ...]
    separated_by: str
    determined: bool = True
    adds: bool = False

    @property
    def below(self) -> float:
        """Up to where its interval reaches."""
        return abs(self.value) + 2.0 * self.std


@dataclass(frozen=True, eq=False)
class Joined:
    """What is known of unknowns of which some are `held` (h,) and the `free` (f,) have standard deviations `std` (f,) beside them.

    `values`, `sizes`, `full` (p,): values, usual sizes, standard deviations with nothing held; `floor` (p,): precision that is enough
    whatever the value is."""

    unknowns: Sequence[Unknown]
    values: Array
    sizes: Array
    full: Array
    floor: Array
    free: Array
    held: Array
    std: Array

    def combinations(self, precision: Precision, asked: Array) -> tuple[Combination, ...]:
        """Those of the `asked` (p,) among the free that depend on the held."""
        if not len(self.held):
            return ()
        shares = precision.regrouped(self.free, self.held)
        shares = shares * precision.scale[self.free][:, None] / precision.scale[self.held]
        found = (self._of(int(i), row, float(std)) for i, row, std in zip(self.free, shares, self.std, strict=True) if asked[i])
        return tuple(one for one in found if one is not None)

    def _of(self, i: int, row: Array, std: float) -> Combination | None:
        """Of free unknown `i`, which takes over `row` (h,) of each held one: as a sum, or as a ratio where that is better known."""
        terms = self._terms(i, row)
        options = [self._ratio(i, row, terms, std, int(k)) for k in self._divisors(terms)]
        if terms:
            options.insert(0, self._sum(i, row, terms, std))
        if not options:
            return None
        known = [one for one in options if one.determined]
        return min(known, key=lambda one: one.std / max(abs(one.value), 1e-300)) if known else options[0]

    def _terms(self, i: int, row: Array) -> dict[int, float]:
        """Position among the held → coefficient, of those that belong to a sum. One whose value happens to be next to nothing does as
        well: it might be another, and all of the sum where they are exchanged one for one."""
        near = [k for k, h in enumerate(self.held) if _alike(self.unknowns[i], self.unknowns[h])]
        whole = max([abs(self.values[i]), *(abs(row[k] * self.values[self.held[k]]) for k in near)])
        found = {}
        for k in near:
            h = self.held[k]
            plain = self.unknowns[h].unit == self.unknowns[i].unit and abs(abs(row[k]) - 1.0) < _ROUND
            if plain or abs(row[k]) * self.sizes[h] > _PART * whole:
                found[k] = float(np.sign(row[k])) if plain else float(row[k])
        return found

    def _divisors(self, terms: dict[int, float]) -> list[int]:
        """Positions among the held by which a ratio may be taken: positive numbers that grow with a torque."""
        found = []
        for k, h in enumerate(self.held):
            one = self.unknowns[h]
            grows = follows_torque(one, one.place) and one.lower >= 0.0 and self.values[h] > 0.0
            if grows and (k in terms or one.scale):
                found.append(k)
        return found

    def _sum(self, i: int, row: Array, terms: dict[int, float], std: float) -> Combination:
        printed = np.zeros(len(self.held))
        printed[list(terms)] = list(terms.values())
        value = self.values[i] + float(printed @ self.values[self.held])
        text = _text(self.unknowns[i], [(c, self.unknowns[self.held[k]]) for k, c in terms.items()])
        members = [i, *(int(self.held[k]) for k in terms)]
        one = self._named(text, value, self._std(row, printed, std), self.unknowns[i].unit, members, self.floor[i])
        return replace(one, adds=all(_leaves(self.unknowns[self.held[k]].lower, c) for k, c in terms.items()))

    def _ratio(self, i: int, row: Array, terms: dict[int, float], std: float, divisor: int) -> Combination:
        """What grows with the divisor is divided by it; a delay or a share of torque stands beside."""
        by, unit = self.unknowns[self.held[divisor]], self.unknowns[i].unit
        others = {k: c for k, c in terms.items() if k != divisor}
        above = {k: c for k, c in others.items() if follows_torque(self.unknowns[self.held[k]], by.place)}
        scale = float(self.values[self.held[divisor]])
        top = self.values[i] + sum(c * self.values[self.held[k]] for k, c in above.items())
        beside = {k: c / scale for k, c in others.items() if k not in above}
        printed = np.zeros(len(self.held))
        printed[list(others)] = list(others.values())
        printed[divisor] = -top / scale
        value = top / scale + sum(c * self.values[self.held[k]] for k, c in beside.items())
        text = _text(self.unknowns[i], [(c, self.unknowns[self.held[k]]) for k, c in above.items()])
        text = f"({text}) / {by.name}" if " " in text else f"{text} / {by.name}"
        text += _added([(c, self.unknowns[self.held[k]]) for k, c in beside.items()])
        members = [i, *(int(self.held[k]) for k in (*others, divisor))]
        return self._named(
            text, value, self._std(row, printed, std) / scale, unit if by.unit == "1" else f"{unit} / ({by.unit})", members, 0.0
        )

    def _std(self, row: Array, printed: Array, std: float) -> float:
        """Of what is printed: coefficients (h,) other than those of `row` let in what is not known of the held."""
        doubt = np.minimum(self.full[self.held], self.sizes[self.held])
        return float(np.sqrt(std**2 + np.sum(np.square((printed - row) * doubt))))

    def _named(self, text: str, value: float, std: float, unit: str, members: list[int], floor: float) -> Combination:
        named = [self.unknowns[m] for m in members]
        determined = bool(std <= max(SHARE * abs(value), floor))
        return Combination(text, float(value), std, unit, tuple(u.name for u in named), separated_by(named), determined)


def _leaves(lower: float, coefficient: float) -> bool:
    """Whether a member of a sum, with its lower bound, may leave all of it to the first: it adds something that may be nothing, or is
    exchanged one for one whatever its sign is."""
    return coefficient > 0.0 if lower >= 0.0 else abs(coefficient) == 1.0


def _alike(one: Unknown, other: Unknown) -> bool:
    """Whether two unknowns can stand in one sum: of one joint, or of all."""
    return one.joint == other.joint or min(one.joint, other.joint) < 0


def _text(first: Unknown, terms: Sequence[tuple[float, Unknown]]) -> str:
    return (first.expression or first.name) + _added(terms)


def _added(terms: Sequence[tuple[float, Unknown]]) -> str:
    text = ""
    for coefficient, unknown in terms:
        size = "" if abs(coefficient) == 1.0 else f"{abs(coefficient):.3g} "
        text += f" {'+' if coefficient > 0 else '-'} {size}{unknown.name}"
    return text


def separated_by(members: Sequence[Unknown]) -> str:
    """The further log or number that would tell the members of a combination apart."""
    places = {u.place for u in members}
    advice = []
    if any(u.place == "kd" and not u.scale for u in members):
        advice.append("kd from the drive's settings, a log with another kd, or a log in which the velocity command dq_cmd varies")
    if any(u.place == "torque_scale" and u.unit in _PER_VOLT for u in members) and "kp" not in places:
        advice.append(
            "torque_scale (torque constant over winding resistance) from the data sheet, a log with a known mass added (load in"
            " [drive.by_log]), or one with current or torque"
        )
    elif scales := sorted({u.place for u in members if u.scale}):
        scale = scales[0]
        advice.append(
            f"{scale} from the drive's settings, a log with a known mass added (load in [drive.by_log]), or one with current or torque"
        )
    if {"back_emf", "viscous"} <= places:
        advice.append("free swings with the torque switched off (torque_enable 0)")
    if places & {"delay_s", "command_lag_s"}:
        advice.append("step commands, or commands of a wider bandwidth")
    if "deadband" in places:
        advice.append("deadband from the drive's settings, or larger and faster motion")
    if "integral_start" in places:
        advice.append("a log that begins where the drive is switched on, with integral_start = 0")
    if "link" in places or ("offset" in places and "integral_start" not in places):
        advice.append("motion in other postures")
    return "; ".join(advice) or "faster and slower motion, steps, and other postures"
