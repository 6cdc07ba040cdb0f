"""Generalised least squares: the noise of different joints at one instant is correlated, and weighted so."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..errors import ConfigurationError
from ..problem.information import stack_triangles
from ..problem.linear_solution import LinearSolution, full_values, order_of, solve_triangle, step_size
from .base import Capability, Estimator, register
from .finish import finish
from .least_squares import weighted_solution

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem
    from ..signals.rows import Rows

Array = np.ndarray
#: Least eigenvalue of the correlation across joints that is believed; a smaller one gives all weight to one combination.
_CORRELATION_FLOOR = 1e-4


@register
@dataclass(frozen=True, kw_only=True)
class GeneralisedLeastSquares(Estimator):
    """Least squares weighted by the full covariance of the noise across joints, estimated from the residual and repeated.

    The rows of one instant are whitened by the inverse root of that covariance; each repetition is one streaming pass.
    `covariance`: rows of the (n, n) noise covariance on the measured side if known; None estimates it. `iterations`: at most.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.GeneralisedLeastSquares()
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "gls"
    title: ClassVar[str] = "generalised least squares (cross-joint covariance)"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING, Capability.WEIGHTS})

    covariance: tuple[tuple[float, ...], ...] | None = None
    iterations: int = 15

    def check(self, problem: Problem) -> None:
        if self.covariance is None:
            return
        n = problem.valid.shape[1]
        given = np.asarray(self.covariance, float)
        if given.shape != (n, n) or not np.allclose(given, given.T) or np.linalg.eigvalsh(given)[0] <= 0:
            raise ConfigurationError(f"method 'gls': covariance must be a symmetric positive definite {n} x {n} matrix, one row a joint.")

    def _solve(self, problem: Problem) -> Estimate:
        if self.covariance is not None:
            known = np.asarray(self.covariance, float)
            solution = _whitened_solution(problem, RowWeights(known))
            return self._finish(problem, solution, known, [])
        values = full_values(problem, weighted_solution(problem)[0])
        steps: list[float] = []
        while True:
            across = row_covariance(problem, values)
            solution = _whitened_solution(problem, RowWeights(across))
            previous, values = values, full_values(problem, solution)
            steps.append(step_size(solution, values, previous))
            if steps[-1] < 1e-6 or len(steps) >= self.iterations:
                return self._finish(problem, solution, across, steps)

    def _finish(self, problem: Problem, solution: LinearSolution, across: Array, steps: list[float]) -> Estimate:
        warnings: tuple[str, ...] = ()
        if steps and steps[-1] > 1e-3:
            warnings = (f"gls: pass {len(steps)} still moved the estimate by {steps[-1]:.1e} standard deviations; allow more iterations.",)
        trace = {"covariance": across.tolist(), "steps": steps}
        score = RowWeights(across).score
        return finish(problem, solution, 1.0 / np.diag(across), self.name, score=score, warnings=warnings, trace=trace)


def _whitened_solution(problem: Problem, weights: RowWeights) -> LinearSolution:
    """Least squares over whitened rows: one pass over the samples."""
    triangle = np.zeros((problem.base.count + 1,) * 2)
    for rows in problem.rows():
        for whitened in weights.whitened(rows):
            triangle = stack_triangles(triangle, whitened)
    return solve_triangle(triangle[:-1, :-1], triangle[:-1, -1], order_of(problem.base))


def row_covariance(problem: Problem, values: Array) -> Array:
    """Covariance (n, n) of the residual across rows of one instant, over the instants where both are present; never singular."""
    residual = problem.residual(values)
    present = np.isfinite(residual)
    filled = np.where(present, residual, 0.0)
    pairs = present.T.astype(float) @ present
    covariance = np.divide(filled.T @ filled, pairs, out=np.zeros_like(pairs), where=pairs > 0)
    torque = np.sum(np.where(problem.valid, problem.tau, 0.0) ** 2, axis=0)
    variance = np.diag(covariance)
    # A row that is fitted exactly must not take all the weight; one without data gets any.
    floor = 1e-24 * torque / np.maximum(np.diag(pairs), 1.0)
    variance = np.where(np.diag(pairs) > 0, np.maximum(variance, np.maximum(floor, 1e-300)), 1.0)
    scale = np.sqrt(variance)
    correlation = covariance / np.outer(scale, scale)
    np.fill_diagonal(correlation, 1.0)
    eigenvalues, vectors = np.linalg.eigh(correlation)
    correlation = (vectors * np.maximum(eigenvalues, _CORRELATION_FLOOR)) @ vectors.T
    return correlation * np.outer(scale, scale)


class RowWeights:
    """Inverse of the covariance of the rows that are present, for every pattern of missing rows."""

    def __init__(self, covariance: Array) -> None:
        self.covariance = covariance
        self._known: dict[bytes, Array] = {}

    def inverse_root(self, present: Array) -> Array:
        """L (p, p) with LᵀL the inverse of the covariance of the p rows present (n,) bool."""
        key = present.tobytes()
        if key not in self._known:
            from scipy.linalg import solve_triangular

            part = self.covariance[np.ix_(present, present)]
            scale = np.sqrt(np.diag(part))
            lower = np.linalg.cholesky(part / np.outer(scale, scale))
            self._known[key] = solve_triangular(lower, np.diag(1.0 / scale), lower=True)
        return self._known[key]

    def _patterns(self, valid: Array) -> Iterator[tuple[Array, Array]]:
        patterns, which = np.unique(valid, axis=0, return_inverse=True)
        for i, present in enumerate(patterns):
            if present.any():
                yield np.flatnonzero(which.reshape(-1) == i), present

    def whitened(self, rows: Rows) -> Iterator[Array]:
        """Stacked rows (p m, b+1) of columns and torque with white noise of unit variance."""
        for samples, present in self._patterns(rows.valid):
            root = self.inverse_root(present)
            block = np.concatenate([rows.columns[samples][:, present], rows.tau[samples][:, present, None]], axis=2)
            yield np.matmul(root, block).reshape(-1, block.shape[2])

    def score(self, rows: Rows) -> Array:
        """W Φ (m, n, b) with W the inverse covariance of the rows present; zero where absent."""
        out = np.zeros_like(rows.columns)
        for samples, present in self._patterns(rows.valid):
            root = self.inverse_root(present)
            out[np.ix_(samples, np.flatnonzero(present))] = np.matmul(root.T @ root, rows.columns[samples][:, present])
        return out
