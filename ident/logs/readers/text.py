"""Tables of text: columns as float arrays, and where one cannot be read, why."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...errors import DataError, IdentError
from .damage import DAMAGED, damage_told, reason
from .header import MISSING, Header, is_number
from .moments import is_moment
from .packed import open_binary, open_whole
from .parquet import arrow_values
from .strangers import is_stranger, without_strangers

Array = np.ndarray
#: Characters of a field that messages show.
_SHOWN = 40
#: Bytes at the beginning in which the kind of line ends is looked for.
_HEAD = 1 << 16
#: What stands for a missing number, beside what pandas knows.
_NONE = [text for lower in MISSING if lower for text in {lower, lower.upper(), lower.replace("nan", "NaN").replace("ind", "IND")}]
#: What pandas says of quotes that are open at the end of the text.
_NEVER_CLOSED = "EOF inside string"


def read_text_columns(path: Path, header: Header, names: Sequence[str]) -> dict[str, Array]:
    """The named columns of a text file as they stand, as arrays of str (for columns that hold names or lists). Raises DataError."""
    import pandas as pd

    # All columns, not only those wanted: otherwise rows with too many fields, or too few, would be read as others.
    with damage_told(path, "cannot be read as a table"), body_of(path, header) as stream:
        frame = pd.read_csv(
            stream,
            sep=header.delimiter,
            names=list(header.names),
            dtype=str,
            keep_default_na=False,
            encoding=header.encoding,
            encoding_errors="replace",
        )
    if not isinstance(frame.index, pd.RangeIndex):
        raise DataError(f"log {path}: rows have more fields than the header.")
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
    try:
        return _text_columns(path, header, names)
    except DataError:
        if said is None:
            raise
        with body_of(path, header) as stream:
            rows, left = without_strangers(stream, header)
        if not left:
            raise
        try:
            columns = pandas_columns(io.BytesIO(rows), header, names, 0)
        except (ValueError, OverflowError):
            columns = None
        if columns is None:
            raise
        said += [note for note in left.notes(f"log {path}") if note not in said]
        return columns


def _text_columns(path: Path, header: Header, names: Sequence[str]) -> dict[str, Array]:
    if find_spec("pyarrow") is not None and header.delimiter != " ":
        found = _arrow_columns(path, header, names)
        if found is not None:
            return found
    try:
        with open_whole(path) as stream:
            if quotes_stay_open(stream) and over_lines(rows_of_text(path, header), header, names):
                raise bad_text(path, header, names, "quotes are open at the end of a line")
        with body_of(path, header) as stream:
            return pandas_columns(stream, header, names, 0)
    except IdentError:
        raise
    except (ValueError, OverflowError) as error:
        raise bad_text(path, header, names, str(error)) from None
    except DAMAGED as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None


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


def unpaired_quotes(text: Any) -> bool:
    """Whether a text, as any buffer of bytes, holds an odd number of quotes."""
    whole = memoryview(text)
    return sum(bytes(whole[i : i + _HEAD]).count(b'"') for i in range(0, len(whole), _HEAD)) % 2 == 1


def quotes_stay_open(stream: IO[bytes]) -> bool:
    """Whether a line opens quotes that it does not close. (Lines are counted only where there are quotes at all.)"""
    while chunk := stream.read(1 << 20):
        if b'"' in chunk:
            stream.seek(0)
            return any(line.count(b'"') % 2 for line in stream)
    return False


def over_lines(rows: Iterable[tuple[int, list[str]]], header: Header, names: Sequence[str]) -> bool:
    """Whether in rows (line, fields) a number of these columns, within quotes, goes on over the end of its line: some readers, and some
    versions of them, take it, others do not."""
    index = [header.names.index(n) for n in names]
    return any(i < len(fields) and _goes_on(fields[i]) for _, fields in rows for i in index)


def _goes_on(field: str) -> bool:
    return "\n" in field and is_number(field)


def rows_of_text(path: Path, header: Header) -> Iterator[tuple[int, list[str]]]:
    """Line number (from 1) and fields of every row of data."""
    try:
        with open_binary(path) as stream, io.TextIOWrapper(stream, encoding=header.encoding, errors="replace", newline="") as text:
            yield from ((line, fields) for line, fields in numbered_rows(path, text, header) if line > header.line)
    except DAMAGED as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None


def numbered_rows(path: Path, text: Iterable[str], header: Header, before: int = 0) -> Iterator[tuple[int, list[str]]]:
    """Rows of a text of a file that are not blank, each with the number of the line on which it begins, after `before` lines."""
    if header.delimiter == " ":
        yield from ((i, row.split()) for i, row in enumerate(text, before + 1) if row.strip())
        return
    reader = csv.reader(text, delimiter=header.delimiter)
    line = before + 1
    while True:
        try:
            fields = next(reader)
        except StopIteration:
            return
        except csv.Error as error:
            raise DataError(f"log {path}: line {line} cannot be read ({error}).") from None
        if any(f.strip() for f in fields):
            yield line, fields
        line = before + reader.line_num + 1


def bad_text(
    path: Path, header: Header, names: Sequence[str], reason: str, rows: Iterable[tuple[int, list[str]]] | None = None, first: int = 1
) -> DataError:
    """Find the first row that cannot be read and say what is wrong with it. `rows`: those to look at, beginning with data row
    `first`; by default all."""
    index, last = [(header.names.index(n), n) for n in names], (first, 0)
    own = ((line, fields) for line, fields in (rows_of_text(path, header) if rows is None else rows) if not is_stranger(fields, header))
    for row, (line, fields) in enumerate(own, first):
        if len(fields) > len(header.names):
            return DataError(
                f"log {path}: line {line} (data row {row}) has {len(fields)} fields, but the header has {len(header.names)}; mend that"
                " line, or take it out: what is missing is bridged or left out."
            )
        for i, name in index:
            text = fields[i].strip() if i < len(fields) else ""
            if i < len(fields) and _goes_on(fields[i]):
                return DataError(
                    f"log {path}: column {name!r}, line {line} (data row {row}): {fields[i]!r} goes on over the end of its line."
                    " Close the quotes on the line, or leave them out."
                )
            if text.lower() not in MISSING and not is_number(text):
                # A quote that is not closed takes in the rest of the file.
                shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
                remedy = "Correct or remove the row; write a missing value as an empty field."
                if header.decimal == "," and is_number(text.replace(",", ".", 1)):
                    continue
                if is_number(text.replace(",", ".", 1)):
                    remedy = "It has a decimal comma: write the file with decimal points."
                elif is_moment(text):
                    remedy = "It is a date with a time: write times as seconds (since any moment), in every row."
                return DataError(f"log {path}: column {name!r}, line {line} (data row {row}): {shown!r} is not a number. {remedy}")
        last = row, line
    if _NEVER_CLOSED in reason:
        return DataError(
            f"log {path}: line {last[1]} (data row {last[0]}) opens quotes that are never closed, which hide all behind it. Close them,"
            " or leave them out."
        )
    return DataError(f"log {path}: cannot be read as a table of numbers: {reason}.")
