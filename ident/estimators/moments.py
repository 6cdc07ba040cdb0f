"""Moments of instruments against regressor and residual: all that instrumental variables need from the samples."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class WhiteRows:
    """A block of m rows in units of the noise's standard deviation, joint by joint: `lines[j]` (m, w) holds the instruments of the columns
    `columns[j]` that the joint has, then these columns, the error (torque less what the parameters predict) and the torque; what
    follows is zero. All is zero where `valid` (m, n) is false; `place` in the problem's rows; `run`."""

    lines: tuple[Array, ...]
    columns: tuple[Array, ...]
    valid: Array
    place: slice
    run: int

    def instruments(self, j: int) -> Array:
        """(m, l) of joint j, over its own columns."""
        return self.lines[j][:, : len(self.columns[j])]

    def others(self, j: int) -> Array:
        """Columns, error and torque (m, l + 2) of joint j."""
        size = len(self.columns[j])
        return self.lines[j][:, size : 2 * size + 2]

    def error(self, j: int) -> Array:
        """(m,) of joint j."""
        return self.lines[j][:, 2 * len(self.columns[j])]


@dataclass(frozen=True, eq=False)
class InstrumentMoments:
    """Sums over weighted rows, for b columns and instruments of k lags.

    `cross` (k, b, b): Zᵀ Φ; `gram` (k, b, b): Zᵀ Z; `miss` (k, b): Zᵀ e at some parameters; `own` (b, b): Φᵀ Φ, `own_miss` (b,): Φᵀ e;
    `error` (M, n): e itself, NaN in rows not used; `torques` (n,): Σ τ²; `windowed` (b, b), where asked for: Σ s sᵀ over windows of
    time, s the window's part of Zᵀ e of the first lag: its covariance with all that correlates the errors within a window."""

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


@dataclass(frozen=True, eq=False)
class InstrumentProducts:
    """What a step needs of `InstrumentMoments`, with the instruments as they are: `cross` (b, b), `gram` (b, b), `miss` (b,)."""

    cross: Array
    gram: Array
    miss: Array

    @classmethod
    def of(cls, columns: Sequence[Array], products: Sequence[Array], b: int) -> InstrumentProducts:
        """From the products (w, w) of each joint's line (`WhiteRows`), of which the upper triangle of the instruments' rows counts."""
        cross, gram = np.zeros((2, b, b))
        miss = np.zeros(b)
        for own, sums in zip(columns, products, strict=True):
            size, square = len(own), np.ix_(own, own)
            upper = np.triu(sums[:size, :size])
            gram[square] += upper + np.triu(upper, 1).T
            cross[square] += sums[:size, size : 2 * size]
            miss[own] += sums[:size, 2 * size]
        return cls(cross, gram, miss)


def instrument_moments(
    blocks: Iterable[WhiteRows], shape: tuple[int, ...], b: int, lags: tuple[int, ...] = (0,), window: int = 0
) -> InstrumentMoments:
    """One pass over M rows of n joints, `shape`; instruments as they are and as they were so many rows before, run by run.

    The first lag is 0. `window`: rows in a window of time (0: `windowed` stays zero)."""
    own, earlier = _OwnSums(shape, b, window), [_LaggedSums(lag, b) for lag in lags[1:]]
    for rows in blocks:
        own.add(rows)
        for sums in earlier:
            sums.add(rows)
    own.close()
    for sums in earlier:
        sums.close()
    return InstrumentMoments(
        np.stack([own.cross, *(sums.cross for sums in earlier)]),
        np.stack([own.gram, *(sums.gram for sums in earlier)]),
        np.stack([own.miss, *(sums.miss for sums in earlier)]),
        own.own,
        own.own_miss,
        own.error,
        own.torques,
        own.windows.gram,
    )


class _OwnSums:
    """Sums with the instruments of the same rows; see `InstrumentMoments`."""

    def __init__(self, shape: tuple[int, ...], b: int, window: int) -> None:
        self.cross, self.gram, self.own = np.zeros((3, b, b))
        self.miss, self.own_miss = np.zeros((2, b))
        self.error, self.torques = np.full(shape, np.nan), np.zeros(shape[1])
        self.windows = _Windows(window, b)
        self._columns: tuple[Array, ...] = ()
        self._products: list[Array] = []

    def add(self, rows: WhiteRows) -> None:
        """Rows that follow the last ones."""
        if not self._columns:
            self._columns = rows.columns
            self._products = [np.zeros((line.shape[1],) * 2) for line in rows.lines]
        for j, line in enumerate(rows.lines):
            self._products[j] += line.T @ line
            self.error[rows.place, j] = np.where(rows.valid[:, j], rows.error(j), np.nan)
        if self.windows.length:
            scores = np.zeros((len(rows.valid), len(self.miss)))
            for j, columns in enumerate(rows.columns):
                scores[:, columns] += rows.instruments(j) * rows.error(j)[:, None]
            self.windows.add(rows.run, scores)

    def close(self) -> None:
        """The sums of all joints together."""
        for j, (columns, products) in enumerate(zip(self._columns, self._products, strict=True)):
            size, square = len(columns), np.ix_(columns, columns)
            Z, Phi, error, torque = slice(size), slice(size, 2 * size), 2 * size, 2 * size + 1
            self.gram[square] += products[Z, Z]
            self.cross[square] += products[Z, Phi]
            self.own[square] += products[Phi, Phi]
            self.miss[columns] += products[Z, error]
            self.own_miss[columns] += products[Phi, error]
            self.torques[j] = products[torque, torque]


class _LaggedSums:
    """Sums with the instruments of `lag` rows ago; see `InstrumentMoments`."""

    def __init__(self, lag: int, b: int) -> None:
        self.cross, self.gram = np.zeros((2, b, b))
        self.miss = np.zeros(b)
        self._lagged = Lagged(lag)
        self._columns: tuple[Array, ...] = ()
        self._products: list[tuple[Array, Array]] = []

    def add(self, rows: WhiteRows) -> None:
        """Rows that follow the last ones."""
        if not self._columns:
            self._columns = rows.columns
            self._products = [(np.zeros((len(c), len(c))), np.zeros((len(c), len(c) + 2))) for c in rows.columns]
        for j, (Z, (gram, others)) in enumerate(zip(self._lagged(rows), self._products, strict=True)):
            gram += Z.T @ Z
            others += Z.T @ rows.others(j)

    def close(self) -> None:
        """The sums of all joints together."""
        for columns, (gram, others) in zip(self._columns, self._products, strict=True):
            square = np.ix_(columns, columns)
            self.gram[square] += gram
            self.cross[square] += others[:, :-2]
            self.miss[columns] += others[:, -2]


class Lagged:
    """Instruments (m, l) of each joint as they were `lag` rows ago, run by run; where there are none yet, zero."""

    def __init__(self, lag: int) -> None:
        self.lag, self._run = lag, -1
        self._past: list[Array] = []

    def __call__(self, rows: WhiteRows) -> list[Array]:
        """Of rows that follow the last ones."""
        now = [rows.instruments(j) for j in range(len(rows.lines))]
        if self.lag == 0:
            return now
        if rows.run != self._run:
            self._run, self._past = rows.run, [np.zeros((self.lag, Z.shape[1])) for Z in now]
        out = []
        for j, Z in enumerate(now):
            line = np.concatenate([self._past[j], Z])
            self._past[j] = line[len(line) - self.lag :]
            found = line[: len(Z)]
            if not rows.valid[:, j].all():
                found = np.where(rows.valid[:, j, None], found, 0.0)
            out.append(found)
        return out


class _Windows:
    """Σ s sᵀ of sums s over so many rows each, run by run; blocks of any size give the same."""

    def __init__(self, length: int, b: int) -> None:
        self.length, self._run, self._seen = length, -1, 0
        self._open, self._closed = np.zeros(b), np.zeros((b, b))

    def add(self, run: int, scores: Array) -> None:
        """Rows (m, b) of a run that follow the last ones."""
        if run != self._run:
            self._close()
            self._run, self._seen = run, 0
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
