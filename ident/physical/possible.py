"""Possible: does a set of base parameters keep H(q), reflected rotor inertia included, positive definite at every position?

A configuration where it is not is a proof against it; a certificate on the continuum (`certificate`) is a proof for it. Reference:
K. Yoshida, dissertation (1995), chapter 4; Yoshida and Khalil, Int. J. Robotics Research 19 (2000), for the notion."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .certificate import certify
from .search import Minimum, minimise_eigenvalue, typical_diagonal
from .structure import InertiaStructure

Array = np.ndarray

#: A certificate of H itself at this share of the smallest eigenvalue found leaves nothing for another one to prove.
_TIGHT = 0.99
#: Below this share of the typical diagonal a smallest eigenvalue cannot be distinguished from zero.
ROUNDING = 1e-11


@dataclass(frozen=True, eq=False)
class Possible:
    """Verdict. `possible`: H is positive definite everywhere; `certified`: proven, by a configuration or on the whole continuum.

    `min_eigenvalue`: smallest eigenvalue of H found, kg m^2, at `worst_configuration` (joint -> rad, m; joints on which H does not
    depend are left out); `lower_bound`: no smaller one exists (kg m^2; -inf without a certificate). `margin_std`: distance
    from the border in standard deviations of the estimate, negative outside, None without a covariance. `worst_vector`
    (nv,): unit joint rates of that eigenvalue. `candidates` (m, n): all local minima found."""

    possible: bool
    certified: bool
    min_eigenvalue: float
    worst_configuration: dict[str, float]
    lower_bound: float
    margin_std: float | None
    method: str
    within_limits: bool
    seconds: float
    worst_position: Array
    worst_vector: Array
    candidates: Array
    notes: tuple[str, ...] = ()

    def text(self) -> str:
        """A few lines for people."""
        where = ", ".join(f"{name} {value:.3f}" for name, value in self.worst_configuration.items()) or "any position"
        verdict = "possible" if self.possible else "not possible"
        how = "certified" if self.certified else "not certified: no configuration against it was found, but none is excluded"
        lines = [
            f"{verdict} ({how}): smallest eigenvalue of the inertia matrix {self.min_eigenvalue:.4g} kg m^2 at {where}"
            + (" within the joint limits" if self.within_limits else "")
        ]
        if np.isfinite(self.lower_bound) and self.possible:
            lines.append(f"proven lower bound {self.lower_bound:.4g} kg m^2")
        if self.margin_std is not None:
            side = "inside" if self.margin_std >= 0 else "outside"
            lines.append(f"distance to the feasibility boundary: {abs(self.margin_std):.3g} standard deviations, {side}")
        return "\n".join([*lines, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "possible": self.possible,
            "certified": self.certified,
            "min_eigenvalue": self.min_eigenvalue,
            "lower_bound": self.lower_bound if np.isfinite(self.lower_bound) else None,
            "worst_configuration": dict(self.worst_configuration),
            "margin_std": self.margin_std,
            "method": self.method,
            "within_limits": self.within_limits,
            "seconds": self.seconds,
            "notes": list(self.notes),
        }


def judge_possible(
    structure: InertiaStructure,
    values: Array,
    *,
    covariance: Array | None = None,
    limits: bool = False,
    time_limit: float = 60.0,
    seed: int = 0,
    beside: Possible | None = None,
) -> Possible:
    """Judge base values (b,) over whole turns, or within the joint limits if `limits`.

    `covariance` (b, b) of the estimate gives the distance from the border. `time_limit` (s) bounds search and certificate together.
    `beside`: the verdict on another matrix of the same robot, where its minima are sought first. Raises ConfigurationError for values
    that do not fit the structure."""
    start = time.perf_counter()
    values = structure.check_values(values)
    lower, upper, notes = structure.ranges(limits)
    plain = np.ones(structure.nv)
    outer = certify(structure, values, lower, upper, plain, time_limit=0.1 * time_limit, splits=False)
    floor = bound = outer.bound
    weight = typical_diagonal(structure, values, lower, upper, seed)
    # Joints of unlike size are judged against their own size: the sign is the same, and no small wrist hides a large joint.
    search = partial(minimise_eigenvalue, structure, values, lower, upper, samples=512, seed=seed, time_limit=0.3 * time_limit)
    seek = None if beside is not None else search(weight=1.0 / np.sqrt(weight))
    known = np.concatenate([x.candidates for x in (beside, seek) if x is not None])
    lowest = _lowest(structure, values, lower, upper, known, floor, seed, start + time_limit)
    if not bound >= _TIGHT * lowest.eigenvalue > 0:
        seek = seek or search(weight=1.0 / np.sqrt(weight), seeds=known)
        if seek.eigenvalue > ROUNDING:
            certificate = certify(structure, values, lower, upper, weight, time_limit=0.4 * time_limit)
            bound = max(bound, certificate.bound)
            floor = max(floor, certificate.eigenvalue_bound if certificate.bound > 0 else -np.inf)
            if certificate.reason and not bound > 0:
                notes += (f"no certificate: {certificate.reason}.",)
    least = lowest if seek is None else seek
    possible = least.eigenvalue > (0.0 if seek is None else ROUNDING) and lowest.eigenvalue > 0
    if not possible and abs(least.eigenvalue) <= ROUNDING:
        notes += ("the inertia matrix is singular at the worst configuration: the set lies on the border.",)
    candidates = np.concatenate([lowest.candidates, known if seek is None else seek.candidates])
    margin = None if covariance is None else border_distance(structure, values, np.asarray(covariance, float), lower, upper, candidates)
    method = "smallest eigenvalue: multistart descent" + (", chained linear matrix inequalities" if bound > 0 else "")
    return Possible(
        possible=possible,
        certified=bool(bound > 0 or not possible),
        min_eigenvalue=lowest.eigenvalue,
        worst_configuration={name: float(lowest.q[i]) for i, name in enumerate(structure.joint_names) if structure.relevant[i]},
        lower_bound=floor,
        margin_std=margin,
        method=method,
        within_limits=limits,
        seconds=time.perf_counter() - start,
        worst_position=lowest.q,
        worst_vector=lowest.vector,
        candidates=candidates,
        notes=notes + structure.notes,
    )


def _lowest(
    structure: InertiaStructure, values: Array, lower: Array, upper: Array, known: Array, floor: float, seed: int, deadline: float
) -> Minimum:
    """Lowest plain eigenvalue, from `known` positions (m, n) and others: repeated while it stays clear of the proven bound and time
    allows."""
    best: Minimum | None = None
    for again in range(3):
        left = deadline - time.perf_counter()
        if best is not None and (left < 0 or best.eigenvalue <= floor + 1e-3 * abs(floor)):
            break
        seeds = known if best is None else np.concatenate([known[:2], best.candidates[:2]])
        found = minimise_eigenvalue(
            structure, values, lower, upper, seed=seed + 1 + again, seeds=seeds, samples=512, floor=floor, time_limit=max(0.3 * left, 0.1)
        )
        if best is None or found.eigenvalue < best.eigenvalue:
            best = found
        if not np.isfinite(floor) and again:
            break
    assert best is not None
    return best


def border_distance(
    structure: InertiaStructure, values: Array, covariance: Array, lower: Array, upper: Array, candidates: Array, polish: int = 3
) -> float:
    """Distance of base values from the border of the possible sets, in standard deviations: min over q, v of v'H(q)v / std(v'H(q)v).

    Each (q, v) is one half-space of the convex set of possible parameters, so inside this is the distance itself (as far as the
    minimum was found: at most that), and outside a distance that no repair can undercut."""
    from scipy.optimize import minimize

    n, nv = structure.n, structure.nv
    # A velocity is scaled by the diagonal, so that joints of unlike size are sought alike.
    scale = 1.0 / np.sqrt(typical_diagonal(structure, values, lower, upper))

    def ratio(points: Array) -> Array:
        rows = structure.quadratic_rows(points[:, :n], points[:, n:] * scale)
        spread = np.sqrt(np.maximum(np.einsum("Nb,bc,Nc->N", rows, covariance, rows, optimize=True), 1e-300))
        return rows @ values / spread

    _, vectors = np.linalg.eigh(structure.inertia_matrix(values, candidates) * np.outer(scale, scale))
    points = np.concatenate([np.concatenate([candidates, vectors[:, :, k]], axis=1) for k in range(min(2, nv))])
    at = ratio(points)
    order = np.argsort(at)[:polish]
    best = float(at[order[0]])

    def both(x: Array) -> tuple[float, Array]:
        q, v = x[None, :n], x[None, n:] * scale
        row = structure.quadratic_rows(q, v)[0]
        spread = float(np.sqrt(max(row @ covariance @ row, 1e-300)))
        found = float(row @ values) / spread
        # The slope of v'H(q)v at fixed parameters, at those that change as numerator and spread do.
        moved = (values - found / spread * (covariance @ row)) / spread
        by_rate = 2.0 * (structure.inertia_matrix(moved, q)[0] @ v[0]) * scale
        return found, np.concatenate([structure.position_gradient(moved, q, v)[0], by_rate])

    whole = upper - lower >= 2 * np.pi - 1e-9
    bounds = [(None, None) if whole[i] else (lower[i], upper[i]) for i in range(n)] + [(-2.0, 2.0)] * nv
    for i in order:
        found = minimize(both, points[i], jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
        best = min(best, float(found.fun))
    return best
