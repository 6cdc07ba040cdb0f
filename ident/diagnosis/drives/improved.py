"""Fits of models with something found, nearer to the best: sought from afar, and at weights of their own errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...drives.nearby import approached, refitted
from ...drives.residual import more_than_noise
from ...drives.search import begun, derivatives
from ...drives.starts import starts
from ...drives.stretches import shares, steadied
from .screening import Screened
from .trials import STEPS, Stage, gained


def from_afar(stage: Stage, ends: list[tuple[Screened, Stage]]) -> tuple[list[tuple[Screened, Stage]], bool]:
    """Models with a candidate each, sought from every start of a fit, where none of them leaves noise: what is missing bends the other
    unknowns, and the minimum next to bent ones may leave a part of it. `stage`: without any. And whether it may help again: where it did
    not, what is left is no matter of the search."""
    if any_leaves_noise(ends):
        return ends, True
    found = [(one, _from_afar(stage, after)) for one, after in ends]
    return found, any(after is not before for (_, after), (_, before) in zip(found, ends, strict=True))


def any_leaves_noise(ends: list[tuple[Screened, Stage]]) -> bool:
    """Whether some model with a candidate leaves no more than the noise of the readings."""
    return not all(more_than_noise(after.plant, after.fit) for _, after in ends)


def _from_afar(stage: Stage, after: Stage) -> Stage:
    plant, sizes, weights = after.plant, after.sizes, stage.fit.weights
    at = begun(plant, *starts(plant), narrower=after.fit.values[None])
    near = approached(plant, at, sizes, weights, derivatives(plant, at, sizes, np.arange(len(at))), steps=STEPS)
    if not gained(after.in_its_steps(), replace(after, fit=near)):
        return after
    found = refitted(plant, near.values, sizes, weights, near.slopes, steps=STEPS)
    return replace(after, fit=found) if found.cost < after.fit.cost else after


def reweighed(stage: Stage) -> Stage:
    """The same model with weights of its own errors, joint by joint, to which it is fitted: those of the model without what was found were
    small where that was, and leave the others' noise to be fitted with it. So were those of stretches that it explains."""
    plant, sizes, light = stage.plant, stage.sizes, shares(stage.plant, stage.fit.weights)
    rms = np.sqrt(np.sum(np.square(stage.fit.residual * light), axis=0) / np.maximum(np.sum(light**2, axis=0), 1))
    counted = (stage.fit.weights > 0) / np.maximum(rms, 1e-12)
    if not np.any((light > 0.0) & (light < 1.0)):
        return replace(stage, fit=refitted(plant, stage.fit.values, sizes, counted, stage.fit.slopes, steps=STEPS))
    near = approached(plant, stage.fit.values, sizes, counted, stage.fit.slopes, steps=STEPS)
    fit = steadied(plant, near, sizes)
    return replace(stage, fit=refitted(plant, near.values, sizes, counted, near.slopes, steps=STEPS) if fit is near else fit)
