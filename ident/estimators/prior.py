"""Least squares with prior knowledge: the URDF's inertial parameters, in a metric that respects physics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .._utils.singular_values import singular_values, svd
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from ..problem.information import triangle
from ..problem.linear_solution import LinearSolution, full_values, score_gram
from ..statistics.noise import fit_noise
from .base import Capability, Estimator, register
from .finish import finish
from .inertial_metric import METRICS, nominal_root
from .least_squares import weighted_solution

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class PriorLeastSquares(Estimator):
    """Weighted least squares drawn towards the nominal inertial parameters of the URDF; drive parameters stay free.

    `metric`: "entropic" (second order of the distance between pseudo-inertias; Lee, Wensing & Park 2020) or "scale" (each
    parameter by its link's mass and size). `relative_std`: how far, relative to itself, a link's inertia may be from the
    nominal one; None takes the value that makes the log most likely (evidence). Directions that the log does not show take
    their prior value, so that no inertial parameter is grouped away. The covariance is that of the posterior.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.PriorLeastSquares(relative_std=0.5)
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "prior"
    title: ClassVar[str] = "least squares with the URDF's inertias as prior"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING, Capability.WEIGHTS, Capability.PRIOR})

    metric: str = "entropic"
    relative_std: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.metric not in METRICS:
            raise unknown_name("metric of method 'prior'", self.metric, METRICS)
        if self.relative_std is not None and not self.relative_std > 0:
            raise ConfigurationError(
                f"method 'prior': relative_std must be positive (1: as large as the link's own inertia), not {self.relative_std}."
            )

    def check(self, problem: Problem) -> None:
        if problem.model.robot.nominal is None:
            raise UnsupportedError(
                f"method 'prior' pulls the estimate towards the URDF's inertial parameters, but robot"
                f" {problem.model.robot.name!r} has none;"
                " use 'wls', or 'bounded' for physical bounds alone."
            )

    def _solve(self, problem: Problem) -> Estimate:
        start, weights = weighted_solution(problem)
        residual = problem.residual(full_values(problem, start))
        noise = fit_noise(residual, problem.row_runs, problem.row_shape)
        gram = score_gram(problem, noise, lambda rows: rows.columns * weights[:, None], residual)
        # Coloured noise leaves fewer independent samples than rows: the data count for less by that share.
        share = max(1.0, _colour(start, gram))
        R, z, _ = problem.information.combined(weights / share)
        blend = _Blend(problem, R, z, nominal_root(problem.model.robot, self.metric))
        spread = self.relative_std or blend.likely_spread()
        solution, covariance = blend.posterior(spread, gram / share**2)
        trace = {"metric": self.metric, "relative_std": spread}
        return finish(problem, solution, weights, self.name, covariance=covariance, trace=trace)


def _colour(solution: LinearSolution, gram: Array) -> float:
    """By how much coloured noise inflates the variance of the mean parameter: tr(A⁻¹ ΦᵀWΓWΦ) / b."""
    from scipy.linalg import solve_triangular

    if not len(solution.values):
        return 1.0
    inner = gram[np.ix_(solution.columns, solution.columns)]
    half = solve_triangular(solution.root, inner, trans="T")
    return float(np.trace(solve_triangular(solution.root, half.T, trans="T"))) / len(solution.values)


class _Blend:
    """Data information R p = z over base parameters, seen through all k parameters, beside a prior on the rigid ones.

    `root` (r, r): ‖root (π − π₀)‖ measures the distance from the nominal parameters."""

    def __init__(self, problem: Problem, R: Array, z: Array, root: Array) -> None:
        self.regroup = problem.base.regroup
        self.nominal = np.asarray(problem.model.robot.nominal, float)
        self.A, self.z, self.prior = R @ self.regroup, z, root
        self.rigid = np.array([p.effect == "rigid_body" for p in problem.base.parameters])

    def likely_spread(self) -> float:
        """Spread of the prior under which the data are most likely, free parameters integrated out."""
        from scipy.linalg import solve_triangular
        from scipy.optimize import minimize_scalar

        free = self.A[:, ~self.rigid]
        rest = np.eye(len(self.A))
        if free.any():
            left, size, _ = svd(free / np.maximum(np.linalg.norm(free, axis=0), 1e-300))
            rest = left[:, int(np.sum(size > 1e-10 * size[0])) :].T
        miss = rest @ (self.z - self.A[:, self.rigid] @ self.nominal)
        per_unit = solve_triangular(self.prior, (rest @ self.A[:, self.rigid]).T, trans="T").T
        U, s, _ = svd(per_unit, full_matrices=False)
        seen = U.T @ miss

        def surprise(log_spread: float) -> float:
            variance = 1.0 + np.exp(2 * log_spread) * s**2
            return float(np.sum(np.log(variance)) + np.sum(seen**2 / variance))

        grid = np.linspace(np.log(1e-4), np.log(100.0), 80)
        best = int(np.argmin([surprise(x) for x in grid]))
        bracket = (grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)])
        return float(np.exp(minimize_scalar(surprise, bounds=bracket, method="bounded").x))

    def posterior(self, spread: float, gram: Array) -> tuple[LinearSolution, Array]:
        """Base parameters with a prior of this spread, and their covariance; `gram` (b, b) is that of the data's score.

        With C = (AᵀA + Λ)⁻¹ over all parameters the covariance is C (regroupᵀ gram regroup + Λ) C, carried to the base.
        Free parameters that the data do not show take the base parameters that hold them with them."""
        from scipy.linalg import solve_triangular

        size = np.linalg.norm(self.A, axis=0)
        unseen = ~self.rigid & (size <= 1e-10 * max(float(size[~self.rigid].max(initial=0.0)), 1e-300))
        which = np.flatnonzero(~unseen)
        rigid = np.flatnonzero(self.rigid[which])
        stacked = np.zeros((len(self.A) + len(self.prior), len(which) + 1))
        stacked[: len(self.A), :-1], stacked[: len(self.A), -1] = self.A[:, which], self.z
        stacked[len(self.A) :, rigid] = self.prior / spread
        stacked[len(self.A) :, -1] = self.prior @ self.nominal / spread
        factor = triangle(stacked)
        scale = np.linalg.norm(factor[:-1, :-1], axis=0)
        unit, z = factor[:-1, :-1] / scale, factor[:-1, -1]
        kept = np.flatnonzero(~np.any(self.regroup[:, unseen] != 0, axis=1))
        rows = self.regroup[np.ix_(kept, which)]
        reach = solve_triangular(unit, (rows / scale).T, trans="T")
        gain = solve_triangular(unit, reach) / scale[:, None]  # C rowsᵀ
        data, prior = self.regroup[:, which] @ gain, stacked[len(self.A) :, :-1] @ gain
        covariance = data.T @ gram @ data + prior.T @ prior
        root = triangle(solve_triangular(triangle(reach), np.eye(len(kept)), trans="T"))
        singular = singular_values(root / np.linalg.norm(root, axis=0))
        values = rows @ (solve_triangular(unit, z) / scale)
        regroup = np.eye(len(self.regroup))[kept]
        return LinearSolution(kept, regroup, values, root, float(singular[0] / singular[-1])), (covariance + covariance.T) / 2
