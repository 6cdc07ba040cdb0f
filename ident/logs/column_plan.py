"""The resolved columns of a log: made once from a header, applied to any number of tables, or pieces of tables, that have these columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import DataError
from .names import QUANTITIES, TEXT, Column
from .readers.header import seconds

Array = np.ndarray


@dataclass(frozen=True)
class ColumnPlan:
    """The resolved columns of a log. `joints`: names, where the header gives them; `extra`: columns that are nothing of ours; `hint`:
    where there is no torque, which of those look like it, as a question; `where`: the file, for messages; `wanted`: columns of desired
    motion (`q_ref`, `q_cmd` …) that are read with them; `rate_hz`: samples per second by which the time is counted, where there is none."""

    columns: tuple[Column, ...]
    n: int
    joints: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())
    hint: str = ""
    where: str = "log"
    wanted: tuple[Column, ...] = ()
    rate_hz: float | None = None

    @property
    def sources(self) -> tuple[str, ...]:
        """Columns of the file that must be read."""
        return tuple(dict.fromkeys(c.source for c in self.read))

    @property
    def read(self) -> tuple[Column, ...]:
        """All that is read."""
        return (*self.columns, *self.wanted)

    def on_clock(self, *columns: Column) -> ColumnPlan:
        """The same with other columns for the time, which add up."""
        return replace(self, columns=(*columns, *(c for c in self.columns if c.quantity != "t")))

    def quantity(self, name: str) -> tuple[Column, ...]:
        """The columns of one quantity."""
        return tuple(c for c in self.columns if c.quantity == name)

    def arrays(self, table: Mapping[str, Array]) -> dict[str, Array]:
        """SI arrays from raw columns (any number of rows): "t" (N,), every other quantity present (N, n), NaN where a joint has none."""
        out: dict[str, Array] = {}
        for quantity in (*QUANTITIES, *dict.fromkeys(c.quantity for c in self.wanted)):
            columns = tuple(c for c in self.read if c.quantity == quantity)
            if not columns:
                continue
            if quantity == "t" and len(columns) > 1:  # seconds, and a fraction of one
                out["t"] = sum(
                    (c.scale * np.asarray(table[c.source], float) for c in columns[1:]), np.asarray(table[columns[0].source], float)
                )
                continue
            rows = len(table[columns[0].source])
            array = np.full((rows, self.n), np.nan) if quantity != "t" else np.empty((rows, 1))
            for c in columns:
                values = np.asarray(table[c.source])
                if values.dtype.kind in "mM":
                    if quantity != "t":
                        raise DataError(f"{self.where}: column {c.source!r} holds times, not numbers; it cannot be {TEXT[quantity]}.")
                    # What is a time in the file has its unit there, whatever the column's name says.
                    array[:, c.joint] = seconds(values)
                    continue
                values = values.astype(float, copy=False)
                array[:, c.joint] = values if c.scale == 1.0 else values * c.scale
                if c.offset:
                    array[:, c.joint] += c.offset
            out[quantity] = array[:, 0] if quantity == "t" else array
        return out
