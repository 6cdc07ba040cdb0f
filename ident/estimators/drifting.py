"""Parameters that drift: a random walk followed by a Kalman filter, and smoothed backwards."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..errors import ConfigurationError, unknown_name
from ..problem.linear_solution import full_values
from ..statistics.noise import fit_noise
from .base import Capability, Estimator, register
from .finish import finish
from .least_squares import weighted_solution
from .random_walk import RandomWalk

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.linear_solution import LinearSolution
    from ..problem.problem import Problem

Array = np.ndarray
#: Least noise that the filter believes, relative to the torque.
_LEAST_NOISE = 1e-4
#: Passes between drift and the colour of the noise.
_PASSES = 3


@register
@dataclass(frozen=True, kw_only=True)
class DriftingParameters(Estimator):
    """Random-walk parameters by a Kalman filter over blocks of the log (filterpy), smoothed by Rauch, Tung & Striebel.

    `drifting`: base parameters that may drift; None means all that belong to the drive. `drift`: standard deviation of the change
    over the whole log, relative to the value; None takes for each parameter the one that makes the log most likely, mostly
    none. `blocks`: at most so many over the log; within one the parameters stand. The estimate is that at the end of the log;
    the smoothed course of the drifting parameters is in the trace.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.DriftingParameters(drift=0.01)
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "kalman"
    title: ClassVar[str] = "Kalman filter for drifting parameters"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.WEIGHTS, Capability.DRIFT})

    drifting: tuple[str, ...] | None = None
    drift: float | None = None
    blocks: int = 120

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.drift is not None and not self.drift >= 0:
            raise ConfigurationError(f"method 'kalman': drift must not be negative, but is {self.drift}.")
        if self.blocks < 2:
            raise ConfigurationError(f"method 'kalman': blocks must be at least 2, not {self.blocks}.")

    def check(self, problem: Problem) -> None:
        for name in self.drifting or ():
            if name not in problem.base.names:
                raise unknown_name("base parameter in `drifting`", name, problem.base.names)

    def _solve(self, problem: Problem) -> Estimate:
        solution, weights = weighted_solution(problem)
        information = problem.information
        # Below this noise a covariance form resolves nothing: a noise-free log would have infinitely certain blocks.
        most = information.counts / np.maximum(_LEAST_NOISE**2 * information.torque_squares(), 1e-300)
        moving = self._moving(problem, solution)
        drift = np.zeros(len(moving))
        residual = problem.residual(full_values(problem, solution))
        attempts = 0
        while True:
            # What drifts without being modelled passes as coloured noise: it must be worth more than that, and then frees the noise of it.
            noise = fit_noise(residual, problem.row_runs, problem.row_shape)
            level = np.where(information.counts > 0, 1.0 / np.maximum(noise.variance * noise.correlation_time, 1e-300), 0.0)
            walk = RandomWalk(problem, solution, np.minimum(level, most), self.blocks)
            previous, attempts = drift, attempts + 1
            drift = walk.likely_drift(moving) if self.drift is None else np.full(len(moving), self.drift)
            course = walk.course(moving, drift)
            if np.array_equal(previous, drift) or attempts == _PASSES:
                break
            residual = walk.residual(problem, course)
        trace: dict[str, Any] = {
            "names": [problem.base.names[solution.columns[i]] for i in moving], "drift": drift.tolist(), "time": walk.times.tolist(),
            "log_likelihood": course.likelihood, "values": course.values[:, moving].tolist(), "std": course.std[:, moving].tolist(),
        }  # fmt: skip
        if not drift.any():
            return finish(problem, solution, weights, self.name, trace=trace)
        final = replace(solution, values=course.values[-1])
        return finish(problem, final, weights, self.name, covariance=course.final_covariance, trace=trace)

    def _moving(self, problem: Problem, solution: LinearSolution) -> list[int]:
        """Places among the solution's columns of the parameters that may drift."""
        base = problem.base
        stayers = [base.parameters[base.independent[c]] for c in solution.columns]
        if self.drifting is None:
            return [i for i, p in enumerate(stayers) if p.effect != "rigid_body"]
        return [i for i, p in enumerate(stayers) if p.name in self.drifting]
