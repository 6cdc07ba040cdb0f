"""Reading a log's table, whatever its format: names in, float columns out; nothing about robots."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from functools import lru_cache
from itertools import islice
from pathlib import Path

import numpy as np

from ...errors import DataError
from . import (
    bag,
    cells,
    channel_rows,
    hdf5,
    lists,
    mat,
    messages,
    numpy_files,
    scope,
    unread,
    yaml_documents,
)  # the formats that are registered
from .damage import damage_told
from .dialect import text_header
from .header import MISSING, Header, check_file, is_number, numeric, seconds
from .moments import MOMENT, seconds_of
from .parquet import arrow_values, parquet_file, parquet_table, stored_names, time_columns
from .stored import Stored, format_of, split_inside
from .text import read_text_columns, text_columns
from .text_rows import rows_of_text

Array = np.ndarray
#: The formats that come with the package.
BUILT_IN = (
    numpy_files.NPZ, numpy_files.NPY, mat.MAT, hdf5.HDF5, hdf5.MATLAB, messages.JSON, messages.XML, lists.DATASET, lists.ARROW, scope.SCOPE,
    cells.CELLS, channel_rows.CHANNEL_ROWS, yaml_documents.YAML, bag.BAG, unread.UNREAD,
)  # fmt: skip
_PARQUET = (".parquet", ".pq")
#: Rows that tell the size of a time.
_FIRST = 5


def read_header(path: Path) -> Header:
    """Column names of a file. Raises DataError."""
    if not split_inside(path)[1] and not (path.is_dir() and format_of(path)):
        check_file(path)
    if (stored := stored_table(path)) is not None:
        return Header(stored.names, units=tuple(stored.units.get(name, "") for name in stored.names))
    if path.suffix.lower() in _PARQUET:
        file = parquet_file(path)
        with damage_told(path, "the file is damaged"):
            times = time_columns(file)
        return Header(
            tuple(name for name, _ in stored_names(file)), units=tuple(MOMENT if own in times else "" for _, own in stored_names(file))
        )
    return text_header(path)


def stored_table(path: Path) -> Stored | None:
    """What a file holds that is read as a whole; None for tables of text, plain Parquet, and what is not there."""
    found = format_of(path)
    if found is None:
        return None
    outer, _ = split_inside(path)
    return _read_stored(found.name, path, outer.stat().st_mtime_ns)


@lru_cache(maxsize=2)
def _read_stored(name: str, path: Path, stamp: int) -> Stored:
    found = format_of(path)
    assert found is not None
    return found.read(path)


def read_labels(path: Path, header: Header, name: str, rows: int | None = None) -> list[str]:
    """A column as text, one a row. `rows`: of the file's numbers, where they are known. Raises DataError."""
    if (stored := stored_table(path)) is not None:
        return [f"{x:g}" for x in stored.columns[name]]
    if path.suffix.lower() in _PARQUET:
        own = dict(stored_names(parquet_file(path)))[name]
        return [str(x).strip() for x in parquet_table(path, [own]).column(0).to_pylist()]
    return [str(x).strip() for x in read_text_columns(path, header, [name], rows)[name]]


def first_values(path: Path, header: Header, name: str) -> Array:
    """A column's numbers in the first rows of a text or a plain Parquet file; times and what is no number are none."""
    if path.suffix.lower() in _PARQUET:
        file = parquet_file(path)
        own = dict(stored_names(file))[name]
        with damage_told(path, "the file is damaged"):
            batch = next(iter(file.iter_batches(_FIRST, columns=[own])), None)
        values = np.asarray(batch.column(0)) if batch is not None else np.zeros(0)
        return values.astype(float) if values.dtype.kind in "fiu" else np.zeros(0)
    at = header.names.index(name)
    fields = [row[at].strip().replace(header.decimal, ".") for _, row in islice(rows_of_text(path, header), _FIRST) if at < len(row)]
    return np.array([float(x) for x in fields if is_number(x)])


def recordings_in(path: Path) -> list[Path]:
    """The recordings of a file: itself, or one path inside it for each."""
    try:
        found = format_of(path) if path.exists() else None
        inside = found.recordings(path) if found is not None else ()
    except DataError:
        return [path]  # which is said when it is read
    return [path / name for name in inside] or [path]


def read_columns(
    path: Path, header: Header, names: Sequence[str], optional: Sequence[str] = (), said: list[str] | None = None
) -> dict[str, Array]:
    """The named columns as float arrays (missing entries are NaN), and those of `optional` that are numbers. `said`: as of `text_columns`.

    Raises DataError naming file, column and row."""
    if (stored := stored_table(path)) is not None:
        whole = stored.columns
        return {name: seconds(numeric(whole[name], path, name)) if name in optional else whole[name] for name in (*names, *optional)}
    if path.suffix.lower() in _PARQUET:
        own_names = {name: own for name, own in stored_names(parquet_file(path)) if name in (*names, *optional)}
        table = parquet_table(path, list(own_names.values()))
        columns = {name: arrow_values(table.column(own)) for name, own in own_names.items()}
        out = {name: numeric(columns[name], path, name) for name in names}
        for name in optional:
            with suppress(DataError):
                out[name] = seconds(numeric(columns[name], path, name))
        return out
    first = [fields for _, fields in islice(rows_of_text(path, header), 5)]
    place = {name: header.names.index(name) for name in optional}
    numbers = [n for n, i in place.items() if all(i < len(f) and _number_or_none(f[i], header) for f in first)]
    texts = [n for n in (*names, *optional) if n in header.moments]
    names = [n for n in names if n not in texts]
    read: dict[str, Array] = {}
    if numbers:
        with suppress(DataError):
            read = text_columns(path, header, [*names, *numbers], said)
    if not read and (names or not texts):
        read = text_columns(path, header, names, said)
    if not texts:
        return read
    rows = len(next(iter(read.values()))) if read else None
    return read | {n: seconds_of(x, path, n) for n, x in read_text_columns(path, header, texts, rows).items()}


def _number_or_none(text: str, header: Header) -> bool:
    return text.strip().lower() in MISSING or is_number(text.replace(header.decimal, "."))
