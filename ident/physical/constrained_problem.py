"""The conic program of a consistent fit: base values and directions that no torque sees, and what is asked of them."""

from __future__ import annotations

import numpy as np

from .._utils.singular_values import lstsq
from .bounds import Bounds, Metric, Prior
from .conic import ConicProgram, InfeasibleError, Solution, SolverError, triangle_indices
from .consistent import _drive_scale, _free_scale, link_scales, scaled_units
from .interior import InteriorProblem, Matrices
from .pseudo_inertia import UNITS
from .structure import InertiaStructure
from .target import Target

Array = np.ndarray
#: Least eigenvalue of a link's pseudo-inertia, relative to a typical link of that robot.
MARGIN = 1e-5
#: Cost per unit of a (scaled) pseudo-inertia's trace that settles what no torque sees; the data cost 1 per standard deviation squared.
SETTLE = 1e-4
#: Units (standard deviations) in which distances are counted, in the order of trial.
_UNITS = (1.0, 30.0, 1e3, 0.03)


class ConstrainedProblem:
    """The unknowns x = (w, z), base values and unseen directions, and what is asked of the parameters constant + sensitivity @ x."""

    def __init__(
        self, structure: InertiaStructure, target: Target, bounds: Bounds, prior: Prior | None, margin: float, scale: Array,
        released: str = "",
    ) -> None:  # fmt: skip
        """`released`: name of a link or parameter that may be anything (to learn what its constraint costs)."""
        self.structure, self.target, self.prior, self.margin, self.scale, self.released = structure, target, prior, margin, scale, released
        free = structure.null_space
        drive = _drive_scale(structure, structure.lift @ (target.offset + target.root @ target.target))
        self.constant = structure.lift @ target.offset
        self.sensitivity = np.concatenate([structure.lift @ target.root, free * _free_scale(structure, free, scale, drive)], axis=1)
        self.roots = [None] * structure.tree.nb if prior is None else prior.roots(structure)
        A, c = bounds.rows(structure)
        at = np.array([i for i in structure.drive if structure.names[i] != released], int)
        of_drive = np.isin(structure.drive, at)
        signed = np.array([i for i in structure.nonnegative if structure.names[i] != released], int)
        # A rotor inertia that the data fix must be positive; one that is grouped away may be zero.
        least = np.where(np.any(np.abs(free[at]) > 1e-12, axis=1), 0.0, margin)
        unit = np.eye(structure.k)
        rows = np.concatenate([unit[at] / drive[of_drive, None], unit[signed], A])
        constants = np.concatenate([-least, np.zeros(len(signed)), c])
        size = np.maximum(np.linalg.norm(rows @ self.sensitivity, axis=1), 1e-12)
        self.rows, self.constants = (rows @ self.sensitivity) / size[:, None], (rows @ self.constant + constants) / size
        moved = np.abs(rows @ self.sensitivity).max(axis=1, initial=0.0) > 0
        stuck = np.flatnonzero(~moved[: len(at) + len(signed)] & (self.constants[: len(at) + len(signed)] < 0))
        if len(stuck):
            names = ", ".join(structure.names[np.concatenate([at, signed])[i]] for i in stuck)
            raise InfeasibleError(
                f"{names}: rotor inertia must be positive and friction not negative, but the covariance says that the value may not change."
            )
        self.rows, self.constants = self.rows[moved], self.constants[moved]
        self.cones = [(cone @ self.sensitivity, cone @ self.constant) for cone in bounds.cones(structure)]

    def solve(self, inside: Array | None = None, limit: float | None = None) -> tuple[Array, Array, float, Solution]:
        """(values, standard, cost of the data, solution). `inside` (k,): parameters that satisfy everything strictly, if known.

        `limit`: the data may cost that much (squared standard deviations), and the links alone are minimised."""
        solution = self._conic(0.0, limit)
        x = solution.x[: self.sensitivity.shape[1]]
        if self.prior is not None and self.prior.metric == Metric.GEOMETRIC:
            x = self._geometric(self.prior, x, inside)
        elif self.prior is not None and self.prior.metric == Metric.ENTROPIC and limit is None:
            x = self._polished(self.prior, x)
        structure, target = self.structure, self.target
        standard = self.constant + self.sensitivity @ x
        # Rounding may leave a rotor inertia or friction a hair below zero: put it on the border, where it is meant to be. A hair is a
        # thousandth of a standard deviation, or of a unit where the data do not see it.
        signed = np.concatenate([structure.drive, structure.nonnegative])
        seen = np.linalg.norm(self.sensitivity[signed][:, : len(target.target)][:, target.costed], axis=1)
        hair = 1e-3 * np.where(seen > 0, seen, 1.0)
        standard[signed[(standard[signed] < 0) & (standard[signed] > -hair)]] = 0.0
        values = structure.regroup @ standard
        if not target.root.shape[1]:
            values = target.offset
            standard = standard + structure.lift @ (values - structure.regroup @ standard)
        return values, standard, float(np.sum((x[: len(target.target)] - target.target)[target.costed] ** 2)), solution

    def _link(self, body: int, units: Array) -> tuple[Array, Array]:
        """(constant (s, s), slopes (p, s, s)) of a link's matrix with the given matrices per unit parameter."""
        at = self.structure.inertial[10 * body : 10 * body + 10]
        return np.tensordot(self.constant[at], units, 1), np.tensordot(self.sensitivity[at].T, units, 1)

    def _relative(self, body: int, root: Array) -> tuple[Array, Array]:
        """Pseudo-inertia relative to the nominal one, J0^-1/2 J J0^-T/2."""
        inverse = np.linalg.inv(root)
        return self._link(body, np.einsum("ai,kij,bj->kab", inverse, UNITS, inverse))

    def _conic(self, inside: float, limit: float | None = None) -> Solution:
        """The program with the quadratic or entropic metric, or none; `inside` keeps all inequalities that far from their borders.

        How far the constraints move the estimate is not known beforehand: where the solver does not get through, distances are
        counted in larger units. A badly scaled program looks infeasible to it, so that is believed only if every unit says so."""
        for unit in _UNITS:
            try:
                found = self._conic_in(inside, unit, limit)
                found.x[: len(self.target.target)] *= unit
                return found
            except (SolverError, InfeasibleError):
                if unit == _UNITS[-1]:
                    raise
        raise AssertionError

    def _conic_in(self, inside: float, unit: float, limit: float | None) -> Solution:
        """The same with base directions counted in `unit` standard deviations."""
        program = ConicProgram()
        p, moves = self.sensitivity.shape[1], len(self.target.target)
        x = program.variables(p)
        step = np.ones(p)
        step[:moves] = unit
        share = 1.0 / unit**2
        costed = self.target.costed
        settle = SETTLE
        if limit is None:
            program.distance(x[:moves][costed], self.target.target[costed] / unit)
        else:
            # Only the links are minimised: their terms need not be small beside the data's.
            share, settle = 1.0, 1e-2
            place = np.flatnonzero(costed)
            rows = np.concatenate([np.zeros((1, len(place))), np.eye(len(place))])
            radius = np.concatenate([[np.sqrt(limit) / unit], -self.target.target[place] / unit])
            program.second_order(radius, [(x[:moves][place], rows.T)])
        # What the data do not see stays near zero, as far as nothing else asks for it.
        program.distance(x[:moves][~costed], np.zeros(int(np.sum(~costed))), SETTLE)
        default = link_scales(self.structure)
        for body, root in enumerate(self.roots):
            if self.structure.body_names[body] != self.released:
                constant, slope = self._link(body, scaled_units(self.scale[body]))
                program.semidefinite(constant - (self.margin + inside) * np.eye(4), [(x, slope * step[:, None, None])])
                if root is None:
                    # Among links that no torque tells apart, the light and compact ones.
                    trace = np.trace(self._link(body, scaled_units(default[body]))[1], axis1=1, axis2=2)
                    program.linear(x, settle * share * trace * step)
            if root is not None:
                self._distance(program, x, body, root, share, step)
        if len(self.constants):
            program.nonnegative(self.constants - inside, [(x, (self.rows * step).T)])
        for cone, offset in self.cones:
            lowered = offset.copy()
            lowered[0] -= inside
            program.second_order(lowered, [(x, (cone * step).T)])
        return program.solve("the physically consistent fit")

    def _distance(self, program: ConicProgram, x: Array, body: int, root: Array, share: float, step: Array) -> None:
        """Add a link's distance from its nominal body to the objective; the geometric metric is begun with the entropic one."""
        assert self.prior is not None
        constant, slope = self._relative(body, root)
        if self.prior.metric != Metric.QUADRATIC:
            _log_det(program, x, constant, slope * step[:, None, None], share / self.prior.spread**2)
            return
        i, j, size = triangle_indices(4)
        size = np.sqrt(0.5 * share) / self.prior.spread * size
        program.squares(x, (slope[:, i, j] * size).T * step, (np.eye(4) - constant)[i, j] * size)

    def _polished(self, prior: Prior, x: Array) -> Array:
        """A conic solution (p,) with the entropic metric, made exact by a few Newton steps where these converge."""
        interior = self._interior(prior)
        try:
            return interior.solve(x, 30) if interior.is_inside(x) else x
        except SolverError:
            return x

    def _geometric(self, prior: Prior, x: Array, inside: Array | None) -> Array:
        """The geometric metric's minimiser by Newton's method, from the entropic one (p,), or from what is strictly inside."""
        interior = self._interior(prior)
        starts = [] if inside is None else [lstsq(self.sensitivity, inside - self.constant, rcond=None)]
        for start in (x, *starts):
            if interior.is_inside(start):
                return interior.solve(start)
        try:
            return interior.solve(self._conic(1e-7).x[: len(x)])
        except InfeasibleError:
            raise SolverError("the fit with a prior: the bounds leave no room inside; use the entropic or the quadratic metric.") from None

    def _interior(self, prior: Prior) -> InteriorProblem:
        p = self.sensitivity.shape[1]
        nominal = [self._relative(body, root) for body, root in enumerate(self.roots) if root is not None]
        others = []
        for body in (i for i, root in enumerate(self.roots) if root is None):
            constant, slope = self._link(body, scaled_units(self.scale[body]))
            others.append((constant - 0.9 * self.margin * np.eye(4), slope))
        target = np.zeros(p)
        target[: len(self.target.target)] = self.target.target
        costed = np.zeros(p, bool)
        costed[: len(self.target.target)] = self.target.costed

        def matrices(found: list[tuple[Array, Array]]) -> Matrices:
            return Matrices(np.array([f[0] for f in found]).reshape(-1, 4, 4), np.array([f[1] for f in found]).reshape(-1, p, 4, 4))

        return InteriorProblem(
            target,
            costed,
            matrices(nominal),
            prior.metric,
            1.0 / prior.spread**2,
            matrices(others),
            self.rows,
            self.constants,
            tuple(self.cones),
        )


def _log_det(program: ConicProgram, x: Array, constant: Array, slope: Array, weight: float) -> None:
    """Add weight (tr A - log det A) of A = constant + slope x (4, 4) to the objective.

    log det A is the largest sum of log z_ii over lower triangular Z with [[A, Z], [Z', diag Z]] >= 0 (Nesterov and Nemirovski)."""
    size = len(constant)
    rows, columns = np.tril_indices(size)
    z, logs = program.variables(len(rows)), program.variables(size)
    whole = np.zeros((2 * size, 2 * size))
    whole[:size, :size] = constant
    large = np.zeros((len(slope), 2 * size, 2 * size))
    large[:, :size, :size] = slope
    part = np.zeros((len(rows), 2 * size, 2 * size))
    part[np.arange(len(rows)), rows, size + columns] = 1.0
    part[np.arange(len(rows)), size + columns, rows] = 1.0
    on = rows == columns
    part[np.flatnonzero(on), size + rows[on], size + rows[on]] = 1.0
    program.semidefinite(whole, [(x, large), (z, part)])
    for i, at in enumerate(np.flatnonzero(on)):
        # (log, 1, z_ii) in the exponential cone: exp(log) <= z_ii.
        program.exponential(
            np.array([0.0, 1.0, 0.0]), [(logs[i : i + 1], np.array([[1.0, 0, 0]])), (z[at : at + 1], np.array([[0.0, 0, 1.0]]))]
        )
    program.linear(x, weight * np.trace(slope, axis1=1, axis2=2))
    program.linear(logs, -weight * np.ones(size))
