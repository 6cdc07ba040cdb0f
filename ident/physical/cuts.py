"""Nearest set of base parameters that keeps H(q) away from indefinite, by cutting planes.

H is linear in the base parameters, so every violated configuration q with the velocity v gives the half-space v'H(q; beta)v >= eps that all
possible sets lie in (the set is convex). The nearest point of the half-spaces found so far is a least-distance problem (Lawson
and Hanson, 1974, by nonnegative least squares); its distance never exceeds the true one, and no solver is needed."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .conic import InfeasibleError, SolverError
from .search import Minimum, minimise_eigenvalue
from .structure import InertiaStructure

Array = np.ndarray
#: The nearest point is sought in units of the worst violation, and of so many times that, until it is no farther than some ten of them.
_NEAR = 1e-3
_FARTHER = 30.0
_UNITS = 8
#: Positions that are kept, half-spaces at most, and steps at known positions between two searches for others.
_KEPT = 40
_MOST_ROWS = 600
_INNER = 40


@dataclass(frozen=True, eq=False)
class CutResult:
    """`values` (b,) with the smallest scaled eigenvalue `eigenvalue` found at them; `distance` in the metric; `cuts`, `rounds` taken."""

    values: Array
    eigenvalue: float
    distance: float
    cuts: int
    rounds: int


def nearest_by_cuts(
    structure: InertiaStructure,
    values: Array,
    root: Array,
    *,
    weight: Array,
    margin: float,
    lower: Array,
    upper: Array,
    start: int = 0,
    tolerance: float = 0.1,
    rounds: int = 200,
    time_limit: float = 30.0,
) -> CutResult:
    """Nearest base values with H[start:, start:] >= margin * diag(weight)[start:], up to `tolerance` of the margin.

    `root` (b, u): changes are root @ x and cost |x| (a root of the covariance); what has no column stays as it is.
    Raises InfeasibleError where changes cannot help, SolverError where time or rounds run out."""
    deadline = time.perf_counter() + time_limit
    scale = 1.0 / np.sqrt(weight)
    rows, limits = np.zeros((0, len(values))), np.zeros(0)
    seeds = np.zeros((0, structure.n))
    x, current = np.zeros(root.shape[1]), np.array(values, float)
    worst = np.inf

    def lowest(turn: int, starts: int, samples: int) -> Minimum:
        return minimise_eigenvalue(
            structure, current, lower, upper, weight=scale, start=start, seed=7 * turn, starts=starts, samples=samples, seeds=seeds
        )

    for turn in range(rounds):
        # A quick look first; a thorough one before the point is taken for good.
        found = lowest(turn, 8, 64)
        if found.eigenvalue >= margin * (1.0 - tolerance):
            found = lowest(turn, 24, 512)
        worst = found.eigenvalue
        if worst >= margin * (1.0 - tolerance):
            return CutResult(current, worst, float(np.linalg.norm(x)), len(rows), turn)
        if time.perf_counter() > deadline:
            break
        seeds = np.concatenate([seeds, found.candidates[found.eigenvalues < margin][:12]])[-_KEPT:]
        for _ in range(_INNER):
            # First at the positions that are known: that takes no search.
            eigenvalue, new = _violated(structure, current, seeds, scale, start, margin)
            if eigenvalue >= margin * (1.0 - 0.5 * tolerance) or time.perf_counter() > deadline:
                break
            rows, limits = np.concatenate([rows, new]), np.concatenate([limits, np.full(len(new), margin)])
            x = _least_distance(rows @ root, limits - rows @ values)
            current = values + root @ x
            if len(rows) > _MOST_ROWS:
                # Half-spaces that are far from being touched only cost time.
                keep = np.sort(np.argsort(rows @ current - limits)[: _MOST_ROWS // 2])
                rows, limits = rows[keep], limits[keep]
    raise SolverError(
        f"the nearest possible set was not reached within {time_limit:.0f} s and {rounds} rounds of cutting planes"
        f" (smallest scaled eigenvalue {worst:.2e}, wanted {margin:.2e}). Allow more time, or a smaller margin."
    )


def _violated(structure: InertiaStructure, values: Array, q: Array, scale: Array, start: int, margin: float) -> tuple[float, Array]:
    """The lowest eigenvalue at positions q, and rows (m, b) of the half-spaces that values leave there, of two directions each at most."""
    H = structure.inertia_matrix(values, q) * np.outer(scale, scale)
    eigenvalues, vectors = np.linalg.eigh(H[:, start:, start:])
    rows = []
    for k in range(min(2, vectors.shape[2])):
        low = eigenvalues[:, k] < margin
        v = np.zeros((int(low.sum()), structure.nv))
        v[:, start:] = vectors[low, :, k]
        rows.append(structure.quadratic_rows(q[low], v * scale))
    return float(eigenvalues.min()), np.concatenate(rows)


def _least_distance(G: Array, h: Array) -> Array:
    """Smallest x with G x >= h. Raises InfeasibleError where there is none."""
    from scipy.optimize import nnls

    if not len(h) or np.all(h <= 0):
        return np.zeros(G.shape[1])
    size = np.linalg.norm(G, axis=1)
    dead = size <= 1e-14 * max(float(size.max()), 1e-300)
    if np.any(dead & (h > 0)):
        raise InfeasibleError("no change of the free parameters makes the inertia matrix positive definite at some configuration.")
    G, h = G[~dead] / size[~dead, None], h[~dead] / size[~dead]
    # Measured in units of the distance itself, as far as it is known: the residual below is 1 / (1 + distance²).
    unit = float(h.max())
    for _ in range(_UNITS):
        E = np.concatenate([G.T, (h / unit)[None]])
        f = np.zeros(len(E))
        f[-1] = 1.0
        y, _ = nnls(E, f, maxiter=50 * E.shape[1] + 1000)
        r = E @ y - f
        if -r[-1] > _NEAR:
            return -r[:-1] / r[-1] * unit
        unit *= _FARTHER
    raise InfeasibleError("no change of the free parameters makes the inertia matrix positive definite at all configurations found.")
