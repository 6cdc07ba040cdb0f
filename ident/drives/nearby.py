"""From a fit to one near by, with derivatives that are at hand: few simulations where a search takes many."""

from __future__ import annotations

import numpy as np

from .descent import TRIED, SimulatedSearch
from .plant import DrivePlant
from .search import Fitted
from .starts import expected

Array = np.ndarray
#: Derivatives are recomputed at most so many times: where a step reaches less than this share of the decrease that they predict.
_ANEW, _SHORT = 2, 0.3
#: Damping of the first step, and beyond which there is none that leads further.
_DAMPED, _STUCK = 1e-2, 1e6


def approached(
    plant: DrivePlant, values: Array, sizes: Array, weights: Array, slopes: Array, *, enough: float, steps: int = 10
) -> Fitted:  # fmt: skip
    """The fit nearest to `values` (p,), where the simulation has derivatives `slopes` (N, n, p).

    Each step simulates a few sets of unknowns, and corrects the derivatives by what it sees (Broyden, 1965). Ends where a step lowers the
    cost by less than `enough`."""
    measured = np.concatenate([log.q for log in plant.logs])
    search = SimulatedSearch(plant, measured, sizes, weights, *expected(plant))
    values = np.maximum(values, search.lower)
    (residual,) = search.residuals(values[None])
    cost = float(search.costs_of(values[None], residual[None])[0])
    scale = np.maximum(np.abs(values), sizes)
    damping, left, settled, used = _DAMPED, _ANEW, False, 0
    while used < steps and not settled and np.isfinite(cost):
        used += 1
        J = (slopes * weights[..., None]).reshape(-1, len(values))
        r = (residual * weights).reshape(-1)
        sets = np.stack([search.moved(values, J, r, factor) for factor in damping * TRIED])
        found = search.residuals(sets)
        costs = search.costs_of(sets, found)
        best = int(np.argmin(costs))
        gain, move = cost - float(costs[best]), sets[best] - values
        predicted = float(r @ r) - float(np.sum(np.square(r + J @ move)))
        if gain > 0.0:
            surprise = found[best] - residual - slopes @ move
            share = move / np.square(scale)
            slopes = slopes + surprise[..., None] * (share / max(float(share @ move), 1e-300))
            values, residual, cost = sets[best], found[best], float(costs[best])
            damping = max(1e-9, float(damping * TRIED[best]))
            scale = np.maximum(np.abs(values), sizes)
        if gain < _SHORT * predicted and predicted > enough and left:
            slopes, left = search.along(values, np.arange(len(values))), left - 1
        elif gain <= 0.0:
            damping *= 1e3
            settled = damping > _STUCK
        else:
            settled = gain < enough
    return Fitted(values, residual, slopes, weights, settled, used)
