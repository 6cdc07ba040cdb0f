"""Consistent fits: least squares over base parameters subject to real links, rotor inertias and friction, in one conic program.

The unknowns are the base values and the directions that no torque sees, so that links appear as such: pseudo-inertias positive definite
(Sousa and Cortesão 2014; Wensing, Kim and Slotine 2018), bounds and a prior on them. The data enter as a triangle (information) or a
covariance, never as samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .bounds import Bounds, Metric, Prior
from .conic import InfeasibleError, SolverError, require_solver
from .consistent import _deepest, _drive_scale, _holds, judge_consistent, link_scales, wrong_signs
from .constrained_problem import MARGIN, ConstrainedProblem
from .pseudo_inertia import UNITS
from .structure import InertiaStructure
from .target import Target

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class ConsistentFit:
    """`values` (b,) and the consistent parameters (k,) `standard` that give them; `cost`: the data's part of the objective."""

    values: Array
    standard: Array
    cost: float
    method: str
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Settling:
    """How a fit without a prior settles what the data hardly see: links that are exactly the best may be absurd (hundreds of kilograms

    that save a hundredth of a standard deviation). Among all fits that cost the data at most `most` squared standard deviations more
    (and at most `share` of the best fit's own cost), those links are taken that are nearest to `near`, or the lightest and most compact.
    By convexity no direction then moves by more than sqrt(most) standard deviations."""

    near: Prior | None = None
    most: float = 1.0
    share: float = np.inf

    def allowance(self, cost: float) -> float:
        """Squared standard deviations that may be given away."""
        return min(self.most, self.share * cost)


def fit_consistent(
    structure: InertiaStructure,
    target: Target,
    *,
    bounds: Bounds | None = None,
    prior: Prior | None = None,
    margin: float = MARGIN,
    settling: Settling | None = None,
) -> ConsistentFit:
    """Best base values with real links (pseudo-inertias >= margin), rotor inertia and friction of the right sign, bounds and prior.

    `settling` (without a prior): see there. Raises InfeasibleError where nothing satisfies all of it, SolverError where the solver fails
    or what it returns does not hold, ConfigurationError without the solver. What is returned has been checked."""
    require_solver("the physically consistent fit")
    bounds, wanted = bounds or Bounds(), margin
    scale = link_scales(structure) if prior is None else nominal_scale(structure, prior)
    inside: Array | None = None
    if not target.root.shape[1]:
        # Exactly these base values: they may leave less room than is asked for, and the links may be of any size.
        scale, room, inside = _room(structure, target.offset)
        wanted = min(margin, 0.5 * room)
    for _ in range(4):
        problem = ConstrainedProblem(structure, target, bounds, prior, wanted, scale)
        values, standard, cost, solution = problem.solve(inside)
        if _holds(structure, standard) and not wrong_signs(structure, structure.lift @ values, structure.null_space):
            notes = () if solution.accurate else (f"the solver stopped with {solution.status}; the result was checked and holds.",)
            found = ConsistentFit(values, standard, cost, "linear matrix inequalities (Clarabel)", notes)
            return found if settling is None or prior is not None else _settled(structure, target, bounds, wanted, found, settling)
        # Rounding of the solver ate the margin: measure each link by what was found, and keep further away from the border.
        scale = link_scales(structure, standard)
        wanted = wanted if not target.root.shape[1] else max(10.0 * wanted, 1e-9)
    raise SolverError(
        "the physically consistent fit: what the solver returned is not consistent when checked."
        " Check the scale of the data and bounds, or use method='log_cholesky'."
    )


def _settled(
    structure: InertiaStructure, target: Target, bounds: Bounds, margin: float, best: ConsistentFit, settling: Settling
) -> ConsistentFit:
    """The best fit with its links settled; the best fit itself where that cannot be had."""
    limit = best.cost + settling.allowance(best.cost)
    near = settling.near
    scale = link_scales(structure) if near is None else nominal_scale(structure, near)
    for metric in ("",) if near is None else (Metric.ENTROPIC, Metric.QUADRATIC):
        prior = None if near is None else replace(near, metric=Metric(metric), spread=1.0)
        try:
            # The margin is counted in other units now; a tenth leaves room for the best fit itself.
            problem = ConstrainedProblem(structure, target, bounds, prior, 0.1 * margin, scale)
            values, standard, cost, _ = problem.solve(limit=limit)
        except (SolverError, InfeasibleError):
            continue
        holds = _holds(structure, standard) and not wrong_signs(structure, structure.lift @ values, structure.null_space)
        if holds and cost <= limit * (1 + 1e-4) + 1e-6:
            towards = "lightest and most compact links" if prior is None else f"links nearest to the URDF's ({metric} metric)"
            given = np.sqrt(max(limit - best.cost, 0.0))
            note = f"what the data barely determine is set to the {towards}, within {given:.2g} standard deviations of the best fit."
            return replace(best, values=values, standard=standard, cost=cost, notes=(*best.notes, note))
    return best


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


def nominal_scale(structure: InertiaStructure, prior: Prior) -> Array:
    """`link_scales` of the prior's nominal links, and typical ones where it knows none."""
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
