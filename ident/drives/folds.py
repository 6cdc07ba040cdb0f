"""Models of drives against each other: the error on readings that the fit did not count, simulated from the first sample on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .nearby import approached
from .plant import DrivePlant
from .search import Fitted

Array = np.ndarray
#: From so many logs on, they are held out whole, one by one up to so many; below, every other stretch of time in two turns.
_LOGS, _TURNS = 4, 10
#: Stretches of a log, and the seconds of one at least.
_STRETCHES = 12
_SECONDS = 0.5


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Squared error (N, n) of each reading, simulated with what was fitted to the others; NaN where a reading is a repeat.
    `logs` (N,): number of the log of each."""

    squares: Array
    logs: Array

    @property
    def rms(self) -> Array:
        """(n,) rad or m."""
        return np.sqrt(np.nanmean(self.squares, axis=0))


def turns(plant: DrivePlant) -> Array:
    """(N,) number of the turn in which each reading is held out: stretches of each log, or logs where there are enough of them."""
    if len(plant.logs) >= _LOGS:
        return np.concatenate([np.full(len(log.t), i % _TURNS) for i, log in enumerate(plant.logs)])
    parts = []
    for log in plant.logs:
        length = max(log.duration / _STRETCHES, _SECONDS)
        parts.append((log.t / length).astype(int) % 2)
    return np.concatenate(parts)


def held_out(plant: DrivePlant, fit: Fitted, sizes: Array) -> HeldOut:
    """Fit again with a part of the readings held out, from a fit to all of them on, and look at that part; each in its turn."""
    turn = turns(plant)
    squares = np.full(fit.residual.shape, np.nan)
    for number in range(int(turn.max()) + 1):
        other = turn == number
        found = approached(plant, fit.values, sizes, fit.weights * ~other[:, None], fit.slopes)
        squares[other] = np.where(fit.weights[other] > 0, np.square(found.residual[other]), np.nan)
    logs = np.repeat(np.arange(len(plant.logs)), [len(log.t) for log in plant.logs])
    return HeldOut(squares, logs)


def best(options: Sequence[HeldOut]) -> int:
    """Which is the most likely, each joint's error in each log of a size of its own: by Σ N log(rms). The first wins where no other is
    better by 1 % of the error."""
    errors = np.array([_log_error(option) for option in options])
    least = int(np.argmin(errors))
    return least if errors[least] < errors[0] - 0.01 else 0


def _log_error(option: HeldOut) -> float:
    """Mean logarithm of the error, over readings."""
    total = count = 0.0
    for log in np.unique(option.logs):
        own = option.squares[option.logs == log]
        read = np.sum(np.isfinite(own), axis=0)
        mean = np.nansum(own, axis=0) / np.maximum(read, 1)
        total += float(np.sum(read * 0.5 * np.log(np.maximum(mean, 1e-300))))
        count += float(np.sum(read))
    return total / max(count, 1.0)
