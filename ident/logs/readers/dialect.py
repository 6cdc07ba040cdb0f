"""How a text writes its table: header, separator, decimal sign, units, encoding."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from ...errors import DataError
from .damage import DAMAGED, reason
from .encodings import likely_encodings
from .header import Header, is_number, once
from .moments import MOMENT, is_moment
from .packed import bounded_lines, open_binary
from .remarks import told_by_cells, told_in
from .stacked_headers import stacked_names

#: A first line by which spreadsheets are told what separates fields; what else may, and of how many columns at least.
_SEPARATOR = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_SPACES = re.compile(r"\s+")
_COLUMNS = 2
#: Marks of a comment.
_COMMENT = re.compile(r"#|//|%(?=\s)")
#: What stands before names of columns in a comment, and before the header in LabVIEW's measurement files.
_LABEL, _END = re.compile(r"^(columns|fields|header|names|format|data)\s*:\s*", re.IGNORECASE), "***End_of_Header***"
#: A field of a line that is drawn below a header.
_RULE = re.compile(r":?[-=+]*:?")
#: Lines in which a header behind others is looked for, and comments that are looked at.
_PREAMBLE = 80
#: Longest word that a row of units holds.
_UNIT = 8
#: Of a joint state as text: the place of its frame, and the fields of numbers behind the names.
_FRAME, _ECHOED = 2, ("position", "velocity", "effort")


def text_header(path: Path) -> Header:
    """How a file of text writes its table. Raises DataError."""
    try:
        return _header_of(path, "utf-8-sig")
    except UnicodeDecodeError as error:
        if b"\x00" not in error.object[:4096]:
            for encoding in likely_encodings(error.object):
                with suppress(UnicodeDecodeError):
                    return _header_of(path, encoding)
        raise DataError(f"log {path}: is not a text table ({error}).") from None


def text_encoding(raw: bytes) -> str:
    """The encoding of a text that is held whole."""
    try:
        raw.decode("utf-8-sig")
    except UnicodeDecodeError:
        return next(iter(likely_encodings(raw)), "latin-1")
    return "utf-8-sig"


def plain_number(text: str) -> str:
    """A number as it may stand in a field, with a decimal point for its comma."""
    return text.replace(",", ".", 1)


@dataclass(frozen=True)
class _Beginning:
    """The first line that is no comment, its number (from 1), the lines behind it, the comment right before it, the separator told,
    and what all comments before it say."""

    line: str
    number: int
    rows: tuple[str, ...]
    comment: str
    told: str
    remarks: tuple[str, ...]


def _beginning(path: Path, encoding: str) -> _Beginning:
    try:
        with open_binary(path) as stream, io.TextIOWrapper(stream, encoding=encoding, newline="") as text:
            told, said, remarks = "", (0, ""), list[str]()
            lines = bounded_lines(text, path)
            for number, line in enumerate(lines, 1):
                if mark := _COMMENT.match(line):
                    said = number, line[mark.end() :].lstrip("#%/").strip()
                    if len(remarks) < _PREAMBLE:
                        remarks.append(said[1])
                elif found := _SEPARATOR.fullmatch(line.strip(" \r\n")):
                    told = found[1]
                elif line.strip():
                    rows = tuple(row for row in islice(lines, 4) if row.strip())
                    return _Beginning(line, number, rows, said[1] if said[0] == number - 1 else "", told, tuple(remarks))
    except DAMAGED as error:
        raise DataError(f"log {path}: is not a text table ({reason(error)}).") from None
    raise DataError(f"log {path}: the file holds no header row.")


def _header_of(path: Path, encoding: str) -> Header:
    begin = _beginning(path, encoding)
    found = _header_behind(begin, path, encoding)
    return replace(found, constants=(*found.constants, *told_in(begin.remarks)))


def _header_behind(begin: _Beginning, path: Path, encoding: str) -> Header:
    line, number, rows = begin.line, begin.number, begin.rows
    if "\x00" in line:
        raise DataError(
            f"log {path}: line {number} holds NUL characters: it is not text, or it is UTF-16 without a byte-order mark. Save it as UTF-8."
        )
    delimiter = begin.told or _delimiter(line, rows, path)
    spaced = delimiter not in line and len(_SPACES.split(line.strip())) > _COLUMNS
    if spaced and (not rows or len(rows[0].split()) != len(line.split())):
        if rows and (begins := _behind_preamble(path, encoding, (line,))):
            return begins
        raise DataError(
            f"log {path}: its columns are separated by spaces (line {number}), but their number varies between rows; write the file"
            f" with commas, semicolons or tabs."
        )
    delimiter = " " if spaced else delimiter
    if line.count('"') % 2:
        raise DataError(f"log {path}: line {number}: a column name has a quote that is never closed. Close it, or remove it.")
    names = _fields(line, delimiter, path)
    if rows and (begins := _behind_preamble(path, encoding, names)):
        return begins
    if all(is_number(n) for n in names):
        # What numpy.savetxt writes: the header behind a sign of comment, right before the numbers.
        behind = _fields(_LABEL.sub("", begin.comment), delimiter, path) if begin.comment else ()
        if len(behind) == len(names) and not any(is_number(n) for n in behind):
            return Header(once(behind), number - 1, delimiter)
        numbered = tuple(f"#{k}" for k in range(len(names)))
        return Header(numbered, number - 1, delimiter, unnamed=True)
    if echoed := _echoed(names):
        return Header(echoed, number - 1, delimiter, encoding=encoding)
    if not rows:
        raise DataError(f"log {path}: there is a header, but no row of data.")
    # A row that cannot be split tells nothing here; who reads the rows says which line it is.
    told = [_fields(row, delimiter, path) for row in rows if len(row) < csv.field_size_limit()]
    return _with_rows(names, told or [()], number, delimiter, encoding)


def _delimiter(line: str, rows: Sequence[str], path: Path) -> str:
    """What separates the fields of a header: what the first row of numbers has as often, and numbers between; else the usual first one."""
    there = [d for d in (",", ";", "\t", "|") if d in line]
    if len(there) > 1 and rows and all(len(row) < csv.field_size_limit() for row in (line, rows[-1])):
        for d in there:
            own, last = _fields(line, d, path), _fields(rows[-1], d, path)
            if len(own) == len(last) and all(not x or is_number(plain_number(x)) for x in last):
                return d
    return there[0] if there else ","


def _with_rows(names: tuple[str, ...], rows: list[tuple[str, ...]], number: int, delimiter: str, encoding: str) -> Header:
    """The header on line `number`, with what the first rows behind it tell: units, the decimal sign, moments, separators at the end."""
    while len(rows) > 1 and any(rows[0]) and all(_RULE.fullmatch(x) for x in rows[0]):
        rows, number = rows[1:], number + 1  # a line of dashes below the header
    decimal, units, first = ".", tuple[str, ...](), rows[0]
    if (whole := stacked_names(names, rows[:-1])) is not None:
        names, units, below = whole
        number, first = number + below, rows[below]
    if (
        whole is None
        and len(rows) > 1
        and len(first) == len(names)
        and not any(is_number(x.replace(",", ".")) for x in first)
        and _is_units(first)
    ):
        units, number, first = first, number + 1, rows[1]
    if len(first) == len(names) + 1 and not any(row[len(names) :] != ("",) for row in rows[bool(units) :] if len(row) > len(names)):
        names, units = (*names, ""), (*units, "") if units else ()  # every row ends with a separator
    numbers = [x for row in rows[rows.index(first) :] for x in row if is_number(plain_number(x))]
    # With commas between fields a decimal comma stands in quotes.
    if any("," in x for x in numbers) and not any("." in x for x in numbers):
        decimal = ","
    moments = tuple(name for name, x in zip(names, first, strict=False) if is_moment(x))
    if moments:
        units = tuple(MOMENT if name in moments else unit for name, unit in zip(names, units or ("",) * len(names), strict=False))
    return Header(once(names), number, delimiter, decimal, units, encoding, moments=moments)


def _echoed(fields: tuple[str, ...]) -> tuple[str, ...]:
    """The columns of joint states as `ros2 topic echo --csv` writes them, without a header: stamp, frame, names, then the numbers of each
    field; () for another line."""
    text = [k for k, x in enumerate(fields) if not is_number(x)]
    joints = [k for k in text if k > _FRAME]
    n, rest = len(joints), len(fields) - 1 - _FRAME - len(joints)
    whole = len(fields) > _FRAME and all(x.isdecimal() for x in fields[:_FRAME])
    if not whole or not n or joints != list(range(_FRAME + 1, _FRAME + 1 + n)) or rest % n or not 1 <= rest // n <= len(_ECHOED):
        return ()
    told = [f"{word}{k}" for word in ("name", *_ECHOED[: rest // n]) for k in range(n)]
    return ("header.stamp.sec", "header.stamp.nanosec", "header.frame_id", *told)


def _behind_preamble(path: Path, encoding: str, names: tuple[str, ...]) -> Header | None:
    """The header behind lines that tell of the recording (a name and a value each), if there are such; None for a table from the start.

    It is the last line of names before the first of numbers, of as many fields (more than two, more than the first line has); a row of
    units may stand between. A comma is the decimal sign where fields are separated by others."""
    with open_binary(path) as stream, io.TextIOWrapper(stream, encoding=encoding, newline="") as text:
        lines = [*islice(bounded_lines(text, path), _PREAMBLE)]
    for delimiter in ("\t", ";", ","):
        usual = (bool(line.strip()) and line.count('"') % 2 == 0 and len(line) < csv.field_size_limit() for line in lines)
        table = [_fields(line, delimiter, path) if fits else () for line, fits in zip(lines, usual, strict=True)]
        plain = [tuple(x.replace(",", ".", 1) if delimiter != "," else x for x in fields) for fields in table]
        first = next(
            (k for k, row in enumerate(plain) if len(row) > _COLUMNS and all(x == "" or is_number(x) for x in row) and any(row)), 0
        )
        above = [k for k in range(first) if len(table[k]) == len(plain[first]) and not any(is_number(x) for x in plain[k])]
        if ended := [k + 1 for k in range(first - 1) if lines[k].startswith(_END)]:
            above = ended[-1:]
        whole = stacked_names(table[above[0]], [table[k] for k in above[1:]]) if len(above) > 1 and above[0] else None
        if whole is not None and above == list(range(above[0], first)) and len(above) == whole[2] + 1:
            comma = delimiter != "," and any("," in x for x in table[first])
            constants = told_by_cells(table[: above[0]])
            return Header(once(whole[0]), first, delimiter, "," if comma else ".", whole[1], encoding, constants=constants)
        if len(above) not in (1, 2) or above[0] == 0 or len(names) >= len(table[above[0]]) or any(table[above[-1] + 1 : first]):
            continue
        units = table[above[1]] if len(above) == 2 and _is_units(table[above[1]]) else ()
        if len(above) == 2 and not units:
            continue
        comma = delimiter != "," and any("," in x for x in table[first])
        constants = told_by_cells(table[: above[0]])
        return Header(once(table[above[0]]), above[-1] + 1, delimiter, "," if comma else ".", units, encoding, constants=constants)
    return None


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
