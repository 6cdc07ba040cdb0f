"""Global minimum of the smallest eigenvalue of H(q): nested seeds from the tip, random seeds, many descents side by side.

The smallest eigenvalue is smooth but where eigenvalues meet; its slope is v' dH/dq v with the unit eigenvector v. All
starts descend together (quasi-Newton with a projected step), since evaluating many positions costs little more than one.
A configuration found here is a proof that a set is not possible; that none was found is evidence, not a proof (see `certificate`)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from .structure import InertiaStructure

Array = np.ndarray
#: Eigenvalues nearer than this (relative) are those of positions that a symmetry of the robot makes equal.
_EQUAL = 1e-5


@dataclass(frozen=True, eq=False)
class Minimum:
    """The smallest eigenvalue found: `eigenvalue` (kg m^2) at `q` (n,) with the unit `vector` (nv,) of velocities.

    `candidates` (m, n): the distinct local minima, lowest first, with their `eigenvalues` (m,). `evaluations`: positions evaluated."""

    eigenvalue: float
    q: Array
    vector: Array
    candidates: Array
    eigenvalues: Array
    evaluations: int


class _Objective:
    """Smallest eigenvalue of W H(q) W (W diagonal) with its vector and slope; counts what it evaluates."""

    def __init__(self, structure: InertiaStructure, values: Array, weight: Array, start: int) -> None:
        self.structure, self.values, self.weight, self.start = structure, values, weight, start
        self.evaluations = 0

    def both(self, q: Array) -> tuple[Array, Array]:
        """Smallest eigenvalues (N,) and their unit vectors (N, nv), zero before the block."""
        eigenvalues, vectors = np.linalg.eigh(self._matrix(q)[:, self.start :, self.start :])
        v = np.zeros((len(q), self.structure.nv))
        v[:, self.start :] = vectors[:, :, 0]
        return eigenvalues[:, 0], v

    def slope(self, q: Array, v: Array) -> Array:
        """Slope (N, n) of eigenvalues with the vectors v."""
        return self.structure.position_gradient(self.values, q, v * self.weight) * self.structure.relevant

    def trailing(self, q: Array, start: int) -> Array:
        """Smallest eigenvalues (N,) of the block from row `start` on."""
        return np.linalg.eigvalsh(self._matrix(q)[:, start:, start:])[:, 0]

    def _matrix(self, q: Array) -> Array:
        self.evaluations += len(q)
        return self.structure.inertia_matrix(self.values, q) * np.outer(self.weight, self.weight)


def typical_diagonal(structure: InertiaStructure, values: Array, lower: Array, upper: Array, seed: int = 0) -> Array:
    """Typical size (nv,) of the diagonal of H over random positions: what makes joints of unlike size comparable."""
    q = random_positions(structure, lower, upper, 64, np.random.default_rng(seed))
    size = np.sqrt(np.mean(np.diagonal(structure.inertia_matrix(values, q), axis1=1, axis2=2) ** 2, axis=0))
    largest = float(size.max(initial=0.0))
    return np.maximum(size, 1e-9 * largest) if largest > 0 else np.ones_like(size)


def random_positions(structure: InertiaStructure, lower: Array, upper: Array, count: int, rng: np.random.Generator) -> Array:
    """Uniform positions (count, n) within the ranges; joints that never matter stay in the middle."""
    middle = np.clip(0.0, lower, upper)
    return np.where(structure.relevant, rng.uniform(lower, upper, (count, structure.n)), middle)


def minimise_eigenvalue(
    structure: InertiaStructure,
    values: Array,
    lower: Array,
    upper: Array,
    *,
    weight: Array | None = None,
    starts: int = 24,
    samples: int = 1024,
    seed: int = 0,
    seeds: Array | None = None,
    floor: float = -np.inf,
    time_limit: float = np.inf,
    start: int = 0,
) -> Minimum:
    """Smallest eigenvalue of W H(q) W over lower <= q <= upper, W = diag(`weight`) (the identity by default).

    `seeds` (m, n): positions to start from beside the nested and the random ones. `floor`: a proven lower bound; once a position comes
    as near to it as one part in ten thousand, nothing is left to be found. `time_limit` in s bounds the descents."""
    deadline = time.perf_counter() + time_limit
    rng = np.random.default_rng(seed)
    weight = np.ones(structure.nv) if weight is None else np.asarray(weight, float)
    objective = _Objective(structure, values, weight, start)
    if not structure.relevant.any():
        q = np.clip(np.zeros((1, structure.n)), lower, upper)
        found, v = objective.both(q)
        vector = v[0] * weight
        return Minimum(float(found[0]), q[0], vector / np.linalg.norm(vector), q, found, 1)
    pool = [random_positions(structure, lower, upper, samples, rng), nested_seeds(objective, structure, lower, upper, rng)]
    if seeds is not None and len(seeds):
        pool.append(np.clip(seeds, lower, upper))
    q = np.concatenate(pool)
    found, _ = objective.both(q)
    q = q[_spread(q, found, starts, structure.relevant)]
    # All together for a few steps; then the better half, twice, and the last digits of the lowest alone.
    for iterations, keep in ((8, 2), (12, 2), (40, 1)):
        q, found = _descend(objective, q, lower, upper, iterations, 1e-6, floor, deadline)
        order = _spread(q, found, max(len(q) // keep, 4), structure.relevant, 1e-2)
        q, found = q[order], found[order]
    # Of positions that a symmetry of the robot makes equal, the nearest to zero, whichever rounding made the lowest.
    equal = int(np.count_nonzero(found <= found[0] + _EQUAL * abs(found[0])))
    order = np.append(np.argsort(np.abs(q[:equal]).sum(axis=1)), np.arange(equal, len(q)))
    q, found = q[order], found[order]
    q[0], found[0] = _nearest_image(objective, q[0], found[0], lower, upper)
    best, value = _descend(objective, q[:1], lower, upper, 100, 1e-13, -np.inf, deadline)
    if value[0] <= found[0]:
        q[0], found[0] = best[0], value[0]
    _, v = objective.both(q[:1])
    vector = v[0] * weight
    return Minimum(float(found[0]), q[0].copy(), vector / np.linalg.norm(vector), q, found, objective.evaluations)


def _nearest_image(objective: _Objective, q: Array, value: float, lower: Array, upper: Array) -> tuple[Array, float]:
    """Of the positions that half turns of single joints make of q (n,), the nearest to zero whose eigenvalue is the same.

    A few starts meet some of the images of a minimum only; which ones, rounding decides."""
    structure = objective.structure
    for i in np.flatnonzero(structure.relevant & ~structure.prismatic & (np.abs(q) > 0.5 * np.pi)):
        image = q.copy()
        image[i] -= np.copysign(np.pi, q[i])
        if lower[i] <= image[i] <= upper[i]:
            there = float(objective.both(image[None])[0][0])
            if there <= value + _EQUAL * abs(value):
                q, value = image, there
    return q, value


def nested_seeds(
    objective: _Objective,
    structure: InertiaStructure,
    lower: Array,
    upper: Array,
    rng: np.random.Generator,
    width: int = 12,
    points: int = 12,
) -> Array:
    """Seeds built from the tip: the trailing block of joints i.. depends on the joints after i only (dissertation 4.2).

    The worst positions of each block, joint by joint, are what the next larger block starts from."""
    n, base = structure.n, structure.nv - structure.n
    beam = random_positions(structure, lower, upper, width, rng)
    if structure.has_loop:
        return beam
    first = 0 if base else 1
    for i in reversed(range(max(first, objective.start - base), n)):
        if not structure.relevant[i]:
            continue
        grid = np.linspace(lower[i], upper[i], points, endpoint=structure.prismatic[i] or upper[i] - lower[i] < 6.28)
        q = np.repeat(beam, len(grid), axis=0)
        q[:, i] = np.tile(grid, len(beam))
        # The block in which this joint first appears starts at the joint before it.
        values = objective.trailing(q, max(base + i - 1 if i else 0, objective.start))
        beam = q[np.argsort(values)[:width]]
    return beam


def _spread(q: Array, values: Array, count: int, relevant: Array, distance: float = 0.3) -> Array:
    """Indices of the `count` lowest positions that are `distance` (rad, m) apart, lowest first."""
    order = np.argsort(values)
    kept: list[int] = []
    for i in order[: max(40 * count, 200)]:
        if kept:
            delta = q[kept][:, relevant] - q[i, relevant]
            # Angles that differ by a turn are one position; a slide never reaches that far.
            delta = delta - 2 * np.pi * np.round(delta / (2 * np.pi))
            if delta.shape[1] and np.abs(delta).max(axis=1).min() < distance:
                continue
            if not delta.shape[1]:
                break
        kept.append(int(i))
        if len(kept) == count:
            break
    return np.array(kept, int)


#: Step lengths that are tried side by side, as multiples of the quasi-Newton step.
_TRIALS = np.array([1.0, 0.3, 0.05, 2.5])


def _descend(
    objective: _Objective, q: Array, lower: Array, upper: Array, iterations: int, tolerance: float, floor: float, deadline: float
) -> tuple[Array, Array]:
    """Projected BFGS, all starts (S, n) together: (q, values). A start stops when it gains less than `tolerance` (relative)."""
    S, n = q.shape
    whole = upper - lower >= 2 * np.pi - 1e-9
    q = q.copy()
    value, v = objective.both(q)
    slope = objective.slope(q, v)
    inverse = np.repeat(np.eye(n)[None], S, 0)
    fresh = np.ones(S, bool)
    active = np.ones(S, bool)
    reach = np.full(S, 0.1)
    for _ in range(iterations):
        at = np.flatnonzero(active)
        near = value.min() <= floor + 1e-4 * abs(floor) if np.isfinite(floor) else False
        if not len(at) or near or time.perf_counter() > deadline:
            break
        g = _free(slope[at], q[at], lower, upper, whole)
        step = _free(-np.einsum("Sij,Sj->Si", inverse[at], g), q[at], lower, upper, whole, along=True)
        uphill = np.einsum("Si,Si->S", step, g) >= 0
        step[uphill], fresh[at[uphill]] = -g[uphill], True
        length = np.maximum(np.abs(step).max(axis=1), 1e-300)
        # Without curvature yet: a tenth of a radian, or less where that has failed; with it at most half a radian.
        step *= np.where(fresh[at], reach[at] / length, np.minimum(1.0, 0.5 / length))[:, None]
        trial = (q[at, None] + _TRIALS[:, None] * step[:, None]).reshape(-1, n)
        trial = np.where(whole, trial, np.clip(trial, lower, upper))
        tried, vectors = objective.both(trial)
        choice = tried.reshape(-1, len(_TRIALS)).argmin(axis=1) + len(_TRIALS) * np.arange(len(at))
        gain = value[at] - tried[choice]
        better = gain > 0
        # Where nothing helped: again along the plain slope, ever shorter, then stop.
        stuck = at[~better]
        reach[stuck] = np.where(fresh[stuck], 0.02 * reach[stuck], reach[stuck])
        active[stuck] = reach[stuck] > 1e-8
        inverse[stuck], fresh[stuck] = np.eye(n), True
        go, pick = at[better], choice[better]
        if not len(go):
            continue
        new_slope = objective.slope(trial[pick], vectors[pick])
        _update(inverse, go, trial[pick] - q[go], new_slope - slope[go], fresh)
        q[go], value[go], slope[go] = trial[pick], tried[pick], new_slope
        active[go] &= gain[better] > tolerance * np.maximum(np.abs(value[go]), 1e-12)
    wrapped = np.where(whole, q - 2 * np.pi * np.round(q / (2 * np.pi)), q)
    return wrapped, value


def _free(direction: Array, q: Array, lower: Array, upper: Array, whole: Array, along: bool = False) -> Array:
    """The direction (or, for a slope, its negative) without what leads out of the ranges."""
    sign = 1.0 if along else -1.0
    out = ((q <= lower) & (sign * direction < 0)) | ((q >= upper) & (sign * direction > 0))
    return np.where(out & ~whole, 0.0, direction)


def _update(inverse: Array, at: Array, s: Array, y: Array, fresh: Array) -> None:
    """BFGS update of the inverse curvature of the starts `at`, skipped where curvature is not positive."""
    sy = np.einsum("Si,Si->S", s, y)
    yy = np.einsum("Si,Si->S", y, y)
    use = sy > 1e-12 * np.sqrt(yy * np.einsum("Si,Si->S", s, s))
    rows = at[use]
    if not len(rows):
        return
    s, y, sy, yy = s[use], y[use], sy[use], yy[use]
    start = fresh[rows]
    inverse[rows[start]] *= (sy / np.maximum(yy, 1e-300))[start, None, None]
    fresh[rows] = False
    B = inverse[rows]
    By = np.einsum("Sij,Sj->Si", B, y)
    yBy = np.einsum("Si,Si->S", y, By)
    inverse[rows] = (
        B
        + ((sy + yBy) / sy**2)[:, None, None] * np.einsum("Si,Sj->Sij", s, s)
        - (np.einsum("Si,Sj->Sij", By, s) + np.einsum("Si,Sj->Sij", s, By)) / sy[:, None, None]
    )
