"""Ordinary and weighted least squares from information blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..problem.linear_solution import LinearSolution, order_of, solve_triangle
from ..problem.reweighting import reweighted
from .base import Capability, Estimator, per_joint, register
from .finish import finish

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class LeastSquares(Estimator):
    """Ordinary least squares: every measured row counts alike, whatever its unit or noise.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.LeastSquares()
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "ls"
    title: ClassVar[str] = "ordinary least squares"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING})

    def _solve(self, problem: Problem) -> Estimate:
        weights = np.ones(problem.valid.shape[1])
        R, z, _ = problem.information.combined(weights)
        return finish(problem, solve_triangle(R, z, order_of(problem.base)), weights, self.name)


@register
@dataclass(frozen=True, kw_only=True)
class WeightedLeastSquares(Estimator):
    """Least squares with each row weighted by its noise: given, or estimated from the residual and repeated.

    `noise_std`: standard deviation per joint on the measured side (N m, N); None estimates it. `iterations`: at most.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.WeightedLeastSquares()
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "wls"
    title: ClassVar[str] = "weighted least squares"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING, Capability.WEIGHTS})

    noise_std: tuple[float, ...] | float | None = None
    iterations: int = 20

    def check(self, problem: Problem) -> None:
        n = problem.valid.shape[1]
        if self.noise_std is not None:
            per_joint(self.noise_std, n, "noise_std", positive=True)

    def _solve(self, problem: Problem) -> Estimate:
        if self.noise_std is None:
            solution, weights = weighted_solution(problem, self.iterations)
        else:
            weights = 1.0 / np.square(per_joint(self.noise_std, problem.valid.shape[1], "noise_std", positive=True))
            solution = solve_triangle(*problem.information.combined(weights)[:2], order_of(problem.base))
        return finish(problem, solution, weights, self.name)


def weighted_solution(problem: Problem, iterations: int = 20) -> tuple[LinearSolution, Array]:
    """Iterated weighted least squares: each row is weighted by the variance of its own residual.

    Parameters
    ----------
    problem : Problem
        Model and signals.
    iterations : int
        At most.

    Returns
    -------
    solution : LinearSolution
    weights : array (n,)
        Per measured row.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> problem = ident.Problem(robot.rigid_body() + ident.friction.Coulomb(), ident.ZeroPhase()(train, robot))
    >>> solution, weights = ident.estimators.weighted_solution(problem)
    >>> len(solution.values) == problem.base.count, weights.shape
    (True, (6,))
    """
    return reweighted(problem.information, order_of(problem.base), iterations=iterations)
