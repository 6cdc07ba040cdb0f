"""A table to be read as a log: a file of any format, or a DataFrame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .readers.frames import chosen_columns, frame_columns
from .readers.header import Header
from .readers.tables import first_values, read_columns, read_header, read_labels, stored_table

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray


@dataclass(frozen=True)
class TableSource:
    """What messages call a table (`where`), its `name`, its `header`, how columns and labels are read, and the file that it is.

    `read`: (names, optional) → columns as floats; `labels`: name (and how many rows there are) → one text a row.
    `notes`: what its reader has to say, once it has read;
    `whole`: it is read as a whole, whatever is wanted of it; `constants`: single numbers that the file tells, by name."""

    where: str
    name: str
    header: Header
    read: Callable[[Sequence[str], Sequence[str]], dict[str, Array]]
    labels: Callable[..., list[str]]
    path: Path | None = None
    notes: Sequence[str] = ()
    whole: bool = False
    constants: Mapping[str, float] = field(default_factory=dict)

    def usual_size(self, name: str) -> float:
        """Median size of a column's first numbers, NaN where there is none (or it is a moment, which knows its unit): one of them may be
        damaged."""
        values = first_values(self.path, self.header, name) if self.path is not None and not self.whole else self.read([name], ())[name]
        known = np.asarray(values)
        known = known[np.isfinite(known)] if known.dtype.kind == "f" else known[:0]
        return float(np.median(np.abs(known))) if len(known) else np.nan

    @classmethod
    def of(cls, source: Path | pd.DataFrame) -> TableSource:
        """A file's table, or one in memory. Raises DataError."""
        if isinstance(source, Path):
            header, stored = read_header(source), stored_table(source)
            said = [] if stored is None else list(stored.notes)

            def read(names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
                return read_columns(source, header, names, optional=optional, said=said)

            return cls(
                f"log {source}",
                source.name.split(".")[0],
                header,
                read,
                partial(read_labels, source, header),
                source,
                said,
                stored is not None,
                dict(header.constants) if stored is None else stored.constants,
            )
        columns = frame_columns(source)

        def labels(name: str, rows: int | None = None) -> list[str]:
            return [str(x).strip() for x in columns[name]]

        return cls("log DataFrame", "frame", Header(tuple(columns)), partial(chosen_columns, columns), labels)
