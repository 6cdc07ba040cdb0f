"""Findings that others make needless, and searches from afar where the nearest minimum leaves more than noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...drives.plant import DrivePlant
from ...drives.residual import FORETOLD, left_over
from ...drives.search import fitted, refitted
from ...drives.starts import starts
from .result import DriveFinding
from .screening import Screened
from .trials import STEPS, Stage, gained


@dataclass(frozen=True, eq=False)
class Accepted:
    """A finding, with the candidate that it is of."""

    one: Screened
    finding: DriveFinding


def from_afar(stage: Stage, ends: list[tuple[Screened, Stage]]) -> list[tuple[Screened, Stage]]:
    """Models with a candidate each, sought from every start of a fit, where none of them leaves noise: what is missing bends the other
    unknowns, and the minimum next to bent ones may leave a part of it. `stage`: without any."""
    if any(left_over(after.plant, after.fit) <= FORETOLD for _, after in ends):
        return ends
    return [(one, _from_afar(stage, after)) for one, after in ends]


def _from_afar(stage: Stage, after: Stage) -> Stage:
    ends = fitted(after.plant, *starts(after.plant), narrower=after.fit.values[None])
    found = refitted(after.plant, ends.values, after.sizes, stage.fit.weights, steps=STEPS)
    return Stage(after.plant, found, after.sizes) if found.cost < after.fit.cost else after


def needed(declared: DrivePlant, now: Stage, accepted: Sequence[Accepted]) -> tuple[list[Accepted], Stage]:
    """Those of the accepted without which the fit is worse by as much as a finding has to gain, in the order in which they were found:
    what stood in for something that was found later goes. `declared`: the plant without any."""
    kept = list(accepted)
    for one in accepted[:-1]:
        rest = [other for other in kept if other is not one]
        without = _of(declared, now, rest)
        if not gained(without, now):
            kept, now = rest, without
    return kept, now


def _of(declared: DrivePlant, now: Stage, kept: Sequence[Accepted]) -> Stage:
    """The model with these alone, fitted from where all of them have ended."""
    plant = declared
    for other in kept:
        plant = other.one.candidate.added_to(plant, other.one.joints)
    at = {u.name: i for i, u in enumerate(now.plant.unknowns)}
    own = [at[u.name] for u in plant.unknowns]
    fit = refitted(plant, now.fit.values[own], now.sizes[own], now.fit.weights, steps=STEPS)
    return Stage(plant, fit, now.sizes[own])
