"""Least squares on simulated positions: Levenberg-Marquardt steps within bounds, from several starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from .._utils.singular_values import lstsq
from ..errors import DataError
from .descent import SimulatedSearch
from .plant import DrivePlant, joined
from .starts import expected

Array = np.ndarray
#: A step that lowers the cost by less than this share ends a coarse search.
NEAR = 1e-3
#: So often all torque of single joints is scaled, and the search goes on from there.
_RESCALED = 6
#: While residuals count in units of the motion, not of their own size, what is expected counts so little.
_COARSE = 1e-3
#: Times as many steps lead to the end, where all of them are small.
_LAST = 3
#: Steps of a search at most.
_STEPS = 40
#: So many starts are followed for a few steps.
_FOLLOWED, _SHORT = 3, 6
#: Where a joint comes to rest makes valleys of their own: from the best end of a single joint, which is simulated in no time, dry friction
#: is set to these shares of it, the others make up for that, and the offset is none.
_HOPS = (0.3, 0.6, 1.6, 3.0)


@dataclass(frozen=True, eq=False)
class Fitted:
    """Values (p,) with the residual (N, n) in rad, its derivatives (N, n, p), weights (N, n), and whether the search settled.

    A reading that does not count has weight 0."""

    values: Array
    residual: Array
    slopes: Array
    weights: Array
    settled: bool
    steps: int

    @property
    def rms(self) -> Array:
        """Position error (n,), over all readings."""
        return np.sqrt(np.mean(self.residual**2, axis=0))

    @property
    def cost(self) -> float:
        """Sum of weighted squares."""
        return float(np.sum(np.square(self.residual * self.weights)))

    @property
    def spread(self) -> float:
        """Variance of the weighted residual, as large as its memory makes it count."""
        r = self.residual * self.weights
        count = max(int(np.count_nonzero(self.weights)) - len(self.values), 1)
        own: Array = np.sum(r * r, axis=0)
        ahead: Array = np.sum(r[1:] * r[:-1], axis=0) / np.maximum(own, 1e-300)
        share = float(np.clip(ahead, 0.0, 0.99).max())
        return float(np.sum(own)) / count * (1.0 + share) / (1.0 - share)


def fitted(
    plant: DrivePlant, starts: Array, sizes: Array, *, counted: Array | None = None, narrower: Array | None = None, steps: int = _STEPS,
    progress: Callable[[float], None] | None = None,
) -> Fitted:  # fmt: skip
    """From starts (S, p): the better ones are followed coarsely, the best to the end, then again with weights from its own residual: those
    of each joint in each log by themselves, since what a log leaves unexplained differs from log to log.

    `sizes` (p,): what is a usual size of each unknown. `counted` (N, n): which readings count; by default those that are no repeat.
    `narrower` (S, p): where models with less in them have ended; what is found is no worse than what is reached from the best of them."""
    search = _by_motion(plant, sizes, counted)
    best = _coarse_end(search, starts, narrower, steps)
    if progress is not None:
        progress(0.4)
    others = () if narrower is None else (narrower[int(np.argmin(search.costs(narrower)))],)
    ends = [search.run(start, steps) for start in (best, *others)]
    values = min(ends, key=lambda end: end[1])[0]
    fresh, spread = search.weights > 0.0, _spread(plant)
    rms = rms_by_log(plant, search.residual(values), fresh)
    search = replace(search, weights=fresh / np.maximum(rms, 1e-3 * spread), near=1.0).fine()
    values, _, settled, used = search.run(values, _LAST * steps)
    if progress is not None:
        progress(1.0)
    values, residual, slopes = search.precise().ended(values)
    return Fitted(values, residual, slopes, search.weights, settled, used)


def begun(plant: DrivePlant, starts: Array, sizes: Array, *, counted: Array | None = None, narrower: Array | None = None) -> Array:
    """Where a fit's coarse search from starts (S, p) ends, (p,): near a minimum, with residuals in units of the motion."""
    return _coarse_end(_by_motion(plant, sizes, counted), starts, narrower, _STEPS)


def _spread(plant: DrivePlant) -> Array:
    """Standard deviation (n,) of each joint's motion."""
    return np.maximum(np.std(np.concatenate([log.q for log in plant.logs]), axis=0), 1e-6)


def _by_motion(plant: DrivePlant, sizes: Array, counted: Array | None) -> SimulatedSearch:
    """A search with residuals in units of the motion; `counted` (N, n): which readings count, by default those that are no repeat."""
    measured = np.concatenate([log.q for log in plant.logs])
    fresh = np.concatenate([log.fresh for log in plant.logs]) if counted is None else counted
    return SimulatedSearch(plant, measured, sizes, fresh / _spread(plant), *expected(plant), near=_COARSE)


def _coarse_end(search: SimulatedSearch, starts: Array, narrower: Array | None, steps: int) -> Array:
    """The better starts followed for a few steps, the best of them to its end, all torque of single joints scaled."""
    coarse = search.coarse()
    starts = _composed(coarse, starts if narrower is None else np.concatenate([narrower, starts]))
    costs = coarse.costs(starts)
    order = [i for i in np.argsort(costs)[:_FOLLOWED] if np.isfinite(costs[i])]
    if not order:
        raise DataError(
            "the simulation diverges from every starting point of the search: check the signs of commands and positions, and the gains."
        )
    ends = [coarse.run(starts[i], _SHORT, NEAR) for i in order]
    best = min(ends, key=lambda end: end[1])
    best = coarse.run(best[0], steps, NEAR)
    for _ in range(_RESCALED):
        scaled = coarse.rescaled(best[0])
        if np.array_equal(scaled, best[0]):
            break
        best = coarse.run(scaled, steps, NEAR)
    if search.plant.robot.n == 1:
        best = min([best, *(coarse.run(hop, 2 * _SHORT, NEAR) for hop in _hops(coarse, best[0]))], key=lambda end: end[1])
    return best[0]


def rms_by_log(plant: DrivePlant, residual: Array, counted: Array) -> Array:
    """Position error (N, n) of the log and joint that each reading is of, over the readings that count."""
    ends = np.cumsum([0, *(len(log.t) for log in plant.logs)])
    out = np.empty(residual.shape)
    for start, stop in pairwise(ends):
        at = slice(int(start), int(stop))
        squares = np.sum(np.square(residual[at]) * counted[at], axis=0)
        out[at] = np.sqrt(squares / np.maximum(np.sum(counted[at], axis=0), 1))
    # A log of which nothing counts is weighed as the others are on average.
    empty = out <= 0.0
    return np.where(empty, np.sqrt(np.mean(np.square(out), axis=0)), out)


def _composed(search: SimulatedSearch, starts: Array) -> Array:
    """Starts (S + 1, p), with one of which every joint's unknowns are those of the start that moves it best."""
    if len(starts) < 2 or search.plant.robot.n == 1:
        return starts
    found = joined(search.plant.positions(starts)) - search.measured
    errors = np.nan_to_num(np.sum(np.square(found * search.weights), axis=1), nan=np.inf)
    of = [np.argmin(errors.sum(axis=1)) if u.joint < 0 else np.argmin(errors[:, u.joint]) for u in search.plant.unknowns]
    return np.concatenate([starts, [starts[of, np.arange(len(of))]]])


def _hops(search: SimulatedSearch, values: Array) -> list[Array]:
    """Starts (p,) beside the best end, from which another valley may be found; what can make up for a change of friction does."""
    places = np.array([u.place for u in search.plant.unknowns])
    dry = np.flatnonzero(places == "dry")
    if not len(dry) or len(values) < 2:
        return []
    _, slopes = search.linear(values)
    J = (slopes * search.weights[..., None]).reshape(-1, len(values)) * search.sizes
    others = np.setdiff1d(np.arange(len(values)), dry)
    along = -lstsq(J[:, others], J[:, dry].sum(axis=1), rcond=1e-6)
    out = []
    for share in _HOPS:
        hop, change = values.copy(), (share - 1.0) * float(np.mean(values[dry] / search.sizes[dry]))
        hop[dry] *= share
        moved = hop[others] + change * along * search.sizes[others]
        least = np.minimum(0.5 * hop[others], 2.0 * hop[others])
        hop[others] = np.clip(moved, least, 2.5 * hop[others] - least)
        hop[places == "offset"] = 0.0
        out.append(np.maximum(hop, search.lower))
    return out


def derivatives(plant: DrivePlant, values: Array, sizes: Array, own: Array) -> Array:
    """Derivatives (N, n, m) of the simulated positions at values (p,) along some of the unknowns (m,)."""
    measured = np.concatenate([log.q for log in plant.logs])
    return SimulatedSearch(plant, measured, sizes, np.ones_like(measured)).along(values, own)
