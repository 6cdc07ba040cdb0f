"""Plain instrumental variables, p = (Ωᵀ Ψ)⁻¹ Ωᵀ τ, as K. Yoshida's dissertation (1995) has them in (3.22) to (3.35).

Every row counts alike; the start is ordinary least squares; nothing is known of the noise's colour. The sums are kept as the triangular
factor of [Ω Ψ τ] (extended information form): with Ω = Q S, Ωᵀ Ψ p = Ωᵀ τ is (QᵀΨ) p = Qᵀτ, whose blocks the factor holds. So no product
is formed that would square the condition number, and a recursion over samples is the same sums in another order."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import singular_values
from ..errors import DataError
from ..problem.information import triangle
from ..problem.linear_solution import LinearSolution, order_of, solve_triangle
from ..regressor.row_information import stacked_information
from ..statistics.autoregression import Autoregression
from .instrument_result import InstrumentResult
from .instrument_rows import InstrumentRows
from .instruments import Instruments, instrument_problem, paired
from .possible import possible_along

if TYPE_CHECKING:
    from ..problem.problem import Problem
    from .experiment import Experiment

Array = np.ndarray
#: A direction of the instruments below this share of the largest is none.
_NONE = 1e-10
#: Called with the sums after every block of rows, and the number of instants so far.
Watch = Callable[["ExtendedInformation", int], None]


@dataclass(frozen=True, eq=False)
class ExtendedInformation:
    """Triangular `factor` (2b+1, 2b+1) of the rows [Ω Ψ τ] over b columns, and how many `rows` they are worth.

    Immutable: what adds rows gives the next one."""

    factor: Array
    rows: float = 0.0

    @classmethod
    def empty(cls, b: int) -> ExtendedInformation:
        """No rows yet."""
        return cls(np.zeros((2 * b + 1, 2 * b + 1)))

    @property
    def b(self) -> int:
        return len(self.factor) // 2

    def with_rows(self, instruments: Array, columns: Array, tau: Array, valid: Array) -> ExtendedInformation:
        """Add m instants of n joints: `instruments` and `columns` (m, n, b), `tau` and `valid` (m, n)."""
        m, n, b = columns.shape
        both = np.concatenate([instruments, columns], axis=2).reshape(m * n, 1, 2 * b)
        good = valid.reshape(m * n, 1)
        made, counts = stacked_information(both, np.where(good, tau.reshape(m * n, 1), 0.0), valid=good)
        return ExtendedInformation(triangle(np.concatenate([self.factor, made[0]])), self.rows + float(counts[0]))

    def scaled(self, factor: float) -> ExtendedInformation:
        """Every row weighted by `factor` (forgetting)."""
        return ExtendedInformation(np.sqrt(factor) * self.factor, factor * self.rows)

    @property
    def determined(self) -> bool:
        """Whether the instruments are independent of one another and there are more rows than columns."""
        size = np.linalg.norm(self.factor[:, : self.b], axis=0)
        if self.rows <= self.b or not size.all():
            return False
        singular = singular_values(self.factor[: self.b, : self.b] / size)
        return bool(singular[-1] > _NONE * singular[0])

    def solution(self, order: list[int] | None = None) -> LinearSolution:
        """The instrumental estimate; its `root` is that of the information Ψᵀ Ω (Ωᵀ Ω)⁻¹ Ωᵀ Ψ."""
        b = self.b
        R = triangle(self.factor[:b, b:])
        return solve_triangle(R[:-1, :-1], R[:-1, -1], order)

    def variance(self, values: Array) -> float:
        """Variance of the residual at values (b,), over the degrees of freedom."""
        rest = self.factor @ np.concatenate([np.zeros(self.b), -values, [1.0]])
        return float(rest @ rest) / max(self.rows - self.b, 1.0)


@dataclass(frozen=True, eq=False)
class PlainPasses:
    """Where repeated passes of the plain method stand: base `values` (b,), of which `columns` are estimated, by the ordinary
    least-squares `start`; the `instruments` and the rows (M, n) that are `usable` of the last pass, its `information`; per pass the
    largest step in white standard deviations (`steps`) and the change that made the model possible (`repaired`)."""

    values: Array
    columns: Array
    start: LinearSolution
    root: Array
    instruments: Problem | None = None
    usable: Array | None = None
    information: ExtendedInformation | None = None
    steps: tuple[float, ...] = ()
    repaired: tuple[float, ...] = ()

    @classmethod
    def begin(cls, problem: Problem) -> PlainPasses:
        """From ordinary least squares."""
        R, z, _ = problem.information.combined(np.ones(problem.valid.shape[1]))
        start = solve_triangle(R, z, order_of(problem.base))
        values = np.zeros(problem.base.count)
        values[start.columns] = start.values
        return cls(values, start.columns, start, whole_root(problem.base.count, start.columns, start.root))

    def next(
        self, problem: Problem, source: Instruments, experiment: Experiment | None, watch: Watch | None = None, forgetting: float = 1.0
    ) -> PlainPasses:
        """One more pass: instruments from the model of the last one, then their equations."""
        possible = possible_along(problem, self.values, self.root)
        instruments, usable = instrument_problem(problem, possible, source, experiment)
        info = ExtendedInformation.empty(len(self.columns))
        for rows, Z in paired(problem, instruments, usable):
            part = Z[:, :, self.columns], rows.columns[:, :, self.columns], rows.tau, rows.valid
            if watch is None and forgetting == 1.0:
                info = info.with_rows(*part)
                continue
            info = _watched(info, part, rows.place.start, watch, forgetting)
        if not info.determined:
            raise DataError("the instruments cannot separate all parameters: the model's motion does not follow the measured one.")
        found = info.solution()
        if len(found.values) != len(self.columns):
            raise DataError("the instruments cannot separate all parameters: the model's motion does not follow the measured one.")
        values = self.values.copy()
        values[self.columns] = found.values
        std = np.linalg.norm(np.linalg.inv(found.root), axis=1) * np.sqrt(info.variance(found.values))
        change = np.abs(values - self.values)[self.columns]
        live = change > 1e-10 * np.abs(found.values)
        step = float(np.max(np.where(live, change / np.maximum(std, 1e-300), 0.0), initial=0.0))
        return replace(
            self, values=values, root=whole_root(problem.base.count, self.columns, found.root), instruments=instruments, usable=usable,
            information=info, steps=(*self.steps, step), repaired=(*self.repaired, possible.moved),
        )  # fmt: skip

    def result(self, problem: Problem, *, commanded: bool) -> InstrumentResult:
        """The tests, and the covariance under the noise's colour, of the last pass; see `InstrumentResult`."""
        assert self.instruments is not None
        assert self.usable is not None
        coloured = InstrumentRows.at(problem, self.instruments, self.usable, self.columns, self.values)
        plain = replace(coloured, weighting=(Autoregression(np.ones(1), 1.0),) * problem.valid.shape[1])
        return InstrumentResult(plain, self.start, commanded=commanded, judged=coloured)


def _watched(
    info: ExtendedInformation, part: tuple[Array, Array, Array, Array], first: int, watch: Watch | None, forgetting: float
) -> ExtendedInformation:
    """The rows of a block in pieces, as a recursion takes them."""
    Z, columns, tau, valid = part
    m, piece = len(tau), max(1, getattr(watch, "piece", len(tau)))
    cuts = [0, *range(piece - first % piece, m, piece), m]
    for a, b in itertools.pairwise(cuts):
        if forgetting < 1.0:
            root = np.sqrt(forgetting ** np.arange(b - a - 1, -1, -1.0))[:, None]
            info = info.scaled(forgetting ** (b - a))
            info = info.with_rows(
                Z[a:b] * root[:, :, None], columns[a:b] * root[:, :, None], np.where(valid, tau, 0.0)[a:b] * root, valid[a:b]
            )
        else:
            info = info.with_rows(Z[a:b], columns[a:b], tau[a:b], valid[a:b])
        if watch is not None:
            watch(info, first + b)
    return info


def whole_root(count: int, columns: Array, part: Array) -> Array:
    """A root over some columns as one over all `count` base parameters; those that were grouped away are held where they are."""
    root = np.zeros((count, count))
    root[np.ix_(columns, columns)] = part
    gone = np.setdiff1d(np.arange(count), columns)
    root[gone, gone] = 1e3 * float(np.abs(np.diag(part)).max(initial=1.0))
    return root
