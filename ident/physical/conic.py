"""Small layer over Clarabel: quadratic objective, linear, second-order, exponential and semidefinite constraints, by index.

Variables are numbers of columns; a constraint is a constant and a few (columns, coefficients) blocks. Everything is sparse."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError, IdentError

if TYPE_CHECKING:
    import scipy.sparse as sp

Array = np.ndarray

#: (columns (k,), coefficients (k, ...)): the sum of coefficient i times variable columns[i].
Block = tuple[Array, Array]


class SolverError(IdentError):
    """The solver stopped without a solution; the text says how far it came and what to do."""


class InfeasibleError(ConfigurationError):
    """No parameters satisfy the constraints together."""


def solver_available() -> bool:
    """Whether the semidefinite solver (Clarabel) is installed."""
    return importlib.util.find_spec("clarabel") is not None


def require_solver(what: str) -> None:
    """Raise ConfigurationError, with how to install it, where the solver is missing."""
    if not solver_available():
        raise ConfigurationError(f"{what} needs the semidefinite solver Clarabel, which is not installed: pip install 'ident[sdp]'.")


def triangle_indices(size: int) -> tuple[Array, Array, Array]:
    """(rows, columns, scale) of the upper triangle, column by column, off-diagonals scaled by sqrt 2 (Clarabel's order)."""
    columns = np.concatenate([np.full(j + 1, j) for j in range(size)]) if size else np.zeros(0, int)
    rows = np.concatenate([np.arange(j + 1) for j in range(size)]) if size else np.zeros(0, int)
    return rows, columns, np.where(rows == columns, 1.0, np.sqrt(2.0))


def symmetric_basis(size: int) -> Array:
    """A basis of the symmetric matrices: (size (size + 1) / 2, size, size), unit entries mirrored."""
    rows, columns, _ = triangle_indices(size)
    out = np.zeros((len(rows), size, size))
    out[np.arange(len(rows)), rows, columns] = 1.0
    out[np.arange(len(rows)), columns, rows] = 1.0
    return out


@dataclass(frozen=True, eq=False)
class Solution:
    """Solver's answer: `x` (variables,), `objective`, its relative `gap` to the dual one, `status` in the solver's words."""

    x: Array
    objective: float
    gap: float
    status: str

    @property
    def accurate(self) -> bool:
        """Whether the solver reached its full tolerance."""
        return self.status == "Solved"


class ConicProgram:
    """Minimise ½ x'Px + q'x (+ constant) under constraints that are added one by one."""

    def __init__(self) -> None:
        self.count = 0
        self._rows: list[tuple[str, int, Array, list[Block]]] = []
        self._P: list[tuple[Array, Array]] = []
        self._q: list[Block] = []

    def variables(self, count: int) -> Array:
        """New variables: their columns."""
        start, self.count = self.count, self.count + count
        return np.arange(start, start + count)

    def linear(self, columns: Array, coefficients: Array) -> None:
        """Add coefficients' x to the objective."""
        self._q.append((np.atleast_1d(columns), np.atleast_1d(np.asarray(coefficients, float))))

    def squares(self, columns: Array, matrix: Array, target: Array) -> None:
        """Add |matrix @ x[columns] - target|^2 to the objective, through residuals of their own: squaring would square the condition."""
        residual = self.variables(len(target))
        self._P.append((residual, 2.0 * np.ones(len(target))))
        self.equal(-np.asarray(target, float), [(columns, np.asarray(matrix, float).T), (residual, -np.eye(len(target)))])

    def distance(self, columns: Array, target: Array, weight: float = 1.0) -> None:
        """Add weight |x[columns] - target|^2 to the objective."""
        self._P.append((columns, 2.0 * weight * np.ones(len(columns))))
        self._q.append((columns, -2.0 * weight * np.asarray(target, float)))

    def equal(self, constant: Array, blocks: Sequence[Block]) -> None:
        """constant + sum of blocks = 0; coefficients (k, m)."""
        self._add("zero", np.atleast_1d(np.asarray(constant, float)), blocks)

    def nonnegative(self, constant: Array, blocks: Sequence[Block]) -> None:
        """constant + sum of blocks >= 0, entry by entry; coefficients (k, m)."""
        self._add("nonnegative", np.atleast_1d(np.asarray(constant, float)), blocks)

    def second_order(self, constant: Array, blocks: Sequence[Block]) -> None:
        """First entry >= norm of the others."""
        self._add("second_order", np.asarray(constant, float), blocks)

    def exponential(self, constant: Array, blocks: Sequence[Block]) -> None:
        """(x, y, z) with y exp(x / y) <= z, y > 0."""
        self._add("exponential", np.asarray(constant, float), blocks)

    def semidefinite(self, constant: Array, blocks: Sequence[Block]) -> None:
        """constant (s, s) + sum of blocks, coefficients (k, s, s), positive semidefinite."""
        rows, columns, scale = triangle_indices(len(constant))
        self._add("semidefinite", constant[rows, columns] * scale, [(c, m[:, rows, columns] * scale) for c, m in blocks], len(constant))

    def _add(self, kind: str, constant: Array, blocks: Sequence[Block], size: int | None = None) -> None:
        self._rows.append(
            (kind, len(constant) if size is None else size, constant, [(np.atleast_1d(c), np.asarray(m, float)) for c, m in blocks])
        )

    def solve(self, what: str, *, tolerance: float = 1e-9, accept: float = 1e-5, time_limit: float = 60.0) -> Solution:
        """Solve. `what` names the problem in errors; `accept`: largest relative gap at which an answer short of `tolerance` is taken.

        Raises InfeasibleError, SolverError, ConfigurationError (no solver)."""
        require_solver(what)
        import clarabel
        import scipy.sparse as sp

        cones: list[Any] = []
        make = {
            "zero": clarabel.ZeroConeT,
            "nonnegative": clarabel.NonnegativeConeT,
            "second_order": clarabel.SecondOrderConeT,
            "exponential": lambda _: clarabel.ExponentialConeT(),
            "semidefinite": clarabel.PSDTriangleConeT,
        }
        for kind, size, _, _ in self._rows:
            cones.append(make[kind](size))
        A, b = self._constraints(sp)
        P, q = self._objective(sp)
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.time_limit = time_limit
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = tolerance
        # One thread: the programs are small, and the machine may be shared.
        settings.max_threads = 1
        try:
            found = clarabel.DefaultSolver(P, q, A, b, cones, settings).solve()
        except BaseException as error:
            if isinstance(error, (KeyboardInterrupt, SystemExit)):
                raise
            raise SolverError(
                f"{what}: the solver failed ({error}). Check the scale of the problem, or use method='log_cholesky'."
            ) from None
        status = str(found.status)
        if status in ("PrimalInfeasible", "AlmostPrimalInfeasible"):
            raise InfeasibleError(f"{what}: no parameters satisfy all constraints together; loosen the bounds or the margin.")
        x, objective, dual = np.asarray(found.x), float(found.obj_val), float(found.obj_val_dual)
        gap = abs(objective - dual) / max(1.0, abs(objective)) if np.isfinite(objective) and np.isfinite(dual) else np.inf
        usable = (
            status in ("InsufficientProgress", "MaxIterations", "MaxTime", "NumericalError") and np.all(np.isfinite(x)) and gap <= accept
        )
        if status not in ("Solved", "AlmostSolved") and not usable:
            raise SolverError(
                f"{what}: the solver stopped with {status} after {found.iterations} iterations."
                " Check the scale of the problem and its bounds."
            )
        return Solution(x, objective, gap, status)

    def _constraints(self, sp: Any) -> tuple[sp.csc_matrix, Array]:
        data: list[Array] = []
        rows: list[Array] = []
        columns: list[Array] = []
        right: list[Array] = []
        start = 0
        for _, _, constant, blocks in self._rows:
            for c, m in blocks:
                i, j = np.nonzero(m)
                data.append(-m[i, j])
                rows.append(start + j)
                columns.append(c[i])
            right.append(constant)
            start += len(constant)
        joined = [np.concatenate(x) if x else np.zeros(0) for x in (data, rows, columns)]
        A = sp.csc_matrix((joined[0], (joined[1].astype(int), joined[2].astype(int))), shape=(start, self.count))
        return A, np.concatenate(right) if right else np.zeros(0)

    def _objective(self, sp: Any) -> tuple[sp.csc_matrix, Array]:
        q = np.zeros(self.count)
        for c, v in self._q:
            np.add.at(q, c, v)
        diagonal = np.zeros(self.count)
        for c, v in self._P:
            np.add.at(diagonal, c, v)
        P = sp.diags(diagonal, format="csc")
        return P, q
