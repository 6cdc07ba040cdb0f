"""A random walk of the parameters over blocks of a log: filter, likelihood and smoother."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..problem.information import triangle

if TYPE_CHECKING:
    from ..problem.linear_solution import LinearSolution
    from ..problem.problem import Problem

Array = np.ndarray
#: Variance of the starting point, in units of the whole log's own variance: as good as unknown, and still well conditioned.
_DIFFUSE = 1e6
#: Total drift over the log, relative to the value, that is tried where none is given.
_DRIFTS = (0.03, 0.1, 0.3, 1.0, 3.0)
#: Gain in log-likelihood from which a drift is believed (a likelihood ratio of 20).
_GAIN = 3.0


@dataclass(frozen=True, eq=False)
class Course:
    """Smoothed `values` and `std` (s, b) after every block, `final_covariance` (b, b), and the log-likelihood (less a constant)."""

    likelihood: float
    values: Array
    std: Array
    final_covariance: Array


class RandomWalk:
    """Blocks of the log as measurements, in coordinates in which the whole log has the information matrix 1.

    Those coordinates are y = root (p − batch solution): filterpy's covariance form loses nothing in them."""

    def __init__(self, problem: Problem, solution: LinearSolution, weights: Array, blocks: int) -> None:
        from scipy.linalg import solve_triangular

        self.batch = solution
        information = problem.information.selected(solution.columns)
        # The same root with the weights in use, which are less than the batch's where noise is coloured.
        self.root = information.combined(weights)[0]
        self.measured: list[tuple[Array, Array]] = []
        self.block_of = np.zeros(len(problem.valid), int)
        times = []
        for time, places, block in _blocks(problem, solution.columns, weights, blocks):
            R = triangle(block) if len(block) > block.shape[1] else block
            rows, z = R[:, :-1], R[:, -1] - R[:, :-1] @ solution.values
            self.block_of[places] = len(self.measured)
            self.measured.append((solve_triangular(self.root, rows.T, trans="T").T, z))
            times.append(time)
        self.times = np.array(times)
        self.steps = np.diff(self.times, prepend=self.times[0])
        self.length = max(float(np.sum(np.maximum(self.steps, 0.0))), 1e-9)
        self.steps = np.maximum(self.steps, 0.0)

    def likely_drift(self, moving: list[int]) -> Array:
        """Drift of each parameter under which the log is most likely, found one after another; mostly 0."""
        drift = np.zeros(len(moving))
        best = self._filter(moving, drift)[0]

        def with_(i: int, d: float) -> float:
            trial = drift.copy()
            trial[i] = d
            return self._filter(moving, trial)[0]

        first = [with_(i, _DRIFTS[2]) - best for i in range(len(moving))]
        for i in np.argsort(first)[::-1]:
            if first[i] < -_GAIN:
                break
            scores = [with_(int(i), d) for d in _DRIFTS]
            if max(scores) > best + _GAIN:
                best, drift[i] = max(scores), _DRIFTS[int(np.argmax(scores))]
        return drift

    def _shift(self, moving: list[int], drift: Array) -> Array:
        """Covariance of the change of y over the whole log."""
        part = self.root[:, moving] * (drift * np.abs(self.batch.values[moving]))
        return part @ part.T

    def _filter(self, moving: list[int], drift: Array) -> tuple[float, Array, Array]:
        """Log-likelihood (less a constant), and mean (s, b) and covariance (s, b, b) after every block."""
        from filterpy.kalman import KalmanFilter

        b = len(self.batch.values)
        shift = self._shift(moving, drift) / self.length
        likelihood = 0.0
        states, covariances = [], []
        walk = KalmanFilter(dim_x=b, dim_z=1)
        walk.x, walk.P = np.zeros(b), _DIFFUSE * np.eye(b)
        for (H, z), step in zip(self.measured, self.steps, strict=True):
            walk.predict(F=np.eye(b), Q=shift * step)
            if len(z):
                S = H @ walk.P @ H.T + np.eye(len(z))
                miss = z - H @ walk.x
                likelihood -= 0.5 * float(np.linalg.slogdet(S)[1] + miss @ np.linalg.solve(S, miss))
                walk.update(z, R=np.eye(len(z)), H=H)
            states.append(walk.x.copy())
            covariances.append((walk.P + walk.P.T) / 2)
        return likelihood, np.array(states), np.array(covariances)

    def course(self, moving: list[int], drift: Array) -> Course:
        """All parameters after every block, given the whole log (Rauch, Tung & Striebel)."""
        from filterpy.kalman import KalmanFilter

        likelihood, states, covariances = self._filter(moving, drift)
        b = states.shape[1]
        shift = self._shift(moving, drift) / self.length
        # Step k of the smoother goes from block k to block k+1.
        ahead = [shift * step for step in np.append(self.steps[1:], 0.0)]
        smoother = KalmanFilter(dim_x=b, dim_z=1)
        x, P, _, _ = smoother.rts_smoother(states, covariances, Fs=[np.eye(b)] * len(states), Qs=ahead)
        found = [self._parameters(xi, Pi) for xi, Pi in zip(x, P, strict=True)]
        std = np.sqrt(np.maximum([np.diag(C) for _, C in found], 0.0))
        return Course(likelihood, np.array([v for v, _ in found]), std, found[-1][1])

    def residual(self, problem: Problem, course: Course) -> Array:
        """Measured minus predicted torque (M, n) with the values of each block; NaN in rows that are not used."""
        out = np.full(problem.tau.shape, np.nan)
        for rows in problem.rows():
            values = course.values[self.block_of[rows.place]]
            torque = np.einsum("mjb,mb->mj", rows.columns[:, :, self.batch.columns], values)
            out[rows.place] = np.where(rows.valid, rows.tau - torque, np.nan)
        return out

    def _parameters(self, y: Array, P: Array) -> tuple[Array, Array]:
        """Parameters and their covariance from the filter's coordinates."""
        from scipy.linalg import solve_triangular

        half = solve_triangular(self.root, P)
        covariance = solve_triangular(self.root, half.T)
        return self.batch.values + solve_triangular(self.root, y), (covariance + covariance.T) / 2


def _blocks(problem: Problem, columns: Array, weights: Array, count: int) -> Iterator[tuple[float, slice, Array]]:
    """Time of the end, place in the rows, and weighted equations (r, b+1) of about `count` blocks; one never spans two runs."""
    time = problem.row_time
    size = max(1, -(-len(problem.valid) // count))
    pending: list[Array] = []
    start = end = run = 0

    def done() -> tuple[float, slice, Array]:
        return float(time[end - 1]), slice(start, end), np.concatenate(pending)

    for rows in problem.rows():
        for a in range(0, len(rows.tau), size):
            part = slice(a, min(a + size, len(rows.tau)))
            use = rows.valid[part]
            if pending and (end - start + len(use) > size or rows.run != run):
                yield done()
                pending = []
            if not pending:
                start, run = rows.place.start + a, rows.run
            block = np.concatenate([rows.columns[part][:, :, columns], np.where(use, rows.tau[part], 0.0)[:, :, None]], axis=2)
            pending.append((block * np.sqrt(weights)[:, None])[use])
            end = rows.place.start + part.stop
    if pending:
        yield done()
