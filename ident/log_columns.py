"""Which column of a log is what: names, aliases, units, and a user's own mapping (DESIGN.md 3.1).

Resolving names is separate from reading values: a `ColumnPlan` is made once from a header and applied to any number of
tables or pieces of tables that have these columns."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .errors import ConfigurationError, DataError, unknown_name
from .log_files import seconds
from .log_hints import lookalikes, question, torque_question
from .log_units import Unit, bracketed, expected_units, is_unit, split_unit, unit_of

Array = np.ndarray

#: Quantities a log may hold. Torque is kept by what was logged: on the joint side, on the motor side, or as a motor current.
QUANTITIES = ("t", "q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "tau_joint", "tau_motor", "tau_current")
_SYMBOL = re.compile(r"^(?P<symbol>ddq|dq|q|tau|i)(?P<motor>_?m)?_?(?P<joint>[0-9]+)$", re.IGNORECASE)
_BY_NAME = re.compile(r"^(?P<joint>.+)[./](?P<word>position|velocity|acceleration|effort|torque|current)$", re.IGNORECASE)
_WORDS = {
    "position": "q", "velocity": "dq", "acceleration": "ddq", "effort": "tau_joint", "torque": "tau_joint", "current": "tau_current",
}  # fmt: skip
_TEXT = {
    "t": "time", "q": "position", "dq": "velocity", "ddq": "acceleration", "q_motor": "motor position", "dq_motor": "motor velocity",
    "ddq_motor": "motor acceleration", "tau_joint": "torque", "tau_motor": "motor torque", "tau_current": "current",
}  # fmt: skip


@dataclass(frozen=True)
class JointNames:
    """What a log's columns are matched against: joint names in order, and which joints are prismatic."""

    names: tuple[str, ...]
    prismatic: tuple[bool, ...]


@dataclass(frozen=True)
class Column:
    """One column of a file as one quantity: SI value = scale * value + offset. `joint` counts from 0 (0 for time)."""

    source: str
    quantity: str
    joint: int
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""


@dataclass(frozen=True)
class ColumnPlan:
    """The resolved columns of a log. `joints`: names, where the header gives them; `extra`: columns that are nothing of ours; `hint`:
    where there is no torque, which of those look like it, as a question; `where`: the file, for messages."""

    columns: tuple[Column, ...]
    n: int
    joints: tuple[str, ...] = ()
    extra: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())
    hint: str = ""
    where: str = "log"

    @property
    def sources(self) -> tuple[str, ...]:
        """Columns of the file that must be read."""
        return tuple(dict.fromkeys(c.source for c in self.columns))

    def quantity(self, name: str) -> tuple[Column, ...]:
        """The columns of one quantity."""
        return tuple(c for c in self.columns if c.quantity == name)

    def arrays(self, table: Mapping[str, Array]) -> dict[str, Array]:
        """SI arrays from raw columns (any number of rows): "t" (N,), every other quantity present (N, n), NaN where a joint has none."""
        out: dict[str, Array] = {}
        for quantity in QUANTITIES:
            columns = self.quantity(quantity)
            if not columns:
                continue
            rows = len(table[columns[0].source])
            array = np.full((rows, self.n), np.nan) if quantity != "t" else np.empty((rows, 1))
            for c in columns:
                values = np.asarray(table[c.source])
                if values.dtype.kind in "mM":
                    if quantity != "t":
                        raise DataError(f"{self.where}: column {c.source!r} holds times, not numbers; it cannot be {_TEXT[quantity]}.")
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
) -> ColumnPlan:
    """Resolve a header into a plan.

    `joints`: the robot's joints; without them their number is taken from the columns. `mapping`: quantity (`q1`, `tau_m2`,
    `t`, `<joint>.position`, or with a unit, `q1_deg`) → column name; from Python, where a sign or an offset is wanted, also a dict of
    "column" and any of "unit", "scale", "offset" (SI value = unit * (scale * x + offset)). `where` names the file in messages.
    Raises ConfigurationError for a wrong mapping or unit, DataError where columns are missing or too many."""
    duplicate = sorted({h for h in header if list(header).count(h) > 1})
    if duplicate:
        raise DataError(f"{where}: column {duplicate[0]!r} occurs more than once in the header. Rename one of them.")
    notes: list[str] = []
    found: dict[tuple[str, int], Column] = {}
    taken: set[str] = set()
    automatic = True
    for key, value in (mapping or {}).items():
        column = _mapped(key, value, header, joints, where, notes)
        found[column.quantity, column.joint] = column
        taken.add(column.source)
        own = _parse(column.source, joints, where, strict=False)
        if own is not None and own.quantity == column.quantity != "t" and own.joint != column.joint:
            automatic = False  # the mapping renumbers joints: unmapped numbered columns keep a numbering that is not the robot's
    if not automatic:
        notes.append(f"{where}: [columns] renumbers joints, so only mapped columns are used (besides time).")
    mapped = set(taken)
    names: list[str] = []
    for source in header:
        if source in taken:
            continue
        parsed = _parse(source, joints, where, strict=True, names=names)
        if parsed is None or (not automatic and parsed.quantity != "t"):
            continue
        present = found.get((parsed.quantity, parsed.joint))
        if present is None:
            found[parsed.quantity, parsed.joint] = parsed
            taken.add(source)
        elif present.source not in mapped:
            notes.append(f"{where}: columns {present.source!r} and {source!r} hold the same quantity; the first is used.")
    unknown = [h for h in header if h not in taken]
    n = _joint_count(found, joints, where, unknown)
    _check_units(found, joints, where, notes)
    found = _complete(found, n, joints, where, notes, unknown)
    columns = tuple(sorted(found.values(), key=lambda c: (QUANTITIES.index(c.quantity), c.joint)))
    used = {c.source for c in columns}
    known = joints.names if joints else tuple(names)
    known = known if len(known) == n else ()
    hint = "" if any(c.quantity.startswith("tau") for c in columns) else torque_question(unknown, range(n), known)
    return ColumnPlan(columns, n, known, tuple(h for h in header if h not in used), tuple(notes), hint, where)


def _parse(source: str, joints: JointNames | None, where: str, *, strict: bool, names: list[str] | None = None) -> Column | None:
    """What the contract says about a column's name, or None. `names` collects joint names when the robot is not known."""
    name = source.strip().strip('"')
    stem, unit = split_unit(name)
    for candidate, suffix in ((name, None), (stem, unit)):
        if candidate.lower() in ("t", "time", "%time", "timestamp"):
            return _with_unit(source, "t", 0, suffix or ("ns" if candidate == "%time" else None), where, strict)
        match = _SYMBOL.match(candidate)
        if match:
            quantity = match["symbol"].lower()
            if quantity == "i":
                if match["motor"]:
                    continue
                quantity = "tau_current"
            elif quantity == "tau":
                quantity = "tau_motor" if match["motor"] else "tau_joint"
            elif match["motor"]:
                quantity += "_motor"
            joint = int(match["joint"]) - 1
            if joint < 0:
                raise DataError(f"{where}: column {source!r}: joints are counted from 1.")
            return _with_unit(source, quantity, joint, suffix, where, strict)
        match = _BY_NAME.match(candidate)
        if match:
            quantity = _WORDS[match["word"].lower()]
            if quantity == "tau_joint" and suffix and unit_of(suffix).dimension == "current":
                quantity = "tau_current"
            index = _joint_of(match["joint"], joints, names)
            return None if index is None else _with_unit(source, quantity, index, suffix, where, strict)
    return None


def _joint_of(name: str, joints: JointNames | None, names: list[str] | None) -> int | None:
    """Index of a joint given by name, which may be the end of a path (`/joint_states/elbow`)."""
    last = re.split(r"[./]", name)[-1]
    if joints is not None:
        for candidate in (name, last):
            if candidate in joints.names:
                return joints.names.index(candidate)
        return None
    if names is None:
        return None
    if name not in names:
        names.append(name)
    return names.index(name)


def _with_unit(source: str, quantity: str, joint: int, suffix: str | None, where: str, strict: bool) -> Column | None:
    if suffix is None:
        return Column(source, quantity, joint)
    unit = unit_of(suffix)
    if unit.dimension not in expected_units(quantity):
        if not strict:
            return None
        raise ConfigurationError(
            f"{where}: column {source!r}: {suffix} is not a unit of {_TEXT[quantity]} ({', '.join(_known_suffixes(quantity))})."
            " Rename the column, or name the quantity it holds under [columns]."
        )
    return Column(source, quantity, joint, unit.scale, 0.0, suffix)


def _known_suffixes(quantity: str) -> list[str]:
    from .log_units import UNITS

    return [u.name for u in UNITS.values() if u.dimension in expected_units(quantity)]


def _mapped(key: str, value: Any, header: Sequence[str], joints: JointNames | None, where: str, notes: list[str]) -> Column:
    """One entry of the [columns] table."""
    target = _parse(key, joints, where, strict=True, names=None)
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
        raise unknown_name(f"column of {where} in [columns] {key} =", source, header)
    suffix = options.get("unit") or target.unit or None
    if suffix is not None and not is_unit(suffix):
        raise unknown_name(f"unit in [columns] {key}", suffix, _known_suffixes(target.quantity))
    guessed = split_unit(source)[1] if suffix is None else None
    if guessed is not None and unit_of(guessed).dimension in expected_units(target.quantity):
        suffix = guessed
    elif guessed is not None:
        notes.append(f"{where}: {guessed}, on which {source!r} ends, is not a unit of {_TEXT[target.quantity]}; SI is assumed.")
    elif suffix is None and bracketed(source)[1]:
        notes.append(f"{where}: what stands in the brackets of {source!r} is no unit that is known; SI is assumed.")
    own = split_unit(source)[1]
    if suffix is not None and own is not None and unit_of(own).dimension == unit_of(suffix).dimension and own != unit_of(suffix).name:
        notes.append(f"{where}: column {source!r} says {own}, but [columns] {key} says {unit_of(suffix).name}, which is what counts.")
    unit = Unit("", "", 1.0)
    if suffix is not None:
        checked = _with_unit(source, target.quantity, target.joint, suffix, where, strict=True)
        assert checked is not None
        unit = unit_of(suffix)
    try:
        scale, offset = float(options.get("scale", 1.0)), float(options.get("offset", 0.0))
    except (TypeError, ValueError):
        raise ConfigurationError(f"[columns] {key}: scale and offset must be numbers.") from None
    return Column(source, target.quantity, target.joint, unit.scale * scale, unit.scale * offset, suffix or "")


def _joint_count(found: Mapping[tuple[str, int], Column], joints: JointNames | None, where: str, unknown: Sequence[str]) -> int:
    sides = [sorted({j for quantity, j in found if quantity == side}) for side in ("q", "q_motor")]
    positions = sides[0] if len(sides[0]) >= len(sides[1]) else sides[1]
    others = sorted({j for quantity, j in found if quantity != "t"})
    if not positions:
        names = joints.names if joints else ()
        asked = question(lookalikes(unknown, "q", range(len(names) or len(unknown)), names), "q")
        raise DataError(
            f"{where}: no joint position found (q1, q2, … or q_m1, … or <joint>.position)."
            f" Columns not understood: {_listed(unknown) or 'none'}."
            f" {asked[:1].upper() + asked[1:] if asked else 'Name them under [columns], for example q1 = angle.'}"
        )
    count = len(joints.names) if joints else positions[-1] + 1
    missing = [j for j in range(count) if j not in positions]
    surplus = [j for j in positions if j >= count]
    if missing or surplus:
        have = _listed([found.get(("q", j), found.get(("q_motor", j))).source for j in positions])  # type: ignore[union-attr]
        expected = f"the robot has {count} joints" if joints else f"the columns go up to joint {count}"
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
            " Choose the robot that was logged, lock the joints that were not ([robot] locked), or map columns under [columns]."
        )
    stray = [j for j in others if j >= count]
    if stray:
        raise DataError(
            f"{where}: columns of joint {stray[0] + 1}, but {'the robot' if joints else 'the log'} has {count} joints with positions."
        )
    if ("t", 0) not in found:
        raise DataError(f'{where}: no time column (t or time, in s, or with a unit as in time_ms). Name it under [columns]: t = "...".')
    return count


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
            notes.append(f"{where}: no {_TEXT[quantity]} logged for {missing}{f'; {asked}' if asked else '.'}")
        else:
            notes.append(f"{where}: {_TEXT[quantity]} is not logged for {missing}, so no {_TEXT[quantity]} is taken from the log.")
            out = {k: v for k, v in out.items() if k[0] != quantity}
    return out


def _listed(items: Sequence[str], most: int = 12) -> str:
    return ", ".join(items[:most]) + (" …" if len(items) > most else "")
