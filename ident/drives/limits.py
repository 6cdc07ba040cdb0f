"""Limits of the drives' torque that nothing in the logs speaks for: beyond where one is reached it may be any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .nearby import refitted
from .plant import DrivePlant
from .search import Fitted
from .starts import largest_asked

Array = np.ndarray
#: Standard deviations by which a fit is better with something that is there, where what it is was sought.
SEEN = 4.5
#: What stands for none, in times the largest torque that a log asks for.
_NONE = 1e3


def without_unreached(plant: DrivePlant, fit: Fitted, sizes: Array) -> Fitted:
    """The fit, with limits without which it is as good out of reach. `sizes` (p,): usual sizes of the unknowns."""
    stiff = fit.values[[u.place == plant.law.gain for u in plant.unknowns]]
    gain = np.where(np.isnan(plant.law.constants[plant.law.gain]), float(np.max(stiff, initial=0.0)), plant.law.constants[plant.law.gain])
    most = largest_asked(plant, gain)
    for i, unknown in enumerate(plant.unknowns):
        if unknown.place != "effort_limit" or unknown.joint < 0:
            continue
        others = np.arange(len(fit.values)) != i
        free = refitted(_unlimited(plant, unknown.joint), fit.values[others], sizes[others], fit.weights, fit.slopes[..., others])
        if free.cost - fit.cost < SEEN**2 * fit.spread:
            values, slopes = np.empty(len(others)), np.zeros((*fit.residual.shape, len(others)))
            values[others], slopes[..., others] = free.values, free.slopes
            values[i] = _NONE * max(float(most[unknown.joint]), 1e-3)
            fit = replace(free, values=values, slopes=slopes)
    return fit


def _unlimited(plant: DrivePlant, joint: int) -> DrivePlant:
    """The plant without a limit of one joint that is to be identified."""
    limits = plant.law.constants["effort_limit"].copy()
    limits[joint] = np.inf
    return replace(plant, law=replace(plant.law, constants={**plant.law.constants, "effort_limit": limits}))
