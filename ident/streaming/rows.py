"""Rows of the regression equation made part by part and kept in files: each part is a pure function of the log and the decisions."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..filters import RowFilter
from ..model import Model
from ..motion import Motion
from ..problem import Rows
from ..rows import _TURNING_REACH, _TURNING_SHARE, _UNSOUND, _share
from ..transmission import Side
from .columns import RowColumns, live_columns
from .decisions import Decisions
from .motion import DerivedRun

if TYPE_CHECKING:
    from .signals import StreamedSignals

Array = np.ndarray


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
    torque that is missing or cut off; `rest`: share of standstill; `turning`: a reversal reaches into the row."""

    tau: Array
    missing: Array
    limited: Array
    rest: Array
    turning: Array


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
            with np.load(part.path) as file:
                return RowFacts(*(file[k] for k in RowFacts.__dataclass_fields__))
        run, drive = part.run.run, part.run.run.robot.transmission
        found = part.run.at(part.samples.start, part.samples.stop)
        row_filter = part.run.derivation.row_filter
        pace = np.abs(found.dq if drive.measured == Side.JOINT else drive.motor_rate(found.dq))
        none = np.zeros(pace.shape, bool)
        threshold = self.decisions.threshold

        def share(flag: Array) -> Array:
            return flag.astype(float) if row_filter is None else _share(row_filter, flag)

        facts = RowFacts(
            found.smooth if row_filter is None else row_filter.apply(found.smooth),
            share(found.missing) > _UNSOUND,
            share(self.decisions.at_limit(found.torque) if self.saturated else none) > _UNSOUND,
            share(pace <= threshold if self.standstill else none),
            share(pace <= _TURNING_REACH * threshold if self.standstill else none) > _TURNING_SHARE,
        )
        kept = {k: getattr(facts, k) for k in RowFacts.__dataclass_fields__}
        if self.model is not None and row_filter is not None:
            motion = Motion.of(run.robot, found.q, found.dq, found.ddq, found.t, rate=run.rate, torque=found.torque, start=run.origin)
            columns = RowColumns(self.model, row_filter)(motion)
            kept["columns"] = columns[:, live_columns(self.model)]
            _save(part.path, kept)
        return facts


def _save(path: Path, arrays: dict[str, Array]) -> None:
    """A file that is there completely or not at all."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    with temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays)
    temporary.replace(path)


@dataclass(frozen=True, eq=False)
class StoredRows:
    """The columns of all rows of `model`, in files; iterates over `Rows` with the torque and the masks of `signals`."""

    parts: Sequence[RowPart]
    model: Model
    signals: StreamedSignals

    def __iter__(self) -> Iterator[Rows]:
        live = live_columns(self.model)
        for part in self.parts:
            yield self._rows(part, live)

    def of_run(self, number: int, *, backwards: bool = False) -> Iterator[Rows]:
        """The blocks of one run, from the last to the first if asked."""
        live = live_columns(self.model)
        mine = [p for p in self.parts if p.number == number]
        return (self._rows(part, live) for part in (reversed(mine) if backwards else mine))

    def _rows(self, part: RowPart, live: Array) -> Rows:
        with np.load(part.path) as file:
            packed = file["columns"]
        columns = np.zeros((len(packed), *live.shape))
        columns[:, live] = packed
        return Rows(columns, self.signals.tau[part.place], self.signals.valid[part.place], part.place, part.number)


def packed_bytes(model: Model, rows: int) -> int:
    """Bytes that the columns of so many rows take on disk."""
    return 8 * rows * int(live_columns(model).sum())


def rows_in(run: DerivedRun, row_filter: RowFilter | None) -> int:
    """Rows that a derived run gives."""
    return len(run) if row_filter is None else row_filter.count(len(run))
