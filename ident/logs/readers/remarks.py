"""Numbers that are told of a recording beside its table: in comments before it (`# fs = 250`), or in lines of a name and a value."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

#: A number, and its unit right behind; a comma before three digits may part thousands.
_NUMBER = r"(?P<value>[-+]?(?:\d+(?:\.\d+)?|0,\d+|\d+,(?!\d{3}\b)\d+)(?:[eE][-+]?\d+)?)(?![\d.,:/\-]*\d)\s*(?P<unit>[^\W\d_][\w/]*\b)?"
_NAMED = re.compile(rf"(?P<name>[^\W\d][^:=,;|\t]*?)\s*[:=]\s*{_NUMBER}")
#: Without a sign between name and number, a unit must stand behind it: `recorded at 250 Hz`.
_SPOKEN = re.compile(r"(?P<name>[^\W\d][^:=,;|\t\d]*?)\s+(?P<value>\d+(?:\.\d+)?)\s*(?P<unit>k?Hz|ms|us|µs|s)\b", re.IGNORECASE)
#: Longest line that is looked at, and most numbers that are kept.
_LONGEST, _MOST = 400, 64

Told = tuple[tuple[str, float], ...]


def told_in(lines: Iterable[str]) -> Told:
    """Names (their unit in brackets) and numbers that lines of text tell; of a name that stands again the first.

    Examples
    --------
    >>> told_in(["sample rate: 250 Hz, gain = 3", "recorded at 4 ms"])
    (('sample rate [Hz]', 250.0), ('gain', 3.0), ('recorded at [ms]', 4.0))
    """
    found: dict[str, float] = {}
    for line in lines:
        if len(line) > _LONGEST:
            continue
        for match in [*_NAMED.finditer(line)] or [*_SPOKEN.finditer(line)]:
            unit = match["unit"]
            name = match["name"].strip() + (f" [{unit}]" if unit else "")
            if len(found) < _MOST:
                found.setdefault(name, float(match["value"].replace(",", ".")))
    return tuple(found.items())


def told_by_cells(rows: Iterable[Sequence[str]]) -> Told:
    """The same of rows of cells: a name, a value, and perhaps its unit."""
    filled = ([cell for cell in row if cell] for row in rows)
    return told_in(f"{name.rstrip(': =')}: {' '.join(rest[:2])}" for name, *rest in (row for row in filled if row) if rest)
