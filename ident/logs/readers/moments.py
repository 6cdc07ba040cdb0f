"""Time stamps as text: dates with a time of day, or a time of day alone, as seconds."""

from __future__ import annotations

import re
from datetime import date
from functools import lru_cache
from pathlib import Path

import numpy as np

from ...errors import DataError
from .header import MISSING

Array = np.ndarray
_MOMENT = re.compile(
    r"(?:(?P<date>\d{4}[-/]\d{1,2}[-/]\d{1,2}|\d{1,2}[./]\d{1,2}[./]\d{2,4})[T ,]+)?(?P<hour>\d{1,2}):(?P<minute>\d{2}):"
    r"(?P<second>\d{2}(?:[.,:]\d+)?)\s*(?P<half>[AaPp][Mm])?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
_DAY = 86_400.0
#: What stands for the unit of such a column.
MOMENT = "moment"


def is_moment(text: str) -> bool:
    """Whether a text is a date with a time, or a time of day with seconds."""
    return _MOMENT.fullmatch(text.strip()) is not None


def seconds_of(texts: Array, path: Path, name: str) -> Array:
    """Texts (N,) as seconds: since 1970 with a date that is written year first, else of the day, over midnights; NaN where nothing stands.

    Raises DataError naming the row of another text."""
    out = np.full(len(texts), np.nan)
    dated = True
    for k, text in enumerate(texts.tolist()):
        found = _MOMENT.fullmatch(str(text).strip())
        if found is None:
            if str(text).strip().lower() in MISSING:
                continue
            raise DataError(
                f"log {path}: column {name!r}, data row {k + 1}: {str(text)[:40]!r} is not a date with a time, unlike the others."
                " Correct or remove the row."
            )
        hour = int(found["hour"])
        if found["half"]:
            hour = hour % 12 + 12 * (found["half"].lower() == "pm")
        out[k] = 3600.0 * hour + 60.0 * int(found["minute"]) + float(re.sub("[,:]", ".", found["second"])) - _zone(found["zone"] or "")
        day = _day(found["date"] or "")
        dated &= day is not None
        out[k] += 0.0 if day is None else _DAY * day
    if not dated:
        known = np.flatnonzero(np.isfinite(out))
        out[known] %= _DAY
        out[known[1:]] += _DAY * np.cumsum(np.diff(out[known]) < -0.5 * _DAY)
    return out


@lru_cache(maxsize=64)
def _day(text: str) -> int | None:
    """Days since 1970 of a date that begins with its year; None for others, of which nobody knows the day from the month."""
    parts = re.split("[-/]", text)
    if len(parts) != 3 or len(parts[0]) != 4:
        return None
    try:
        return date(*map(int, parts)).toordinal() - date(1970, 1, 1).toordinal()
    except ValueError:
        return None


@lru_cache(maxsize=64)
def _zone(text: str) -> float:
    if not text or text in ("Z", "UTC"):
        return 0.0
    digits = text[1:].replace(":", "")
    return (1.0 if text[0] == "+" else -1.0) * (3600.0 * int(digits[:2]) + 60.0 * int(digits[2:]))
