"""Derivatives of stored runs, piece by piece, with the overlap that makes them those of the whole run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..signals.filters import RowFilter
from ..signals.preparation import Preparation
from .runs import StoredRun

Array = np.ndarray
#: Samples that are derived at a time.
PIECE = 1 << 14


@dataclass(frozen=True, eq=False)
class Stretch:
    """Some samples of a run, in memory: `t` (L,), `q`, `dq`, `ddq` (L, n) on the joint side; `torque` (L, n) on the measured side as
    recorded, NaN where `missing`; `smooth`: the same without NaN, and filtered like the positions where rows are samples."""

    t: Array
    q: Array
    dq: Array
    ddq: Array
    torque: Array
    smooth: Array
    missing: Array


@dataclass(frozen=True, eq=False)
class Derivation:
    """How runs are derived: a strategy with its cut-off (Hz) and the rows' filter."""

    prep: Preparation
    rate: float
    cutoff: float
    row_filter: RowFilter | None

    @property
    def piece(self) -> int:
        """Samples worth deriving at a time: many against the overlap."""
        taps = 0 if self.row_filter is None else len(self.row_filter.taps)
        return max(PIECE, 4 * (2 * self.prep.reach(self.cutoff, self.rate) + taps))

    def of(self, run: StoredRun) -> DerivedRun:
        """The run, and which of its samples have derivatives."""
        # A window at either end tells what the strategy gives up there; a shorter run is derived whole.
        window = 2 * self.prep.reach(self.cutoff, self.rate) + math.ceil(2 * (self.prep.edge_s or 0.0) * self.rate) + PIECE
        if len(run) <= window:
            found = self.prep._derive(run.read(0, len(run), slice(0, len(run))), self.rate, self.cutoff, self.row_filter)
            return DerivedRun(self, run, found.offset, found.offset + len(found))
        # The number given up at an end depends on the length of the run in no strategy beyond such a window.
        found = self.prep._derive(run.read(0, window, slice(0, window)), self.rate, self.cutoff, self.row_filter)
        return DerivedRun(self, run, found.offset, len(run) - (window - found.offset - len(found)))


@dataclass(frozen=True, eq=False)
class DerivedRun:
    """Samples `start` … `stop` - 1 of a stored run have derivatives; they are counted from 0 here."""

    derivation: Derivation
    run: StoredRun
    start: int
    stop: int

    def __len__(self) -> int:
        return max(0, self.stop - self.start)

    def at(self, a: int, b: int) -> Stretch:
        """Samples `a` … `b` - 1."""
        d, total = self.derivation, len(self.run)
        reach = d.prep.reach(d.cutoff, d.rate)
        # What is given up at either end of a piece comes on top of what the filters feel.
        low = max(0, self.start + a - reach - self.start)
        high = min(total, self.start + b + reach + total - self.stop)
        within = slice(0, total) if d.row_filter is None else slice(self.start, self.stop)
        piece = self.run.read(low, high, slice(max(within.start, 0), within.stop))
        found = d.prep._derive(piece, d.rate, d.cutoff, d.row_filter)
        inner = slice(self.start + a - low - found.offset, self.start + b - low - found.offset)
        own = slice(self.start + a - low, self.start + b - low)
        missing = piece.missing[own]
        torque = piece.torque[own]
        return Stretch(
            piece.t[own],
            found.q[inner],
            found.dq[inner],
            found.ddq[inner],
            np.where(missing, np.nan, torque) if missing.any() else torque,
            found.torque[inner],
            missing,
        )

    def stretches(self) -> Iterator[Stretch]:
        """All samples in order."""
        size = self.derivation.piece
        for a in range(0, len(self), size):
            yield self.at(a, min(a + size, len(self)))
