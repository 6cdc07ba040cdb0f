"""Headers over two rows: what is above stands for several columns (a merged cell, or a word again), what is below tells them apart."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from ..units import as_suffix, is_unit
from ..words import TIME, words_of
from .header import is_number

Row = Sequence[str]


def stacked_names(names: Row, rows: Sequence[Row]) -> tuple[tuple[str, ...], tuple[str, ...], int] | None:
    """Names of columns whose header goes on in the row below, the units told below these, and how many rows there are below the first.

    None where the first row names every column by itself. A third row may tell units, or the name of the index alone (pandas)."""
    below = rows[0] if rows else ()
    if len(below) != len(names) or not any(below) or (any(is_number(x) for x in below) and not _counts(names, below)):
        return None
    merged = [k for k in range(1, len(names)) if not names[k] and below[k]]
    counts = Counter(x for x in names if x)
    again = any(count > 1 for count in counts.values()) and len({*zip(names, below, strict=True)}) == len(names)
    if not merged and not again:
        return None
    above = _filled(names)
    if merged and all(is_unit(_unit(x)) for x in below if x):
        return _numbered(above, names), tuple(below), 1
    told = tuple(f"{a} [{b.strip('[]()')}]" if a and is_unit(_unit(b)) else f"{a} {b}".strip() for a, b in zip(above, below, strict=True))
    third = rows[1] if len(rows) > 1 and len(rows[1]) == len(names) else ()
    if any(third) and not any(is_number(x) for x in third):
        if not any(third[1:]):
            return (third[0], *told[1:]), (), 2
        if all(is_unit(_unit(x)) for x in third if x):
            return told, tuple(third), 2
    return told, (), 1


def _counts(names: Row, below: Row) -> bool:
    """Whether numbers below merged cells count what is in each: 1, 2, 3 below every one, and nothing below another."""
    found: dict[int, list[str]] = {}
    begins = 0
    for k, text in enumerate(below):
        begins = k if names[k] else begins
        found.setdefault(begins, []).append(text)
    wide = [texts for texts in found.values() if any(texts)]
    counted = [[str(k + first) for k in range(len(wide[0]))] for first in (0, 1)] if wide else []
    return len(wide) > 1 and len(wide[0]) > 1 and wide[0] in counted and all(texts == wide[0] for texts in wide) and len(wide) < len(found)


def _unit(text: str) -> str:
    return as_suffix(text.strip().strip("[]()"))


def _filled(names: Row) -> list[str]:
    """For each column what stands above it; what stands above a time is of that alone."""
    out, group = [], ""
    for name in names:
        group = name or ("" if words_of(group) & TIME else group)
        out.append(group)
    return out


def _numbered(above: Row, names: Row) -> tuple[str, ...]:
    """The columns below a merged cell, counted; those below a cell of their own by its name."""
    out, place = [], 0
    for k, group in enumerate(above):
        place = 0 if names[k] else place + 1
        wide = not names[k] or (k + 1 < len(names) and not names[k + 1] and above[k + 1] == group)
        out.append(f"{group}[{place}]" if group and wide else group)
    return tuple(out)
