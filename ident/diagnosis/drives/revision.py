"""What was found, looked at again beside what was found later: findings that are not needed any more, and what explains as much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...drives.nearby import approached, refitted
from ...drives.plant import DrivePlant
from ...drives.search import derivatives
from ...drives.starts import starts
from .result import DriveFinding
from .screening import Screened
from .trials import STEPS, Stage, gained, with_candidate

Array = np.ndarray
#: Squared standard deviations below which one model is as good as another.
ALIKE = 9.0


@dataclass(frozen=True, eq=False)
class Accepted:
    """A finding, with the candidate that it is of, and those that explained as much when it was found."""

    one: Screened
    finding: DriveFinding
    rivals: tuple[Screened, ...] = ()


def needed(declared: DrivePlant, now: Stage, accepted: Sequence[Accepted]) -> tuple[list[Accepted], Stage]:
    """Those of the accepted without which the fit is worse by as much as a finding has to gain, in the order in which they were found:
    what stood in for something that was found later goes, and what is nothing at the weights of all. `declared`: the plant without any."""
    kept = list(accepted)
    for one in accepted:
        rest = [other for other in kept if other is not one]
        # A few steps end no lower than a search does: what they show to be needless is.
        if not gained(_near(_with(declared, rest), now), now.in_its_steps()):
            kept, now = rest, _of(declared, now, rest)
    return kept, now


def _near(plant: DrivePlant, now: Stage) -> Stage:
    """A model, a few steps from where one with more in it has ended."""
    at = _begun(plant, now)
    return replace(at, fit=approached(plant, at.fit.values, at.sizes, now.fit.weights, at.fit.slopes, steps=STEPS))


def _begun(plant: DrivePlant, now: Stage) -> Stage:
    """A model where one with more in it has ended. What that one has not (a spring's torque at zero, for which an offset stood) is none."""
    known = {u.name: i for i, u in enumerate(now.plant.unknowns)}
    own = np.array([u.name in known for u in plant.unknowns])
    at = [known[u.name] for u in plant.unknowns if u.name in known]
    _, sizes = starts(plant)
    values, slopes = np.zeros(len(own)), np.empty((*now.fit.residual.shape, len(own)))
    values[own], sizes[own], slopes[..., own] = now.fit.values[at], now.sizes[at], now.fit.slopes[..., at]
    if not own.all():
        slopes[..., ~own] = derivatives(plant, values, sizes, np.flatnonzero(~own))
    return Stage(plant, replace(now.fit, values=values, slopes=slopes), sizes)


def with_rivals(declared: DrivePlant, now: Stage, accepted: Sequence[Accepted], inertia: Array) -> list[Accepted]:
    """The accepted with those of their rivals that still explain as much beside all that was found later. `inertia` (n,): what each joint
    moves, kg m²."""
    if len(accepted) < 2:
        return list(accepted)
    out, names = [], {one.finding.effect for one in accepted}
    for one in accepted:
        tried = [rival for rival in one.rivals if rival.candidate.name not in names]
        gone = {rival.candidate.name for rival in one.rivals} - {rival.candidate.name for rival in tried}
        if tried:
            without = _of(declared, now, [other for other in accepted if other is not one])
            for rival in tried:
                beside = with_candidate(without, rival, inertia)
                found = refitted(beside.plant, beside.fit.values, beside.sizes, now.fit.weights, beside.fit.slopes, steps=STEPS)
                if not found.cost - now.fit.cost < ALIKE * now.fit.spread:
                    gone.add(rival.candidate.name)
        left = tuple(rival for rival in one.finding.rivals if rival.effect not in gone)
        whole = one.finding.confidence + sum(rival.confidence for rival in left)
        told = replace(one.finding, rivals=left, confidence=one.finding.confidence / max(whole, 1e-300)) if gone else one.finding
        out.append(replace(one, finding=told))
    return out


def _of(declared: DrivePlant, now: Stage, kept: Sequence[Accepted]) -> Stage:
    """The model with these alone, fitted from where all of them have ended."""
    plant = _with(declared, kept)
    at = _begun(plant, now)
    return replace(at, fit=refitted(plant, at.fit.values, at.sizes, now.fit.weights, at.fit.slopes, steps=STEPS))


def _with(declared: DrivePlant, kept: Sequence[Accepted]) -> DrivePlant:
    """The declared plant with these in it."""
    plant = declared
    for other in kept:
        plant = other.one.candidate.added_to(plant, other.one.joints)
    return plant
