"""The Cramér-Rao bound: what no unbiased estimator can go below, given the torque noise and the true motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ident.problem.information import triangle
from ident.problem.problem import Problem

if TYPE_CHECKING:
    from ident.signals.filters import RowFilter

Array = np.ndarray


def filtered_bound(problem: Problem, noise: Array) -> Array:
    """Standard deviations (b,) of the bound for the rows of a problem on exact motion; `noise` (n,): std of white torque noise.

    The rows' filter colours the noise: its exact correlation between rows is whitened away, run by run, over the rows in use."""
    shape = _correlation(problem.signals.row_filter)
    b = problem.base.count
    R = np.zeros((b, b))
    blocks = [(rows.run, rows) for rows in problem.rows()]
    for run in range(len(problem.row_runs)):
        mine = [rows for number, rows in blocks if number == run]
        if not mine:
            continue
        columns = np.concatenate([rows.columns for rows in mine])
        valid = np.concatenate([rows.valid for rows in mine])
        parts = [R]
        for j, std in enumerate(noise):
            at = np.flatnonzero(valid[:, j])
            if len(at):
                parts.append(_whitened(columns[at, j], at, shape) / std)
        R = triangle(np.concatenate(parts))
    scale = np.linalg.norm(R, axis=0)
    inverse = np.linalg.solve(R / scale, np.eye(b))
    return np.linalg.norm(inverse, axis=1) / scale


def _correlation(row_filter: RowFilter | None) -> Array:
    """Covariance of rows at distance 0, 1, … for white noise of variance one at the samples."""
    if row_filter is None:
        return np.ones(1)
    taps = row_filter.taps
    return np.correlate(taps, taps, mode="full")[len(taps) - 1 :: row_filter.factor]


def _whitened(columns: Array, at: Array, shape: Array) -> Array:
    """Columns (m, b) at rows `at` (m,), divided by the root of their noise's covariance."""
    if len(shape) == 1:
        return columns / np.sqrt(shape[0])
    apart = np.abs(at[:, None] - at[None, :])
    covariance = np.where(apart < len(shape), shape[np.minimum(apart, len(shape) - 1)], 0.0)
    # Rows closer than the filter's own bandwidth asks for are nearly dependent.
    covariance[np.diag_indices(len(at))] *= 1.0 + 1e-6
    return np.linalg.solve(np.linalg.cholesky(covariance), columns)
