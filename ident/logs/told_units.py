"""Units that columns' names tell, those that nobody knows included."""

from __future__ import annotations

import re

from .channel_group import unit_suffix
from .units import bracketed, split_unit
from .words import (
    SAID,
    TIME,
    words_of,
)

#: What stands in brackets and is no unit, and in names and tells no joint: which joint, side or sensor it is of.
BESIDE = {"joint", "axis", "motor", "link", "arm", "side", "raw", "left", "right", "sensor", "encoder", "si"}
#: Words at a name's end that tell a share, or what a sensor counts: no unit whose size is known.
_NO_UNITS = {
    "percent", "pct", "prozent", "permille", "promille", "permil", "perthousand", "ticks", "tick", "counts", "count", "lsb", "inc", "incs",
    "increments", "digits", "adc", "pu",
}  # fmt: skip
#: A letter or two before a unit: a multiple that is not known.
_LIKE_UNIT = re.compile(r"[a-zµ]{1,2}(deg|rad|nm|rpm|rev|turns?)|(deg|rad|nm|rev|turns?|mm)(per)?[a-z]{1,3}", re.IGNORECASE)
#: What is told for something a time, in other units of time than those of rates that are known.
_RATE = re.compile(r"/\s*(ms|us|µs|ns|h|cycle|tick|sample)\b", re.IGNORECASE)
_LAST_BRACKETS = re.compile(r"[\[(]([^\[\]()]*)[\])]\s*$")


def unit_in(stem: str) -> str:
    """The unit that a name tells: `act_pos_mot#_deg`, `vel#_deg_per_s`, `speed # [rpm]`; single letters count only in brackets."""
    bare = stem.replace("[#]", "").replace("[]", "").replace("#", "")
    if found := unit_suffix(bracketed(bare)[1]):
        return found
    unit = split_unit(re.sub(r"_+", "_", bare.replace("_per_", "_")).strip("_"))[1] or ""
    return unit if len(unit) > 1 else ""


def unread_unit(text: str) -> str:
    """What is told for a unit, where it says something that is no unit that is known; "" for a unit, for nothing, and for words."""
    inside = text.strip().strip("[]()").strip()
    plain = (
        not inside
        or inside in "-–—."
        or inside.isdecimal()
        or unit_suffix(inside)
        or (bool(words_of(inside) & (SAID | TIME | BESIDE)) and not _RATE.search(inside))
    )
    return "" if plain else inside


def unread_in(name: str) -> str:
    """What a name tells for a unit, in brackets or behind its last line, where it is none that is known."""
    bare = name.replace("[#]", "").replace("[]", "").replace("#", "")
    found = _LAST_BRACKETS.search(bare)
    last = re.split(r"[_\s]+", bare.strip("_ "))[-1]
    alike = last != bare and bool(_LIKE_UNIT.fullmatch(last)) and last.lower() != "return" and not words_of(last) & (SAID | TIME | BESIDE)
    suffix = last.lower() in _NO_UNITS or (alike and not unit_suffix(last))
    return unread_unit(found[1]) if found else last if suffix else ""
