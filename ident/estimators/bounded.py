"""Weighted least squares within physical bounds: friction and rotor inertia are not negative, and bounds of the user's own."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..errors import ConfigurationError, unknown_name
from ..estimate.status import StatusCode
from ..problem.linear_solution import LinearSolution, order_of, solve_triangle
from ..problem.reweighting import residual_weights
from ..robots.parameters import Parameter
from .base import Capability, Estimator, register
from .finish import finish

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem
    from ..regressor.base_parameters.reduction import BaseReduction

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class BoundedLeastSquares(Estimator):
    """Weighted least squares with each base parameter between bounds (active set, Stark & Parker 1995).

    The bounds of the model's parameters hold by themselves: those of a base parameter follow from everything grouped in it.
    `bounds`: base parameter → (lower, upper) instead, in its unit; None for no bound on that side. Parameters at a bound are
    named in the status. The covariance is that without bounds: for a true value inside them the error is never larger.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.BoundedLeastSquares(bounds={"Fv_joint1": (0.0, 1.0)})
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "bounded"
    title: ClassVar[str] = "weighted least squares within bounds"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING, Capability.WEIGHTS, Capability.BOUNDS})

    bounds: Mapping[str, tuple[float | None, float | None]] | tuple[tuple[str, tuple[float | None, float | None]], ...] = ()
    iterations: int = 20

    def check(self, problem: Problem) -> None:
        _user_bounds(dict(self.bounds), problem.base)

    def _solve(self, problem: Problem) -> Estimate:
        information = problem.information
        lower, upper = base_bounds(problem.base)
        for i, pair in _user_bounds(dict(self.bounds), problem.base).items():
            lower[i], upper[i] = pair
        weights = np.where(information.counts > 0, 1.0, 0.0)
        for _ in range(max(2, self.iterations)):
            new = residual_weights(information, _within(problem, weights, lower, upper)[1], weights)
            change = np.max(np.abs(new - weights) / np.where(new > 0, new, 1.0))
            weights = new
            if change < 1e-6:
                break
        free, solution, at = _within(problem, weights, lower, upper)
        estimate = finish(problem, solution, weights, self.name)
        if not len(at):
            return estimate
        details = tuple(
            f"{estimate.names[i]} stands at {solution.values[i]:.6g} {estimate.parameters[i].unit};"
            f" without the bound it would be {free.values[i]:.6g} ± {estimate.std[i]:.2g}."
            for i in at[:8]
        )
        if len(at) > 8:
            details = (*details, f"So do {len(at) - 8} more.")
        trace = {"at_bound": [estimate.names[i] for i in at], "unbounded": [float(free.values[i]) for i in at]}
        return replace(estimate, status=replace(estimate.status, code=StatusCode.AT_BOUND, details=details), trace=trace)


def _within(problem: Problem, weights: Array, lower: Array, upper: Array) -> tuple[LinearSolution, LinearSolution, Array]:
    """Solutions without and with the bounds (b,), and which values stand at one."""
    free = solve_triangle(*problem.information.combined(weights)[:2], order_of(problem.base))
    # What the data group into another parameter no longer has bounds of its own.
    alone = np.count_nonzero(free.regroup, axis=1) == 1
    low = np.where(alone, lower[free.columns], -np.inf)
    high = np.where(alone, upper[free.columns], np.inf)
    solution = replace(free, values=bounded_solution(free, low, high))
    return free, solution, np.flatnonzero((solution.values <= low) | (solution.values >= high))


def bounded_solution(free: LinearSolution, lower: Array, upper: Array) -> Array:
    """Values (b',) that minimise ‖root (p − free)‖ within bounds (b',); exact on the active set that was found."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import lsq_linear

    if np.all((free.values >= lower) & (free.values <= upper)):
        return free.values
    scale = np.linalg.norm(free.root, axis=0)
    fixed = lower == upper
    values = np.where(fixed, lower, 0.0)
    open_ = np.flatnonzero(~fixed)
    target = free.root @ (free.values - values)
    if len(open_):
        found = lsq_linear(
            free.root[:, open_] / scale[open_], target, ((lower * scale)[open_], (upper * scale)[open_]), method="bvls", tol=1e-14
        )
        values[open_] = found.x / scale[open_]
        at = np.zeros(len(values), bool)
        at[open_] = found.active_mask != 0
        values = np.where(at & (values - lower < upper - values), lower, np.where(at & ~fixed, upper, values))
        inside = np.flatnonzero(~at & ~fixed)
        if len(inside):
            Q, R = np.linalg.qr(free.root[:, inside])
            rest = np.where(at | fixed, values, 0.0)
            polished = solve_triangular(R, Q.T @ (free.root @ (free.values - rest)))
            if np.all((polished >= lower[inside]) & (polished <= upper[inside])):
                values[inside] = polished
    return np.clip(values, lower, upper)


def base_bounds(base: BaseReduction) -> tuple[Array, Array]:
    """Bounds (b,), (b,) of the base parameters, from those of everything grouped in each (interval arithmetic)."""
    low = np.array([p.lower for p in base.parameters])
    high = np.array([p.upper for p in base.parameters])
    return _interval(base.regroup, low, high), -_interval(-base.regroup, low, high)


def _interval(rows: Array, low: Array, high: Array) -> Array:
    """Least value of rows @ p over low ≤ p ≤ high."""
    with np.errstate(invalid="ignore"):
        terms = np.where(rows > 0, rows * low, np.where(rows < 0, rows * high, 0.0))
    return terms.sum(axis=1)


def _user_bounds(bounds: Mapping[str, tuple[float | None, float | None]], base: BaseReduction) -> dict[int, tuple[float, float]]:
    out = {}
    for name, pair in bounds.items():
        if name not in base.names:
            raise unknown_name("base parameter in `bounds`", name, base.names)
        try:
            low, high = (limit if x is None else float(x) for x, limit in zip(pair, (-math.inf, math.inf), strict=True))
        except (TypeError, ValueError):
            raise ConfigurationError(f"bounds of {name!r} must be [lower, upper] (numbers, or null for none), not {pair!r}.") from None
        if not low <= high:
            raise ConfigurationError(f"bounds of {name!r}: lower {low:g} is not below upper {high:g}{_unit(base.parameters, name)}.")
        out[base.names.index(name)] = (low, high)
    return out


def _unit(parameters: tuple[Parameter, ...], name: str) -> str:
    return next((f" {p.unit}" for p in parameters if p.name == name), "")
