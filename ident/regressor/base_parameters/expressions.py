"""Base parameters as a person reads them: `Izz_joint3 + Iyy_joint4 + 0.19 m_joint5`.

Terms stand from the base to the tip; within a link moments of inertia come before first moments and those before the mass
(the order in which Gautier's regrouping keeps them), so that the first term is the parameter the others are grouped into."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ...robots.parameters import LINK_SYMBOLS, LINK_UNITS

Array = np.ndarray

#: Which symbol of a link stays before which, when only one of them can (Gautier 1991, axis z): indices into LINK_SYMBOLS.
LINK_PREFERENCE = (9, 4, 5, 7, 8, 1, 2, 3, 6, 0)
#: A coefficient below this share of the row's largest is rounding.
_NOISE = 1e-10
_RANK = {LINK_SYMBOLS[index]: place for place, index in enumerate(LINK_PREFERENCE)}


@lru_cache(maxsize=4096)
def coefficient_text(value: float) -> str:
    """A kinematic constant in as few digits as give it (up to nine), else in six."""
    if value == 1.0:
        return "1"
    digits = next((d for d in range(1, 10) if abs(float(f"{value:.{d}g}") - value) <= 2e-10 * abs(value)), 6)
    text = f"{value:.{digits}g}"
    if "e" in text and 1e-4 <= abs(value) < 1e7:
        return np.format_float_positional(float(text), trim="-")
    return text


def expression(row: Array, names: Sequence[str]) -> str:
    """Linear combination of the parameters `names` (k,) with the coefficients `row` (k,), as text.

    Coefficients of one are left out, those that are rounding (1e-10 of the largest) too; a row of zeros gives "0".
    A coefficient carries the unit of the base parameter (that of its first term) over the unit of its own parameter."""
    row = np.asarray(row, float)
    largest = float(np.abs(row).max(initial=0.0))
    if largest == 0.0:
        return "0"
    place, leading = _places(tuple(names))
    live = np.flatnonzero(np.abs(row) > _NOISE * largest).tolist()
    first = min(live, key=lambda i: leading[i])
    order = [first, *sorted((i for i in live if i != first), key=lambda i: place[i])]
    words: list[str] = []
    for i in order:
        value = float(row[i])
        size = coefficient_text(abs(value))
        sign = ("-" if value < 0 else "") if not words else (" - " if value < 0 else " + ")
        words.append(sign + ("" if size == "1" else f"{size} ") + names[i])
    return "".join(words)


def split_name(name: str) -> tuple[str, str]:
    """(symbol, joint) of a parameter's name: `Izz_joint3` gives ("Izz", "joint3")."""
    symbol, _, joint = name.partition("_")
    return symbol, joint


def link_parameter_names(bodies: Sequence[str]) -> tuple[str, ...]:
    """Names of the 10 inertial parameters of each body, in Pinocchio's order."""
    return tuple(f"{symbol}_{body}" for body in bodies for symbol in LINK_SYMBOLS)


def parameter_unit(name: str) -> str:
    """Unit of a link parameter or reflected rotor inertia, from its name; "" for any other."""
    symbol, _ = split_name(name)
    if symbol in LINK_SYMBOLS:
        return LINK_UNITS[LINK_SYMBOLS.index(symbol)]
    return "kg m^2" if symbol == "Ia" else ""


@lru_cache(maxsize=32)
def _places(names: tuple[str, ...]) -> tuple[list[tuple[int, int]], list[tuple[int, int, int]]]:
    """For each name: its place within an expression, and its rank as the leading term (link parameters lead)."""
    joints: dict[str, int] = {}
    place: list[tuple[int, int]] = []
    leading: list[tuple[int, int, int]] = []
    for index, name in enumerate(names):
        symbol, joint = split_name(name)
        link = symbol in _RANK and bool(joint)
        number = joints.setdefault(joint or name, len(joints))
        within = _RANK[symbol] if link else len(_RANK) + index
        place.append((number, within))
        leading.append((0 if link else 1, number, within))
    return place, leading
