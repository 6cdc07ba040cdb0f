"""Rows of the regression equation made part by part and kept in files: each part is a pure function of the log and the decisions."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from ..effects.motion import Motion
from ..model import Model
from ..problem.columns import RowColumns, live_columns
from ..robots.transmission import Side
from ..signals.filters import RowFilter
from ..signals.rows import Rows
from ..signals.signals import Signals
from ..signals.sound import REVERSAL_REACH, REVERSAL_SHARE, UNSOUND, filtered_share
from .decisions import Decisions
from .motion import DerivedRun

Array = np.ndarray
#: Numbers in the columns of a block of rows, at most where parts are smaller.
_BLOCK_NUMBERS = 300_000


@dataclass(frozen=True)
class RowPart:
    """Rows of one run: `samples` of the derived run, which are rows `place` of all, run number `number`; `path`: the file they go to."""

    run: DerivedRun
    samples: slice
    place: slice
    number: int
    path: Path


@dataclass(frozen=True, eq=False)
class RowFacts:
    """What a part's rows are, without their columns. (m, n) each: `tau` filtered torque; `missing`, `limited`: too much of the row rests on
    torque that is missing or cut off; `rest`: share of standstill; `near_reversal`: a reversal reaches into the row."""

    tau: Array
    missing: Array
    limited: Array
    rest: Array
    near_reversal: Array

    def packed(self) -> Array:
        """All of them beside each other, (m, 5 n)."""
        return np.concatenate([getattr(self, f.name) for f in fields(self)], axis=1, dtype=float)

    @classmethod
    def unpacked(cls, numbers: Array, n: int) -> RowFacts:
        """From rows that begin with what `packed` gave."""
        tau, missing, limited, rest, reversing = (numbers[:, i * n : (i + 1) * n] for i in range(5))
        return cls(tau, missing != 0.0, limited != 0.0, rest, reversing != 0.0)


@dataclass(frozen=True, eq=False)
class MakeRows:
    """Makes the rows of a part. `standstill`: whether it is looked for; `saturated`: whether cut-off torque masks; `model`: of whose
    columns the part's file shall hold those that can be other than zero (None: no columns are kept)."""

    decisions: Decisions
    standstill: bool
    saturated: bool
    model: Model | None

    def __call__(self, part: RowPart) -> RowFacts:
        """The facts of a part's rows, from its file if it was made before."""
        if part.path.exists():
            return RowFacts.unpacked(_numbers(part), part.run.run.robot.n)
        run, drive = part.run.run, part.run.run.robot.transmission
        found = part.run.at(part.samples.start, part.samples.stop)
        row_filter = part.run.derivation.row_filter
        pace = np.abs(found.dq if drive.measured == Side.JOINT else drive.motor_rate(found.dq))
        none = np.zeros(pace.shape, bool)
        threshold = self.decisions.threshold

        def share(flag: Array) -> Array:
            return flag.astype(float) if row_filter is None else filtered_share(row_filter, flag)

        facts = RowFacts(
            found.smooth if row_filter is None else row_filter.apply(found.smooth),
            share(found.missing) > UNSOUND,
            share(self.decisions.at_limit(found.torque) if self.saturated else none) > UNSOUND,
            share(pace <= threshold if self.standstill else none),
            share(pace <= REVERSAL_REACH * threshold if self.standstill else none) > REVERSAL_SHARE,
        )
        numbers = facts.packed()
        if self.model is not None and row_filter is not None:
            motion = Motion.of(run.robot, found.q, found.dq, found.ddq, found.t, rate=run.rate, torque=found.torque, start=run.origin)
            columns = RowColumns(self.model, row_filter)(motion)
            numbers = np.concatenate([numbers, columns[:, self.live]], axis=1)
        _save(part.path, numbers)
        return facts

    @cached_property
    def live(self) -> Array:
        """The columns that are kept, (n, b) bool."""
        return np.zeros((0, 0), bool) if self.model is None else live_columns(self.model)


def _save(path: Path, numbers: Array) -> None:
    """A file that is there completely or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    numbers.tofile(temporary)
    temporary.replace(path)


def _numbers(part: RowPart) -> Array:
    """What is in a part's file: facts, then the live columns, of each row."""
    return np.fromfile(part.path).reshape(part.place.stop - part.place.start, -1)


@dataclass(frozen=True, eq=False)
class StoredRows:
    """The columns of all rows of `model`, in files; iterates over `Rows` with the torque and the masks of `signals`."""

    parts: Sequence[RowPart]
    model: Model
    signals: Signals

    @property
    def count(self) -> int:
        """Number of columns."""
        return self.model.base.count

    @property
    def row_runs(self) -> tuple[slice, ...]:
        """The rows of each run."""
        return self.signals.row_runs

    def __iter__(self) -> Iterator[Rows]:
        return map(self._rows, self._groups(self.parts))

    def of_run(self, number: int, *, backwards: bool = False) -> Iterator[Rows]:
        """The blocks of one run, from the last to the first if asked."""
        groups = [*self._groups([p for p in self.parts if p.number == number])]
        return map(self._rows, reversed(groups) if backwards else groups)

    def _groups(self, parts: Sequence[RowPart]) -> Iterator[list[RowPart]]:
        """Parts of one run that follow each other, enough for a block."""
        most = max(1, _BLOCK_NUMBERS // max(1, self._live.size))
        held: list[RowPart] = []
        for part in parts:
            if held and (part.number != held[0].number or part.place.stop - held[0].place.start > most):
                yield held
                held = []
            held.append(part)
        if held:
            yield held

    @cached_property
    def _live(self) -> Array:
        return live_columns(self.model)

    def _rows(self, parts: list[RowPart]) -> Rows:
        place = slice(parts[0].place.start, parts[-1].place.stop)
        columns = np.zeros((place.stop - place.start, *self._live.shape))
        facts = 5 * len(self._live)
        for part in parts:
            columns[part.place.start - place.start : part.place.stop - place.start, self._live] = _numbers(part)[:, facts:]
        return Rows(columns, self.signals.tau[place], self.signals.valid[place], place, parts[0].number)


def packed_bytes(model: Model, rows: int) -> int:
    """Bytes that the columns of so many rows take on disk."""
    return 8 * rows * int(live_columns(model).sum())


def rows_in(run: DerivedRun, row_filter: RowFilter | None) -> int:
    """Rows that a derived run gives."""
    return len(run) if row_filter is None else row_filter.count(len(run))
