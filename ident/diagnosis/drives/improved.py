"""Fits of models with something found, nearer to the best: sought from afar, and at weights of their own errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...drives.residual import FORETOLD, left_over
from ...drives.search import fitted, refitted
from ...drives.starts import starts
from ...drives.stretches import shares, steadied
from .screening import Screened
from .trials import STEPS, Stage


def from_afar(stage: Stage, ends: list[tuple[Screened, Stage]]) -> tuple[list[tuple[Screened, Stage]], bool]:
    """Models with a candidate each, sought from every start of a fit, where none of them leaves noise: what is missing bends the other
    unknowns, and the minimum next to bent ones may leave a part of it. `stage`: without any. And whether it may help again: where it did
    not, what is left is no matter of the search."""
    if any(left_over(after.plant, after.fit) <= FORETOLD for _, after in ends):
        return ends, True
    found = [(one, _from_afar(stage, after)) for one, after in ends]
    return found, any(after is not before for (_, after), (_, before) in zip(found, ends, strict=True))


def _from_afar(stage: Stage, after: Stage) -> Stage:
    ends = fitted(after.plant, *starts(after.plant), narrower=after.fit.values[None])
    found = refitted(after.plant, ends.values, after.sizes, stage.fit.weights, steps=STEPS)
    better = np.sum(np.log(np.maximum(found.rms, 1e-12))) < np.sum(np.log(np.maximum(after.fit.rms, 1e-12)))
    return Stage(after.plant, found, after.sizes) if better else after


def reweighed(stage: Stage) -> Stage:
    """The same model with weights of its own errors, joint by joint, to which it is fitted: those of the model without what was found were
    small where that was, and leave the others' noise to be fitted with it. So were those of stretches that it explains."""
    plant, sizes, light = stage.plant, stage.sizes, shares(stage.plant, stage.fit.weights)
    rms = np.sqrt(np.sum(np.square(stage.fit.residual * light), axis=0) / np.maximum(np.sum(light**2, axis=0), 1))
    counted = (stage.fit.weights > 0) / np.maximum(rms, 1e-12)
    fit = refitted(plant, stage.fit.values, sizes, counted, steps=STEPS)
    return replace(stage, fit=steadied(plant, fit, sizes) if np.any((light > 0.0) & (light < 1.0)) else fit)
