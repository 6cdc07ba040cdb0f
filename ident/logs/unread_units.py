"""Channels beside positions of our own names whose unit nobody knows: never taken for SI, and always told."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from .channels import groups
from .column_plan import ColumnPlan
from .names import KEYS, parse_name
from .told_units import unread_in

#: What one of a unit is to be told in, by the key under [columns].
_SI = {"q": "rad (m)", "dq": "rad/s (m/s)", "ddq": "rad/s^2 (m/s^2)", "tau": "N m (N)", "i": "A"}


def unread_note(key: str, columns: Sequence[str], unit: str) -> str:
    """What is said of channels in a unit that nobody knows. `key`: theirs under [columns] (`tau1`)."""
    named = repr(columns[0]) if len(columns) == 1 else f"{columns[0]!r} … {columns[-1]!r}"
    are, more = ("is", "") if len(columns) == 1 else ("are", " …")
    si = _SI[key.rstrip("0123456789").removesuffix("_m")]
    return (
        f"{named} {are} in {unit!r}, which is not a known unit, and {are} not used: give its size in {si} under [columns] of a"
        f' study file, {key} = {{ column = "{columns[0]}", scale = … }}{more}.'
    )


def unread_beside(plan: ColumnPlan, units: Mapping[str, str]) -> tuple[str, ...]:
    """What is said of columns that are not used because their unit is not known, and would be otherwise. `units`: told of columns."""
    there = {(c.quantity, c.joint) for c in plan.columns}
    found: dict[tuple[str, str], list[tuple[int, str]]] = {}
    for name in plan.extra:
        unread = unread_in(name)
        stem = re.sub(r"[\s_\[(]*$", "", name.rpartition(unread)[0]) if unread else ""
        named = parse_name(stem, None, list(plan.joints)) if stem else None
        if named is not None and 0 <= named.joint < plan.n and (named.quantity, named.joint) not in there:
            found.setdefault((KEYS[named.quantity], unread), []).append((named.joint, name))
    said = []
    for (key, unit), members in found.items():
        (first, _), *_ = own = sorted(members)
        said.append(unread_note(f"{key}{first + 1}", [name for _, name in own], unit))
    told = {name for own in found.values() for _, name in own}
    have = {"tau" if quantity.startswith("tau") else quantity for quantity, _ in there}
    for g in groups(plan.extra, None, units):
        other = "tau" if g.quantity == "i" else g.quantity
        lacking = other in ("dq", "tau") and other not in have and len(g.columns) == plan.n
        if g.unread and lacking and not (g.wanted or g.estimated or told & set(g.columns)):
            said.append(unread_note(f"{g.quantity}1", g.columns, g.unread))
    return tuple(said)
