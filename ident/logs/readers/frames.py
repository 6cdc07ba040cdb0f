"""Tables in memory: a pandas DataFrame as columns by name."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from ...errors import DataError
from .header import numeric, seconds

if TYPE_CHECKING:
    import pandas as pd

Array = np.ndarray
#: What messages call the table, where they name a file.
_WHERE = Path("DataFrame")
_TIMES = ("t", "time", "timestamp")


def is_frame(value: Any) -> TypeGuard[pd.DataFrame]:
    """Whether it is a DataFrame; pandas is not imported for that."""
    pandas = sys.modules.get("pandas")
    return pandas is not None and isinstance(value, pandas.DataFrame)


def frame_columns(frame: pd.DataFrame) -> dict[str, Array]:
    """Columns as they stand, by name; an index of times (named t or time, or dates) is one of them. Raises DataError for names that occur
    twice."""
    names = [str(name) for name in frame.columns]
    again = sorted({name for name in names if names.count(name) > 1})
    if again:
        raise DataError(f"log {_WHERE}: column {again[0]!r} occurs {names.count(again[0])} times; rename or drop all but one.")
    columns = {name: frame.iloc[:, i].to_numpy() for i, name in enumerate(names)}
    timed = str(frame.index.name).lower() in _TIMES or frame.index.dtype.kind in "mM"
    if timed and not any(name.lower() in _TIMES for name in names):
        columns = {"t": frame.index.to_numpy(), **columns}
    return columns


def chosen_columns(columns: Mapping[str, Array], names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
    """Some columns as float arrays, and those of `optional` that are numbers. Raises DataError naming column and row."""
    out = {name: _numbers(columns[name], name) for name in names}
    for name in optional:
        with suppress(DataError, ValueError, TypeError):
            out[name] = _numbers(columns[name], name)
    return out


def _numbers(values: Array, name: str) -> Array:
    return seconds(numeric(values, _WHERE, name))
