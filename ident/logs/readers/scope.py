"""TwinCAT Scope's text export: a block of what is told of each channel, then a pair of columns (time, value) for each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import DataError
from .damage import DAMAGED, reason
from .header import is_number
from .packed import open_binary
from .stored import LogFormat, Stored, register_log_format

Array = np.ndarray
#: Bytes in which what is told of the channels is looked for, and a key that only this export has.
_FRONT, _KEY = 1 << 15, b"SampleTime[ms]"
_UNIT_KEYS = ("Unit", "Units")


def _is_one(path: Path, start: bytes) -> bool:
    if not start.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"Name") or not path.is_file():
        return False
    with open_binary(path) as stream:
        return _KEY in stream.read(_FRONT)


def _read(path: Path) -> Stored:
    """Channels by name over `time` (s) of the channel with most samples; the others are brought to it. Raises DataError."""
    try:
        with open_binary(path) as stream:
            text = stream.read().decode("utf-8-sig", "replace")
    except DAMAGED as error:
        raise DataError(f"log {path}: the file is damaged ({reason(error)}).") from None
    lines = text.splitlines()
    mark = "\t" if any("\t" in line for line in lines[:20]) else ";"
    fields = [line.split(mark) for line in lines]
    begins = next((k for k, row in enumerate(fields) if len(row) > 1 and all(_is_value(x) for x in row) and any(x.strip() for x in row)), 0)
    told = {row[0].strip(): [x.strip() for x in row[1::2]] for row in fields[:begins] if row and row[0].strip() in row[2::2] + row[:1]}
    rows = [row for row in fields[begins:] if any(x.strip() for x in row)]
    width = max((len(row) for row in rows), default=0) // 2
    names = told.get("Name", told.get("SymbolName", []))
    if not begins or width < 1 or len(names) < width:
        raise DataError(
            f"log {path}: is an export of TwinCAT Scope without the names of its {width} channels; export it as CSV with names."
        )
    table = np.full((len(rows), 2 * width), np.nan)
    for k, row in enumerate(rows):
        for j, x in enumerate(row[: 2 * width]):
            if x.strip():
                table[k, j] = float(x.strip().replace(",", "."))
    known = [np.isfinite(table[:, 2 * j]) for j in range(width)]
    main = int(np.argmax([own.sum() for own in known]))
    t = table[known[main], 2 * main]
    columns: dict[str, Array] = {"time": 1e-3 * t}
    for j, name in enumerate(names[:width]):
        own, values = table[known[j], 2 * j], table[known[j], 2 * j + 1]
        columns[name] = values if np.array_equal(own, t) else np.interp(t, own, values, left=np.nan, right=np.nan)
    units = next((told[key] for key in _UNIT_KEYS if key in told), [])
    return Stored(columns, {name: unit.strip("()[]") for name, unit in zip(names, units, strict=False) if unit.strip("()[] ")})


def _is_value(text: str) -> bool:
    return not text.strip() or is_number(text.strip().replace(",", ".", 1))


SCOPE = register_log_format(LogFormat("TwinCAT Scope export", _is_one, _read))
