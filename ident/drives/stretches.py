"""Stretches of a log that a fit does not explain: what happened there must not bend what the rest of the log says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..statistics.outliers import BY_CHANCE, beyond
from .descent import SimulatedSearch
from .nearby import approached
from .plant import DrivePlant
from .search import Fitted
from .starts import expected

Array = np.ndarray
#: Seconds of a stretch; so many of them at least must show motion for there to be a usual error.
_SECONDS, _FEW = 0.5, 6
#: Share of a joint's whole motion that makes a stretch one with motion.
_MOVES = 0.05
#: Samples that make a gap, and seconds behind one in which what it left is still seen.
_GAP, _AFTER = 3.0, 0.5
#: Rounds of weights at most, and the change of a weight that ends them.
_ROUNDS, _SAME = 6, 0.02


@dataclass(frozen=True)
class LogStretch:
    """Part of a log, `start` to `stop` s, of one joint (index), with its error as a multiple of the usual one. `gap`: the longest time
    without a reading in it, s, where that is more than a few samples."""

    log: str
    joint: int
    start: float
    stop: float
    times: float
    gap: float = 0.0

    def text(self, joint: str) -> str:
        """One line for people."""
        why = (
            f"with a gap of {self.gap:.3g} s in the readings, in which the commands are not known"
            if self.gap
            else "unexplained by the model (stiction, a contact, another load?)"
        )
        return (
            f"log {self.log}, {joint}, {self.start:.3g} to {self.stop:.3g} s: {self.times:.3g} times the usual error, {why}; this part has"
            " less weight in the fit."
        )


@dataclass(frozen=True, eq=False)
class _JointStretches:
    """Stretches of one joint in one log (numbers): its rows, the stretch (N,) of each reading, the error (K,) of each by the usual one,
    which of them (K,) are far beyond the others, and the share (K,) of the log's usual weight that they have in the fit."""

    log: int
    joint: int
    rows: slice
    number: Array
    times: Array
    far: Array
    share: Array


def unexplained(plant: DrivePlant, fit: Fitted) -> tuple[LogStretch, ...]:
    """Stretches that count the less in a fit, with their error as a multiple of the usual one; adjoining ones as one."""
    found: list[LogStretch] = []
    for own in _stretches(plant, fit):
        log = plant.logs[own.log]
        # What another fit left there may be explained by now.
        light = (own.share < 1.0 - 1e-9) & own.far
        for k in np.flatnonzero(light):
            t = log.t[own.number == k]
            start, stop, size = float(t[0]), float(t[-1]), float(own.times[k])
            if k and light[k - 1]:
                start, size = found[-1].start, max(size, found.pop().times)
            found.append(LogStretch(log.name, own.joint, start, stop, size, _gap(log.t, start - _AFTER, stop)))
    return tuple(found)


def _gap(t: Array, start: float, stop: float) -> float:
    """The longest time without a reading in part of a log, 0 where it is no more than a few samples."""
    steps = np.diff(t)
    inside = steps[(t[1:] >= start) & (t[:-1] <= stop)]
    longest = float(np.max(inside, initial=0.0))
    return longest if longest > _GAP * float(np.median(steps)) else 0.0


def shares(plant: DrivePlant, weights: Array) -> Array:
    """Weights (N, n) as shares of the largest of their joint in their log: less than 1 in stretches that count the less."""
    ends = np.cumsum([len(log.t) for log in plant.logs])
    largest = [np.broadcast_to(own.max(axis=0), own.shape) for own in np.split(weights, ends[:-1])]
    return np.asarray(weights / np.maximum(np.concatenate(largest), 1e-300))


def steadied(plant: DrivePlant, fit: Fitted, sizes: Array) -> Fitted:
    """The same fit, where stretches are unexplained with these weighed by their own error, as logs are among each other.

    A stretch that bends the fit makes the others' errors large as well. So it is judged by a fit that it does not bend: one in which every
    stretch beyond the usual error is weighed by its own. There its error has to be far beyond what the others' spread lets the largest of
    so many have: a model that errs by much in some places and by little in others is not refined yet, and all of its log counts.

    `sizes` (p,): usual sizes of the unknowns. Without such stretches the fit stays as it is."""
    every = [np.ones(len(own.times), bool) for own in _stretches(plant, fit)]
    if not every:
        return fit
    robust = _lighter(plant, fit, sizes, every, fit.weights)
    far = [own.far for own in _stretches(plant, replace(robust, weights=fit.weights))]
    if not any(np.any(one) for one in far):
        return fit
    near = _lighter(plant, robust, sizes, far, fit.weights)
    measured = np.concatenate([log.q for log in plant.logs])
    search = SimulatedSearch(plant, measured, sizes, near.weights, *expected(plant)).fine()
    values, _, settled, used = search.run(near.values, _ROUNDS)
    values, residual, slopes = search.precise().ended(values)
    return Fitted(values, residual, slopes, near.weights, settled, fit.steps + used)


def _lighter(plant: DrivePlant, fit: Fitted, sizes: Array, which: Sequence[Array], plain: Array) -> Fitted:
    """From a fit on, with these stretches, (K,) of each log and joint, weighed by their own error where that is beyond the usual one."""
    weights = fit.weights
    for _ in range(_ROUNDS):
        before, weights = weights, plain.copy()
        for own, some in zip(_stretches(plant, replace(fit, weights=plain)), which, strict=True):
            share = np.where(some, np.minimum(1.0, 1.0 / np.maximum(own.times, 1e-300)), 1.0)
            weights[own.rows, own.joint] *= share[own.number]
        fit = approached(plant, fit.values, sizes, weights, fit.slopes)
        if np.max(np.abs(weights - before) / np.maximum(plain, 1e-300)) < _SAME:
            break
    return fit


def _stretches(plant: DrivePlant, fit: Fitted) -> list[_JointStretches]:
    """Those of every log and joint with enough motion for a usual error."""
    found, begin = [], 0
    for i, log in enumerate(plant.logs):
        rows, begin = slice(begin, begin + len(log.t)), begin + len(log.t)
        number = (log.t / _SECONDS).astype(int)
        for j in range(log.q.shape[1]):
            weights = fit.weights[rows, j]
            count = np.bincount(number, weights > 0)
            squares = np.bincount(number, np.square(fit.residual[rows, j]) * (weights > 0))
            error = np.sqrt(squares / np.maximum(count, 1.0))
            moving = _moving(log.q[:, j], number) & (count > 0)
            if np.sum(moving) >= _FEW and np.median(error[moving]) > 0.0:
                most = np.zeros(len(error))
                np.maximum.at(most, number, weights)
                share = np.where(count > 0, most / np.max(weights), 1.0)
                found.append((i, j, rows, number, error / float(np.median(error[moving])), moving, share))
    # What is at rest is no usual error, but may be beyond it.
    level = BY_CHANCE / max(len(found), 1)
    return [
        _JointStretches(i, j, rows, number, times, times > beyond(times[moving | (times > 1.0)], level), share)
        for i, j, rows, number, times, moving, share in found
    ]


def _moving(q: Array, number: Array) -> Array:
    """Whether a joint moves in each stretch. One that is commanded and rests is no measure of a usual error, whatever it is sent: it is
    simulated at rest as well, and what is left there is nothing beside the error of motion."""
    least = _MOVES * float(np.ptp(q))
    spans = [float(np.ptp(own)) if len(own := q[number == k]) else 0.0 for k in range(int(number[-1]) + 1)]
    return (np.array(spans) > least) & (least > 0.0)
