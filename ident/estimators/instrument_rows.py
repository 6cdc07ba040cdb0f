"""Rows and their instruments, weighted by the noise's own colour: refined instrumental variables.

With noise of covariance Γ the best instruments for given noise-free columns Z are Γ⁻¹ Z (Young & Jakeman 1979).
Γ⁻¹ = LᵀL, L lower triangular and built from the predictors of all orders, so LZ, LΦ and Le are formed instead; differenced
noise, which is small only where motion is slow, then weighs as little as it should, and edges of masks need no care: the
first rows after a gap are predicted from as many rows as there are, and weigh by what that leaves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..statistics.autoregression import Autoregression, rising
from ..statistics.noise import NoiseModel, fit_noise
from ..statistics.whitening import RowWhitener, padded
from .moments import InstrumentMoments, InstrumentProducts, WhiteRows, instrument_moments

if TYPE_CHECKING:
    from ..problem.columns import PackedColumns
    from ..problem.problem import PackedRows, Problem

Array = np.ndarray
#: Columns of arrays (m, …) that stand side by side.
Parts = tuple[tuple[Array, slice], ...]
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
        made = cls(problem, instruments, usable, columns, values, noise, weighting)
        made.__dict__["residual"] = residual
        return made

    @cached_property
    def residual(self) -> Array:
        """Torque less what the base values predict (M, n), NaN where rows are not used."""
        return np.where(self.usable, self.problem.residual(self.values), np.nan)

    def _parts(self, filters: list[RowWhitener]) -> Iterator[tuple[PackedRows, tuple[_JointColumns, ...], Array, list[Parts]]]:
        """Blocks of rows, the joints' columns, which rows are used, and for each joint what goes through its filter, which stands at the
        beginning of a run where one begins."""
        run = -1
        joints: tuple[_JointColumns, ...] = ()
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
            error = self.residual[rows.place]
            yield rows, joints, valid, [joint.parts(other.columns, rows.columns, error, rows.tau, j) for j, joint in enumerate(joints)]

    def __iter__(self) -> Iterator[WhiteRows]:
        """Weighted blocks. Rows of different joints are weighted apart; what correlates them does not make the estimate inconsistent."""
        filters = self._filters
        for rows, joints, valid, parts in self._parts(filters):
            lines = tuple(one.rows(own, (valid, j)) for j, (one, own) in enumerate(zip(filters, parts, strict=True)))
            yield WhiteRows(lines, tuple(joint.columns for joint in joints), valid, rows.place, rows.run)

    @property
    def _filters(self) -> list[RowWhitener]:
        return [RowWhitener(w.polynomial, w.innovation) for w in self.weighting]

    def products(self) -> InstrumentProducts:
        """What a step needs, in one pass that never holds weighted rows."""
        filters = self._filters
        sums: list[Array] = []
        joints: tuple[_JointColumns, ...] = ()
        for _, joints, valid, parts in self._parts(filters):
            sums = sums or [np.zeros((joint.width, joint.width)) for joint in joints]
            for j, (one, joint, own) in enumerate(zip(filters, joints, parts, strict=True)):
                one.add_products(own, (valid, j), sums[j], padded(len(joint.columns)))
        return InstrumentProducts.of([joint.columns for joint in joints], sums, len(self.columns))

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
    """What one joint has of the columns: the estimated ones at `estimated` of the packed values, which are `columns` of those estimated;
    `width` of its line."""

    estimated: slice | Array
    columns: Array
    width: int

    @classmethod
    def of(cls, packed: PackedColumns, j: int, chosen: Array) -> _JointColumns:
        """`chosen` (b_all,): place of each base column among those estimated, −1 for none."""
        every, places = packed.columns[j], packed.places[j]
        mine = chosen[every] >= 0
        columns = chosen[every[mine]]
        return cls(_stretch(places[mine]), columns, padded(2 * len(columns) + 2))

    def parts(self, instruments: PackedColumns, columns: PackedColumns, error: Array, torque: Array, j: int) -> Parts:
        """Instruments, columns, error and torque of joint j, side by side."""
        own = slice(j, j + 1)
        return (*(_columns(x.values, self.estimated) for x in (instruments, columns)), (error, own), (torque, own))


def _columns(values: Array, places: slice | Array) -> tuple[Array, slice]:
    return (values, places) if isinstance(places, slice) else (values[:, places], slice(0, len(places)))


def _stretch(places: Array) -> slice | Array:
    """Places that follow one another as a slice, which needs no copy."""
    if len(places) and np.array_equal(places, np.arange(places[0], places[0] + len(places))):
        return slice(int(places[0]), int(places[0]) + len(places))
    return places
