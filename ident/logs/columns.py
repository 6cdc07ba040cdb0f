"""Which column of a log is what: names, aliases, units, and a user's own mapping (docs/formats.md).

Resolving names is separate from reading values: a `ColumnPlan` is made once from a header and applied to any number of
tables or pieces of tables that have these columns."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from .._utils.text import listed
from ..errors import ConfigurationError, DataError
from .column_mapping import columns_of, take_mapped
from .column_plan import ColumnPlan
from .hints import lookalikes, question, torque_question
from .joint_count import from_zero, joint_count, without_surplus
from .names import LOCKED, QUANTITIES, TEXT, Column, JointNames, parse_name
from .readers.header import AGAIN
from .units import unit_of

Array = np.ndarray


def resolve_columns(
    header: Sequence[str],
    joints: JointNames | None = None,
    mapping: Mapping[str, Any] | None = None,
    *,
    where: str = "log",
    units: Mapping[str, str] | None = None,
) -> ColumnPlan:
    """Resolve a header into a plan. `units`: suffixes of units that the file tells beside the names.

    `joints`: the robot's joints; without them their number is taken from the columns. `mapping`: quantity (`q1`, `tau_m2`,
    `t`, `<joint>.position`, or with a unit, `q1_deg`) → column name; from Python, where a sign or an offset is wanted, also a dict of
    "column" and any of "unit", "scale", "offset" (SI value = unit * (scale * x + offset)). `where` names the file in messages.
    Raises ConfigurationError for a wrong mapping or unit, DataError where columns are missing or too many."""
    header, twice = _named_once(header)
    notes = [f"{where}: {listed(sorted(twice))} occur more than once in the header, and are not used."] if twice else list[str]()
    found: dict[tuple[str, int], Column] = {}
    joints = None if joints is None else joints.counted([*(h for h in header if h not in columns_of(mapping)), *(mapping or {})])
    idle: list[str] = []
    automatic = take_mapped(mapping, header, joints, where, notes, found, idle)
    taken = set(mapped := {c.source for c in found.values()})
    if not automatic and any((p := parse_name(h, joints)) is not None and p.quantity != "t" for h in header if h not in taken):
        notes.append(f"{where}: [columns] renumbers joints, so only mapped columns are used (besides time).")
    _refuse_twice([h for h in twice if h in mapped], where)
    names: list[str] = []
    zero: dict[str, str] = {}
    numbered: dict[str, list[Column]] = {}
    for source in header:
        if source in taken:
            continue
        named = parse_name(source, joints, names)
        if named is None or (not automatic and named.quantity != "t"):
            continue
        _refuse_twice([source] if source in twice else [], where)
        if named.joint == LOCKED:
            idle.append(source)
            continue
        if named.joint < 0:
            zero.setdefault(named.quantity, source)
            continue
        parsed = replace(named, unit=named.unit or (units or {}).get(source, "")).column(source, where)
        if named.numbered:
            numbered.setdefault(named.quantity, []).append(parsed)
        present = found.get((parsed.quantity, parsed.joint))
        if present is None:
            found[parsed.quantity, parsed.joint] = parsed
            taken.add(source)
        elif present.source not in mapped:
            notes.append(f"{where}: columns {present.source!r} and {source!r} hold the same quantity; the first is used.")
    notes += _locked_note(idle, joints, where)
    found = without_surplus(found, mapping, joints, where, notes)
    notes += from_zero(zero, found, numbered, joints, where)
    _refuse_other_joint(found.values(), joints, mapped, where)
    # Questions number the joints that are left, which is not how this log counts where some are locked.
    unknown = [] if joints is not None and joints.numbered else [h for h in header if h not in taken]
    n = joint_count(found, joints, where, unknown)
    _check_units(found, joints, where, notes)
    found = _complete(found, n, joints, where, notes, unknown)
    known = k if len(k := joints.names if joints else tuple(names)) == n else ()
    return _plan_of(found, header, n, known, unknown, notes, where)


def _plan_of(
    found: Mapping[tuple[str, int], Column], header: Sequence[str], n: int, known: tuple[str, ...], unknown: Sequence[str],
    notes: Sequence[str], where: str,
) -> ColumnPlan:  # fmt: skip
    """The plan of columns that were `found` for n joints, whose names are `known`; the question for a torque among the `unknown` ones."""
    columns = tuple(sorted(found.values(), key=lambda c: (QUANTITIES.index(c.quantity), c.joint)))
    used = {c.source for c in columns}
    hint = "" if any(c.quantity.startswith("tau") for c in columns) else torque_question(unknown, range(n), known)
    return ColumnPlan(columns, n, known, tuple(h for h in header if h not in used), tuple(notes), hint, where)


def _locked_note(idle: Sequence[str], joints: JointNames | None, where: str) -> list[str]:
    """A note on columns of locked joints, which are `idle`; empty where there are none."""
    if joints is None or not idle:
        return []
    whole, locked = len(joints.whole), listed(joints.locked)
    return [f"{where}: the columns number all {whole} joints of the robot; those of locked joints ({locked}) are not used: {listed(idle)}."]


def _refuse_other_joint(columns: Iterable[Column], joints: JointNames | None, mapped: Container[str], where: str) -> None:
    """A column `q2` counts the second joint; where another joint is called q2, nobody knows which of the two is meant."""
    for c in columns:
        if joints is not None and c.source not in mapped and c.source in joints.names and joints.names.index(c.source) != c.joint:
            raise ConfigurationError(
                f"{where}: column {c.source!r} would be joint {c.joint + 1} by its number ({joints.names[c.joint]}), but another joint"
                f" is named {c.source!r}. Make clear which is meant: name it '<joint>.position', or map the columns under [columns]."
            )


def _named_once(header: Sequence[str]) -> tuple[Sequence[str], set[str]]:
    """The header without columns that stand there again, and the names of such."""
    plain = [h for h in header if AGAIN not in h]
    twice = {h.split(AGAIN)[0] for h in header if AGAIN in h}
    counts: dict[str, int] = {}
    for h in plain:
        counts[h] = counts.get(h, 0) + 1
    twice |= {h for h, k in counts.items() if k > 1}
    return list(dict.fromkeys(plain)), twice - {""}


def _refuse_twice(names: Sequence[str], where: str) -> None:
    if names:
        raise DataError(f"{where}: column {names[0]!r} occurs more than once in the header. Rename one of them.")


def _check_units(found: dict[tuple[str, int], Column], joints: JointNames | None, where: str, notes: list[str]) -> None:
    """Angle or length, torque or force, as the joint's kind asks; only on the joint side, where the kind is known."""
    if joints is None:
        return
    for (quantity, j), column in found.items():
        if not column.unit or quantity not in ("q", "dq", "ddq", "tau_joint"):
            continue
        linear = unit_of(column.unit).dimension in ("length", "speed", "linear acceleration", "force")
        if linear == joints.prismatic[j]:
            continue
        kind = "prismatic" if joints.prismatic[j] else "revolute"
        text = f"column {column.source!r} is in {column.unit}, but joint {joints.names[j]!r} is {kind}"
        if unit_of(column.unit).scale != 1.0:
            raise ConfigurationError(f"{where}: {text}. Correct the unit in the column's name, or the robot.")
        notes.append(f"{where}: {text}; the number is taken as SI.")


def _complete(
    found: dict[tuple[str, int], Column], n: int, joints: JointNames | None, where: str, notes: list[str], unknown: Sequence[str]
) -> dict[tuple[str, int], Column]:
    """Drop quantities that are measured on some joints only, unless it is torque, which may be."""
    out = dict(found)
    for quantity in QUANTITIES[1:]:
        have = [j for q, j in found if q == quantity]
        if not have or len(have) == n:
            continue
        lacking = [j for j in range(n) if j not in have]
        missing = listed([joints.names[j] if joints else f"joint {j + 1}" for j in lacking])
        if quantity.startswith("tau"):
            asked = question(lookalikes(unknown, quantity, lacking, joints.names if joints else ()), quantity)
            notes.append(f"{where}: no {TEXT[quantity]} logged for {missing}{f'; {asked}' if asked else '.'}")
        else:
            notes.append(f"{where}: {TEXT[quantity]} is not logged for {missing}, so no {TEXT[quantity]} is taken from the log.")
            out = {k: v for k, v in out.items() if k[0] != quantity}
    return out
