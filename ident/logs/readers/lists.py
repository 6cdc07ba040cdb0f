"""Parquet files whose columns hold a list a row (LeRobot), and Arrow files: a column an element, named as the dataset's description names
it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ConfigurationError, DataError, UnsupportedError
from ..words import words_of
from .arrays import CHUNK, STRETCH, element, stretches
from .damage import damage_told
from .header import numeric
from .moments import MOMENT
from .parquet import arrow_values, parquet_file, parquet_table
from .stored import Chunked, LogFormat, Stored, register_log_format

Array = np.ndarray
_MAGIC, _DAMAGED = b"PAR1", "the file is damaged"
#: Mark of a stream that is cut off.
_CUT = b"cut off"
#: Words for a column that names joints.
_NAMES = {"name", "names", "joint", "joints"}


def _is_one(path: Path, start: bytes) -> bool:
    return start.startswith(_MAGIC) and any("list" in str(f.type) or "struct" in str(f.type) for f in parquet_file(path).schema_arrow)


def _read(path: Path) -> Stored:
    with damage_told(path, _DAMAGED):
        columns = columns_of_arrow(parquet_table(path), path, _described(path))
        moments = _moments(parquet_file(path).schema_arrow, columns)
    if not columns:
        raise DataError(f"log {path}: holds no column of numbers.")
    return Stored(columns, moments)


def _moments(schema: Any, columns: Mapping[str, Array]) -> dict[str, str]:
    """What stands for the unit of columns that are times by their type."""
    import pyarrow as pa

    return {f.name: MOMENT for f in schema if pa.types.is_timestamp(f.type) and f.name in columns}


def columns_of_arrow(table: Any, path: Path, told: Mapping[str, tuple[str, ...]]) -> dict[str, Array]:
    """Columns of numbers of an Arrow table; those of lists by element, named as they are `told` to be; structs by field."""
    import pyarrow as pa

    columns: dict[str, Array] = {}
    while any(pa.types.is_struct(f.type) for f in table.schema):
        table = table.flatten()
    named = _names_beside(table, path)
    for name in table.column_names:
        column = table.column(name)
        if _is_list(column.type) and pa.types.is_struct(column.type.value_type):
            columns |= _structs(name, column, path)
        elif _is_list(column.type):
            columns |= _elements(name, column, told.get(name, ()) or named.get(name.rpartition(".")[0], ()))
        else:
            with suppress(DataError, ValueError):
                columns[name] = numeric(arrow_values(column), path, name)
    return columns


def _is_list(kind: Any) -> bool:
    import pyarrow as pa

    return bool(pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind))


def _names_beside(table: Any, path: Path) -> dict[str, tuple[str, ...]]:
    """Names of joints that stand as a list in every row, by the path of their struct ("" for none). Raises DataError where rows name them
    in another order than the first."""
    import pyarrow as pa

    out = {}
    for name in table.column_names:
        column = table.column(name)
        if (
            _is_list(column.type)
            and pa.types.is_string(column.type.value_type)
            and words_of(name.rpartition(".")[2]) & _NAMES
            and len(column)
        ):
            first = column[0].as_py()
            flat = column.combine_chunks().flatten()
            if not first or len(flat) != len(first) * len(column) or flat.to_pylist() != first * len(column):
                raise DataError(
                    f"log {path}: column {name!r} names different joints in some rows, or in a different order: write the same"
                    f" joints in the same order in every row."
                )
            out[name.rpartition(".")[0]] = _names(first)
    return out


def _structs(name: str, column: Any, path: Path) -> dict[str, Array]:
    """Columns of lists of structs (`joints: [{name, position}]`): by their names where they tell them, alike in every row."""
    import pyarrow as pa

    flat, rows = column.combine_chunks().flatten(), len(column)
    width = len(flat) // rows if rows and len(flat) % rows == 0 else 0
    if not width:
        return {}
    fields = {flat.type.field(k).name: flat.field(k) for k in range(flat.type.num_fields)}
    told = tuple(fields["name"][:width].to_pylist()) if "name" in fields and pa.types.is_string(fields["name"].type) else ()
    if told and fields["name"].to_pylist() != list(told) * rows:
        raise DataError(
            f"log {path}: column {name!r} names its elements in a different order in some rows: write the same order in every row."
        )
    out: dict[str, Array] = {}
    for field, values in fields.items():
        with suppress(TypeError, ValueError):
            table = np.asarray(values, float).reshape(rows, width)
            out |= {f"{name}[{told[j] if told else j}].{field}": table[:, j] for j in range(width)}
    return out


def _chunks(path: Path) -> Chunked:
    file, told = parquet_file(path), _described(path)
    groups = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]

    def tables(first: int) -> Iterator[tuple[int, Any]]:
        at, group = 0, 0
        while group < len(groups) and at + groups[group] <= first:
            at, group = at + groups[group], group + 1
        for batch in file.iter_batches(CHUNK, row_groups=range(group, len(groups)), use_threads=False):
            yield at, batch
            at += batch.num_rows

    return _chunked(tables, path, told, sum(groups))


def _chunked(tables: Callable[[int], Iterator[tuple[int, Any]]], path: Path, told: Mapping[str, tuple[str, ...]], rows: int) -> Chunked:
    """From record batches: `tables` gives those that begin at a row or hold it, and the number of the first row of each."""
    import pyarrow as pa

    def columns(batch: Any, skip: int = 0, most: int | None = None) -> dict[str, Array]:
        return columns_of_arrow(pa.Table.from_batches([batch.slice(skip, most)]), path, told)

    def read(names: Sequence[str], first: int) -> Iterator[dict[str, Array]]:
        with damage_told(path, _DAMAGED):
            for at, batch in tables(first):
                skip = max(0, first - at)
                if skip < batch.num_rows:
                    found = columns(batch, skip)
                    if lacking := [name for name in names if name not in found]:
                        raise DataError(f"log {path}: column {lacking[0]!r} changes after row {at + skip}: its lists differ in length.")
                    yield {name: found[name] for name in names}

    def sample(names: Sequence[str]) -> dict[str, Array]:
        starts = stretches(rows)
        if len(starts) == 1:
            parts = [*read(names, 0)]
        else:
            with damage_told(path, _DAMAGED):
                first = ((start, next(tables(start))) for start in starts)
                parts = [columns(batch, start - at, STRETCH) for start, (at, batch) in first]
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

    with damage_told(path, _DAMAGED):
        names = next((tuple(columns(batch)) for _, batch in tables(0)), ())
    if not names:
        raise DataError(f"log {path}: holds no column of numbers.")
    return Chunked(names, read, sample, rows)


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


DATASET = register_log_format(LogFormat("Parquet with lists", _is_one, _read, chunks=_chunks))


def _is_arrow(path: Path, start: bytes) -> bool:
    return start.startswith((b"ARROW1", b"FEA1")) or (
        start.startswith(b"\xff\xff\xff\xff") and len(start) > 8 and start[8:12] in (b"\x10\x00\x00\x00", b"\x0c\x00\x00\x00")
    )


def _opened(path: Path) -> Any:
    """An Arrow file, mapped into memory; a stream as a table."""
    if find_spec("pyarrow") is None:
        raise ConfigurationError(f"log {path}: reading Arrow files needs pyarrow: pip install pyarrow. Or export the log as CSV.")
    import pyarrow as pa

    with damage_told(path, "is not an Arrow file"):
        with path.open("rb") as file:
            start = file.read(6)
        if start.startswith(b"FEA1"):  # of which Arrow believes every place in the file: damage ends the whole process
            raise DataError(f"log {path}: is in version 1 of Feather, which is not supported; save it as Feather 2 or Parquet.")
        source = pa.memory_map(str(path))
        return pa.ipc.open_file(source) if start == b"ARROW1" else _stream(pa.ipc.open_stream(source))


def _stream(reader: Any) -> Any:
    """The record batches of a stream that are whole, as a table; one that is cut off says so in the table's metadata."""
    import pyarrow as pa

    batches, cut = [], ""
    try:
        batches += iter(reader)
    except (pa.ArrowInvalid, OSError) as error:
        if not batches:
            raise
        cut = str(error)
    return pa.Table.from_batches(batches, reader.schema.with_metadata({_CUT: cut} if cut else None))


def _read_arrow(path: Path) -> Stored:
    found = _opened(path)
    with damage_told(path, _DAMAGED):
        table = found.read_all() if hasattr(found, "read_all") else found
        table.validate(full=True)  # places in a damaged file would be believed
        columns = columns_of_arrow(table, path, _described(path))
    if not columns:
        raise DataError(f"log {path}: holds no column of numbers.")
    cut = _CUT in (table.schema.metadata or {})
    return Stored(columns, _moments(table.schema, columns), (f"log {path}: is truncated; the complete part of it is read.",) if cut else ())


def _arrow_chunks(path: Path) -> Chunked:
    file = _opened(path)
    if not hasattr(file, "get_batch"):
        raise UnsupportedError(
            f"log {path}: this kind of Arrow file cannot be streamed: read it into memory (--no-stream), or save it as Feather 2."
        )
    with damage_told(path, _DAMAGED):
        batches = [file.get_batch(k) for k in range(file.num_record_batches)]
        for batch in batches:
            batch.validate(full=True)
    ends = np.cumsum([batch.num_rows for batch in batches])

    def tables(first: int) -> Iterator[tuple[int, Any]]:
        for k in range(int(np.searchsorted(ends, first, side="right")), len(batches)):
            yield int(ends[k]) - batches[k].num_rows, batches[k]

    return _chunked(tables, path, _described(path), int(ends[-1]) if len(ends) else 0)


ARROW = register_log_format(LogFormat("Arrow", _is_arrow, _read_arrow, chunks=_arrow_chunks))
