"""Moments of instruments against regressor and residual, per measured row: what instrumental variables need from the samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError
from .instruments import paired

if TYPE_CHECKING:
    from ..problem import Problem

Array = np.ndarray
#: Which of a row's columns decides on its weight: the one above this share of the others in noise.
_CAUTION = 0.9


@dataclass(frozen=True, eq=False)
class CrossMoments:
    """Sums over the samples of each measured row j, for b columns.

    `cross` (n, b, b): Zⱼᵀ Φⱼ; `miss` (n, b): Zⱼᵀ (τ − Φ p) at some p; `gram` (n, b, b): Zⱼᵀ Zⱼ; `counts` (n,);
    `scatter`, `energy` (n, b): sums of (Σ w z e)² over short windows w and of (w z)², for the noise that the instruments see;
    `pending` (n, b): Σ w z e of the window number `window` that is not complete yet."""

    cross: Array
    miss: Array
    gram: Array
    counts: Array
    scatter: Array
    energy: Array
    pending: Array
    window: int = -1

    @classmethod
    def empty(cls, n: int, b: int) -> CrossMoments:
        """No samples yet."""
        square, line = np.zeros((n, b, b)), np.zeros((n, b))
        return cls(square, line, square, np.zeros(n, np.int64), line, line, line)

    def with_rows(self, instruments: Array, columns: Array, residual: Array, valid: Array, place: Array, length: int) -> CrossMoments:
        """Add m samples that follow the last ones: `instruments`, `columns` (m, n, b), `residual`, `valid` (m, n).

        `place` (m,): the samples' numbers, rising; windows are `length` of them, so that blocks of any size give the same."""
        n, b = self.miss.shape
        # Windows fade in and out: differenced noise has most of its sum at hard edges.
        fade = np.sin(np.pi * (place % length + 1) / (length + 1)) ** 2
        number = place // length
        firsts = np.flatnonzero(np.diff(number, prepend=-1))
        cross, gram, miss, energy = np.zeros((n, b, b)), np.zeros((n, b, b)), np.zeros((n, b)), np.zeros((n, b))
        sums = np.zeros((len(firsts), n, b))
        for j in range(n):
            Z = np.where(valid[:, j, None], instruments[:, j], 0.0)
            e = np.where(valid[:, j], residual[:, j], 0.0)
            faded = Z * fade[:, None]
            cross[j], gram[j], miss[j], energy[j] = Z.T @ columns[:, j], Z.T @ Z, Z.T @ e, np.sum(faded**2, axis=0)
            sums[:, j] = np.add.reduceat(faded * e[:, None], firsts, axis=0)
        before = self if number[0] == self.window else self.closed()
        sums[0] += before.pending
        return CrossMoments(
            self.cross + cross,
            self.miss + miss,
            self.gram + gram,
            self.counts + valid.sum(axis=0),
            before.scatter + np.sum(sums[:-1] ** 2, axis=0),
            self.energy + energy,
            sums[-1],
            int(number[-1]),
        )

    def closed(self) -> CrossMoments:
        """The same with the last window counted as complete."""
        return replace(self, scatter=self.scatter + self.pending**2, pending=np.zeros_like(self.pending), window=-1)

    def __add__(self, other: CrossMoments) -> CrossMoments:
        """Merge the moments of two sets of samples."""
        if self.cross.shape != other.cross.shape:
            raise ConfigurationError("moments of different models cannot be merged.")
        one, two = self.closed(), other.closed()
        summed = ("cross", "miss", "gram", "counts", "scatter", "energy")
        return replace(one, **{f: getattr(one, f) + getattr(two, f) for f in summed})

    def selected(self, columns: Array) -> CrossMoments:
        """The moments of a subset of columns and their instruments."""
        square = np.ix_(np.arange(len(self.counts)), columns, columns)
        return replace(
            self, cross=self.cross[square], gram=self.gram[square], miss=self.miss[:, columns], scatter=self.scatter[:, columns],
            energy=self.energy[:, columns], pending=self.pending[:, columns],
        )  # fmt: skip

    def noise(self) -> Array:
        """Variance (n,) of white noise that would disturb the instruments' sums as much as the residual does.

        Differenced noise disturbs quick columns more than slow ones; the row weighs by its quick ones."""
        with np.errstate(divide="ignore", invalid="ignore"):
            share = self.closed().scatter / self.energy
        share[~np.isfinite(share)] = np.nan
        out = np.ones(len(self.counts))
        for j, row in enumerate(share):
            seen = row[np.isfinite(row)]
            if len(seen):
                out[j] = float(np.quantile(seen, _CAUTION))
        return out


def cross_moments(problem: Problem, instruments: Problem, share: Array, values: Array) -> CrossMoments:
    """One pass over the samples: moments with the residual at base values (b,)."""
    n, b = problem.valid.shape[1], problem.base.count
    rows_total = max(1, len(problem.valid))
    # Long enough to see the noise at the motion's own frequencies, short enough for many batches.
    length = max(1, min(rows_total // 60, round(0.3 * rows_total / max(problem_seconds(problem), 1e-9))))
    total, run = CrossMoments.empty(n, b), 0
    for rows, Z in paired(problem, instruments, share):
        residual = np.where(rows.valid, rows.tau - rows.columns @ values, 0.0)
        place = np.arange(rows.place.start, rows.place.stop) - problem.row_runs[rows.run].start
        # Every run has windows of its own.
        total, run = (total if rows.run == run else total.closed()), rows.run
        total = total.with_rows(Z, rows.columns, residual, rows.valid, place, length)
    return total.closed()


def problem_seconds(problem: Problem) -> float:
    """Seconds of log that the rows cover."""
    s = problem.signals
    return sum(run.stop - run.start for run in s.runs) / s.rate
