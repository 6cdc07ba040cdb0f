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

from ..regressor.kernel_choice import kernel
from ..statistics.autoregression import Autoregression, lower_orders, rising
from ..statistics.noise import NoiseModel, fit_noise
from .moments import InstrumentMoments, WhiteRows, instrument_moments

if TYPE_CHECKING:
    from ..problem.columns import PackedColumns
    from ..problem.problem import PackedRows, Problem

Array = np.ndarray
#: Rows in a piece of which the motion's spectrum is taken.
_SPECTRUM = 4096
#: Windows of time within which errors may be correlated beyond their model: seconds of each, and how many there are at least.
_WINDOW_S = 0.5
_WINDOWS = 60
#: Variance of the residual below this share of the torque's own square is round-off.
_ROUND_OFF = 1e-24
#: Numbers that a line has a multiple of: what the compiled filter takes at once.
_LANES = 8


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
        run = -1
        joints: tuple[_JointColumns, ...] = ()
        filters = [_Whitener(w.polynomial, w.innovation) for w in self.weighting]
        for rows, other in zip(self.problem.packed_rows(), self.instruments.packed_rows(), strict=True):
            if not joints:
                chosen = np.full(self.problem.base.count, -1)
                chosen[self.columns] = np.arange(len(self.columns))
                joints = tuple(_JointColumns.of(rows.columns, j, chosen) for j in range(len(filters)))
            if rows.run != run:
                run = rows.run
                for one, joint in zip(filters, joints, strict=True):
                    one.reset(joint.width)
            valid = rows.valid & self.usable[rows.place]
            lines = tuple(
                one.whitened(joint.line(rows, other.columns, self.values, j, one.room(len(valid))), valid[:, j])
                for j, (one, joint) in enumerate(zip(filters, joints, strict=True))
            )
            yield WhiteRows(lines, tuple(joint.columns for joint in joints), valid, rows.place, run)

    def moments(self, lags: tuple[int, ...] = (0,), *, windowed: bool = False) -> InstrumentMoments:
        """One pass over the samples; `windowed`: also what correlates errors within windows of time."""
        rows = len(self.usable)
        per_second = rows / max(sum(r.stop - r.start for r in self.problem.signals.runs) / self.problem.signals.rate, 1e-9)
        window = max(1, min(round(_WINDOW_S * per_second), rows // _WINDOWS))
        return instrument_moments(self, self.usable.shape, len(self.columns), lags, window if windowed else 0)

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


@dataclass(frozen=True, eq=False)
class _JointColumns:
    """What one joint has of the columns: the base columns `every` at `places` of the packed values, for the prediction; the estimated ones
    among them at `estimated`, which are `columns` of those estimated; `width` of its line."""

    every: Array
    places: slice | Array
    estimated: slice | Array
    columns: Array
    width: int

    @classmethod
    def of(cls, packed: PackedColumns, j: int, chosen: Array) -> _JointColumns:
        """`chosen` (b_all,): place of each base column among those estimated, −1 for none."""
        every, places = packed.columns[j], packed.places[j]
        mine = chosen[every] >= 0
        columns = chosen[every[mine]]
        width = -(-(2 * len(columns) + 2) // _LANES) * _LANES
        return cls(every, _stretch(places), _stretch(places[mine]), columns, width)

    def line(self, rows: PackedRows, instruments: PackedColumns, values: Array, j: int, out: Array) -> Array:
        """`out` (p + m, width), with instruments, columns, error and torque of joint j in its last m rows; rows that are not valid may hold
        anything."""
        size, here = len(self.columns), out[len(out) - len(rows.tau) :]
        here[:, :size] = instruments.values[:, self.estimated]
        here[:, size : 2 * size] = rows.columns.values[:, self.estimated]
        here[:, 2 * size + 1] = rows.tau[:, j]
        here[:, 2 * size + 2 :] = 0.0
        np.subtract(rows.tau[:, j], rows.columns.values[:, self.places] @ values[self.every], out=here[:, 2 * size])
        return out


def _stretch(places: Array) -> slice | Array:
    """Places that follow one another as a slice, which needs no copy."""
    if len(places) and np.array_equal(places, np.arange(places[0], places[0] + len(places))):
        return slice(int(places[0]), int(places[0]) + len(places))
    return places


class _Whitener:
    """Rows of one joint, block by block, through the predictor of the order that the rows since the last gap allow."""

    def __init__(self, polynomial: Array, innovation: float) -> None:
        last = int(np.flatnonzero(polynomial)[-1])
        predictors = [a / np.sqrt(variance) for a, variance in lower_orders(polynomial[: last + 1], innovation)]
        self.full = predictors[-1]
        #: By rows since the last gap: weights of the rows since then.
        self.triangle = np.zeros((last, last))
        for order, a in enumerate(predictors[:-1]):
            self.triangle[order, : order + 1] = a[::-1]
        self.order = last
        self.reset(0)

    def reset(self, width: int) -> None:
        """Begin a run of rows of this width."""
        self.past, self.age = np.zeros((self.order, width)), 0

    def room(self, count: int) -> Array:
        """The last rows (p, c), and room for as many more."""
        line = np.empty((self.order + count, self.past.shape[1]))
        line[: self.order] = self.past
        return line

    def whitened(self, line: Array, valid: Array) -> Array:
        """Whitened rows (m, c) of `room` filled with m rows that follow the last ones; zero where `valid` (m,) is false."""
        m, p = len(valid), self.order
        whole = bool(valid.all())
        if not whole:
            line[p:][~valid] = 0.0
        self.past = line[len(line) - p :].copy()
        out = kernel().series.average(self.full, line)
        if whole and self.age >= p:
            return out
        place = np.arange(m)
        # Rows since the last gap, before each row; those of the blocks before count on.
        gap = np.maximum.accumulate(np.where(valid, -1 - self.age, place))
        age = np.minimum(np.concatenate([[self.age], place[1:] - gap[:-1] - 1]), p)
        self.age = int(min(place[-1] - gap[-1], p))
        if not whole:
            out[~valid] = 0.0
        young = np.flatnonzero(valid & (age < p))
        if not len(young):
            return out
        ends = np.flatnonzero(np.diff(young) != 1)
        for first, last in zip(young[np.append(0, ends + 1)].tolist(), (young[np.append(ends, -1)] + 1).tolist(), strict=True):
            seen = int(age[first])
            np.matmul(
                self.triangle[seen : seen + last - first, : seen + last - first], line[p + first - seen : p + last], out=out[first:last]
            )
        return out
