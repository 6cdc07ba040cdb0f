"""Lines for a terminal: what is too wide is cut (expressions) or wrapped (sentences)."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

#: Columns of a wide terminal.
WIDTH = 160
#: Characters of a name that a list shows.
_SHOWN = 120
#: Verbs of one thing that do not end on s.
_ONE = {"are": "is", "were": "was", "have": "has"}


def counted(count: int, noun: str, verb: str = "", *, plural: str = "", of: str = "") -> str:
    """So many things, and what they do: "1 row repeats", "2 rows repeat". `noun`: of one thing; `verb` and
    `plural` (where it is not the noun with an s): of several; `of`: what stands between noun and verb.

    Examples
    --------
    >>> counted(1, "row", "are"), counted(2, "usable row")
    ('1 row is', '2 usable rows')
    """
    one = count == 1
    does = f" {_ONE.get(verb, verb + 's') if one else verb}" if verb else ""
    return f"{count} {noun if one else plural or noun + 's'}{of}{does}"


def listed(items: Sequence[str], most: int = 12) -> str:
    """Names in a row: the first `most` of them, long ones cut off."""
    shown = (item if len(item) <= _SHOWN else f"{item[:_SHOWN]}…" for item in items[:most])  # a garbled header has very long names
    return ", ".join(shown) + (" …" if len(items) > most else "")


def moment(t: float, start: float) -> str:
    """A moment by the time stamps of a log that begins at `start` (s), which may count from 1970, and counted from the first.

    Examples
    --------
    >>> moment(17.25, 0.0), moment(1732800017.25, 1732800000.0)
    ('17.25 s', '1732800017.25 s (17.25 s after the first)')
    """
    return f"{t:.12g} s" if start == 0.0 else f"{t:.12g} s ({t - start:.5g} s after the first)"


def shortened(expression: str, width: int) -> str:
    """An expression that fits `width` columns: whole terms, then "…" for the rest. At least the first term is kept."""
    if len(expression) <= width:
        return expression
    terms = re.split(r" (?=[+-] )", expression)
    kept = terms[0]
    for term in terms[1:]:
        if len(kept) + len(term) + 3 > width:
            break
        kept += f" {term}"
    return f"{kept} …"


def wrapped(sentence: str) -> str:
    """A sentence over as many lines as it needs."""
    return textwrap.fill(sentence, WIDTH, subsequent_indent="  ", break_long_words=False, break_on_hyphens=False)
