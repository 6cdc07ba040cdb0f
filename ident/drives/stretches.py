"""Stretches of a log that a fit does not explain: what happened there must not bend what the rest of the log says."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from .descent import SimulatedSearch
from .nearby import approached
from .plant import DrivePlant
from .search import Fitted
from .starts import expected

Array = np.ndarray
#: Seconds of a stretch; so many of them at least must show motion for there to be a usual one.
_SECONDS, _FEW = 0.5, 6
#: Times the usual error from which on a stretch is none that the model explains, and for how many times it counts then.
_FAR, _COUNTS = 3.0, 2.0
#: Share of a joint's whole motion, or of its command's, that makes a stretch one with motion.
_MOVES = 0.05
#: Rounds of weights at most, the change of a weight that ends them, and the share of the squared error that a step is to take off.
_ROUNDS, _SAME, _ENOUGH = 6, 0.02, 1e-4


@dataclass(frozen=True)
class LogStretch:
    """Part of a log, `start` to `stop` s, of one joint (index), with its error as a multiple of the usual one."""

    log: str
    joint: int
    start: float
    stop: float
    times: float

    def text(self, joint: str) -> str:
        """One line for people."""
        return (
            f"log {self.log}, {joint}, {self.start:.3g} to {self.stop:.3g} s: {self.times:.3g} times the usual error, which the model does"
            " not explain (a joint that sticks, a contact, another load?); it counts the less in the fit."
        )


def unexplained(plant: DrivePlant, fit: Fitted) -> tuple[LogStretch, ...]:
    """Stretches with more than three times the usual error of their joint in their log, adjoining ones as one."""
    found: list[LogStretch] = []
    for i, j, _rows, number, times in _multiples(plant, fit):
        log = plant.logs[i]
        for k in np.flatnonzero(times > _FAR):
            own = log.t[number == k]
            start, stop, size = float(own[0]), float(own[-1]), float(times[k])
            if found and (found[-1].log, found[-1].joint) == (log.name, j) and k and times[k - 1] > _FAR:
                start, size = found[-1].start, max(size, found.pop().times)
            found.append(LogStretch(log.name, j, start, stop, size))
    return tuple(found)


def steadied(plant: DrivePlant, fit: Fitted, sizes: Array) -> Fitted:
    """The same fit, where stretches are unexplained with what is beyond twice the usual error left out of their weight (Huber, 1964).

    `sizes` (p,): usual sizes of the unknowns. Without such stretches the fit stays as it is."""
    if not unexplained(plant, fit):
        return fit
    plain, weights = fit.weights, fit.weights
    for _ in range(_ROUNDS):
        before, weights = weights, _weights(plant, replace(fit, weights=plain))
        fit = approached(plant, fit.values, sizes, weights, fit.slopes, enough=_ENOUGH * float(np.sum(np.square(fit.residual * weights))))
        if np.max(np.abs(weights - before) / np.maximum(plain, 1e-300)) < _SAME:
            break
    measured = np.concatenate([log.q for log in plant.logs])
    search = SimulatedSearch(plant, measured, sizes, weights, *expected(plant)).fine()
    values, _, settled, used = search.run(fit.values, _ROUNDS)
    values, residual, slopes = search.precise().ended(values)
    return Fitted(values, residual, slopes, weights, settled, fit.steps + used)


def _weights(plant: DrivePlant, fit: Fitted) -> Array:
    """Weights (N, n) of the readings, those of unexplained stretches as much smaller as their error is larger than twice the usual."""
    out = fit.weights.copy()
    for _, j, rows, number, times in _multiples(plant, fit):
        if np.any(times > _FAR):
            out[rows, j] *= np.minimum(1.0, _COUNTS / np.maximum(times, 1e-300))[number]
    return out


def _multiples(plant: DrivePlant, fit: Fitted) -> Iterator[tuple[int, int, slice, Array, Array]]:
    """Of each log and joint: their numbers, its rows, the stretch (N,) of each reading, and the error of each stretch by the usual one."""
    begin = 0
    for i, log in enumerate(plant.logs):
        rows, begin = slice(begin, begin + len(log.t)), begin + len(log.t)
        number = (log.t / _SECONDS).astype(int)
        for j in range(log.q.shape[1]):
            counted = fit.weights[rows, j] > 0
            count = np.bincount(number, counted)
            squares = np.bincount(number, np.square(fit.residual[rows, j]) * counted)
            error = np.sqrt(squares / np.maximum(count, 1.0))
            usual = error[_moving(log.q[:, j], log.q_cmd[:, j], number) & (count > 0)]
            if len(usual) >= _FEW and np.median(usual) > 0.0:
                yield i, j, rows, number, error / float(np.median(usual))


def _moving(q: Array, command: Array, number: Array) -> Array:
    """Whether a joint or its command moves in each stretch."""
    out = np.zeros(int(number[-1]) + 1, bool)
    for values in (q, command):
        least = _MOVES * float(np.ptp(values))
        for k in range(len(out)):
            own = values[number == k]
            out[k] |= len(own) > 0 and least > 0.0 and float(np.ptp(own)) > least
    return out
