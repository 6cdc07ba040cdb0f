"""What a candidate changes once everything else follows it, and whether that holds on readings for which nothing was adjusted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..._utils.singular_values import pinv
from ...drives.folds import held_out
from ...drives.nearby import approached, refitted
from ...drives.plant import DrivePlant, joined
from ...drives.search import Fitted, derivatives
from ...drives.uncertainty import Precision
from .candidates import values_in
from .screening import LEAST, SIGNIFICANT, Screened

Array = np.ndarray
#: Fits a plant from where a wider one has ended, of whose unknowns it has some (numbers).
Refit = Callable[[DrivePlant, "Stage", list[int]], Fitted]
#: Steps of a search that decides.
STEPS = 30
#: Share of the squared residual by which larger steps of time may change it, and the largest.
_UNCHANGED, _LARGEST = 1e-2, 2.5e-3
#: Share of the squared error that says more than its size in standard deviations, where what is left is no noise.
_LARGE = 0.1
#: Standard deviations by which a candidate on a joint differs from what was declared, where it counts there.
_COUNTS = 3.0
#: So many of the best are held against readings that they were not fitted to.
_CONFIRMED = 2


@dataclass(frozen=True, eq=False)
class Stage:
    """A model with its fit; `sizes` (p,) of its unknowns."""

    plant: DrivePlant
    fit: Fitted
    sizes: Array

    def in_its_steps(self) -> Stage:
        """The same with its residual in the plant's steps of time: what a fit ends with is of smaller ones."""
        measured = np.concatenate([log.q for log in self.plant.logs])
        return replace(self, fit=replace(self.fit, residual=joined(self.plant.positions(self.fit.values))[0] - measured))

    def quickened(self) -> Stage:
        """The same in steps of time as large as leave its residual what it is, fitted in these."""
        period = min(log.period for log in self.plant.logs)
        step = max(self.plant.longest, min(0.5 * period, _LARGEST))
        plant = replace(self.plant, step=step)
        measured = np.concatenate([log.q for log in plant.logs])
        change = joined(plant.positions(self.fit.values))[0] - measured - self.fit.residual
        if not np.sum(np.square(change * self.fit.weights)) < _UNCHANGED * self.fit.cost:
            plant = self.plant
        near = approached(plant, self.fit.values, self.sizes, self.fit.weights, self.fit.slopes)
        return replace(self, plant=plant, fit=near)


def tried(stage: Stage, one: Screened, inertia: Array) -> tuple[Screened, Stage] | None:
    """The model with a candidate, fitted with the weights of the one without, on those of its joints on which it counts then; None where
    nothing is gained."""
    while one.joints:
        after = with_candidate(stage, one, inertia)
        counts = _counting(stage, one, after, _quick, _approached)
        if len(counts) == len(one.joints):
            return (one, after) if gained(stage, after) else None
        one = replace(one, joints=counts)
    return None


def gained(stage: Stage, after: Stage) -> bool:
    """Whether a model with more in it, fitted with the weights of the one without, is better by more than chance."""
    gain = stage.fit.cost - after.fit.cost
    return bool(np.isfinite(gain) and (gain > SIGNIFICANT**2 * after.fit.spread or gain > _LARGE * stage.fit.cost))


def with_candidate(stage: Stage, one: Screened, inertia: Array) -> Stage:
    """The model with a candidate on its joints, fitted."""
    wider = one.candidate.added_to(stage.plant, one.joints)
    at, sizes, own = values_in(wider, stage.plant, stage.fit.values, one.candidate, inertia)
    known = {u.name: i for i, u in enumerate(stage.plant.unknowns)}
    slopes = np.empty((*stage.fit.residual.shape, len(at)))
    slopes[..., ~own] = stage.fit.slopes[..., [known[u.name] for u, new in zip(wider.unknowns, own, strict=True) if not new]]
    slopes[..., own] = derivatives(wider, at, sizes, np.flatnonzero(own))
    found = approached(wider, at, sizes, stage.fit.weights, slopes)
    return Stage(wider, found, sizes)


def _counting(stage: Stage, one: Screened, after: Stage, deviations: Callable[[Stage], Array], refit: Refit) -> tuple[int, ...]:
    """The joints on which the candidate differs from what was declared by more than chance; `deviations`: standard ones (p,) of a fit;
    `refit`: how one without it is fitted."""
    place = one.candidate.place
    if one.candidate.far and place != "joint_stiffness":
        # Beyond where it is reached a limit may be any: what is none there loses nothing.
        return tuple(j for j in one.joints if gained(_without(stage, one, after, j, refit), after))
    at = [i for i, u in enumerate(after.plant.unknowns) if u.place == place]
    # A spring has no number to start from, and a number for all joints is one: they count as a whole.
    if place == "joint_stiffness" or len(one.joints) == 1 or len(at) != len(one.joints) or not np.isfinite(after.fit.cost):
        return one.joints
    declared = np.array([one.candidate.declared(stage.plant.law, j) for j in one.joints])
    far = np.abs(after.fit.values[at] - declared) > _COUNTS * deviations(after)[at]
    return tuple(j for j, counts in zip(one.joints, far, strict=True) if counts)


def _without(stage: Stage, one: Screened, after: Stage, joint: int, refit: Refit) -> Stage:
    """The model with a candidate on its other joints only."""
    others = [j for j in one.joints if j != joint]
    plant = one.candidate.added_to(replace(stage.plant, step=after.plant.step), others) if others else stage.plant
    at = [[u.name for u in after.plant.unknowns].index(u.name) for u in plant.unknowns]
    return Stage(plant, refit(plant, after, at), after.sizes[at])


def _approached(plant: DrivePlant, after: Stage, at: list[int]) -> Fitted:
    return approached(plant, after.fit.values[at], after.sizes[at], after.fit.weights, after.fit.slopes[..., at])


def _refitted(plant: DrivePlant, after: Stage, at: list[int]) -> Fitted:
    return refitted(plant, after.fit.values[at], after.sizes[at], after.fit.weights, after.fit.slopes[..., at], steps=STEPS)


def _quick(after: Stage) -> Array:
    """Standard deviations (p,) by the derivatives at hand."""
    J = (after.fit.slopes * after.fit.weights[..., None]).reshape(-1, len(after.fit.values))
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    return np.asarray(np.sqrt(after.fit.spread * np.diag(pinv((J / size).T @ (J / size), rcond=1e-10, hermitian=True))) / size)


def _final(after: Stage) -> Array:
    """Standard deviations (p,) as a result has them."""
    precision = Precision.of(after.fit, np.maximum(np.abs(after.fit.values), after.sizes))
    variances = np.diag(precision.covariance(np.arange(len(after.fit.values))))
    return np.asarray(precision.scale * np.sqrt(np.maximum(variances, 0.0)))


def believed(stage: Stage, found: list[tuple[Screened, Stage]]) -> list[tuple[Screened, Stage]]:
    """Those that do better on readings held out, the best of the rest first, with what they take off those: nothing else is believed."""
    counts, out = np.square(stage.fit.weights), []
    before = np.nansum(held_out(stage.plant, stage.fit, stage.sizes).squares * counts) if found else 0.0
    for one, after in sorted(found, key=lambda pair: pair[1].fit.cost):
        left = np.nansum(held_out(after.plant, after.fit, after.sizes).squares * counts)
        gain = float(1.0 - left / max(before, 1e-300))
        if np.isfinite(gain) and gain > LEAST:
            out.append((replace(one, gain=gain), after))
        if len(out) == _CONFIRMED:
            break
    return out


def settled(stage: Stage, one: Screened, after: Stage, step: float, inertia: Array) -> tuple[Screened, Stage] | None:
    """A candidate fitted to the end, in usual steps of time, with derivatives that intervals can be computed from, on those of its joints
    on which it counts then: what large steps of time change may seem a difference of a joint that has none. None where it counts on none.

    `stage`: without it; `after`: with it."""
    while True:
        plant = replace(after.plant, step=step)
        after = replace(after, plant=plant)
        after = replace(after, fit=_refitted(plant, after, list(range(len(after.sizes)))))
        counts = _counting(stage, one, after, _final, _refitted)
        if not counts:
            return None
        if len(counts) == len(one.joints):
            return one, after
        one = replace(one, joints=counts)
        after = with_candidate(stage, one, inertia)
        one = next((found for found, _ in believed(stage, [(one, after)])), one)
