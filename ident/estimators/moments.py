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
    `scatter`, `energy` (n, b): sums of (Σ w z e)² over short windows w and of (w z)², for the noise that the instruments see."""

    cross: Array
    miss: Array
    gram: Array
    counts: Array
    scatter: Array
    energy: Array

    @classmethod
    def empty(cls, n: int, b: int) -> CrossMoments:
        """No samples yet."""
        return cls(np.zeros((n, b, b)), np.zeros((n, b)), np.zeros((n, b, b)), np.zeros(n, np.int64), np.zeros((n, b)), np.zeros((n, b)))

    def with_rows(self, instruments: Array, columns: Array, residual: Array, valid: Array, batch: int) -> CrossMoments:
        """Add m samples: `instruments`, `columns` (m, n, b), `residual`, `valid` (m, n); batches of `batch` samples."""
        place = np.arange(len(residual))
        # Batches fade in and out: differenced noise has most of its sum at hard edges.
        window = np.sin(np.pi * (place % batch + 1) / (batch + 1)) ** 2
        found = []
        for j in range(len(self.counts)):
            use = valid[:, j]
            found.append(_row_sums(instruments[use, j], columns[use, j], residual[use, j], place[use] // batch, window[use]))
        cross, miss, gram, scatter, energy = (np.stack(parts) for parts in zip(*found, strict=True))
        return CrossMoments(
            self.cross + cross,
            self.miss + miss,
            self.gram + gram,
            self.counts + valid.sum(axis=0),
            self.scatter + scatter,
            self.energy + energy,
        )

    def __add__(self, other: CrossMoments) -> CrossMoments:
        """Merge the moments of two sets of samples."""
        if self.cross.shape != other.cross.shape:
            raise ConfigurationError("moments of different models cannot be merged.")
        return CrossMoments(*(getattr(self, f) + getattr(other, f) for f in self.__dataclass_fields__))

    def selected(self, columns: Array) -> CrossMoments:
        """The moments of a subset of columns and their instruments."""
        square = np.ix_(np.arange(len(self.counts)), columns, columns)
        return replace(
            self, cross=self.cross[square], gram=self.gram[square], miss=self.miss[:, columns], scatter=self.scatter[:, columns],
            energy=self.energy[:, columns],
        )  # fmt: skip

    def noise(self) -> Array:
        """Variance (n,) of white noise that would disturb the instruments' sums as much as the residual does.

        Differenced noise disturbs quick columns more than slow ones; the row weighs by its quick ones."""
        with np.errstate(divide="ignore", invalid="ignore"):
            share = self.scatter / self.energy
        share[~np.isfinite(share)] = np.nan
        out = np.ones(len(self.counts))
        for j, row in enumerate(share):
            seen = row[np.isfinite(row)]
            if len(seen):
                out[j] = float(np.quantile(seen, _CAUTION))
        return out


def _row_sums(Z: Array, columns: Array, residual: Array, batch: Array, window: Array) -> tuple[Array, Array, Array, Array, Array]:
    """The sums of one row over its m samples; `batch` (m,) rising: which batch each sample is in; `window` (m,): weights there."""
    if not len(Z):
        b = Z.shape[1]
        return np.zeros((b, b)), np.zeros(b), np.zeros((b, b)), np.zeros(b), np.zeros(b)
    windowed = Z * window[:, None]
    sums = np.add.reduceat(windowed * residual[:, None], np.flatnonzero(np.diff(batch, prepend=-1)), axis=0)
    return Z.T @ columns, Z.T @ residual, Z.T @ Z, np.sum(sums**2, axis=0), np.sum(windowed**2, axis=0)


def cross_moments(problem: Problem, instruments: Problem, share: Array, values: Array) -> CrossMoments:
    """One pass over the samples: moments with the residual at base values (b,)."""
    n, b = problem.valid.shape[1], problem.base.count
    rows_total = max(1, len(problem.valid))
    # Long enough to see the noise at the motion's own frequencies, short enough for many batches.
    batch = max(1, min(rows_total // 60, round(0.3 * rows_total / max(problem_seconds(problem), 1e-9))))
    total = CrossMoments.empty(n, b)
    for rows, Z in paired(problem, instruments, share):
        residual = np.where(rows.valid, rows.tau - rows.columns @ values, 0.0)
        total = total.with_rows(Z, rows.columns, residual, rows.valid, batch)
    return total


def problem_seconds(problem: Problem) -> float:
    """Seconds of log that the rows cover."""
    s = problem.signals
    return sum(run.stop - run.start for run in s.runs) / s.rate
