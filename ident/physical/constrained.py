"""Consistent fits: least squares over base parameters subject to real links, rotor inertias and friction, in one conic program.

The unknowns are the base values and the directions that no torque sees, so that links appear as such: pseudo-inertias positive definite
(Sousa and Cortesão 2014; Wensing, Kim and Slotine 2018), bounds and a prior on them. The data enter as a triangle (information) or a
covariance, never as samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import ConfigurationError
from .bounds import Bounds, Metric, Prior
from .conic import ConicProgram, InfeasibleError, Solution, SolverError, require_solver, triangle_indices
from .consistent import _deepest, _drive_scale, _free_scale, _holds, judge_consistent, link_scales, scaled_units, wrong_signs
from .interior import InteriorProblem, Matrices
from .pseudo_inertia import UNITS
from .structure import InertiaStructure

Array = np.ndarray

#: Least eigenvalue of a link's pseudo-inertia, relative to a typical link of that robot.
MARGIN = 1e-5
#: Cost per unit of a (scaled) pseudo-inertia's trace that settles what no torque sees; the data cost 1 per standard deviation squared.
SETTLE = 1e-4

#: Units (standard deviations) in which distances are counted, in the order of trial.
_UNITS = (1.0, 30.0, 1e3, 0.03)


@dataclass(frozen=True, eq=False)
class Target:
    """What is to be fitted: base values = offset + root @ w at the cost sum over `costed` of (w - target)^2."""

    offset: Array
    root: Array
    target: Array
    costed: Array

    @classmethod
    def from_information(cls, R: Array, z: Array) -> Target:
        """Least squares |R p - z|^2, R (m, b) of any rank; directions it does not see are free."""
        R, z = np.atleast_2d(np.asarray(R, float)), np.asarray(z, float)
        size = np.linalg.norm(R, axis=0)
        D = 1.0 / np.where(size > 0, size, 1.0)
        U, S, Vt = np.linalg.svd(R * D, full_matrices=False)
        # Economic form has min(m, b) directions; the rest are unseen.
        full = np.linalg.svd(Vt, full_matrices=True)[2] if len(Vt) < R.shape[1] else Vt
        seen = S > 1e-12 * max(float(S.max(initial=0.0)), 1e-300)
        root = np.concatenate([(D[:, None] * Vt[seen].T) / S[seen], D[:, None] * np.concatenate([Vt[~seen], full[len(Vt) :]]).T], axis=1)
        # Counted from the unconstrained solution, so that the cost is what the constraints add.
        offset = root[:, : seen.sum()] @ (U[:, seen].T @ z)
        return cls(offset, root, np.zeros(root.shape[1]), np.arange(root.shape[1]) < seen.sum())

    @classmethod
    def from_covariance(cls, values: Array, covariance: Array, unseen: Array | None = None) -> Target:
        """Mahalanobis distance from `values`; directions without variance stay fixed, but for the `unseen` ones (b, u), which are free."""
        root = covariance_root(covariance)
        free = np.zeros((len(root), 0)) if unseen is None else np.asarray(unseen, float)
        both = np.concatenate([root, free], axis=1)
        return cls(np.asarray(values, float), both, np.zeros(both.shape[1]), np.arange(both.shape[1]) < root.shape[1])

    @classmethod
    def fixed(cls, values: Array) -> Target:
        """Exactly these base values."""
        values = np.asarray(values, float)
        return cls(values, np.zeros((len(values), 0)), np.zeros(0), np.zeros(0, bool))


@dataclass(frozen=True, eq=False)
class ConsistentFit:
    """`values` (b,) and the consistent parameters (k,) `standard` that give them; `cost`: the data's part of the objective."""

    values: Array
    standard: Array
    cost: float
    method: str
    notes: tuple[str, ...] = ()


def covariance_root(covariance: Array) -> Array:
    """Root L (b, r) with L L' = covariance, scaled before the rank is decided. Raises ConfigurationError if it is no covariance."""
    C = np.asarray(covariance, float)
    C = 0.5 * (C + C.T)
    if not np.all(np.isfinite(C)) or np.any(np.diagonal(C) < 0):
        raise ConfigurationError("the covariance holds a negative variance or a value that is not finite, so it gives no metric.")
    std = np.sqrt(np.diagonal(C))
    D = np.where(std > 0, std, 1.0)
    eigenvalues, vectors = np.linalg.eigh(C / np.outer(D, D))
    if len(eigenvalues) and eigenvalues[0] < -1e-6 * max(eigenvalues[-1], 1e-300):
        raise ConfigurationError("the covariance is not positive semidefinite, so it gives no metric.")
    keep = eigenvalues > 1e-14 * max(float(eigenvalues.max(initial=0.0)), 1e-300)
    return (D[:, None] * vectors[:, keep]) * np.sqrt(eigenvalues[keep])


def mahalanobis(root: Array, change: Array, unseen: Array | None = None) -> float:
    """Length of a change of base values in the metric of a covariance root (b, r); infinite where it leaves its range.

    Changes along `unseen` directions (b, u) cost nothing."""
    free = np.zeros((len(root), 0)) if unseen is None else unseen
    both = np.concatenate([root, free], axis=1)
    size = np.linalg.norm(both, axis=1)
    D = 1.0 / np.where(size > 0, size, 1.0)
    # Without what is free first, so that it does not count.
    Q, _ = np.linalg.qr(D[:, None] * free)
    A, y = D[:, None] * root, D * change
    A, y = A - Q @ (Q.T @ A), y - Q @ (Q.T @ y)
    x, *_ = np.linalg.lstsq(A, y, rcond=1e-13)
    left = A @ x - y
    return float(np.linalg.norm(x)) if np.linalg.norm(left) <= 1e-6 * max(float(np.linalg.norm(y)), 1e-300) else np.inf


def fit_consistent(
    structure: InertiaStructure, target: Target, *, bounds: Bounds | None = None, prior: Prior | None = None, margin: float = MARGIN
) -> ConsistentFit:
    """Best base values with real links (pseudo-inertias >= margin), rotor inertia and friction of the right sign, bounds and prior.

    Raises InfeasibleError where nothing satisfies all of it, SolverError where the solver fails or what it returns does not hold,
    ConfigurationError without the solver. What is returned has been checked."""
    require_solver("the physically consistent fit")
    bounds, wanted = bounds or Bounds(), margin
    scale = link_scales(structure) if prior is None else _nominal_scale(structure, prior)
    inside: Array | None = None
    if not target.root.shape[1]:
        # Exactly these base values: they may leave less room than is asked for, and the links may be of any size.
        scale, room, inside = _room(structure, target.offset)
        wanted = min(margin, 0.5 * room)
    for _ in range(4):
        problem = _Problem(structure, target, bounds, prior, wanted, scale)
        values, standard, cost, solution = problem.solve(inside)
        if _holds(structure, standard) and not wrong_signs(structure, structure.lift @ values, structure.null_space):
            notes = () if solution.accurate else (f"the solver stopped with {solution.status}; the result was checked and holds.",)
            return ConsistentFit(values, standard, cost, "linear matrix inequalities (Clarabel)", notes)
        # Rounding of the solver ate the margin: measure each link by what was found, and keep further away from the border.
        scale = link_scales(structure, standard)
        wanted = wanted if not target.root.shape[1] else max(10.0 * wanted, 1e-9)
    raise SolverError(
        "the physically consistent fit: what the solver returned is not consistent when checked."
        " Check the scale of the data and bounds, or use method='log_cholesky'."
    )


def _room(structure: InertiaStructure, values: Array) -> tuple[Array, float, Array]:
    """Scale of the links that give these base values, their largest common margin, and links (k,) that have it.

    Raises InfeasibleError where there are none."""
    verdict = judge_consistent(structure, values)
    if verdict.standard is None:
        raise InfeasibleError(f"these base parameters are {verdict.text()}. Repair them first.")
    scale = link_scales(structure, verdict.standard)
    constant = structure.lift @ values
    margin, deepest = _deepest(structure, constant, structure.null_space, scale, _drive_scale(structure, verdict.standard))
    if margin > 0 and _holds(structure, deepest):
        return scale, margin, deepest
    return link_scales(structure), max(verdict.margin, 0.0), verdict.standard


class _Problem:
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

    def solve(self, inside: Array | None = None) -> tuple[Array, Array, float, Solution]:
        """(values, standard, cost of the data, solution). `inside` (k,): parameters that satisfy everything strictly, if known."""
        solution = self._conic(0.0)
        x = solution.x[: self.sensitivity.shape[1]]
        if self.prior is not None and self.prior.metric != Metric.QUADRATIC:
            interior = self._interior(self.prior)
            starts = [self._conic(1e-7).x[: len(x)]]
            if inside is not None:
                starts.insert(0, np.linalg.lstsq(self.sensitivity, inside - self.constant, rcond=None)[0])
            x = interior.solve(next((s for s in starts if interior.is_inside(s)), starts[-1]))
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

    def _conic(self, inside: float) -> Solution:
        """The program with the quadratic metric (or none); `inside` keeps all inequalities that far from their borders.

        How far the constraints move the estimate is not known beforehand: where the solver does not get through, distances are
        counted in larger units."""
        for unit in _UNITS:
            try:
                found = self._conic_in(inside, unit)
                found.x[: len(self.target.target)] *= unit
                return found
            except SolverError:
                if unit == _UNITS[-1]:
                    raise
        raise AssertionError

    def _conic_in(self, inside: float, unit: float) -> Solution:
        """The same with base directions counted in `unit` standard deviations."""
        program = ConicProgram()
        p, moves = self.sensitivity.shape[1], len(self.target.target)
        x = program.variables(p)
        step = np.ones(p)
        step[:moves] = unit
        share = 1.0 / unit**2
        costed = self.target.costed
        program.distance(x[:moves][costed], self.target.target[costed] / unit)
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
                    program.linear(x, SETTLE * share * trace * step)
            if root is not None:
                assert self.prior is not None
                constant, slope = self._relative(body, root)
                i, j, size = triangle_indices(4)
                size = np.sqrt(0.5 * share) / self.prior.spread * size
                program.squares(x, (slope[:, i, j] * size).T * step, (np.eye(4) - constant)[i, j] * size)
        if len(self.constants):
            program.nonnegative(self.constants - inside, [(x, (self.rows * step).T)])
        for cone, offset in self.cones:
            lowered = offset.copy()
            lowered[0] -= inside
            program.second_order(lowered, [(x, (cone * step).T)])
        return program.solve("the physically consistent fit")

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


def binding_constraints(
    structure: InertiaStructure, target: Target, *, bounds: Bounds | None = None, prior: Prior | None = None, least: float = 1.0
) -> dict[str, float]:
    """What holds a consistent fit back: link or parameter -> cost (squared standard deviations) that its constraint alone adds.

    Each is left out in turn; those that add less than `least` are not named. Largest first. The rest of the cost is shared among them."""
    bounds = bounds or Bounds()
    scale = link_scales(structure) if prior is None else _nominal_scale(structure, prior)
    fit = _Problem(structure, target, bounds, prior, MARGIN, scale).solve()
    guess = structure.lift @ (target.offset + target.root @ target.target)
    signed = [structure.names[i] for i in (*structure.drive, *structure.nonnegative) if guess[i] < 0 or fit[1][i] <= 1e-6 * abs(guess[i])]
    found = {}
    for name in (*structure.body_names, *signed):
        cost = _Problem(structure, target, bounds, prior, MARGIN, scale, name).solve()[2]
        if fit[2] - cost >= least:
            found[name] = fit[2] - cost
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def _nominal_scale(structure: InertiaStructure, prior: Prior) -> Array:
    known = np.array([root is not None for root in prior.roots(structure)])
    full = np.zeros(structure.k)
    full[structure.inertial] = prior.nominal
    return np.where(known[:, None], link_scales(structure, full), link_scales(structure))


def prior_distance(structure: InertiaStructure, prior: Prior, standard: Array) -> float:
    """Distance of the links of `standard` (k,) from the prior's nominal ones in its metric (without the spread)."""
    total = 0.0
    for body, root in enumerate(prior.roots(structure)):
        if root is None:
            continue
        inverse = np.linalg.inv(root)
        lam = np.linalg.eigvalsh(inverse @ np.tensordot(standard[structure.inertial[10 * body : 10 * body + 10]], UNITS, 1) @ inverse.T)
        if prior.metric == Metric.QUADRATIC:
            total += 0.5 * float(np.sum((lam - 1.0) ** 2))
        elif np.any(lam <= 0):
            return np.inf
        elif prior.metric == Metric.ENTROPIC:
            total += float(np.sum(lam - np.log(lam) - 1.0))
        else:
            total += 0.5 * float(np.sum(np.log(lam) ** 2))
    return total
