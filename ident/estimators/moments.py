"""Moments of instruments against regressor and residual: all that instrumental variables need from the samples."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class WhiteRows:
    """A block of m rows in units of the noise's standard deviation: `instruments`, `columns` (m, n, b); `error` (m, n): torque less
    what the parameters predict; `torque` (m, n); `valid` (m, n), all is zero elsewhere; `place` in the problem's rows; `run`."""

    instruments: Array
    columns: Array
    error: Array
    torque: Array
    valid: Array
    place: slice
    run: int


@dataclass(frozen=True, eq=False)
class InstrumentMoments:
    """Sums over weighted rows, for b columns and instruments of k lags.

    `cross` (k, b, b): Zᵀ Φ; `gram` (k, b, b): Zᵀ Z; `miss` (k, b): Zᵀ e at some parameters; `own` (b, b): Φᵀ Φ, `own_miss` (b,): Φᵀ e;
    `error` (M, n): e itself, NaN in rows not used; `torques` (n,): Σ τ²."""

    cross: Array
    gram: Array
    miss: Array
    own: Array
    own_miss: Array
    error: Array
    torques: Array

    @property
    def rows(self) -> Array:
        """Rows used (n,)."""
        return np.isfinite(self.error).sum(axis=0)


def instrument_moments(blocks: Iterable[WhiteRows], shape: tuple[int, ...], b: int, lags: tuple[int, ...] = (0,)) -> InstrumentMoments:
    """One pass over M rows of n joints, `shape`; instruments as they are and as they were so many rows before, run by run."""
    k = len(lags)
    cross, gram, miss = np.zeros((k, b, b)), np.zeros((k, b, b)), np.zeros((k, b))
    own, own_miss, torques = np.zeros((b, b)), np.zeros(b), np.zeros(shape[1])
    error = np.full(shape, np.nan)
    for rows, together in with_earlier(blocks, lags):
        e, flat = rows.error.reshape(-1), rows.columns.reshape(-1, b)
        for i in range(k):
            Z = together[:, :, i * b : (i + 1) * b].reshape(-1, b)
            cross[i] += Z.T @ flat
            gram[i] += Z.T @ Z
            miss[i] += Z.T @ e
        own += flat.T @ flat
        own_miss += flat.T @ e
        error[rows.place] = np.where(rows.valid, rows.error, np.nan)
        torques += np.sum(rows.torque**2, axis=0)
    return InstrumentMoments(cross, gram, miss, own, own_miss, error, torques)


def with_earlier(blocks: Iterable[WhiteRows], lags: tuple[int, ...]) -> Iterator[tuple[WhiteRows, Array]]:
    """Blocks of rows beside their instruments of every lag and, last, their columns: (m, n, (k+1) b)."""
    earlier = [_Lagged(lag) for lag in lags]
    for rows in blocks:
        yield rows, np.concatenate([*(lag(rows) for lag in earlier), rows.columns], axis=2)


class _Lagged:
    """Instruments of `lag` rows ago, run by run; where there are none yet, zero."""

    def __init__(self, lag: int) -> None:
        self.lag, self._run, self._past = lag, -1, np.zeros((0, 0, 0))

    def __call__(self, rows: WhiteRows) -> Array:
        if self.lag == 0:
            return rows.instruments
        if rows.run != self._run:
            self._run, self._past = rows.run, np.zeros((self.lag, *rows.instruments.shape[1:]))
        line = np.concatenate([self._past, rows.instruments])
        self._past = line[len(line) - self.lag :]
        return np.where(rows.valid[:, :, None], line[: len(rows.instruments)], 0.0)
