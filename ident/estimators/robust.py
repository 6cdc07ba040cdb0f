"""Iteratively reweighted least squares: rows that do not fit lose their weight (Huber, Tukey)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..errors import ConfigurationError, unknown_name
from ..estimate.status import StatusCode
from ..problem.information import Information
from ..problem.linear_solution import LinearSolution, full_values, order_of, sandwich, score_gram, solve_triangle, step_size
from ..statistics.noise import fit_noise
from .base import Capability, Estimator, register
from .finish import finish
from .least_squares import weighted_solution

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem

Array = np.ndarray

#: Median absolute deviation of a normal variable over its standard deviation.
_MAD = 0.6744897501960817


class Loss(ABC):
    """A loss ρ of the scaled residual u by its weight w(u) = ρ'(u)/u and its curvature ρ''(u)."""

    #: Tuning constant with 95 % efficiency where the noise is normal after all (Huber 1981; Holland & Welsch 1977).
    tuning: float

    @staticmethod
    @abstractmethod
    def weight(u: Array, c: float) -> Array: ...

    @staticmethod
    @abstractmethod
    def curvature(u: Array, c: float) -> Array: ...


class Huber(Loss):
    """Quadratic within c, linear beyond: convex, one solution."""

    tuning = 1.345

    @staticmethod
    def weight(u: Array, c: float) -> Array:
        return c / np.maximum(np.abs(u), c)

    @staticmethod
    def curvature(u: Array, c: float) -> Array:
        return (np.abs(u) <= c).astype(float)


class Tukey(Loss):
    """Bisquare: rows beyond c do not count at all. Not convex, so it starts from Huber's solution."""

    tuning = 4.685

    @staticmethod
    def weight(u: Array, c: float) -> Array:
        return np.maximum(1.0 - (u / c) ** 2, 0.0) ** 2

    @staticmethod
    def curvature(u: Array, c: float) -> Array:
        x = (u / c) ** 2
        return np.where(x < 1, (1 - x) * (1 - 5 * x), 0.0)


_LOSSES: dict[str, type[Loss]] = {"huber": Huber, "tukey": Tukey}


@register
@dataclass(frozen=True, kw_only=True)
class RobustLeastSquares(Estimator):
    """M-estimation by iteratively reweighted least squares; each joint's scale from its median absolute residual.

    `loss`: "huber" or "tukey". `tuning`: residual, in robust standard deviations, from which a row loses weight; None takes the
    value with 95 % efficiency under normal noise. `iterations`: at most. Covariance: A⁻¹BA⁻¹ of the M-estimator, with the
    colour of the clipped residual (Huber & Ronchetti 2009, ch. 7).

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.RobustLeastSquares()
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "irls"
    title: ClassVar[str] = "iteratively reweighted (robust) least squares"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING, Capability.WEIGHTS, Capability.ROBUST})

    loss: str = "huber"
    tuning: float | None = None
    iterations: int = 60

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.loss not in _LOSSES:
            raise unknown_name("loss of method 'irls'", self.loss, _LOSSES)
        if self.tuning is not None and not self.tuning > 0:
            raise ConfigurationError(f"method 'irls': tuning must be positive (standard deviations), not {self.tuning}.")

    def _solve(self, problem: Problem) -> Estimate:
        values = full_values(problem, weighted_solution(problem)[0])
        loss = _LOSSES[self.loss]
        if loss is not Huber:
            values = full_values(problem, _iterate(problem, values, Huber, Huber.tuning, self.iterations)[0])
        c = self.tuning or loss.tuning
        solution, scale, done, steps = _iterate(problem, values, loss, c, self.iterations)
        return _finish(problem, solution, scale, loss, c, self.name, done, steps)


def robust_scale(residual: Array, torque_squares: Array, counts: Array) -> Array:
    """Standard deviation of each row (n,) from the median absolute residual (M, n), NaN where a row is not used."""
    scale = np.ones(residual.shape[1])
    for j in range(residual.shape[1]):
        e = np.abs(residual[np.isfinite(residual[:, j]), j])
        if len(e):
            # More than half the rows may be fitted exactly (noise-free logs): then nothing is an outlier below round-off.
            floor = 1e-12 * np.sqrt(torque_squares[j] / max(1, counts[j]))
            scale[j] = max(float(np.median(e)) / _MAD, float(floor), 1e-150)
    return scale


def _iterate(
    problem: Problem, values: Array, loss: type[Loss], c: float, iterations: int
) -> tuple[LinearSolution, Array, bool, list[float]]:
    order = order_of(problem.base)
    information = problem.information
    squares, counts = information.torque_squares(), information.counts
    steps: list[float] = []
    scale = robust_scale(problem.residual(values), squares, counts)
    while True:
        reweighted = Information.empty(problem.valid.shape[1], problem.base.names)
        residual = np.full(problem.tau.shape, np.nan)
        for rows in problem.rows():
            e = np.where(rows.valid, rows.tau - rows.columns @ values, 0.0)
            residual[rows.place] = np.where(rows.valid, e, np.nan)
            root = np.sqrt(np.where(rows.valid, loss.weight(e / scale, c), 0.0))
            reweighted = reweighted.with_rows(rows.columns * root[:, :, None], np.where(rows.valid, rows.tau, 0.0) * root, rows.valid)
        solution = solve_triangle(*reweighted.combined(1.0 / scale**2)[:2], order)
        previous, values = values, full_values(problem, solution)
        steps.append(step_size(solution, values, previous))
        # The scale follows one step behind, so that one pass over the samples does for both.
        new = robust_scale(residual, squares, counts)
        settled = steps[-1] < 1e-6 and np.all(np.abs(new - scale) <= 1e-6 * scale)
        if settled or len(steps) >= iterations:
            return solution, scale, bool(settled), steps
        scale = new


def _finish(
    problem: Problem, solution: LinearSolution, scale: Array, loss: type[Loss], c: float, method: str, done: bool, steps: list[float]
) -> Estimate:
    residual = problem.residual(full_values(problem, solution))
    u = residual / scale
    with np.errstate(invalid="ignore"):
        clipped = np.where(np.isfinite(u), loss.weight(u, c) * u * scale, np.nan)
        low = (np.isfinite(u) & (loss.weight(u, c) < 0.5)).sum(axis=0)
    noise = fit_noise(clipped, problem.row_runs, problem.row_shape)
    weights = 1.0 / scale**2
    with np.errstate(invalid="ignore"):
        bend = np.where(np.isfinite(u), loss.curvature(u, c), 0.0).sum(axis=0)
    counts = problem.information.counts
    # The curvature enters by its mean per row, as for noise that does not depend on the motion (Huber & Ronchetti, eq. 7.82).
    share = np.maximum(bend, 0.05 * counts) / np.maximum(counts, 1)
    information = problem.information.selected(solution.columns)
    root = information.combined(weights * share)[0]
    gram = score_gram(problem, noise, lambda rows: rows.columns * weights[:, None], clipped)[np.ix_(solution.columns, solution.columns)]
    total = max(1, int(counts.sum()))
    covariance = sandwich(root, gram) * total / max(1, total - len(solution.values))
    trace: dict[str, Any] = {
        "loss": loss.__name__.lower(), "tuning": c, "scale": scale.tolist(), "steps": steps,
        "share_downweighted": [float(a / b) if b else None for a, b in zip(low, counts, strict=True)],
    }  # fmt: skip
    code = StatusCode.OK if done else StatusCode.NOT_CONVERGED
    return finish(problem, solution, weights, method, covariance=covariance, code=code, trace=trace)
