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
    `error` (M, n): e itself, NaN in rows not used; `torques` (n,): Σ τ²; `windowed` (b, b): Σ s sᵀ over windows of time, s the
    window's part of Zᵀ e of the first lag: its covariance with all that correlates the errors within a window."""

    cross: Array
    gram: Array
    miss: Array
    own: Array
    own_miss: Array
    error: Array
    torques: Array
    windowed: Array

    @property
    def rows(self) -> Array:
        """Rows used (n,)."""
        return np.isfinite(self.error).sum(axis=0)


def instrument_moments(
    blocks: Iterable[WhiteRows], shape: tuple[int, ...], b: int, lags: tuple[int, ...] = (0,), window: int = 1
) -> InstrumentMoments:
    """One pass over M rows of n joints, `shape`; instruments as they are and as they were so many rows before, run by run.

    `window`: rows in a window of time."""
    k = len(lags)
    cross, gram, miss = np.zeros((k, b, b)), np.zeros((k, b, b)), np.zeros((k, b))
    own, own_miss, torques = np.zeros((b, b)), np.zeros(b), np.zeros(shape[1])
    error, windows = np.full(shape, np.nan), _Windows(window, b)
    for rows, together in with_earlier(blocks, lags):
        e, flat = rows.error.reshape(-1), rows.columns.reshape(-1, b)
        for i in range(k):
            Z = together[:, :, i * b : (i + 1) * b].reshape(-1, b)
            cross[i] += Z.T @ flat
            gram[i] += Z.T @ Z
            miss[i] += Z.T @ e
        windows.add(rows, np.einsum("mnb,mn->mb", together[:, :, :b], rows.error))
        own += flat.T @ flat
        own_miss += flat.T @ e
        error[rows.place] = np.where(rows.valid, rows.error, np.nan)
        torques += np.sum(rows.torque**2, axis=0)
    return InstrumentMoments(cross, gram, miss, own, own_miss, error, torques, windows.gram)


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


class _Windows:
    """Σ s sᵀ of sums s over so many rows each, run by run; blocks of any size give the same."""

    def __init__(self, length: int, b: int) -> None:
        self.length, self._run, self._seen = length, -1, 0
        self._open, self._closed = np.zeros(b), np.zeros((b, b))

    def add(self, rows: WhiteRows, scores: Array) -> None:
        """Rows (m, b) that follow the last ones."""
        if rows.run != self._run:
            self._close()
            self._run, self._seen = rows.run, 0
        number = (self._seen + np.arange(len(scores))) // self.length
        firsts = np.flatnonzero(np.diff(number, prepend=-1))
        sums = np.add.reduceat(scores, firsts, axis=0)
        if self._seen % self.length:
            sums[0] += self._open
        else:
            self._close()
        self._seen += len(scores)
        self._closed += sums[:-1].T @ sums[:-1]
        self._open = sums[-1]

    def _close(self) -> None:
        self._closed, self._open = self._closed + np.outer(self._open, self._open), np.zeros(len(self._open))

    @property
    def gram(self) -> Array:
        """With the last window as complete."""
        return self._closed + np.outer(self._open, self._open)
