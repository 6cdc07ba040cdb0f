"""Tables of text: columns as float arrays, and where one cannot be read, why."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...errors import IdentError
from .damage import DAMAGED, damage_told, reason
from .header import MISSING, Header, UnreadableRows
from .packed import open_whole
from .parquet import arrow_values
from .strangers import MARKS, Strangers, without_strangers
from .text_rows import (
    RowFault,
    columns_by_rows,
    decoded,
    numbered_rows,
    over_lines,
    quotes_stay_open,
    rows_of_text,
    unpaired_quotes,
)

Array = np.ndarray
#: Bytes at the beginning in which the kind of line ends is looked for.
_HEAD = 1 << 16
#: What stands for a missing number, beside what pandas knows.
_NONE = [text for lower in MISSING if lower for text in {lower, lower.upper(), lower.replace("nan", "NaN").replace("ind", "IND")}]


def read_text_columns(path: Path, header: Header, names: Sequence[str], rows: int | None = None) -> dict[str, Array]:
    """The named columns of a text file as they stand, as arrays of str (for columns that hold names or lists). Raises DataError.

    `rows`: how many the numbers of the file have; where lines that are no rows were left out there, they are here. Without it they are
    where these columns show them."""
    columns = _texts(path, header, names, lambda stream: stream)
    stranger = _seen_strangers(columns) if rows is None else any(len(x) != rows for x in columns.values())
    if stranger:
        columns = _texts(path, header, names, lambda stream: io.BytesIO(without_strangers(stream, header)[0]))
        if rows is not None and (count := len(next(iter(columns.values())))) != rows:
            raise UnreadableRows(
                f"log {path}: {rows} rows hold numbers, but {count} texts; a row is damaged, or ends in the middle. Remove it."
            )
    return columns


def _seen_strangers(columns: dict[str, Array]) -> bool:
    """Whether columns of text hold their own names again, or a comment."""
    return any(bool((x == name).any()) or any(str(text).startswith(MARKS) for text in x.tolist()) for name, x in columns.items())


def _texts(path: Path, header: Header, names: Sequence[str], of: Callable[[IO[bytes]], IO[bytes]]) -> dict[str, Array]:
    """Columns of what `of` makes of the bytes behind the header, as text."""
    import pandas as pd

    # All columns, not only those wanted: otherwise rows with too many fields, or too few, would be read as others.
    with damage_told(path, "cannot be read as a table"), body_of(path, header) as stream:
        frame = pd.read_csv(
            of(stream),
            sep=header.delimiter if header.delimiter != " " else r"\s+",
            names=list(header.names),
            dtype=str,
            keep_default_na=False,
            encoding=header.encoding,
            encoding_errors="replace",
        )
    if not isinstance(frame.index, pd.RangeIndex):
        raise UnreadableRows(f"log {path}: rows have more fields than the header.")
    return {name: frame[name].to_numpy(dtype=object) for name in names}


def body_of(path: Path, header: Header) -> IO[bytes]:
    """The bytes behind the header. Its lines are counted here, since libraries count blank and quoted ones each in their own way."""
    stream = open_whole(path)
    start = stream.read(_HEAD)
    stream.seek(0)
    if b"\r" in start.replace(b"\r\n", b"").removesuffix(b"\r"):  # lines that end with a carriage return alone
        with stream:
            stream = io.BytesIO(stream.read().replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
    for _ in range(header.line):
        stream.readline()
    return stream


def text_columns(path: Path, header: Header, names: Sequence[str], said: list[str] | None = None) -> dict[str, Array]:
    """The named columns as float arrays. Raises DataError naming line and column. What is left out between the rows is added to `said`
    (without which nothing is)."""
    fast = _fast_columns(path, header, names)
    if fast is not None:
        return fast
    with damage_told(path, "the file is damaged"), body_of(path, header) as stream:
        text, left = without_strangers(stream, header) if said is not None else (stream.read(), Strangers())
    columns = lenient_columns(path, header, names, text) if left else None
    if columns is None:
        columns = columns_by_rows(path, header, names, text, header.line)
    if said is not None:
        said += [note for note in left.notes(f"log {path}") if note not in said]
    return columns


def _fast_columns(path: Path, header: Header, names: Sequence[str]) -> dict[str, Array] | None:
    """By the readers of other libraries; None where they do not take the text."""
    if find_spec("pyarrow") is not None and header.delimiter != " ":
        found = _arrow_columns(path, header, names)
        if found is not None:
            return found
    try:
        with open_whole(path) as stream:
            if quotes_stay_open(stream) and over_lines(rows_of_text(path, header), header, names):
                return None
        with body_of(path, header) as stream:
            return pandas_columns(stream, header, names, 0)
    except (ValueError, OverflowError, RowFault):
        return None
    except DAMAGED as error:
        raise UnreadableRows(f"log {path}: the file is damaged ({reason(error)}).") from None


def lenient_columns(path: Path, header: Header, names: Sequence[str], text: bytes) -> dict[str, Array] | None:
    """The named columns of a text behind its header by pandas; None where it does not take it."""
    try:
        if quotes_stay_open(io.BytesIO(text)) and over_lines(numbered_rows(path, decoded(text, header), header), header, names):
            return None
        return pandas_columns(io.BytesIO(text), header, names, 0)
    except (ValueError, OverflowError, RowFault):
        return None


def pandas_columns(stream: IO[bytes], header: Header, names: Sequence[str], skip: int) -> dict[str, Array]:
    """Columns of a text that follow `skip` lines, leniently: rows may be short. Raises ValueError where one cannot be read."""
    import pandas as pd

    # Before version 3, pandas rounds the last digit unless told not to.
    exact: dict[str, Any] = {"float_precision": "round_trip"} if int(pd.__version__.split(".")[0]) < 3 else {}
    # All columns, not only those wanted: otherwise rows with too many fields would pass unseen.
    frame = pd.read_csv(
        stream,
        sep=header.delimiter if header.delimiter != " " else r"\s+",
        skiprows=skip,
        names=list(header.names),
        dtype=dict.fromkeys(names, float),
        skipinitialspace=True,
        low_memory=False,
        decimal=header.decimal,
        na_values=_NONE,
        encoding=header.encoding,
        encoding_errors="replace",  # of columns that are not read; a number with a foreign letter is none
        **exact,
    )
    if not isinstance(frame.index, pd.RangeIndex):
        raise ValueError("rows have more fields than the header")
    return {name: frame[name].to_numpy() for name in names}


def _arrow_columns(path: Path, header: Header, names: Sequence[str]) -> dict[str, Array] | None:
    """The fast way; None where it refuses, so that the slower reader can say why or be more lenient."""
    import pyarrow as pa

    try:
        with body_of(path, header) as stream:
            # From memory: a thread of Arrow that reads ahead from a file of Python's may outlive the interpreter, which ends it badly.
            if isinstance(stream, io.BufferedReader) and isinstance(stream.raw, io.FileIO):
                content = pa.memory_map(str(path)).read_buffer().slice(stream.tell())
            else:
                content = pa.py_buffer(stream.read())
            # Quotes that are never closed hide all rows behind them, which Arrow does not mind.
            return None if unpaired_quotes(content) else arrow_columns(pa.BufferReader(content), header, names, 0)
    except IdentError:
        raise
    except (pa.ArrowException, ValueError, *DAMAGED):
        return None


def arrow_columns(
    source: Any, header: Header, names: Sequence[str], skip: int, *, block: int = 1 << 22, threads: bool = True, pool: Any = None
) -> dict[str, Array]:
    """Columns of a text that follow `skip` lines, by Arrow's reader from a file of its own. Raises ArrowException where it refuses."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    table = arrow.read_csv(
        source,
        read_options=arrow.ReadOptions(column_names=list(header.names), skip_rows=skip, block_size=block, use_threads=threads),
        parse_options=arrow.ParseOptions(delimiter=header.delimiter),
        convert_options=arrow.ConvertOptions(
            include_columns=list(names), column_types=dict.fromkeys(names, pa.float64()), decimal_point=header.decimal
        ),
        memory_pool=pool,
    )
    return {name: arrow_values(table.column(name)) for name in names}
