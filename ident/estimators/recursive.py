"""Recursive least squares: samples as they come, in square-root information form, with forgetting and a prior."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..effects.kinds import Need
from ..effects.motion import Motion
from ..effects.reduction import base_reduction
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from ..problem.information import Information
from ..problem.linear_solution import LinearSolution, order_of
from ..problem.reweighting import reweighted, solve_with_prior
from .base import Capability, Estimator, per_joint, register, require_forgetting
from .earlier import load_earlier, prior_rows
from .finish import finish
from .live import LiveRecursion

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..model import Model
    from ..problem.problem import Problem
    from ..regressor.base_parameters.reduction import BaseReduction
    from ..signals.rows import Rows

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class RecursiveLeastSquares(Estimator):
    """Least squares that is up to date after every sample; at the end of a log it equals weighted least squares.

    `noise_std`: noise per joint on the measured side; None estimates it from the residual so far. `forgetting`: weight of a
    sample against the next (1: none is forgotten; 0.999 at 200 Hz forgets within 5 s). `prior`: an earlier estimate, or the
    path of a saved one. `follow`: base parameters whose course is kept in the trace (None: all), at `trace_points` points.

    Use `solve` for logs. In a live loop: `live = estimator.start(model).live()`, then `live.add(q, dq, ddq, tau)`, and `live.state`.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.RecursiveLeastSquares(noise_std=0.1)
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "rls"
    title: ClassVar[str] = "recursive least squares"
    capabilities: ClassVar[frozenset[Capability]] = frozenset(
        {Capability.STREAMING, Capability.WEIGHTS, Capability.RECURSIVE, Capability.PRIOR, Capability.DRIFT}
    )

    files: ClassVar[frozenset[str]] = frozenset({"prior"})

    noise_std: tuple[float, ...] | float | None = None
    forgetting: float = 1.0
    prior: Estimate | str | None = None
    follow: tuple[str, ...] | None = None
    trace_points: int = 100

    def __post_init__(self) -> None:
        super().__post_init__()
        require_forgetting(self.forgetting, self.name)
        if self.trace_points < 0:
            raise ConfigurationError("method 'rls': trace_points must not be negative.")

    def check(self, problem: Problem) -> None:
        n = problem.valid.shape[1]
        if self.noise_std is not None:
            per_joint(self.noise_std, n, "noise_std", positive=True)
        for name in self.follow or ():
            if name not in problem.base.names:
                raise unknown_name("base parameter in `follow`", name, problem.base.names)

    def start(self, model: Model, base: BaseReduction | None = None, rows: int | None = None) -> RecursiveState:
        """A recursion over the base parameters of a model (`base` if they are known), before the first sample."""
        base = base_reduction(model) if base is None else base
        n = model.robot.n if rows is None else rows
        known = None if self.prior is None else prior_rows(base, load_earlier(self.prior))
        return RecursiveState(model, base, Information.empty(n, base.names), np.zeros(n), 0, self, known)

    def _solve(self, problem: Problem) -> Estimate:
        total = len(problem.valid)
        state = self.start(problem.model, problem.base, problem.valid.shape[1])
        points = np.unique(np.linspace(0, total, self.trace_points + 1).round().astype(int))[1:]
        names = self.follow or problem.base.names
        course = _Course([problem.base.names.index(name) for name in names])
        weights: Array | None = None
        for rows in problem.rows():
            start, stop = rows.place.start, rows.place.stop
            cuts = [start, *points[(points > start) & (points < stop)].tolist(), stop]
            for a, b in pairwise(cuts):
                part = slice(a - start, b - start)
                state = state.update(rows.columns[part], rows.tau[part], rows.valid[part])
                if b in points:
                    weights = course.add(state, weights)
        solution, weights = state.solution()
        trace = {"names": list(names), **course.to_dict(), "forgetting": self.forgetting}
        settled = weights

        def score(rows: Rows) -> Array:
            age = total - 1 - np.arange(rows.place.start, rows.place.stop)
            return rows.columns * settled[:, None] * (self.forgetting**age)[:, None, None]

        return finish(problem, solution, weights, self.name, score=score, trace=trace)


@dataclass(frozen=True, eq=False)
class RecursiveState:
    """Where a recursion stands. Immutable: every update gives the next state.

    `information`: triangular factors over the base parameters, forgotten as asked; `effective` (n,): samples that they are
    worth per row; `seen`: instants taken so far; `prior`: rows of prior knowledge or None."""

    model: Model
    base: BaseReduction
    information: Information
    effective: Array
    seen: int
    config: RecursiveLeastSquares
    prior: tuple[Array, Array] | None

    def update(self, columns: Array, tau: Array, valid: Array | None = None) -> RecursiveState:
        """Take m instants: `columns` (m, n, b) over base parameters, `tau` (m, n), `valid` (m, n) bool (None: all).

        One instant or a block of them: the result is the same."""
        factor = self.config.forgetting
        use = np.isfinite(tau) if valid is None else valid & np.isfinite(tau)
        information, effective, m = self.information, self.effective, len(tau)
        if factor == 1.0:
            information = information.with_rows(columns, tau, use)
            return replace(self, information=information, effective=effective + use.sum(axis=0), seen=self.seen + m)
        weight = factor ** np.arange(m - 1, -1, -1.0)
        root = np.sqrt(weight)[:, None]
        information = information.scaled(factor**m).with_rows(columns * root[:, :, None], np.where(use, tau, 0.0) * root, use)
        return replace(self, information=information, effective=effective * factor**m + weight @ use, seen=self.seen + m)

    def observe(self, q: Array, dq: Array, ddq: Array, tau: Array, t: Array | None = None) -> RecursiveState:
        """Take measured instants, each array (n,) or (m, n): joint-side motion, measured-side torque (NaN: missing)."""
        if self.model.needs & {Need.HISTORY, Need.NEIGHBOURS, Need.REFERENCE}:
            raise UnsupportedError("an effect of this model depends on other instants; make its columns yourself and call `update`.")
        arrays = [np.atleast_2d(np.asarray(x, float)) for x in (q, dq, ddq, tau)]
        motion = Motion.of(self.model.robot, arrays[0], arrays[1], arrays[2], None if t is None else np.atleast_1d(t))
        return self.update(self.model.columns(motion)[:, :, self.base.independent], arrays[3])

    def at(self, information: Information, effective: Array, seen: int) -> RecursiveState:
        """The same recursion elsewhere; see the fields."""
        return replace(self, information=information, effective=effective, seen=seen)

    def live(self) -> LiveRecursion[RecursiveState]:
        """For a live loop: `live.add(q, dq, ddq, tau)` takes one sample at a time, `live.state` gives the state when it is asked for."""
        return LiveRecursion(self, self.config.forgetting)

    def solution(self, weights: Array | None = None, iterations: int = 20) -> tuple[LinearSolution, Array]:
        """Least-squares solution and the weights (n,) of the rows; `weights` start their iteration where noise is not given."""
        counted = replace(self.information, counts=self.effective)
        order = order_of(self.base)
        if self.config.noise_std is not None:
            given = 1.0 / np.square(per_joint(self.config.noise_std, self.information.n, "noise_std", positive=True))
            return solve_with_prior(counted, given, order, self.prior), given
        return reweighted(counted, order, weights, self.prior, iterations)

    @cached_property
    def _now(self) -> tuple[Array, Array]:
        return known(self.solution()[0], self.base.count)

    @property
    def values(self) -> Array:
        """Base parameters (b,); NaN where the samples so far do not determine one alone."""
        return self._now[0]

    @property
    def std(self) -> Array:
        """Their standard deviations (b,), for white noise."""
        return self._now[1]


def known(solution: LinearSolution, count: int) -> tuple[Array, Array]:
    """Values and standard deviations (b,) of the parameters that stand alone in the solution, NaN elsewhere."""
    from scipy.linalg import solve_triangular

    values, std = np.full(count, np.nan), np.full(count, np.nan)
    alone = np.count_nonzero(solution.regroup, axis=1) == 1
    inverse = solve_triangular(solution.root, np.eye(len(solution.values))) if len(solution.values) else np.zeros((0, 0))
    values[solution.columns[alone]] = solution.values[alone]
    std[solution.columns[alone]] = np.linalg.norm(inverse, axis=1)[alone]
    return values, std


class _Course:
    """Values and standard deviations of some parameters against the number of samples."""

    def __init__(self, which: list[int]) -> None:
        self.which = which
        self.samples: list[int] = []
        self.values: list[list[float]] = []
        self.std: list[list[float]] = []

    def add(self, state: RecursiveState, weights: Array | None) -> Array | None:
        """Note where the recursion stands; `weights` of the last point start the next."""
        if np.sum(state.effective) < 1:
            return weights
        solution, weights = state.solution(weights, iterations=2)
        values, std = known(solution, state.base.count)
        self.samples.append(state.seen)
        self.values.append(values[self.which].tolist())
        self.std.append(std[self.which].tolist())
        return weights

    def to_dict(self) -> dict[str, Any]:
        return {"samples": self.samples, "values": self.values, "std": self.std}
