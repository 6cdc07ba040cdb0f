"""Weights of the rows and least squares under them, until neither moves."""

from __future__ import annotations

import numpy as np

from .information import Information, triangle
from .linear_solution import LinearSolution, row_variances, solve_triangle

Array = np.ndarray


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
