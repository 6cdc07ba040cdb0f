"""Columns whose names, or units, are those of a time."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from .channel_group import unit_suffix
from .readers.moments import MOMENT
from .stamps import fraction_of
from .units import bracketed, unit_of
from .words import (
    TIME,
    words_of,
)


def scalar_time_names(names: Sequence[str], units: Mapping[str, str] | None = None) -> list[str]:
    """Columns whose name, or unit, is one of time, the likeliest first: the sender's stamp before the recorder's, plain names before
    others."""
    exact = (
        "t",
        "time",
        "timestamp",
        "timestamps",
        "tstamps",
        "zeit",
        "stamp",
        "secs",
        "sec",
        "seconds",
        "ms",
        "%time",
        "ipoc",
        "x_value",  # LabVIEW
        "clock",
        "ts",
    )
    lower = {n.lower(): n for n in names}
    found = [lower[k] for k in lower if re.search(r"stamp[./_](sec|secs)$|header[./]stamp$", k)] + [lower[k] for k in exact if k in lower]
    others = [n for n in names if words_of(n) & (TIME - {"t", "ms", "ts", "stamp"})]
    split = [n for n in names if fraction_of(n, names)]
    # A stamp or a count of ticks is a time where its last word is a unit of one.
    counted = [n for n in names if words_of(n) & {"stamp", "tick", "ticks"} and _is_time(re.split(r"[^A-Za-z]+", n)[-1])]
    return list(dict.fromkeys([*found, *split, *others, *(n for n in names if _time_unit(n, units or {})), *counted]))


def _time_unit(name: str, units: Mapping[str, str]) -> bool:
    if units.get(name) == MOMENT:
        return True
    return _is_time(unit_suffix(units.get(name, "")) or unit_suffix(bracketed(name)[1]))


def _is_time(word: str) -> bool:
    unit = unit_suffix(word)
    return bool(unit) and unit_of(unit).dimension == "time"
