"""Nearest set of base parameters that keeps H(q) away from indefinite, by cutting planes.

H is linear in the base parameters, so every violated configuration q with the velocity v gives the half-space v'H(q; beta)v >= eps that all
possible sets lie in (the set is convex). The nearest point of the half-spaces found so far is a least-distance problem (Lawson
and Hanson, 1974, by nonnegative least squares); its distance never exceeds the true one, and no solver is needed."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .conic import InfeasibleError, SolverError
from .search import minimise_eigenvalue
from .structure import InertiaStructure

Array = np.ndarray


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
    floors: tuple[Array, Array] | None = None,
    tolerance: float = 0.1,
    rounds: int = 200,
    time_limit: float = 30.0,
    seed: int = 0,
) -> CutResult:
    """Nearest base values with H[start:, start:] >= margin * diag(weight)[start:], up to `tolerance` of the margin.

    `root` (b, u): changes are root @ x and cost |x| (a root of the covariance); columns left out stay fixed. `floors`: further half-spaces
    (rows (m, b), limits (m,)), rows @ values >= limits. Raises InfeasibleError where changes cannot help, SolverError
    where time or rounds run out."""
    deadline = time.perf_counter() + time_limit
    scale = 1.0 / np.sqrt(weight)
    block = np.arange(structure.nv) >= start
    rows: list[Array] = []
    limits: list[float] = []
    if floors is not None:
        rows += list(floors[0])
        limits += [float(x) for x in floors[1]]
    seeds = np.zeros((0, structure.n))
    x = _least_distance(np.array(rows).reshape(-1, len(values)) @ root, np.array(limits) - np.array(rows).reshape(-1, len(values)) @ values)
    current = values + root @ x
    for turn in range(rounds):
        # A quick look first; a thorough one before the point is taken for good.
        for thorough in (False, True):
            found = minimise_eigenvalue(
                structure, current, lower, upper, weight=scale, start=start, seed=seed + 7 * turn,
                starts=24 if thorough else 8, samples=512 if thorough else 64, seeds=seeds[-40:],
            )  # fmt: skip
            if found.eigenvalue < margin * (1.0 - tolerance):
                break
        else:
            return CutResult(current, found.eigenvalue, float(np.linalg.norm(x)), len(rows), turn)
        if time.perf_counter() > deadline:
            break
        q = found.candidates[found.eigenvalues < margin][:12]
        H = structure.inertia_matrix(current, q) * np.outer(scale, scale)
        eigenvalues, vectors = np.linalg.eigh(H[:, start:, start:])
        for k in range(min(2, vectors.shape[2])):
            low = eigenvalues[:, k] < margin
            v = np.zeros((int(low.sum()), structure.nv))
            v[:, block] = vectors[low, :, k]
            rows += list(structure.quadratic_rows(q[low], v * scale))
            limits += [margin] * len(v)
        seeds = np.concatenate([seeds, q])
        G = np.array(rows)
        x = _least_distance(G @ root, np.array(limits) - G @ values)
        current = values + root @ x
        # Half-spaces that have been slack for long only cost time.
        if len(rows) > 600:
            slack = G @ current - np.array(limits)
            keep = np.sort(np.argsort(slack)[:300])
            own = 0 if floors is None else len(floors[1])
            keep = np.unique(np.concatenate([np.arange(own), keep]))
            rows, limits = [rows[i] for i in keep], [limits[i] for i in keep]
    raise SolverError(
        f"the nearest possible set was not reached within {time_limit:.0f} s and {turn + 1} rounds of cutting planes"
        f" (smallest scaled eigenvalue {found.eigenvalue:.2e}, wanted {margin:.2e}). Allow more time, or a smaller margin."
    )


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
    # Measured in units of the worst violation, so that the residual below is an ordinary number.
    unit = float(h.max())
    E = np.concatenate([G.T, (h / unit)[None]])
    f = np.zeros(len(E))
    f[-1] = 1.0
    y, _ = nnls(E, f, maxiter=50 * E.shape[1] + 1000)
    r = E @ y - f
    if -r[-1] < 1e-12:
        raise InfeasibleError("no change of the free parameters makes the inertia matrix positive definite at all configurations found.")
    return -r[:-1] / r[-1] * unit
