"""How much data each method needs, and the recursion of 120,000 samples against the batch solution."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.errors import IdentError
from ident.estimators import RecursiveLeastSquares, WeightedLeastSquares
from ident.problem.problem import Problem
from ident.signals.preparation import CentralDifference, Preparation, ZeroPhase

from .data import CUTOFF, Data, make_case
from .methods import METHODS

Array = np.ndarray
#: Torque error, rms over the joints, at which a method counts as converged.
CONVERGED = 0.01
GROWING = ("ls_raw", "wls", "momentum", "iv_desired")
_RECURSION_SAMPLES = 120_000


@dataclass(frozen=True, eq=False)
class Growth:
    """Torque error `errors` (m,) of a method against the samples of its data, `samples` (m,)."""

    title: str
    samples: Array
    errors: Array

    @property
    def converged_at(self) -> int | None:
        """Samples from which on the error stays below the limit; None: not within the data."""
        good = self.errors <= CONVERGED
        if not good[-1]:
            return None
        bad = np.flatnonzero(~good)
        return int(self.samples[bad[-1] + 1 if len(bad) else 0])


def growth(data: Data, methods: Sequence[str] = GROWING, seed: int = 1) -> dict[str, Growth]:
    """Torque error against the amount of data, runs being added."""
    found: dict[str, Growth] = {}
    for key in methods:
        samples, errors = [], []
        for size in data.scale.sizes:
            case = make_case(data, data.quick.part(slice(0, size)), seed)
            samples.append(sum(len(log) for log in case.logs))
            try:
                estimate = METHODS[key].solve(case)
                errors.append(data.torque_measure(data.world.model.base.base_values(estimate.all_values) - data.world.truth))
            except IdentError:
                errors.append(np.inf)
        found[key] = Growth(METHODS[key].title, np.array(samples), np.array(errors))
    return found


@dataclass(frozen=True, eq=False)
class Recursion:
    """A recursion over `instants` samples: course of the followed parameters (`samples` (p,), `values`, `std` (p, f)), its end value
    against the batch solution (`difference`: largest of all parameters in std, `difference_relative`: relative), seconds of both."""

    title: str
    names: tuple[str, ...]
    truth: Array
    instants: int
    samples: Array
    values: Array
    std: Array
    end: Array
    batch: Array
    difference: float
    difference_relative: float
    seconds: float
    batch_seconds: float


def recursions(data: Data, seed: int = 1, points: int = 150) -> dict[str, Recursion]:
    """Recursive least squares on raw second differences and on filtered signals, rows at every sample."""
    logs = make_case(data, data.quick, seed).logs
    kinds: dict[str, tuple[str, Preparation]] = {
        "raw": ("raw second differences", CentralDifference()),
        "filtered": (f"filtered at {CUTOFF:g} Hz", ZeroPhase(cutoff_hz=CUTOFF, decimate=False, edge_s=0.05)),
    }
    return {key: _recursion(data, title, preparation, logs, points) for key, (title, preparation) in kinds.items()}


def _recursion(data: Data, title: str, preparation: Preparation, logs: tuple, points: int) -> Recursion:
    world = data.world
    problem = _first_instants(Problem(world.model, preparation(logs, world.model.robot)), _RECURSION_SAMPLES)
    follow = followed(world.names)
    estimator = RecursiveLeastSquares(noise_std=tuple(world.noise), follow=follow, trace_points=points)
    start = time.process_time()
    end = estimator.solve(problem)
    middle = time.process_time()
    batch = WeightedLeastSquares(noise_std=tuple(world.noise)).solve(problem)
    last = time.process_time()
    gap = np.abs(end.values - batch.values)
    at = [world.names.index(name) for name in follow]
    trace = end.trace
    return Recursion(
        title, follow, world.truth[at], len(problem.valid), np.array(trace["samples"]), np.array(trace["values"], float),
        np.array(trace["std"], float), end.values[at], batch.values[at], float(np.max(gap / batch.std)),
        float(np.max(gap / np.maximum(np.abs(batch.values), 1e-300))), middle - start, last - middle,
    )  # fmt: skip


def followed(names: tuple[str, ...]) -> tuple[str, ...]:
    """J1z, J3z and J5z, by the names of the base parameters."""
    return tuple(name for name in ("Izz_joint1", "Izz_joint3", "Izz_joint5") if name in names)


def _first_instants(problem: Problem, count: int) -> Problem:
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
