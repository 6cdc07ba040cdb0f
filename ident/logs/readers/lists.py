"""Parquet files whose columns hold a list a row (LeRobot): a column an element, named as the dataset's description names it."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from .arrays import element
from .header import numeric
from .parquet import arrow_values, parquet_file, parquet_table
from .stored import LogFormat, Stored, register_log_format

Array = np.ndarray
_MAGIC = b"PAR1"


def _is_one(path: Path, start: bytes) -> bool:
    return start.startswith(_MAGIC) and any("list" in str(f.type) or "struct" in str(f.type) for f in parquet_file(path).schema_arrow)


def _read(path: Path) -> Stored:
    table = parquet_table(path)
    told = _described(path)
    columns: dict[str, Array] = {}
    while any("struct" in str(f.type) and "list" not in str(f.type) for f in table.schema):
        table = table.flatten()
    for name in table.column_names:
        column = table.column(name)
        if "list" in str(column.type):
            columns |= _elements(name, column, told.get(name, ()))
        else:
            with suppress(DataError, ValueError):
                columns[name] = numeric(arrow_values(column), path, name)
    if not columns:
        raise DataError(f"log {path}: holds no column of numbers.")
    return Stored(columns)


def _elements(name: str, values: Any, names: tuple[str, ...]) -> dict[str, Array]:
    """Columns of an Arrow column of lists of one length; none where they differ, or hold no numbers."""
    try:
        flat = np.asarray(values.combine_chunks().flatten(), float)
    except (TypeError, ValueError, AttributeError):
        return {}
    rows = len(values)
    if rows == 0 or len(flat) % rows:
        return {}
    table = flat.reshape(rows, -1)
    width = table.shape[1]
    return {f"{name}[{names[j]}]" if len(names) == width else element(name, j): table[:, j] for j in range(width)}


def _described(path: Path) -> dict[str, tuple[str, ...]]:
    """Names of the elements of each feature, from the dataset's `meta/info.json` above the file."""
    for folder in path.resolve().parents[:4]:
        info = folder / "meta" / "info.json"
        if info.is_file():
            try:
                features = json.loads(info.read_text())["features"]
                return {k: names for k, f in features.items() if isinstance(f, dict) and (names := _names(f.get("names")))}
            except (ValueError, KeyError, TypeError, AttributeError, OSError):
                return {}
    return {}


def _names(told: Any) -> tuple[str, ...]:
    """Names told as a list, a list in a list, or by kind (`{"motors": [...]}`); () where they are none, or not each its own."""
    if isinstance(told, dict):
        told = next(iter(told.values()), None)
    if isinstance(told, list) and len(told) == 1 and isinstance(told[0], list):
        told = told[0]
    if isinstance(told, list) and all(isinstance(x, str) and x for x in told) and len(set(told)) == len(told):
        return tuple(told)
    return ()


DATASET = register_log_format(LogFormat("Parquet with lists", _is_one, _read))
