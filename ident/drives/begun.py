"""What the integrals of drives begin a log with that no fit saw: read off its positions, as the first position and speed are."""

from __future__ import annotations

import numpy as np

from .._utils.singular_values import lstsq
from .descent import SETTLED, SimulatedSearch
from .plant import DrivePlant
from .starts import starts

Array = np.ndarray
#: Steps at most, and the shares of a step that are tried.
_STEPS, _SHARES = 15, np.array([1.0, 0.5, 0.2, 0.05])


def begun(plant: DrivePlant, values: Array) -> Array:
    """Values (p,) with what is NaN, of one log each, such that the log's simulated positions come nearest to the measured ones."""
    own = np.flatnonzero(np.isnan(values))
    if not len(own):
        return values
    at, sizes = starts(plant)
    values = np.where(np.isnan(values), at[0], values)
    measured = np.concatenate([log.q for log in plant.logs])
    search = SimulatedSearch(plant, measured, sizes, 1.0 / np.maximum(np.std(measured, axis=0), 1e-6) * np.ones_like(measured))
    (residual,) = search.residuals(values[None])
    for _ in range(_STEPS if np.isfinite(residual).all() else 0):
        J = (search.along(values, own) * search.weights[..., None]).reshape(-1, len(own))
        size = np.maximum(np.linalg.norm(J, axis=0), 1e-300)
        move = -lstsq(J / size, (residual * search.weights).reshape(-1), rcond=1e-8) / size
        sets = np.tile(values, (len(_SHARES), 1))
        sets[:, own] += _SHARES[:, None] * move
        found = search.residuals(sets)
        costs = np.nan_to_num(np.sum(np.square(found * search.weights), axis=(1, 2)), nan=np.inf)
        cost, best = float(np.sum(np.square(residual * search.weights))), int(np.argmin(costs))
        if not costs[best] < cost:
            break
        values, residual = sets[best], found[best]
        if costs[best] > (1.0 - SETTLED) * cost:
            break
    return values
