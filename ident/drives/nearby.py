"""From a fit to one near by, with derivatives that are at hand: few simulations where a search takes many."""

from __future__ import annotations

import numpy as np

from .descent import SETTLED, TRIED, SimulatedSearch
from .plant import DrivePlant
from .search import NEAR, Fitted
from .starts import expected

Array = np.ndarray
#: Derivatives are recomputed at most so many times: where a step reaches less than this share of the decrease that they predict.
_ANEW, _SHORT = 2, 0.3
#: Derivatives along so few unknowns cost no more than a step does: they are made anew in each. Where a joint comes to rest, what steps show
#: is rough, and derivatives that were corrected by it end in a valley beside.
_FEW = 2 * len(TRIED)
#: Damping of the first step, and beyond which there is none that leads further.
_DAMPED, _STUCK = 1e-2, 1e6
#: A step that lowers the cost by less than this share ends the way to a fit near by.
_ENOUGH = 1e-4
#: So much of what chance makes of the cost by one unknown is not worth a step.
_HARDLY = 1e-2


def approached(plant: DrivePlant, values: Array, sizes: Array, weights: Array, slopes: Array, *, steps: int = 10) -> Fitted:
    """The fit nearest to `values` (p,), where the simulation has derivatives `slopes` (N, n, p).

    Each step simulates a few sets of unknowns, and corrects the derivatives by what it sees (Broyden, 1965); of few unknowns it makes
    them anew. Ends where a step lowers the cost by next to nothing."""
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
        if gain > 0.0 and len(values) <= _FEW:
            slopes = search.along(values, np.arange(len(values)))
        if gain < _SHORT * predicted and predicted > _ENOUGH * cost and left and len(values) > _FEW:
            slopes, left = search.along(values, np.arange(len(values))), left - 1
        elif gain <= 0.0:
            damping *= 1e3
            settled = damping > _STUCK
        else:
            settled = gain < _ENOUGH * cost
    return Fitted(values, residual, slopes, weights, settled, used)


def refitted(plant: DrivePlant, values: Array, sizes: Array, weights: Array, slopes: Array, *, steps: int = 15) -> Fitted:
    """From near values (p,) on, where the simulation has derivatives `slopes` (N, n, p), with weights (N, n) that stay, as a fit ends:
    costs of several models are then of one kind.

    The search ends where a step gains little of what chance does: a residual that remembers says no more than its memory leaves."""
    near = approached(plant, values, sizes, weights, slopes, steps=steps)
    measured = np.concatenate([log.q for log in plant.logs])
    search = SimulatedSearch(plant, measured, sizes, weights, *expected(plant))
    little = float(np.clip(_HARDLY * near.spread / max(near.cost, 1e-300), SETTLED, NEAR))
    values, _, settled, used = search.run(near.values, steps, little)
    values, residual, slopes = search.fine().precise().ended(values)
    return Fitted(values, residual, slopes, weights, settled, used)


def followed(
    plant: DrivePlant, values: Array, sizes: Array, weights: Array, *, steps: int, apart: Array | float = 0.0
) -> tuple[float, Array]:  # fmt: skip
    """Cost and values (p,) after a few steps from near values on.

    `apart` (N, n): what residuals of smaller steps of time are more, where the search is to go on from an end of theirs."""
    measured = np.concatenate([log.q for log in plant.logs]) - apart
    values, cost, _, _ = SimulatedSearch(plant, measured, sizes, weights, *expected(plant)).run(values, steps, NEAR)
    return cost, values
