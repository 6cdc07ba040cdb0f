"""Which column of a log is what: names, aliases, units, and a user's own mapping (docs/formats.md).

Resolving names is separate from reading values: a `ColumnPlan` is made once from a header and applied to any number of
tables or pieces of tables that have these columns."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._utils.text import counted
from ..errors import ConfigurationError, DataError, unknown_name
from .hints import lookalikes, question, torque_question
from .names import KEYS, LOCKED, QUANTITIES, TEXT, Column, JointNames, known_units, parse_name
from .readers.header import AGAIN, seconds
from .units import Unit, bracketed, expected_units, is_unit, split_unit, unit_of

Array = np.ndarray
#: Characters of a column's name that messages show.
_SHOWN = 120
_EXAMPLE = 'Name them under [columns] of a study file, for example t = "clock", q1 = "angle 1", tau1 = "torque 1".'


@dataclass(frozen=True)
class ColumnPlan:
    """The resolved columns of a log. `joints`: names, where the header gives them; `extra`: columns that are nothing of ours; `hint`:
    where there is no torque, which of those look like it, as a question; `where`: the file, for messages; `wanted`: columns of desired
    motion (`q_ref`, `q_cmd` …) that are read with them; `rate_hz`: samples per second by which the time is counted, where there is none."""

    columns: tuple[Column, ...]
    n: int
    joints: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())
    hint: str = ""
    where: str = "log"
    wanted: tuple[Column, ...] = ()
    rate_hz: float | None = None

    @property
    def sources(self) -> tuple[str, ...]:
        """Columns of the file that must be read."""
        return tuple(dict.fromkeys(c.source for c in self.read))

    @property
    def read(self) -> tuple[Column, ...]:
        """All that is read."""
        return (*self.columns, *self.wanted)

    def on_clock(self, *columns: Column) -> ColumnPlan:
        """The same with other columns for the time, which add up."""
        return replace(self, columns=(*columns, *(c for c in self.columns if c.quantity != "t")))

    def quantity(self, name: str) -> tuple[Column, ...]:
        """The columns of one quantity."""
        return tuple(c for c in self.columns if c.quantity == name)

    def arrays(self, table: Mapping[str, Array]) -> dict[str, Array]:
        """SI arrays from raw columns (any number of rows): "t" (N,), every other quantity present (N, n), NaN where a joint has none."""
        out: dict[str, Array] = {}
        for quantity in (*QUANTITIES, *dict.fromkeys(c.quantity for c in self.wanted)):
            columns = tuple(c for c in self.read if c.quantity == quantity)
            if not columns:
                continue
            if quantity == "t" and len(columns) > 1:  # seconds, and a fraction of one
                out["t"] = sum(
                    (c.scale * np.asarray(table[c.source], float) for c in columns[1:]), np.asarray(table[columns[0].source], float)
                )
                continue
            rows = len(table[columns[0].source])
            array = np.full((rows, self.n), np.nan) if quantity != "t" else np.empty((rows, 1))
            for c in columns:
                values = np.asarray(table[c.source])
                if values.dtype.kind in "mM":
                    if quantity != "t":
                        raise DataError(f"{self.where}: column {c.source!r} holds times, not numbers; it cannot be {TEXT[quantity]}.")
                    # What is a time in the file has its unit there, whatever the column's name says.
                    array[:, c.joint] = seconds(values)
                    continue
                values = values.astype(float, copy=False)
                array[:, c.joint] = values if c.scale == 1.0 else values * c.scale
                if c.offset:
                    array[:, c.joint] += c.offset
            out[quantity] = array[:, 0] if quantity == "t" else array
        return out


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
    notes = [f"{where}: {_listed(sorted(twice))} occur more than once in the header, and are not used."] if twice else list[str]()
    found: dict[tuple[str, int], Column] = {}
    joints = None if joints is None else joints.counted([*(h for h in header if h not in _columns_of(mapping)), *(mapping or {})])
    idle: list[str] = []
    automatic = _take_mapped(mapping, header, joints, where, notes, found, idle)
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
    if joints is not None and idle:
        notes.append(
            f"{where}: the columns number all {len(joints.whole)} joints of the robot; those of what is locked ({_listed(joints.locked)})"
            f" are not used: {_listed(idle)}."
        )
    found = _without_surplus(found, mapping, joints, where, notes)
    notes += _from_zero(zero, found, numbered, joints, where)
    _refuse_other_joint(found.values(), joints, mapped, where)
    # Questions number the joints that are left, which is not how this log counts where some are locked.
    unknown = [] if joints is not None and joints.numbered else [h for h in header if h not in taken]
    n = _joint_count(found, joints, where, unknown)
    _check_units(found, joints, where, notes)
    found = _complete(found, n, joints, where, notes, unknown)
    columns = tuple(sorted(found.values(), key=lambda c: (QUANTITIES.index(c.quantity), c.joint)))
    known, used = (k if len(k := joints.names if joints else tuple(names)) == n else ()), {c.source for c in columns}
    hint = "" if any(c.quantity.startswith("tau") for c in columns) else torque_question(unknown, range(n), known)
    return ColumnPlan(columns, n, known, tuple(h for h in header if h not in used), tuple(notes), hint, where)


def _refuse_other_joint(columns: Iterable[Column], joints: JointNames | None, mapped: Container[str], where: str) -> None:
    """A column `q2` counts the second joint; where another joint is called q2, nobody knows which of the two is meant."""
    for c in columns:
        if joints is not None and c.source not in mapped and c.source in joints.names and joints.names.index(c.source) != c.joint:
            raise ConfigurationError(
                f"{where}: column {c.source!r} would be joint {c.joint + 1} by its number ({joints.names[c.joint]}), but another joint"
                f" is named {c.source!r}. Say which is meant: name it '<joint>.position', or map the columns under [columns]."
            )


def _take_mapped(
    mapping: Mapping[str, Any] | None,
    header: Sequence[str],
    joints: JointNames | None,
    where: str,
    notes: list[str],
    found: dict[tuple[str, int], Column],
    idle: list[str],
) -> bool:
    """Put the columns that [columns] names into `found`, those of locked joints into `idle`. Whether numbers of unmapped columns still
    count the robot's joints."""
    automatic = True
    for key, value in (mapping or {}).items():
        target = parse_name(key, joints)
        if target is not None and target.joint == LOCKED:
            idle.append(key)
            continue
        column = _mapped(key, value, header, joints, where, notes)
        found[column.quantity, column.joint] = column
        own = parse_name(column.source, joints)
        if own is not None and own.quantity == column.quantity != "t" and own.joint != column.joint:
            automatic = False  # the mapping renumbers joints: unmapped numbered columns keep a numbering that is not the robot's
    return automatic


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


def _without_surplus(
    found: dict[tuple[str, int], Column], mapping: Mapping[str, Any] | None, joints: JointNames | None, where: str, notes: list[str]
) -> dict[tuple[str, int], Column]:
    """Where [columns] names the positions of all the robot's joints, further columns that look like joints are others'."""
    if joints is None or not mapping:
        return found
    mapped = {found[k].joint for k in found if k[0] in ("q", "q_motor") and found[k].source in _columns_of(mapping)}
    surplus = {k: c for k, c in found.items() if k[0] != "t" and c.joint >= len(joints.names)}
    if not surplus or len(mapped) < len(joints.names):
        return found
    notes.append(f"{where}: {_listed([repr(c.source) for c in surplus.values()])} are of no joint of the robot, and are not used.")
    return {k: c for k, c in found.items() if k not in surplus}


def _from_zero(
    zero: Mapping[str, str],
    found: Mapping[tuple[str, int], Column],
    numbered: Mapping[str, Sequence[Column]],
    joints: JointNames | None,
    where: str,
) -> list[str]:
    """Notes on columns of a joint 0, by quantity, which are not used. Raises DataError where the joints may be counted from there: the
    numbers must never be taken for those of the joints before."""
    positions = {j for quantity, j in found if quantity in ("q", "q_motor")}
    notes = []
    for quantity, source in zero.items():
        others = sorted(numbered.get(quantity, ()), key=lambda c: c.joint)
        if quantity in ("q", "q_motor"):
            # Without a robot, nothing tells q0 … q2 of three joints from those of two and a column more.
            shifted = not positions if not others else joints is None or others[-1].joint + 1 < max(len(joints.names), len(joints.whole))
        else:
            shifted = bool(others) and others[-1].joint < max(positions, default=0)
        if not shifted:
            notes.append(f"{where}: column {source!r} is not used: joints are counted from 1.")
            continue
        columns = [source, *(c.source for c in others)]
        said = ", ".join(f'{KEYS[quantity]}{j + 1} = "{column}"' for j, column in enumerate(columns))
        raise DataError(
            f"{where}: columns {_listed([repr(c) for c in columns])} seem to count the joints from 0, but joints are counted from 1."
            f" Say which is which under [columns] of a study file, for every column that is to be used: {said}."
        )
    return notes


def _mapped(key: str, value: Any, header: Sequence[str], joints: JointNames | None, where: str, notes: list[str]) -> Column:
    """One entry of the [columns] table."""
    target = parse_name(key, joints)
    if target is not None and target.joint < 0:
        raise ConfigurationError(f"[columns] {key}: joints are counted from 1.")
    if target is None:
        known = ["t", *(f"{s}1" for s in ("q", "dq", "ddq", "tau", "tau_m", "i", "q_m", "dq_m")), *(joints.names if joints else ())]
        raise unknown_name("quantity in [columns]", key, known)
    options: Mapping[str, Any] = {"column": value} if isinstance(value, str) else value
    if (
        not isinstance(options, Mapping)
        or not isinstance(options.get("column"), str)
        or set(options) - {"column", "unit", "scale", "offset"}
    ):
        raise ConfigurationError(
            f"[columns] {key}: give the name of a column as text, not {value!r}. A unit may stand in the key, as in q1_deg."
            ' From Python also a dict of "column" and any of "unit", "scale", "offset".'
        )
    source = options["column"]
    if source not in header:
        unknown = unknown_name(f"column of {where} in [columns] {key} =", source, header)
        raise ConfigurationError(f"{unknown}. [columns] holds for every log, validation logs too: rename the columns of one that differs.")
    suffix = options.get("unit") or target.unit or None
    if suffix is not None and not is_unit(suffix):
        raise unknown_name(f"unit in [columns] {key}", suffix, known_units(target.quantity))
    guessed = split_unit(source)[1] if suffix is None else None
    if guessed is not None and unit_of(guessed).dimension in expected_units(target.quantity):
        suffix = guessed
    elif guessed is not None and not (len(guessed) == 1 and not source.endswith((guessed, f"{guessed}]", f"{guessed})"))):
        notes.append(f"{where}: {guessed}, on which {source!r} ends, is not a unit of {TEXT[target.quantity]}; SI is assumed.")
    elif suffix is None and "scale" not in options and bracketed(source)[1] and not _is_element(source, header):
        notes.append(f"{where}: what stands in the brackets of {source!r} is no unit that is known; SI is assumed.")
    own = split_unit(source)[1]
    if suffix is not None and own is not None and unit_of(own).dimension == unit_of(suffix).dimension and own != unit_of(suffix).name:
        notes.append(f"{where}: column {source!r} says {own}, but [columns] {key} says {unit_of(suffix).name}, which is what counts.")
    unit = Unit("", "", 1.0)
    if suffix is not None:
        replace(target, unit=suffix).column(source, where)  # refuses a unit of something else
        unit = unit_of(suffix)
    try:
        scale, offset = float(options.get("scale", 1.0)), float(options.get("offset", 0.0))
    except (TypeError, ValueError):
        raise ConfigurationError(f"[columns] {key}: scale and offset must be numbers.") from None
    return Column(source, target.quantity, target.joint, unit.scale * scale, unit.scale * offset, suffix or "")


def _is_element(source: str, header: Sequence[str]) -> bool:
    """Whether what stands in the brackets of a column's name counts or names an element: other columns differ from it in that alone."""
    stem, inside = bracketed(source)
    return any(stem == other and inside != told for other, told in map(bracketed, header))


def _joint_count(found: Mapping[tuple[str, int], Column], joints: JointNames | None, where: str, unknown: Sequence[str]) -> int:
    sides = [sorted({j for quantity, j in found if quantity == side}) for side in ("q", "q_motor")]
    positions = sides[0] if len(sides[0]) >= len(sides[1]) else sides[1]
    others = sorted({j for quantity, j in found if quantity != "t"})
    if not positions:
        names = joints.names if joints else ()
        neither = "" if ("t", 0) in found else ", and no time (t or time, in s; or --rate-hz, the samples per second)"
        asked = question(lookalikes(unknown, "q", range(len(names) or len(unknown)), names), "q")
        asked = (
            asked[:1].upper() + asked[1:]
            or 'Name them under [columns] of a study file, for example t = "clock", q1 = "angle 1", tau1 = "torque 1".'
        )
        if torque := torque_question(unknown, range(len(names) or len(unknown)), names):
            asked += f" Torques: {torque}"
        raise DataError(
            f"{where}: no joint position found (q1, q2, … or q_m1, … or <joint>.position){neither}."
            f" Columns not understood: {_listed(unknown) or 'none'}."
            f" {asked}"
        )
    count = len(joints.names) if joints else positions[-1] + 1
    missing = [j for j in range(count) if j not in positions]
    surplus = [j for j in positions if j >= count]
    if missing or surplus:
        have = _listed([found.get(("q", j), found.get(("q_motor", j))).source for j in positions])  # type: ignore[union-attr]
        expected = f"the robot has {counted(count, 'joint')}" if joints else f"the columns go up to joint {count}"
        what = (
            f"missing: {_listed([_label(j, joints) for j in missing])}"
            if missing
            else f"too many: {_listed([f'q{j + 1}' for j in surplus])}"
        )
        side = "q" if positions is sides[0] else "q_motor"
        asked = question(lookalikes(unknown, side, missing, joints.names if joints else ()), side)
        raise DataError(
            f"{where}: wrong joint count: {expected}, but the log has positions of {len(positions)} ({have}); {what}"
            f"{f'; {asked}' if asked else '.'}"
            f" {_what_to_do(joints)}"
        )
    stray = [j for j in others if j >= count]
    if stray:
        raise DataError(
            f"{where}: columns of joint {stray[0] + 1}, but {'the robot' if joints else 'the log'}"
            f" has {counted(count, 'joint')} with positions."
        )
    if ("t", 0) not in found:
        raise DataError(
            f"{where}: no time column (t or time, in s, or with a unit as in time_ms{_unread_time(unknown)})."
            f" Columns not understood: {_listed(unknown) or 'none'}."
            ' Name it under [columns] of a study file: t = "...", or tell the samples per second: [logs] rate_hz = 500 (--rate-hz 500).'
        )
    return count


def _unread_time(columns: Sequence[str]) -> str:
    """What is said of a column of time whose unit is not known."""
    for name in columns:
        stem, unit = bracketed(name)
        if unit and (named := parse_name(stem)) is not None and named.quantity == "t":
            return f'; {name!r} is in {unit!r}, which is no unit of time that is known: t = {{ column = "{name}", scale = … }}'
    return ""


def _columns_of(mapping: Mapping[str, Any] | None) -> set[Any]:
    """The file's columns that a mapping names."""
    return {value.get("column") if isinstance(value, Mapping) else value for value in (mapping or {}).values()}


def _what_to_do(joints: JointNames | None) -> str:
    """How to bring a log and a robot with other numbers of joints together."""
    if joints is None or not joints.locked:
        return (
            "Choose the robot that was logged, lock the joints that were not ([robot] locked), or map columns under [columns] of a study"
            " file."
        )
    left = f"{len(joints.names)} joints that are left ({_listed(joints.names)})"
    return (
        f"Locked: {_listed(joints.locked)}. Number the columns by the {left} or by all {len(joints.whole)} of the robot, name them"
        " <joint>.position, or map them under [columns] of a study file."
    )


def _label(j: int, joints: JointNames | None) -> str:
    return f"q{j + 1} ({joints.names[j]})" if joints else f"q{j + 1}"


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
        missing = _listed([joints.names[j] if joints else f"joint {j + 1}" for j in lacking])
        if quantity.startswith("tau"):
            asked = question(lookalikes(unknown, quantity, lacking, joints.names if joints else ()), quantity)
            notes.append(f"{where}: no {TEXT[quantity]} logged for {missing}{f'; {asked}' if asked else '.'}")
        else:
            notes.append(f"{where}: {TEXT[quantity]} is not logged for {missing}, so no {TEXT[quantity]} is taken from the log.")
            out = {k: v for k, v in out.items() if k[0] != quantity}
    return out


def _listed(items: Sequence[str], most: int = 12) -> str:
    shown = (item if len(item) <= _SHOWN else f"{item[:_SHOWN]}…" for item in items[:most])  # of a text that is garbled, a name is long
    return ", ".join(shown) + (" …" if len(items) > most else "")
