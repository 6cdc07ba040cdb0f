"""Reading tables from files: CSV (plain or compressed), Parquet, MAT. Names in, float columns out; nothing about robots."""

from __future__ import annotations

import bz2
import codecs
import csv
import gzip
import io
import lzma
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import lru_cache
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from ...errors import ConfigurationError, DataError, IdentError
from .arrays import list_columns, npz_columns
from .bag import bag_columns, is_bag
from .damage import DAMAGED, reason
from .mat import mat_columns

Array = np.ndarray
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "+nan", "#n/a", "<na>"}
#: A first line by which spreadsheets are told what separates fields; what else may, and of how many columns at least.
_SEPARATOR = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_OTHER = re.compile(r"\s*\|\s*|\s+")
_COLUMNS = 2
#: Characters of a field that messages show.
_SHOWN = 40
#: What stands between the name of a column that occurs again and its number; longest line (characters) of a table.
AGAIN = "\x00again "
#: Bytes at the beginning in which the kind of line ends is looked for.
_HEAD = 1 << 16
#: Bytes that a packed file may always unpack to, how many times its own size beyond that, and bytes that are unpacked at a time.
_UNPACKED, _RATIO, _BLOCK = 1 << 28, 200, 1 << 20
LONGEST_LINE = 4_000_000
#: Longest word that a row of units holds.
_UNIT = 8
_OPENERS: tuple[tuple[bytes, Callable[..., Any]], ...] = ((b"\x1f\x8b", gzip.open), (b"BZh", bz2.open), (b"\xfd7zXZ", lzma.open))


@dataclass(frozen=True)
class Header:
    """Column names of a table; for text, on which line they end (from 1), what separates fields (" ": runs of spaces) and the digits of a
    number, the units that a row below the names tells, and the encoding."""

    names: tuple[str, ...]
    line: int = 0
    delimiter: str = ","
    decimal: str = "."
    units: tuple[str, ...] = ()
    encoding: str = "utf-8-sig"


def check_file(path: Path) -> None:
    """Raises DataError if `path` is no readable, non-empty file."""
    if not path.exists():
        raise DataError(f"log {path}: no such file.")
    if path.is_dir():
        raise DataError(f"log {path}: is a folder; give its files, for example {path}/*.csv.")
    try:
        if path.stat().st_size == 0:
            raise DataError(f"log {path}: the file is empty.")
        with path.open("rb"):
            pass
    except OSError as error:
        raise DataError(f"log {path}: cannot be read ({error.strerror}).") from None


def read_header(path: Path) -> Header:
    """Column names of a file. Raises DataError."""
    if not (path.is_dir() and is_bag(path)):
        check_file(path)
    kind = path.suffix.lower()
    if kind in (".parquet", ".pq") and _stored_columns(path) is None:
        return Header(tuple(name for name, _ in stored_names(parquet_file(path))))
    if kind == ".mat":
        return Header(tuple(mat_columns(path)))
    if (stored := _stored_columns(path)) is not None:
        return Header(tuple(stored))
    return _text_header(path)


@lru_cache(maxsize=2)
def _read_stored(path: Path, stamp: int) -> dict[str, Array]:
    if is_bag(path):
        return bag_columns(path)
    if path.suffix.lower() == ".npz":
        return npz_columns(path)
    table = parquet_table(path)
    columns: dict[str, Array] = {}
    for name in table.column_names:
        column = table.column(name)
        if "list" in str(column.type):
            columns |= list_columns(name, column) or {}
        else:
            with suppress(DataError, ValueError):
                columns[name] = numeric(arrow_values(column), path, name)
    return columns


def _stored_columns(path: Path) -> dict[str, Array] | None:
    """All columns of a file that is read as a whole: a bag, arrays, Parquet with lists; None for others."""
    lists = path.suffix.lower() in (".parquet", ".pq") and any("list" in str(f.type) for f in parquet_file(path).schema_arrow)
    if not (is_bag(path) or path.suffix.lower() == ".npz" or lists):
        return None
    return _read_stored(path, path.stat().st_mtime_ns)


def read_columns(path: Path, header: Header, names: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Array]:
    """The named columns as float arrays (missing entries are NaN), and those of `optional` that are numbers.

    Raises DataError naming file, column and row."""
    kind = path.suffix.lower()
    if (whole := _stored_columns(path)) is not None:
        return {name: seconds(numeric(whole[name], path, name)) if name in optional else whole[name] for name in (*names, *optional)}
    if kind in (".parquet", ".pq", ".mat"):
        if kind == ".mat":
            columns = mat_columns(path)
        else:
            stored = {name: own for name, own in stored_names(parquet_file(path)) if name in (*names, *optional)}
            table = parquet_table(path, list(stored.values()))
            columns = {name: arrow_values(table.column(own)) for name, own in stored.items()}
        out = {name: numeric(columns[name], path, name) for name in names}
        for name in optional:
            with suppress(DataError):
                out[name] = seconds(numeric(columns[name], path, name))
        return out
    first = [fields for _, fields in islice(rows_of_text(path, header), 5)]
    place = {name: header.names.index(name) for name in optional}
    numbers = [n for n, i in place.items() if all(i < len(f) and _number_or_none(f[i], header) for f in first)]
    if not numbers:
        return _text_columns(path, header, names)
    try:
        return _text_columns(path, header, [*names, *numbers])
    except DataError:
        return _text_columns(path, header, names)


def _number_or_none(text: str, header: Header) -> bool:
    return text.strip().lower() in _MISSING or _is_number(text.replace(header.decimal, "."))


def read_text_columns(path: Path, header: Header, names: Sequence[str]) -> dict[str, Array]:
    """The named columns of a text file as they stand, as arrays of str (for columns that hold names or lists)."""
    import pandas as pd

    with _body(path, header) as stream:
        frame = pd.read_csv(
            stream,
            sep=header.delimiter,
            names=list(header.names),
            usecols=list(names),
            dtype=str,
            keep_default_na=False,
            encoding=header.encoding,
            encoding_errors="replace",
        )
    return {name: frame[name].to_numpy(dtype=object) for name in names}


def open_binary(path: Path) -> IO[bytes]:
    """The bytes of a file, decompressed if it begins like a gzip, bzip2 or xz file."""
    with path.open("rb") as raw:
        start = raw.read(6)
    for magic, opener in _OPENERS:
        if start.startswith(magic):
            return opener(path, "rb")  # type: ignore[no-any-return]
    return path.open("rb")


class _Unpacked(io.RawIOBase):
    """What a packed file unpacks to, up to a size that a table of numbers may have."""

    def __init__(self, inner: IO[bytes], path: Path) -> None:
        self._inner, self._path, self._at = inner, path, 0
        self._most = max(_UNPACKED, _RATIO * path.stat().st_size)

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        self._at = self._inner.seek(offset, whence)
        return self._at

    def readinto(self, buffer: Any) -> int:
        count: int = self._inner.readinto(buffer)  # type: ignore[attr-defined]
        self._at += count
        if self._at > self._most:
            raise DataError(
                f"log {self._path}: unpacks to more than {_RATIO} times its size ({self._at / 1e6:.0f} MB so far): a damaged file, or one"
                " made to fill the memory. If it is meant, unpack it, or read it piece by piece (--stream)."
            )
        return count

    def close(self) -> None:
        self._inner.close()
        super().close()


def _open_whole(path: Path) -> IO[bytes]:
    """`open_binary` for those who keep all of it in memory."""
    stream = open_binary(path)
    return stream if isinstance(stream, io.BufferedReader) else io.BufferedReader(_Unpacked(stream, path), _BLOCK)


def _body(path: Path, header: Header) -> IO[bytes]:
    """The bytes behind the header. Its lines are counted here, since libraries count blank and quoted ones each in their own way."""
    stream = _open_whole(path)
    start = stream.read(_HEAD)
    stream.seek(0)
    if b"\r" in start.replace(b"\r\n", b"").removesuffix(b"\r"):  # lines that end with a carriage return alone
        with stream:
            stream = io.BytesIO(stream.read().replace(b"\r\n", b"\n").replace(b"\r", b"\n"))
    for _ in range(header.line):
        stream.readline()
    return stream


def _text_header(path: Path) -> Header:
    try:
        return _header_of(path, "utf-8-sig")
    except UnicodeDecodeError as error:
        wide = error.object[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
        remedy = " It begins as UTF-16 does: save it as UTF-8." if wide else ""
        if not wide and b"\x00" not in error.object[:4096]:
            with suppress(UnicodeDecodeError):
                return _header_of(path, "cp1252")
        raise DataError(f"log {path}: is not a text table ({error}).{remedy}") from None


def _header_of(path: Path, encoding: str) -> Header:
    try:
        with open_binary(path) as stream, io.TextIOWrapper(stream, encoding=encoding, newline="") as text:
            number, told, said = 0, "", (0, "")
            lines = bounded_lines(text, path)
            for line in lines:
                number += 1
                if line.startswith("#"):
                    said = number, line.lstrip("#").strip()
                if found := _SEPARATOR.fullmatch(line.strip(" \r\n")):
                    told = found[1]
                elif line.strip() and not line.startswith("#"):
                    break
            else:
                raise DataError(f"log {path}: the file holds no header row.")
            rows = [row for row in islice(lines, 4) if row.strip()]
            more = bool(rows)
    except DAMAGED as error:
        raise DataError(f"log {path}: is not a text table ({reason(error)}).") from None
    delimiter = told or next((d for d in (",", ";", "\t") if d in line), ",")
    if delimiter not in line and len(_OTHER.split(line.strip())) > _COLUMNS:
        if "|" in line or not rows or len(rows[0].split()) != len(line.split()):
            mark = "'|'" if "|" in line else "spaces"
            raise DataError(f"log {path}: its columns are separated by {mark} (line {number}); write it with commas, semicolons or tabs.")
        delimiter = " "
    if "\x00" in line:
        raise DataError(f"log {path}: line {number} holds NUL characters: it is no text, or UTF-16 without its mark. Save it as UTF-8.")
    if line.count('"') % 2:
        raise DataError(f"log {path}: line {number}: a column name opens quotes that it does not close. Close them, or leave them out.")
    names = _fields(line, delimiter, path)
    if all(_is_number(n) for n in names):
        # What numpy.savetxt writes: the header behind a sign of comment, right before the numbers.
        behind = _fields(said[1], delimiter, path) if said[0] == number - 1 else ()
        if len(behind) == len(names) and not any(_is_number(n) for n in behind):
            return Header(once(behind), said[0], delimiter)
        raise DataError(
            f"log {path}: line {number} should be a header row with column names, but it holds numbers ({', '.join(names[:4])} …)."
        )
    if not more:
        raise DataError(f"log {path}: there is a header, but no row of data.")
    decimal, units = ".", tuple[str, ...]()
    first = _fields(rows[0], delimiter, path) if rows else ()
    if len(rows) > 1 and len(first) == len(names) and not any(_is_number(x.replace(",", ".")) for x in first) and _is_units(first):
        units, number, first = first, number + 1, _fields(rows[1], delimiter, path)
    numbers = [x for x in first if x]
    if delimiter in ";\t" and any("," in x for x in numbers) and not any("." in x for x in numbers):
        decimal = "," if all(_is_number(x.replace(",", ".", 1)) for x in numbers if "," in x) else "."
    return Header(once(names), number, delimiter, decimal, units, encoding)


def _is_units(fields: Sequence[str]) -> bool:
    """Whether a row below the names tells units: short words without digits, one for each column at the most."""
    return all(len(x) <= _UNIT and not any(c.isdigit() for c in x) for x in fields) and any(fields)


def _fields(line: str, delimiter: str, path: Path) -> tuple[str, ...]:
    """The stripped fields of a header line."""
    if delimiter == " ":
        return tuple(line.split())
    try:
        return tuple(n.strip() for n in next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter), []))
    except csv.Error as error:
        raise DataError(f"log {path}: is not a text table ({error}).") from None


def once(names: Sequence[str]) -> tuple[str, ...]:
    """Column names, each once: what stands again is numbered, so that what is not used stops nothing."""
    seen: dict[str, int] = {}
    out = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        out.append(name if seen[name] == 1 else f"{name}{AGAIN}{seen[name]}")
    return tuple(out)


def bounded_lines(text: Iterable[str], path: Path) -> Iterator[str]:
    """The lines of a text. Raises DataError for one that is longer than any row of a log."""
    read = getattr(text, "readline", None)
    if read is None:
        yield from text
        return
    while line := read(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise DataError(f"log {path}: has a line of more than {LONGEST_LINE} characters: it is no table of rows.")
        yield line


def _is_number(text: str) -> bool:
    """Whether the readers take a text for a number: `1_0` and digits of other scripts are numbers to Python alone."""
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text and text.isascii()


def _text_columns(path: Path, header: Header, names: Sequence[str]) -> dict[str, Array]:
    if find_spec("pyarrow") is not None and header.delimiter != " ":
        found = _arrow_columns(path, header, names)
        if found is not None:
            return found
    try:
        with _open_whole(path) as stream:
            if quotes_stay_open(stream) and over_lines(rows_of_text(path, header), header, names):
                raise bad_text(path, header, names, "quotes are open at the end of a line")
        with _body(path, header) as stream:
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
        with _body(path, header) as stream:
            counted = _CountedQuotes(stream)
            found = arrow_columns(pa.PythonFile(counted, mode="r"), header, names, 0)
            # Quotes that are never closed hide all rows behind them, which Arrow does not mind.
            return None if counted.quotes % 2 else found
    except IdentError:
        raise
    except (pa.ArrowException, ValueError, *DAMAGED):
        return None


#: What pandas says of quotes that are open at the end of the text.
_NEVER_CLOSED = "EOF inside string"


class _CountedQuotes(io.RawIOBase):
    """A stream of bytes that counts the quotes read from it."""

    def __init__(self, stream: IO[bytes]) -> None:
        super().__init__()
        self._stream, self.quotes = stream, 0

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1, /) -> bytes:
        data = self._stream.read(size)
        self.quotes += data.count(b'"')
        return data


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


def arrow_values(column: Any) -> Array:
    """The values of an Arrow column; missing numbers are NaN.

    Floats are taken from its buffers: to ask Arrow for an array would load pandas (40 MB, half a second)."""
    import pyarrow as pa

    if column.type != pa.float64():
        return np.asarray(column)
    parts = [part.fill_null(np.nan) if part.null_count else part for part in column.chunks]
    arrays = [np.frombuffer(p.buffers()[1], np.float64, len(p), 8 * p.offset) for p in parts if len(p)]
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays) if arrays else np.zeros(0)


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
    return "\n" in field and _is_number(field)


def rows_of_text(path: Path, header: Header) -> Iterator[tuple[int, list[str]]]:
    """Line number (from 1) and fields of every row of data."""
    try:
        with open_binary(path) as stream, io.TextIOWrapper(stream, encoding=header.encoding, errors="replace", newline="") as text:
            yield from ((line, fields) for line, fields in numbered_rows(text, header) if line > header.line)
    except DAMAGED as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None


def numbered_rows(text: Iterable[str], header: Header, before: int = 0) -> Iterator[tuple[int, list[str]]]:
    """Rows of a text that are not blank, each with the number of the line on which it begins, after `before` lines."""
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
            raise DataError(f"log: line {line} cannot be read ({error}).") from None
        if any(f.strip() for f in fields):
            yield line, fields
        line = before + reader.line_num + 1


def bad_text(
    path: Path, header: Header, names: Sequence[str], reason: str, rows: Iterable[tuple[int, list[str]]] | None = None, first: int = 1
) -> DataError:
    """Find the first row that cannot be read and say what is wrong with it. `rows`: those to look at, beginning with data row
    `first`; by default all."""
    index, last = [(header.names.index(n), n) for n in names], (first, 0)
    for row, (line, fields) in enumerate(rows_of_text(path, header) if rows is None else rows, first):
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
            if text.lower() not in _MISSING and not _is_number(text):
                # A quote that is not closed takes in the rest of the file.
                shown = text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
                remedy = "Correct or remove the row; write a missing value as an empty field."
                if header.decimal == "," and _is_number(text.replace(",", ".", 1)):
                    continue
                if _is_number(text.replace(",", ".", 1)):
                    remedy = "It has a decimal comma: write the file with decimal points."
                elif _is_moment(text):
                    remedy = "It is a date with a time: write times as seconds (since any moment), in every row."
                return DataError(f"log {path}: column {name!r}, line {line} (data row {row}): {shown!r} is not a number. {remedy}")
        last = row, line
    if _NEVER_CLOSED in reason:
        return DataError(
            f"log {path}: line {last[1]} (data row {last[0]}) opens quotes that are never closed, which hide all behind it. Close them,"
            " or leave them out."
        )
    return DataError(f"log {path}: cannot be read as a table of numbers: {reason}.")


def _is_moment(text: str) -> bool:
    """Whether a text is a date with a time, as ISO 8601 writes them."""
    try:
        datetime.fromisoformat(text)
    except ValueError:
        return False
    return ":" in text


def numeric(values: Array, path: Path, name: str, first: int = 1) -> Array:
    """A column as float64, but for time stamps and durations, which know their own unit. `first`: data row (from 1) of its first value, for
    messages. Raises DataError."""
    if values.dtype.kind in "fiub":
        return values.astype(float)
    if values.dtype.kind in "mM":
        return values
    for row, value in enumerate(values.tolist(), first):
        if value is not None and not isinstance(value, (int, float)) and not (isinstance(value, str) and _is_number(value)):
            raise DataError(f"log {path}: column {name!r}, data row {row}: {value!r} is not a number.")
    return np.array([np.nan if v is None else float(v) for v in values.tolist()])


def seconds(values: Array) -> Array:
    """Time stamps (since 1970) and durations in seconds, NaN where there is none; numbers as they are."""
    kind = values.dtype.kind
    if kind not in "mM":
        return values
    # All dtypes of numpy's time count from the same moment; in seconds and what is beyond them no digit is lost that a float could hold.
    whole = values.astype(f"{kind}8[s]")
    rest = (values - whole).astype("m8[ns]").astype(np.int64)
    return np.where(np.isnat(values), np.nan, whole.astype(np.int64) + 1e-9 * rest)


def parquet_file(path: Path) -> Any:
    """A Parquet file, opened. Raises DataError, and ConfigurationError without pyarrow."""
    if find_spec("pyarrow") is None:
        raise ConfigurationError(f"log {path}: reading Parquet needs pyarrow: pip install pyarrow. Or export the log as CSV.")
    import pyarrow as pa
    from pyarrow import parquet

    try:
        return parquet.ParquetFile(path)
    except (pa.ArrowException, UnicodeDecodeError, *DAMAGED) as error:
        raise DataError(f"log {path}: is not a Parquet file ({reason(error)}).") from None


def parquet_table(path: Path, columns: list[str] | None = None) -> Any:
    """Columns of a Parquet file. Raises DataError where what the file holds is damaged."""
    import pyarrow as pa

    try:
        return parquet_file(path).read(columns=columns)
    except (pa.ArrowException, UnicodeDecodeError, *DAMAGED) as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None


def stored_names(file: Any) -> tuple[tuple[str, str], ...]:
    """What the columns of a Parquet file are called here, without blanks around it as in a text, and what they are called there."""
    try:
        stored = file.schema.names
    except UnicodeDecodeError:
        raise DataError("the names of the columns of a Parquet file are no text: the file is damaged.") from None
    bare = [name.strip() for name in stored]
    return tuple((name if bare.count(name) == 1 else own, own) for name, own in zip(bare, stored, strict=True))
