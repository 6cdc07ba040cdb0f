"""Rows and their instruments, weighted by the noise's own colour: refined instrumental variables.

With noise of covariance Γ the best instruments for given noise-free columns Z are Γ⁻¹ Z (Young & Jakeman 1979).
Γ⁻¹ = LᵀL, L lower triangular and built from the predictors of all orders, so LZ, LΦ and Le are formed instead; differenced
noise, which is small only where motion is slow, then weighs as little as it should, and edges of masks need no care: the
first rows after a gap are predicted from as many rows as there are, and weigh by what that leaves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..signals.rows import Rows
from ..statistics.autoregression import Autoregression, lower_orders, rising
from ..statistics.noise import NoiseModel, fit_noise, noise_gram
from .instruments import paired
from .moments import InstrumentMoments, WhiteRows, instrument_moments, with_earlier

if TYPE_CHECKING:
    from ..problem.problem import Problem

Array = np.ndarray
_ROWS = 128
#: Rows in a piece of which the motion's spectrum is taken.
_SPECTRUM = 4096
#: Windows of time within which errors may be correlated beyond their model: seconds of each, and how many there are at least.
_WINDOW_S = 0.5
_WINDOWS = 60
#: Variance of the residual below this share of the torque's own square is round-off.
_ROUND_OFF = 1e-24


@dataclass(frozen=True, eq=False)
class InstrumentRows:
    """`problem` and its `instruments` over the rows that are `usable` (M, n), at base `values` (b,) of which `columns` are estimated;
    `noise`: of the residual at these values; `weighting`: for each joint, the noise that its rows are weighted by."""

    problem: Problem
    instruments: Problem
    usable: Array
    columns: Array
    values: Array
    noise: NoiseModel
    weighting: tuple[Autoregression, ...]

    @classmethod
    def at(cls, problem: Problem, instruments: Problem, usable: Array, columns: Array, values: Array) -> InstrumentRows:
        """With the noise as the residual at these values shows it."""
        residual = np.where(usable, problem.residual(values), np.nan)
        noise = fit_noise(residual, problem.row_runs, problem.row_shape)
        power = _power(instruments.predict(values), problem.row_runs)
        squares = np.sum(np.where(usable, problem.tau, 0.0) ** 2, axis=0) / np.maximum(usable.sum(axis=0), 1)
        floor = _ROUND_OFF * np.maximum(squares, 1e-270)
        level = np.maximum(np.diag(noise.innovation), floor)
        weighting = tuple(rising(a, v, power[:, j]) for j, (a, v) in enumerate(zip(noise.ar, level.tolist(), strict=True)))
        return cls(problem, instruments, usable, columns, values, noise, weighting)

    def __iter__(self) -> Iterator[WhiteRows]:
        """Weighted blocks. Rows of different joints are weighted apart; what correlates them does not make the estimate inconsistent."""
        b, run = len(self.columns), -1
        filters = [_Whitener(w.polynomial, w.innovation) for w in self.weighting]
        for rows, Z in paired(self.problem, self.instruments, self.usable):
            if rows.run != run:
                run = rows.run
                for one in filters:
                    one.reset(2 * b + 2)
            torque = np.where(rows.valid, rows.tau, 0.0)
            error = torque - np.where(rows.valid, rows.columns @ self.values, 0.0)
            out = np.empty((*rows.valid.shape, 2 * b + 2))
            for j, one in enumerate(filters):
                line = np.concatenate([Z[:, j, self.columns], rows.columns[:, j, self.columns], np.stack([error, torque], 2)[:, j]], axis=1)
                out[:, j] = one(line, rows.valid[:, j])
            yield WhiteRows(out[:, :, :b], out[:, :, b : 2 * b], out[:, :, 2 * b], out[:, :, 2 * b + 1], rows.valid, rows.place, run)

    def moments(self, lags: tuple[int, ...] = (0,)) -> InstrumentMoments:
        """One pass over the samples."""
        rows = len(self.usable)
        per_second = rows / max(sum(r.stop - r.start for r in self.problem.signals.runs) / self.problem.signals.rate, 1e-9)
        window = max(1, min(round(_WINDOW_S * per_second), rows // _WINDOWS))
        return instrument_moments(self, self.usable.shape, len(self.columns), lags, window)

    def score_gram(self, moments: InstrumentMoments, lags: tuple[int, ...]) -> Array:
        """Covariance ((k+1) b, (k+1) b) of the sums Zᵀ e of instruments of k lags and, last, of Φᵀ e.

        Under the colour that the weighted errors still have, and with their own squares for their variance (`noise_gram`)."""
        runs = self.problem.row_runs
        left = fit_noise(moments.error, runs)
        blocks = (Rows(scores, rows.error, rows.valid, rows.place, rows.run) for rows, scores in with_earlier(self, lags))
        return noise_gram(left, blocks, np.ones(self.usable.shape[1]), moments.error)

    @property
    def exact(self) -> bool:
        """Whether the residual is within round-off and integration, and says nothing about noise."""
        squares = np.sum(np.where(self.usable, self.problem.tau, 0.0) ** 2, axis=0)
        return not np.any(self.noise.variance * self.usable.sum(axis=0) > 1e-16 * squares)

    @property
    def weights(self) -> Array:
        """Inverse variance (n,) of white noise as strong as the residual's where the motion is; zero where there are no rows."""
        level = np.array([w.innovation / np.sum(w.polynomial) ** 2 for w in self.weighting])
        return np.where(self.usable.any(axis=0), 1.0 / level, 0.0)


def _power(torque: Array, runs: tuple[slice, ...]) -> Array:
    """Power (F, n) of a torque (M, n) at frequencies from zero to half the rate of the rows, averaged over pieces of the runs."""
    lengths = [run.stop - run.start for run in runs]
    size = min(max(lengths), _SPECTRUM)
    out = np.zeros((size // 2 + 1, torque.shape[1]))
    for run, length in zip(runs, lengths, strict=True):
        if length < size // 2:
            continue
        for first in range(run.start, max(run.stop - size, run.start) + 1, max(1, size // 2)):
            piece = torque[first : min(first + size, run.stop)]
            window = np.hanning(len(piece) + 2)[1:-1, None]
            out += np.abs(np.fft.rfft((piece - piece.mean(axis=0)) * window, size, axis=0)) ** 2
    return out


class _Whitener:
    """Rows of one joint, block by block, through the predictor of the order that the rows since the last gap allow."""

    def __init__(self, polynomial: Array, innovation: float) -> None:
        last = int(np.flatnonzero(polynomial)[-1])
        predictors = [a / np.sqrt(variance) for a, variance in lower_orders(polynomial[: last + 1], innovation)]
        #: By rows since the last gap: weights of a row and of those before it.
        self.young = np.zeros((last + 1, last + 1))
        for order, a in enumerate(predictors):
            self.young[order, : order + 1] = a
        self.order = last
        full = predictors[-1][::-1]
        self.band = np.zeros((_ROWS, _ROWS + last))
        for r in range(_ROWS):
            self.band[r, r : r + last + 1] = full
        self.reset(0)

    def reset(self, width: int) -> None:
        """Begin a run of rows of this width."""
        self.past, self.age = np.zeros((self.order, width)), 0

    def __call__(self, x: Array, valid: Array) -> Array:
        """Whitened rows (m, c) of x (m, c) that follow the last ones; zero where `valid` (m,) is false."""
        m, p = len(x), self.order
        line = np.concatenate([self.past, np.where(valid[:, None], x, 0.0)])
        place = np.arange(m)
        # Rows since the last gap, before each row; those of the blocks before count on.
        gap = np.maximum.accumulate(np.where(valid, -1 - self.age, place))
        age = np.minimum(np.concatenate([[self.age], place[1:] - gap[:-1] - 1]), p)
        self.age = int(min(place[-1] - gap[-1], p))
        self.past = line[len(line) - p :]
        out = np.empty_like(x)
        for first in range(0, m, _ROWS):
            last = min(first + _ROWS, m)
            np.matmul(self.band[: last - first, : last - first + p], line[first : last + p], out=out[first:last])
        out[~valid] = 0.0
        young = np.flatnonzero(valid & (age < p))
        if len(young):
            before = line[young[:, None] + p - np.arange(p + 1)]
            out[young] = np.matmul(self.young[age[young]][:, None, :], before)[:, 0]
        return out
