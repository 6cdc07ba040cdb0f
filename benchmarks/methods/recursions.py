"""The recursions over 120,000 samples: simultaneous and advanced estimate after every sample, and the samples until each parameter settles.

The source's criterion: the number of iterations until a parameter stays within a band. The band is around the value at the end."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from ident.estimate.estimate import Estimate
from ident.estimators import Estimator, InstrumentalVariable, LeastSquares, RecursiveInstrumentalVariable, RecursiveLeastSquares
from ident.problem.problem import Problem
from ident.signals.preparation import CentralDifference

from .data import Data, make_case

Array = np.ndarray
SAMPLES = 120_000
#: Half width of the band as a share of the value at the end.
BAND = 0.02
#: A parameter settles only if it stays within the band for at least this last share of the samples.
_STAYS = 1 / 6
_PASSES = 3


@dataclass(frozen=True, eq=False)
class Recursion:
    """A recursion over `instants` samples of `step` s: `values`, `std` (p, b) of all parameters `names` after `samples` (p,); its end
    against the batch solution (`batch` (b,)): largest `difference` in std, `difference_relative`; `seconds` of both."""

    title: str
    names: tuple[str, ...]
    truth: Array
    instants: int
    step: float
    samples: Array
    values: Array
    std: Array
    end: Array
    batch: Array
    difference: float
    difference_relative: float
    seconds: float
    batch_seconds: float

    def course(self, name: str) -> Array:
        """Course (p,) of one parameter."""
        return self.values[:, self.names.index(name)]

    def settled(self, band: float = BAND) -> Array:
        """Samples (b,) from which on each parameter stays within the band around its value at the end; NaN: not by the end."""
        outside = ~(np.abs(self.values - self.end) <= band * np.abs(self.end))
        last = np.where(outside.any(axis=0), len(outside) - np.argmax(outside[::-1], axis=0), 0)
        found = np.append(self.samples, np.inf)[last].astype(float)
        found[found > (1.0 - _STAYS) * self.instants] = np.nan
        return found

    def settled_one(self, name: str, band: float = BAND) -> float:
        """The same for one parameter."""
        return float(self.settled(band)[self.names.index(name)])

    def settled_all(self, band: float = BAND) -> float:
        """The same for all parameters; NaN where one does not settle."""
        return float(np.max(self.settled(band)))


def recursions(data: Data, seed: int = 1, points: int = 240) -> dict[str, Recursion]:
    """Plain least squares and plain instrumental variables on raw second differences, rows at every sample."""
    logs = make_case(data, data.quick, seed).logs
    world = data.world
    problem = first_instants(Problem(world.model, CentralDifference()(logs, world.model.robot)), SAMPLES)
    instruments = InstrumentalVariable(loop="open", instruments="forward_dynamics", weighting="none", iterations=_PASSES)
    batch, seconds = _timed(instruments, problem)
    advanced = RecursiveInstrumentalVariable(loop="open", passes=len(batch.trace["steps"]), trace_points=points)
    least = RecursiveLeastSquares(noise_std=1.0, trace_points=points)
    return {
        "simultaneous": _recursion(data, "simultaneous (LS)", problem, least, *_timed(LeastSquares(), problem)),
        "advanced": _recursion(data, "advanced simultaneous (IV)", problem, advanced, batch, seconds),
    }


def _timed(estimator: Estimator, problem: Problem) -> tuple[Estimate, float]:
    begin = time.process_time()
    found = estimator.solve(replace(problem))  # nothing is left over from another method
    return found, time.process_time() - begin


def _recursion(data: Data, title: str, problem: Problem, recursive: Estimator, batch: Estimate, batch_seconds: float) -> Recursion:
    end, seconds = _timed(recursive, problem)
    gap, trace = np.abs(end.values - batch.values), end.trace
    return Recursion(
        title, tuple(trace["names"]), data.world.truth, len(problem.valid), 1.0 / data.world.rate, np.array(trace["samples"]),
        np.array(trace["values"], float), np.array(trace["std"], float), end.values, batch.values, float(np.max(gap / batch.std)),
        float(np.max(gap / np.maximum(np.abs(batch.values), 1e-300))), seconds, batch_seconds,
    )  # fmt: skip


def first_instants(problem: Problem, count: int) -> Problem:
    """The first so many instants of a problem whose rows are its samples."""
    if len(problem.valid) <= count:
        return problem
    parts, left = [], count
    for rows in problem.row_runs:
        take = min(left, rows.stop - rows.start)
        if take > 0:
            parts.append(slice(rows.start, rows.start + take))
            left -= take
    return replace(problem, signals=problem.signals.select_rows(parts))
