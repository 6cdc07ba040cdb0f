"""Columns of which nothing is made, but whose names look like what a log lacks: asked about in messages, never acted upon."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence

from .names import KEYS
from .told_units import unread_in
from .units import expected_units, split_unit, unit_of

#: Words by which people name a quantity.
_TORQUE = frozenset({"torque", "torques", "tau", "effort", "efforts", "trq", "moment", "force"})
_CURRENT = frozenset({"current", "currents", "curr", "cur", "amps", "amp", "ampere"})
_POSITION = frozenset({"position", "positions", "pos", "angle", "angles", "theta", "q"})
_WORDS = {
    "q": _POSITION, "q_motor": _POSITION, "tau_joint": _TORQUE, "tau_motor": _TORQUE, "tau_current": _CURRENT | {"effort", "efforts"},
}  # fmt: skip
#: Words that say nothing of which joint it is.
_BESIDE = frozenset(
    {"joint", "j", "axis", "ax", "link", "motor", "mot", "m", "drive", "measured", "meas", "actual", "act", "sensor", "of", "raw"}
)
#: Words that make something else of it.
_OTHER = frozenset({"limit", "max", "min", "constant", "const", "std", "error", "temperature", "enabled", "rate", "offset", "ratio"})
#: Symbols that may be torques: M1 …, T1 …, u1 ….
_SYMBOL = re.compile(r"[MTFu]_?(\d+)")
#: Columns named in a question, at most.
_MOST = 3


def lookalikes(columns: Sequence[str], quantity: str, wanted: Collection[int], names: Sequence[str]) -> dict[int, str]:
    """Joint (of `wanted`, counted from 0) → the first of `columns` whose name looks like its `quantity`. `names`: of all joints, () if
    they are not known. One column is taken for the one joint that lacks it, unless its name tells another."""
    found: dict[int, str] = {}
    told = {column: rest for column in columns if (rest := _rest(column, _WORDS[quantity], quantity)) is not None}
    first = 0 if {"0"} in told.values() else 1
    last = next(iter(wanted)) if len(wanted) == len(told) == 1 else None
    for column, rest in told.items():
        joint = _joint(rest, wanted, names, first)
        joint = last if joint is None else joint
        if joint is not None and joint in wanted:
            found.setdefault(joint, column)
    return found


def question(found: Mapping[int, str], quantity: str, beside: str = "") -> str:
    """The question whether columns hold a quantity, and how to say so, with a remark beside that; "" where there is none."""
    if not found:
        return ""
    pairs = sorted(found.items())[:_MOST]
    more = " …" if len(found) > _MOST else ""
    said = ", ".join(f'{KEYS[quantity]}{j + 1} = "{column}"' for j, column in pairs)
    meant = _listed([column for _, column in pairs])
    return f"did you mean {meant}{more}? If so, map it under [columns] of a study file: {said}{more}{beside}."


def torque_question(columns: Sequence[str], joints: Iterable[int], names: Sequence[str]) -> str:
    """`question` for a log without any torque, whose columns may be torques or currents; "" where none looks like it."""
    wanted = list(joints)
    for quantity in ("tau_joint", "tau_current"):
        beside = "" if quantity == "tau_current" else " (tau_m1 … if they are motor torques)"
        if asked := question(lookalikes(columns, quantity, wanted, names), quantity, beside):
            return asked
    symbols = {int(found[1]) - 1: column for column in columns if (found := _SYMBOL.fullmatch(_stem(column, "tau_joint")))}
    whole = symbols if sorted(symbols) == wanted else {}
    return question(whole, "tau_joint", " (tau_m1 … if they are motor torques)")


def _rest(column: str, words: frozenset[str], quantity: str) -> frozenset[str] | None:
    """The words of a column's name that say which joint it is of; None where the name is not one of `quantity`."""
    if unread_in(column):
        return None  # its unit is to be told first
    stem = _stem(column, quantity)
    if not stem:
        return None
    parts = _parts(stem)
    # An angle or a length under a joint's name needs no word for what it is.
    if not (parts & words or (words is _POSITION and stem != column)) or parts & _OTHER:
        return None
    return parts - words - _BESIDE


def _stem(column: str, quantity: str) -> str:
    """A column's name without its unit; "" where that is a unit of something else than the quantity. What ends in _m may also be a name."""
    stem, unit = split_unit(column)
    if unit is None or unit_of(unit).dimension in expected_units(quantity):
        return stem
    return column if unit.lower() == "m" else ""


def _joint(rest: frozenset[str], wanted: Collection[int], names: Sequence[str], first: int) -> int | None:
    """The joint that these words tell, by its name or by its number counted from `first`; None where it is not clear."""
    if not rest:
        return None
    own = [_parts(name) - _BESIDE for name in names]
    number = next((int(word) for word in rest if word.isdecimal()), None) if len(rest) == 1 else None
    # A bare number is that of the names only where each has one.
    if number is None or all(any(word.isdecimal() for word in parts) for parts in own):
        matches = [j for j, parts in enumerate(own) if rest <= parts]
        lacking = [j for j in matches if j in wanted] or matches
        if len(lacking) == 1:
            return lacking[0]
    return None if number is None else number - first


def _parts(name: str) -> frozenset[str]:
    """Words and numbers of a name, small: "tauShoulder_3" → tau, shoulder, 3."""
    return frozenset(word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name))


def _listed(names: Sequence[str]) -> str:
    return " and ".join(", ".join(repr(n) for n in part) for part in (names[:-1], names[-1:]) if part)
