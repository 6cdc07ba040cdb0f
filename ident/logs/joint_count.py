"""Do the columns of a log fit the joints: joints that lack a position, joints too many, joints counted from 0, and what to do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .._utils.text import counted, listed
from ..errors import DataError
from .column_mapping import columns_of
from .hints import lookalikes, question, torque_question
from .names import KEYS, Column, JointNames, parse_name
from .units import bracketed


def without_surplus(
    found: dict[tuple[str, int], Column], mapping: Mapping[str, Any] | None, joints: JointNames | None, where: str, notes: list[str]
) -> dict[tuple[str, int], Column]:
    """Where [columns] names the positions of all the robot's joints, further columns that look like joints are others'."""
    if joints is None or not mapping:
        return found
    mapped = {found[k].joint for k in found if k[0] in ("q", "q_motor") and found[k].source in columns_of(mapping)}
    surplus = {k: c for k, c in found.items() if k[0] != "t" and c.joint >= len(joints.names)}
    if not surplus or len(mapped) < len(joints.names):
        return found
    notes.append(f"{where}: {listed([repr(c.source) for c in surplus.values()])} belong to no joint of the robot, and are not used.")
    return {k: c for k, c in found.items() if k not in surplus}


def from_zero(
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
            f"{where}: columns {listed([repr(c) for c in columns])} seem to count the joints from 0, but joints are counted from 1."
            f" Map every column that is to be used under [columns] of a study file: {said}."
        )
    return notes


def joint_count(found: Mapping[tuple[str, int], Column], joints: JointNames | None, where: str, unknown: Sequence[str]) -> int:
    """The number of joints of a log. Raises DataError where positions, or the time, are missing or do not fit the robot."""
    sides = [sorted({j for quantity, j in found if quantity == side}) for side in ("q", "q_motor")]
    positions = sides[0] if len(sides[0]) >= len(sides[1]) else sides[1]
    others = sorted({j for quantity, j in found if quantity != "t"})
    if not positions:
        names = joints.names if joints else ()
        neither = "" if ("t", 0) in found else ", and no time (t or time, in s; or give the sample rate with --rate-hz)"
        asked = question(lookalikes(unknown, "q", range(len(names) or len(unknown)), names), "q")
        asked = (
            asked[:1].upper() + asked[1:]
            or 'Map them under [columns] of a study file, for example t = "clock", q1 = "angle 1", tau1 = "torque 1".'
        )
        if torque := torque_question(unknown, range(len(names) or len(unknown)), names):
            asked += f" Torques: {torque}"
        raise DataError(
            f"{where}: no joint position found (q1, q2, … or q_m1, … or <joint>.position){neither}."
            f" Columns not understood: {listed(unknown) or 'none'}."
            f" {asked}"
        )
    count = len(joints.names) if joints else positions[-1] + 1
    missing = [j for j in range(count) if j not in positions]
    surplus = [j for j in positions if j >= count]
    if missing or surplus:
        have = listed([found.get(("q", j), found.get(("q_motor", j))).source for j in positions])  # type: ignore[union-attr]
        expected = f"the robot has {counted(count, 'joint')}" if joints else f"the columns go up to joint {count}"
        what = (
            f"missing: {listed([_label(j, joints) for j in missing])}" if missing else f"too many: {listed([f'q{j + 1}' for j in surplus])}"
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
            f" Columns not understood: {listed(unknown) or 'none'}."
            ' Map it under [columns] of a study file: t = "...", or give the sample rate, for example [logs] rate_hz = 500 (--rate-hz 500).'
        )
    return count


def _unread_time(columns: Sequence[str]) -> str:
    """What is said of a column of time whose unit is not known."""
    for name in columns:
        stem, unit = bracketed(name)
        if unit and (named := parse_name(stem)) is not None and named.quantity == "t":
            return f'; {name!r} is in {unit!r}, which is not a known unit of time: t = {{ column = "{name}", scale = … }}'
    return ""


def _what_to_do(joints: JointNames | None) -> str:
    """How to bring a log and a robot with other numbers of joints together."""
    if joints is None or not joints.locked:
        return (
            "Choose the robot that was logged, lock the joints that were not logged ([robot] locked), or map columns under"
            " [columns] of a study"
            " file."
        )
    left = f"{len(joints.names)} remaining joints ({listed(joints.names)})"
    return (
        f"Locked: {listed(joints.locked)}. Number the columns by the {left} or by all {len(joints.whole)} of the robot, name them"
        " <joint>.position, or map them under [columns] of a study file."
    )


def _label(j: int, joints: JointNames | None) -> str:
    return f"q{j + 1} ({joints.names[j]})" if joints else f"q{j + 1}"
