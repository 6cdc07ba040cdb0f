"""What a candidate changes once everything else follows it, and whether that holds on readings for which nothing was adjusted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..._utils.singular_values import pinv
from ...drives.folds import held_out
from ...drives.nearby import approached
from ...drives.plant import DrivePlant, joined
from ...drives.search import Fitted, derivatives, refitted
from ...drives.uncertainty import Precision
from .candidates import values_in
from .screening import LEAST, SIGNIFICANT, Screened

Array = np.ndarray
#: Steps of a search that decides.
STEPS = 30
#: Share of the squared residual by which larger steps of time may change it, and the largest.
_UNCHANGED, _LARGEST = 1e-2, 2.5e-3
#: Share of the squared error that says more than its size in standard deviations, where what is left is no noise.
_LARGE = 0.1
#: Share of the squared residual that a step of a trial takes off at least.
_ENOUGH = 1e-4
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

    @property
    def spread(self) -> float:
        """Variance of the weighted residual, as large as its memory makes it count."""
        weighted = self.fit.residual * self.fit.weights
        count = max(int(np.count_nonzero(self.fit.weights)) - len(self.fit.values), 1)
        r = weighted.reshape(-1, weighted.shape[1])
        own: Array = np.sum(r * r, axis=0)
        ahead: Array = np.sum(r[1:] * r[:-1], axis=0) / np.maximum(own, 1e-300)
        share = float(np.clip(ahead, 0.0, 0.99).max())
        return float(np.sum(own)) / count * (1.0 + share) / (1.0 - share)

    def quickened(self) -> Stage:
        """The same in steps of time as large as leave its residual what it is, fitted in these."""
        period = min(log.period for log in self.plant.logs)
        step = max(self.plant.longest, min(0.5 * period, _LARGEST))
        plant = replace(self.plant, step=step)
        measured = np.concatenate([log.q for log in plant.logs])
        change = joined(plant.positions(self.fit.values))[0] - measured - self.fit.residual
        if not np.sum(np.square(change * self.fit.weights)) < _UNCHANGED * self.fit.cost:
            plant = self.plant
        near = approached(plant, self.fit.values, self.sizes, self.fit.weights, self.fit.slopes, enough=_ENOUGH * self.fit.cost)
        return replace(self, plant=plant, fit=near)


def tried(stage: Stage, one: Screened, inertia: Array) -> tuple[Screened, Stage] | None:
    """The model with a candidate, fitted with the weights of the one without, on those of its joints on which it counts then; None where
    nothing is gained."""
    while one.joints:
        after = _with(stage, one, inertia)
        counts = _counting(stage, one, after, _quick)
        if len(counts) == len(one.joints):
            return (one, after) if gained(stage, after) else None
        one = replace(one, joints=counts)
    return None


def gained(stage: Stage, after: Stage) -> bool:
    """Whether a model with more in it, fitted with the weights of the one without, is better by more than chance."""
    gain = stage.fit.cost - after.fit.cost
    return bool(np.isfinite(gain) and (gain > SIGNIFICANT**2 * after.spread or gain > _LARGE * stage.fit.cost))


def _with(stage: Stage, one: Screened, inertia: Array) -> Stage:
    """The model with a candidate on its joints, fitted."""
    wider = one.candidate.added_to(stage.plant, one.joints)
    at, sizes, own = values_in(wider, stage.plant, stage.fit.values, one.candidate, inertia)
    known = {u.name: i for i, u in enumerate(stage.plant.unknowns)}
    slopes = np.empty((*stage.fit.residual.shape, len(at)))
    slopes[..., ~own] = stage.fit.slopes[..., [known[u.name] for u, new in zip(wider.unknowns, own, strict=True) if not new]]
    slopes[..., own] = derivatives(wider, at, sizes, np.flatnonzero(own))
    found = approached(wider, at, sizes, stage.fit.weights, slopes, enough=_ENOUGH * stage.fit.cost)
    return Stage(wider, found, sizes)


def _counting(stage: Stage, one: Screened, after: Stage, deviations: Callable[[Stage], Array]) -> tuple[int, ...]:
    """The joints on which the candidate differs from what was declared by more than chance; `deviations`: standard ones (p,) of a fit."""
    place = one.candidate.place
    at = [i for i, u in enumerate(after.plant.unknowns) if u.place == place]
    # A spring has no number to start from, and a number for all joints is one: they count as a whole.
    if place == "joint_stiffness" or len(one.joints) == 1 or len(at) != len(one.joints) or not np.isfinite(after.fit.cost):
        return one.joints
    declared = np.array([one.candidate.declared(stage.plant.law, j) for j in one.joints])
    std = deviations(after)[at]
    # A limit that was none is one where it is reached, so that its value is known.
    none = np.where(np.any(after.fit.slopes[..., at] != 0.0, axis=(0, 1)), 0.0, after.fit.values[at])
    far = np.abs(after.fit.values[at] - np.where(np.isfinite(declared), declared, none)) > _COUNTS * std
    return tuple(j for j, counts in zip(one.joints, far, strict=True) if counts)


def _quick(after: Stage) -> Array:
    """Standard deviations (p,) by the derivatives at hand."""
    J = (after.fit.slopes * after.fit.weights[..., None]).reshape(-1, len(after.fit.values))
    size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
    return np.asarray(np.sqrt(after.spread * np.diag(pinv((J / size).T @ (J / size), rcond=1e-10, hermitian=True))) / size)


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


def settled(stage: Stage, one: Screened, after: Stage, step: float, inertia: Array) -> tuple[Screened, Stage]:
    """A candidate fitted to the end, in usual steps of time, with derivatives that intervals can be computed from, on those of its joints
    on which it counts then: what large steps of time change may seem a difference of a joint that has none.

    `stage`: without it; `after`: with it."""
    while True:
        plant = replace(after.plant, step=step)
        after = replace(after, plant=plant, fit=refitted(plant, after.fit.values, after.sizes, after.fit.weights, steps=STEPS))
        counts = _counting(stage, one, after, _final)
        if not counts or len(counts) == len(one.joints):
            return one, after
        one = replace(one, joints=counts)
        after = _with(stage, one, inertia)
        one = next((found for found, _ in believed(stage, [(one, after)])), one)
