"""Tables of text row by row: what a field is, and which fault a text has. Faster readers take what is plain; this decides on the rest, for
whole files and for pieces of them alike."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..._utils.text import counted
from .damage import DAMAGED, reason
from .header import MISSING, Header, UnreadableRows, is_number
from .moments import is_moment
from .packed import open_binary

Array = np.ndarray
Buffer = bytes | memoryview
#: Characters of a field that messages show, and bytes that are looked at at a time.
_SHOWN, _BLOCK = 40, 1 << 16
#: A number with its unit.
_WITH_UNIT = re.compile(r"[+-]?\d+([.,]\d*)?([eE][+-]?\d+)?\s*[A-Za-z°µμ%][\w°µμ%/·*.²^-]{0,8}")
#: What begins as a number does.
_BEGUN = re.compile(r"[+\u2212-]?[.,]?\d")
#: The minus sign of typesetting, as some programs write it.
_TYPED_MINUS = "\u2212"
#: A number with marks between its thousands: `1.000,50`, `1'000.5`, `1 000,5`.
_THOUSANDS = re.compile(r"[+-]?\d{1,3}(?:(?P<mark>[.,'’ \u00a0\u202f])\d{3})(?:(?P=mark)\d{3})*(?:[.,]\d+)?")


class RowFault(UnreadableRows):
    """A row that cannot even be taken apart into fields, or holds no number: whatever is read of the file, it is at fault."""


def columns_by_rows(path: Path, header: Header, names: Sequence[str], text: Buffer, before: int, first: int = 1) -> dict[str, Array]:
    """The named columns of a text of a file, of which `before` lines and `first` - 1 data rows stand before it; short rows lack values.

    Raises DataError for the first row that cannot be read, and says why."""
    index = [(header.names.index(name), name) for name in names]
    rows, values = list[tuple[int, list[str]]](), list[list[float]]()
    for row, (line, fields) in enumerate(numbered_rows(path, decoded(text, header), header, before), first):
        at = f"line {line} (data row {row})"
        if len(fields) > len(header.names):
            raise UnreadableRows(
                f"log {path}: {at} has {counted(len(fields), 'field')}, but the header has {len(header.names)}; correct that line,"
                f" or remove it: missing samples are bridged or left out."
            )
        own = [(fields[i], name) for i, name in index if i < len(fields)]
        try:
            read = [_value(field, header, f"log {path}: column {name!r}, {at}") for field, name in own]
        except UnreadableRows:
            if any(_says_a_number(field.strip()) for field in fields):
                raise
            whole = header.delimiter.join(fields).rstrip(header.delimiter + " ")
            raise RowFault(
                f"log {path}: {at} is not a row of numbers: {_shown(whole)!r}. Correct or remove that line; missing samples are bridged or"
                " left out."
            ) from None
        told = dict(zip((name for _, name in own), read, strict=True))
        values.append([told.get(name, np.nan) for _, name in index])
        rows[:] = [(line, fields)]
    if rows and header.delimiter != " " and _never_closed(text, header, rows[0][0] - before):
        raise UnreadableRows(
            f"log {path}: line {rows[0][0]} (data row {first + len(values) - 1}) opens a quote that is never closed, which hides"
            f" everything after it. Close it, or remove it."
        )
    table = np.array(values, float).reshape(len(values), len(index))
    return {name: table[:, k] for k, (_, name) in enumerate(index)}


def decoded(text: Buffer, header: Header) -> io.StringIO:
    """A text as its characters, what is none replaced."""
    return io.StringIO(bytes(text).decode(header.encoding, errors="replace"), newline="")


def _value(field: str, header: Header, where: str) -> float:
    """A field as a number, NaN for what stands for none. Raises DataError."""
    text = field.strip()
    if "\n" in field and is_number(text):
        raise UnreadableRows(f"{where}: {field!r} runs past the end of its line. Close the quotes on the same line, or remove them.")
    if text.lower() in MISSING:
        return np.nan
    plain = text.replace(",", ".", 1) if header.decimal == "," and "." not in text else "" if header.decimal == "," else text
    if is_number(plain):
        return float(plain)
    remedy = "Correct or remove the row; write a missing value as an empty field."
    thousands = _THOUSANDS.fullmatch(text)
    # Between commas, a comma in quotes is no decimal one.
    if thousands and (
        thousands["mark"] == header.delimiter == ","
        or len(re.findall(r"\D", text.lstrip("+-"))) > 1
        or not is_number(text.replace(",", ".", 1))
    ):
        remedy = "It has thousands separators: write numbers without them."
    elif header.decimal == "," and is_number(text):
        remedy = "It has a point, where other numbers have a decimal comma: write all numbers alike, without thousands separators."
    elif is_number(text.replace(",", ".", 1)):
        remedy = "It has a decimal comma: write the file with decimal points."
    elif is_number(text.replace(_TYPED_MINUS, "-")):
        remedy = f"Its minus sign is {_TYPED_MINUS!r} (U+2212), not the hyphen '-' of numbers: replace it in the file."
    elif _WITH_UNIT.fullmatch(text):
        remedy = "Write numbers only, and put their unit into the header, as in q1_deg."
    elif is_moment(text):
        remedy = "It is a date with a time: write times in seconds (from any origin), in every row."
    raise UnreadableRows(f"{where}: {_shown(text)!r} is not a number. {remedy}")


def _says_a_number(text: str) -> bool:
    """Whether a field stands for a number, or for a missing one, however it is written."""
    return bool(text) and (text.lower() in MISSING or is_number(text) or _BEGUN.match(text) is not None)


def _shown(text: str) -> str:
    """A text as messages show it: a quote that is not closed takes in the rest of the file."""
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"


def _never_closed(text: Buffer, header: Header, line: int) -> bool:
    """Whether the row that begins on a line (from 1) of a text opens quotes that the text does not close."""
    rest = list(islice(decoded(text, header), line - 1, None))
    if '"' not in "".join(rest[:1]):
        return False
    try:
        for _ in csv.reader(rest, strict=True):
            pass
    except csv.Error as error:
        return "unexpected end" in str(error)
    return False


def rows_of_text(path: Path, header: Header) -> Iterator[tuple[int, list[str]]]:
    """Line number (from 1) and fields of every row of data."""
    try:
        with open_binary(path) as stream, io.TextIOWrapper(stream, encoding=header.encoding, errors="replace", newline="") as text:
            yield from ((line, fields) for line, fields in numbered_rows(path, text, header) if line > header.line)
    except DAMAGED as error:
        raise UnreadableRows(f"log {path}: the file is damaged ({reason(error)}).") from None


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
            raise RowFault(f"log {path}: line {line} cannot be read ({error}).") from None
        if len(fields) > 1 or any(f.strip() for f in fields):
            yield line, fields
        line = before + reader.line_num + 1


def unpaired_quotes(text: Any) -> bool:
    """Whether a text, as any buffer of bytes, holds an odd number of quotes."""
    whole = memoryview(text)
    return sum(bytes(whole[i : i + _BLOCK]).count(b'"') for i in range(0, len(whole), _BLOCK)) % 2 == 1


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
    return any(i < len(fields) and "\n" in fields[i] and is_number(fields[i]) for _, fields in rows for i in index)
