"""How a text writes its table: header, separator, decimal sign, units, encoding."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path

from ...errors import DataError
from .damage import DAMAGED, reason
from .header import Header, is_number, once
from .packed import bounded_lines, open_binary

#: A first line by which spreadsheets are told what separates fields; what else may, and of how many columns at least.
_SEPARATOR = re.compile(r'"?sep=([,;\t])"?', re.IGNORECASE)
_OTHER = re.compile(r"\s*\|\s*|\s+")
_COLUMNS = 2
#: Lines in which a header behind others is looked for.
_PREAMBLE = 80
#: Longest word that a row of units holds.
_UNIT = 8


def text_header(path: Path) -> Header:
    """How a file of text writes its table. Raises DataError."""
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
    if rows and (begins := _behind_preamble(path, encoding, names)):
        return begins
    if all(is_number(n) for n in names):
        # What numpy.savetxt writes: the header behind a sign of comment, right before the numbers.
        behind = _fields(said[1], delimiter, path) if said[0] == number - 1 else ()
        if len(behind) == len(names) and not any(is_number(n) for n in behind):
            return Header(once(behind), said[0], delimiter)
        numbered = tuple(f"#{k}" for k in range(len(names)))
        return Header(numbered, number - 1, delimiter, unnamed=True)
    if not more:
        raise DataError(f"log {path}: there is a header, but no row of data.")
    decimal, units = ".", tuple[str, ...]()
    first = _fields(rows[0], delimiter, path) if rows else ()
    if len(rows) > 1 and len(first) == len(names) and not any(is_number(x.replace(",", ".")) for x in first) and _is_units(first):
        units, number, first = first, number + 1, _fields(rows[1], delimiter, path)
    numbers = [x for x in first if x]
    if delimiter in ";\t" and any("," in x for x in numbers) and not any("." in x for x in numbers):
        decimal = "," if all(is_number(x.replace(",", ".", 1)) for x in numbers if "," in x) else "."
    return Header(once(names), number, delimiter, decimal, units, encoding)


def _behind_preamble(path: Path, encoding: str, names: tuple[str, ...]) -> Header | None:
    """The header behind lines that tell of the recording (a name and a value each), if there are such; None for a table from the start.

    It is the last line of names before the first of numbers, of as many fields (more than two, more than the first line has); a row of
    units may stand between. A comma is the decimal sign where fields are separated by others."""
    with open_binary(path) as stream, io.TextIOWrapper(stream, encoding=encoding, newline="") as text:
        lines = [*islice(bounded_lines(text, path), _PREAMBLE)]
    for delimiter in ("\t", ";", ","):
        table = [_fields(line, delimiter, path) if line.strip() and line.count('"') % 2 == 0 else () for line in lines]
        plain = [tuple(x.replace(",", ".", 1) if delimiter != "," else x for x in fields) for fields in table]
        first = next(
            (k for k, row in enumerate(plain) if len(row) > _COLUMNS and all(x == "" or is_number(x) for x in row) and any(row)), 0
        )
        above = [k for k in range(first) if len(table[k]) == len(plain[first]) and not any(is_number(x) for x in plain[k])]
        if len(above) not in (1, 2) or above[0] == 0 or len(names) >= len(table[above[0]]) or any(table[above[-1] + 1 : first]):
            continue
        units = table[above[1]] if len(above) == 2 and _is_units(table[above[1]]) else ()
        if len(above) == 2 and not units:
            continue
        comma = delimiter != "," and any("," in x for x in table[first])
        return Header(once(table[above[0]]), above[-1] + 1, delimiter, "," if comma else ".", units, encoding)
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
