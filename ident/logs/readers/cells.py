"""Tables of text whose cells hold lists (`"[0.1, 0.2]"`), as a DataFrame of arrays is written: a column an element."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ...errors import DataError, IdentError
from .arrays import element
from .dialect import text_header
from .header import numeric
from .moments import seconds_of
from .stored import LogFormat, Stored, register_log_format
from .text import read_text_columns
from .text_rows import rows_of_text

Array = np.ndarray
_LIST = re.compile(r"\s*(?:array)?\(?\s*[\[(](?P<inside>[^\[\]()]*)[\])].*", re.DOTALL)
#: A list of names makes it an export of joint states.
_NAMED = re.compile(r"(^|[./_])names?$", re.IGNORECASE)


def _is_one(path: Path, start: bytes) -> bool:
    if not path.is_file() or not any(mark in start for mark in (b'"[', b";[", b"\t[", b'"(', b'"array(')):
        return False
    try:
        header = text_header(path)
        first = next((fields for _, fields in rows_of_text(path, header)), [])
    except IdentError:
        return False
    listed = [name for name, x in zip(header.names, first, strict=False) if _LIST.fullmatch(x)]
    return bool(listed) and not any(_NAMED.search(name) for name in header.names)


def _read(path: Path) -> Stored:
    header = text_header(path)
    columns: dict[str, Array] = {}
    for name, cells in read_text_columns(path, header, [name for name in header.names if name]).items():
        if len(cells) and _LIST.fullmatch(str(cells[0])):
            columns |= _elements(path, name, cells)
        elif name in header.moments:
            columns[name] = seconds_of(cells, path, name)
        else:
            try:
                columns[name] = numeric(cells, path, name)
            except DataError:
                continue  # a column of text
    return Stored(columns)


def _elements(path: Path, name: str, cells: Array) -> dict[str, Array]:
    """Columns of a column of lists. Raises DataError where they differ in length, or hold what is no number."""
    rows, width = [], 0
    for k, cell in enumerate(cells.tolist()):
        found = _LIST.fullmatch(cell)
        try:
            values = np.array([float(x) for x in re.split(r"[,;\s]+", found["inside"].strip()) if x]) if found else np.zeros(0)
        except ValueError:
            values = np.zeros(0)
        width = width or len(values)
        if not len(values) or len(values) != width:
            raise DataError(f"log {path}: column {name!r}, data row {k + 1}: {cell[:40]!r} is not a list of {width or 'some'} numbers.")
        rows.append(values)
    table = np.array(rows)
    return {element(name, j): table[:, j] for j in range(width)}


CELLS = register_log_format(LogFormat("lists in cells", _is_one, _read))
