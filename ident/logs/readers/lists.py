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
from .arrays import CHUNK, STRETCH, element, stretches
from .damage import DAMAGED, reason
from .header import numeric
from .parquet import arrow_values, parquet_file, parquet_table
from .stored import Chunked, LogFormat, Stored, register_log_format

Array = np.ndarray
_MAGIC = b"PAR1"


def _is_one(path: Path, start: bytes) -> bool:
    return start.startswith(_MAGIC) and any("list" in str(f.type) or "struct" in str(f.type) for f in parquet_file(path).schema_arrow)


def _read(path: Path) -> Stored:
    columns = columns_of_arrow(parquet_table(path), path, _described(path))
    if not columns:
        raise DataError(f"log {path}: holds no column of numbers.")
    return Stored(columns)


def columns_of_arrow(table: Any, path: Path, told: Mapping[str, tuple[str, ...]]) -> dict[str, Array]:
    """Columns of numbers of an Arrow table; those of lists by element, named as they are `told` to be; structs by field."""
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
    return columns


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
        try:
            for at, batch in tables(first):
                skip = max(0, first - at)
                if skip < batch.num_rows:
                    found = columns(batch, skip)
                    if lacking := [name for name in names if name not in found]:
                        raise DataError(f"log {path}: column {lacking[0]!r} is another after row {at + skip}: its lists differ in length.")
                    yield {name: found[name] for name in names}
        except (pa.ArrowException, UnicodeDecodeError, *DAMAGED) as error:
            raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None

    def sample(names: Sequence[str]) -> dict[str, Array]:
        starts = stretches(rows)
        if len(starts) == 1:
            parts = [*read(names, 0)]
        else:
            first = ((start, next(tables(start))) for start in starts)
            parts = [columns(batch, start - at, STRETCH) for start, (at, batch) in first]
        return {name: np.concatenate([part[name] for part in parts]) for name in names}

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
        start.startswith(b"\xff\xff\xff\xff") and path.suffix.lower() in (".arrow", ".arrows")
    )


def _opened(path: Path) -> Any:
    """An Arrow file, mapped into memory; a stream, or a file of Feather's first version, as a table."""
    if find_spec("pyarrow") is None:
        raise ConfigurationError(f"log {path}: reading Arrow files needs pyarrow: pip install pyarrow. Or export the log as CSV.")
    import pyarrow as pa
    from pyarrow import feather

    try:
        with path.open("rb") as file:
            start = file.read(6)
        if start.startswith(b"FEA1"):
            return feather.read_table(path)
        source = pa.memory_map(str(path))
        return pa.ipc.open_file(source) if start == b"ARROW1" else pa.ipc.open_stream(source).read_all()
    except (pa.ArrowException, UnicodeDecodeError, *DAMAGED) as error:
        raise DataError(f"log {path}: is not an Arrow file ({reason(error)}).") from None


def _read_arrow(path: Path) -> Stored:
    import pyarrow as pa

    found = _opened(path)
    try:
        table = found.read_all() if hasattr(found, "read_all") else found
        columns = columns_of_arrow(table, path, _described(path))
    except (pa.ArrowException, UnicodeDecodeError, *DAMAGED) as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None
    if not columns:
        raise DataError(f"log {path}: holds no column of numbers.")
    return Stored(columns)


def _arrow_chunks(path: Path) -> Chunked:
    import pyarrow as pa

    file = _opened(path)
    if not hasattr(file, "get_batch"):
        raise UnsupportedError(f"log {path}: this kind of Arrow file is read whole (--no-stream); write it as an Arrow file (Feather 2).")
    try:
        batches = [file.get_batch(k) for k in range(file.num_record_batches)]
    except (pa.ArrowException, *DAMAGED) as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None
    ends = np.cumsum([batch.num_rows for batch in batches])

    def tables(first: int) -> Iterator[tuple[int, Any]]:
        for k in range(int(np.searchsorted(ends, first, side="right")), len(batches)):
            yield int(ends[k]) - batches[k].num_rows, batches[k]

    return _chunked(tables, path, _described(path), int(ends[-1]) if len(ends) else 0)


ARROW = register_log_format(LogFormat("Arrow", _is_arrow, _read_arrow, chunks=_arrow_chunks))
