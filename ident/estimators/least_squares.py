"""Ordinary and weighted least squares from information blocks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..problem.information import Information, triangle
from ..problem.linear_solution import LinearSolution, finish, order_of, row_variances, solve_triangle
from .base import Capability, Estimator, per_joint, register

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class LeastSquares(Estimator):
    """Ordinary least squares: every measured row counts alike, whatever its unit or noise."""

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

    `noise_std`: standard deviation per joint on the measured side (N m, N); None estimates it. `iterations`: at most."""

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
    """Solution and weights (n,) of iterated weighted least squares: each row weighs by its own residual's variance."""
    return reweighted(problem.information, order_of(problem.base), iterations=iterations)


def reweighted(
    information: Information,
    order: list[int],
    weights: Array | None = None,
    prior: tuple[Array, Array] | None = None,
    iterations: int = 20,
) -> tuple[LinearSolution, Array]:
    """The same from an information block. `weights` (n,) start the iteration; `prior`: rows (R₀ (r, b), z₀ (r,)) of unit variance."""
    weights = np.where(information.counts > 0, 1.0, 0.0) if weights is None else weights
    solution = solve_with_prior(information, weights, order, prior)
    for _ in range(iterations):
        new = residual_weights(information, solution, weights)
        change = np.max(np.abs(new - weights) / np.where(new > 0, new, 1.0))
        weights = new
        solution = solve_with_prior(information, weights, order, prior)
        if change < 1e-6:
            break
    return solution, weights


def solve_with_prior(information: Information, weights: Array, order: list[int], prior: tuple[Array, Array] | None) -> LinearSolution:
    """Weighted least squares with rows of prior knowledge of unit variance beside the data."""
    R, z, _ = information.combined(weights)
    if prior is not None:
        joint = triangle(np.concatenate([np.column_stack([R, z]), np.column_stack(prior)]))
        R, z = joint[:-1, :-1], joint[:-1, -1]
    return solve_triangle(R, z, order)


def residual_weights(information: Information, solution: LinearSolution, weights: Array) -> Array:
    """Inverse residual variance of each row (n,), zero where a row has no data; `weights` are those of the solution."""
    selected = information.selected(solution.columns)
    variance = row_variances(selected, solution.values, solution.root, weights)
    # A row that is fitted exactly (noise-free data) must not take all the weight.
    floor = 1e-24 * np.maximum(information.torque_squares(), 1e-300) / np.maximum(information.counts, 1)
    seen = (information.counts > 0) & (np.maximum(variance, floor) > 0)
    return np.where(seen, 1.0 / np.where(seen, np.maximum(variance, floor), 1.0), 0.0)
