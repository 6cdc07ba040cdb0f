"""Tables of text that lie on their side: a row for each channel, its name (and unit) first, and a column for each sample."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from ...errors import DataError
from ..words import QUANTITIES, TIME, words_of
from .damage import DAMAGED, reason
from .dialect import plain_number, text_encoding
from .header import MISSING, is_number
from .moments import is_moment
from .packed import bounded_lines, open_whole
from .stored import LogFormat, Stored, register_log_format

_DELIMITERS = (",", ";", "\t", " ")
#: A channel has a name, and perhaps a unit, before so many samples at least.
_LABELS, _SAMPLES = 2, 20


def _is_one(path: Path, start: bytes) -> bool:
    """By the first line: few words, then numbers; the other lines are looked at where that is so."""
    first = (start.lstrip(b"\xef\xbb\xbf\r\n").splitlines() or [b""])[0].decode("latin-1")
    if not path.is_file() or b"\x00" in start or first[:1] in "{[<#%":
        return False
    if not any(0 < _labels(row := _fields(first, mark)) <= _LABELS and len(row) > _SAMPLES for mark in _DELIMITERS):
        return False
    with suppress(DataError):
        return _rows(path) is not None
    return False


def _fields(line: str, mark: str) -> list[str]:
    if mark == " ":
        return line.split()
    try:
        return [x.strip() for x in next(csv.reader([line], delimiter=mark), [])]
    except csv.Error:  # no table of text
        return []


def _labels(row: Sequence[str]) -> int:
    """How many fields before the first number, of which all but the last (which may be cut) are one; 0 where not."""
    if not row:
        return 0
    count = next((k for k, x in enumerate(row) if is_number(plain_number(x))), 0)
    return count if all(x.lower() in MISSING or is_number(plain_number(x)) for x in row[count:-1]) and not is_moment(row[0]) else 0


def _rows(path: Path) -> list[tuple[str, str, list[str]]] | None:
    """Name, unit and samples of each channel; None where the rows are no channels: as many samples in each, names each its own, and one of
    them a word for a quantity or a time."""
    try:
        with open_whole(path) as stream:
            text = stream.read()
        lines = [line for line in bounded_lines(text.decode(text_encoding(text)).splitlines(), path) if line.strip()]
    except DAMAGED as error:
        raise DataError(f"log {path}: is not a text table ({reason(error)}).") from None
    mark = next((m for m in _DELIMITERS if 0 < _labels(_fields(lines[0], m)) <= _LABELS), None) if lines else None
    if mark is None or len(lines) < _LABELS:
        return None
    found = []
    for line in lines:
        row = _fields(line.rstrip(mark) if mark != " " else line, mark)
        count = _labels(row)
        if not 0 < count <= _LABELS or len(row) - count < _SAMPLES:
            return None
        found.append((row[0], row[1] if count > 1 else "", row[count:]))
    alike = len({len(values) for *_, values in found}) == 1 and len({name for name, *_ in found}) == len(found)
    return found if alike and any(words_of(name) & (QUANTITIES | TIME) for name, *_ in found) else None


def _read(path: Path) -> Stored:
    columns, units = {}, {}
    for name, unit, values in _rows(path) or ():
        try:
            columns[name] = np.array([np.nan if x.lower() in MISSING else float(plain_number(x)) for x in values])
        except ValueError:
            raise DataError(f"log {path}: channel {name!r} holds a value that is not a number.") from None
        units[name] = unit
    return Stored(columns, {name: unit for name, unit in units.items() if unit}, (f"log {path}: each row is a channel.",))


CHANNEL_ROWS = register_log_format(LogFormat("channels in rows", _is_one, _read))
