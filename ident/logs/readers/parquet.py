"""Parquet files by pyarrow."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ConfigurationError, DataError
from .damage import damage_told
from .packed import Expansion

Array = np.ndarray


def arrow_values(column: Any) -> Array:
    """The values of an Arrow column; missing numbers are NaN.

    Floats are taken from its buffers: to ask Arrow for an array would load pandas (40 MB, half a second)."""
    import pyarrow as pa

    if column.type != pa.float64():
        return np.asarray(column)
    parts = [part.fill_null(np.nan) if part.null_count else part for part in column.chunks]
    arrays = [np.frombuffer(p.buffers()[1], np.float64, len(p), 8 * p.offset) for p in parts if len(p)]
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays) if arrays else np.zeros(0)


def parquet_file(path: Path) -> Any:
    """A Parquet file, opened. Raises DataError, and ConfigurationError without pyarrow."""
    if find_spec("pyarrow") is None:
        raise ConfigurationError(f"log {path}: reading Parquet needs pyarrow: pip install pyarrow. Or export the log as CSV.")
    from pyarrow import parquet

    with damage_told(path, "is not a Parquet file"):
        return parquet.ParquetFile(path)


def parquet_table(path: Path, columns: list[str] | None = None) -> Any:
    """Columns of a Parquet file. Raises DataError where what the file holds is damaged."""
    file, unpacked = parquet_file(path), Expansion(path)
    with damage_told(path, "the file is damaged"):
        # Values that repeat take next to nothing in the file, and eight bytes each here.
        unpacked.add(8 * file.metadata.num_rows * (file.metadata.num_columns if columns is None else len(columns)))
        return file.read(columns=columns)


def stored_names(file: Any) -> tuple[tuple[str, str], ...]:
    """What the columns of a Parquet file are called here, without blanks around it as in a text, and what they are called there."""
    try:
        stored = file.schema.names
    except UnicodeDecodeError:
        raise DataError("the column names of a Parquet file are not text: the file is damaged.") from None
    bare = [name.strip() for name in stored]
    return tuple((name if bare.count(name) == 1 else own, own) for name, own in zip(bare, stored, strict=True))


def time_columns(file: Any) -> set[str]:
    """The columns that are times by their type, as they are called in the file."""
    import pyarrow as pa

    return {field.name for field in file.schema_arrow if pa.types.is_timestamp(field.type)}
