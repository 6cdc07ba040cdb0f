"""Lines for a terminal: what is too wide is cut (expressions) or wrapped (sentences)."""

from __future__ import annotations

import re
import textwrap

#: Columns of a wide terminal.
WIDTH = 160


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
