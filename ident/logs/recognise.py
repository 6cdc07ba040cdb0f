"""Recordings that name their channels otherwise: recognised by the structure of names, shapes and values, never by a file's name.

Columns that differ in one number (or one joint's name) are a group. What the group holds follows from the words of its name and its unit;
which is measured, wanted or estimated too. Time has its unit from its own numbers, or from positions and velocities that must agree."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from .._utils.text import counted
from ..errors import DataError
from .angles import agreed
from .channel_group import ChannelGroup, bare_name, known_scale
from .channels import groups
from .clocks import RecordedTime, time_of
from .companions import SAME, companions, moves, refuse_parts, side_of_motors
from .hands import driven_hands, left_hands
from .readers.header import seconds
from .recorders import EFFORTS, Recorder, recorder_of
from .references import references
from .told_units import unread_in
from .units import expected_units, split_unit, unit_of
from .words import HANDS, words_of

Array = np.ndarray
Reader = Callable[[Sequence[str]], Mapping[str, Array]]
#: Positions beyond so many turns are no radians.
_TURNS = 2.2
#: A turn of an encoder's counts, as usual.
_WHOLE = 3.0
#: Share of rows in which a time rises.
_RISING = 0.5
_QUANTITIES = {"t": "t", "q": "q", "dq": "dq", "tau": "tau_joint", "tau_m": "tau_motor", "i": "tau_current"}


@dataclass(frozen=True)
class RecordedChannels:
    """What a recording's columns are: `mapping` for `resolve_columns`, `reference` (key → column, factor, offset) of what was wanted, a
    `text` for people, and what was `ignored`. `recorder`: what wrote it, if that is known; `joints`: names, where they are told; `effort`:
    what the torque is, in words; `untimed`: where there is no time, what is wrong with the columns that seem to be one."""

    mapping: Mapping[str, Any]
    reference: Mapping[str, tuple[str, float, float]]
    text: str
    ignored: tuple[str, ...] = field(default=())
    recorder: str = ""
    joints: tuple[str, ...] = ()
    effort: str = ""
    notes: tuple[str, ...] = ()
    rate_hz: float | None = None
    untimed: str = ""


def recognised(
    names: Sequence[str], read: Reader, joints: Sequence[str] | None = None, units: Sequence[str] = (), rate_hz: float | None = None
) -> RecordedChannels | None:
    """What the columns of a recording are, None where no group of positions is among them.

    `read`: columns by name → values (N,); `joints`: the robot's, whose order counts where columns name joints; `units`: of the columns;
    `rate_hz`: samples per second, where they are told otherwise. Raises DataError where something must be asked."""
    unit_of_column = dict(zip(names, units, strict=False))
    recorder = recorder_of(names)
    found = groups(names, joints, unit_of_column, {} if recorder is None else recorder.channels)
    order = () if recorder is None or joints is None else named_alike(recorder.joints, joints)
    if order:
        found = [replace(g, joints=order) if not g.named and len(g.columns) == len(order) else g for g in found]
    fitting, positions = _fitting_positions(names, found, joints, unit_of_column, read)
    if not positions:
        return None
    table = _in_si(read, fitting)
    q = _best(positions, table)
    chosen, beside = companions(q, fitting, table, names, joints) if moves(table, q) else ({}, [])
    if not chosen:
        return None  # nothing there, or torque of some joints only: which is which must be asked
    if recorder is not None and recorder.effort == "current" and "tau" in chosen:
        chosen["i"] = chosen.pop("tau")
    scale, offset, counted = _position_scale(q, table, recorder)
    rate = _factor("dq", chosen["dq"], scale, counted, recorder) if "dq" in chosen else scale
    time = time_of(names, read, table, q, chosen.get("dq"), (scale, rate), unit_of_column)
    t = _seconds(time, read) if rate_hz is None else np.arange(len(table[q.columns[0]])) / rate_hz
    angles = agreed(q, chosen.get("dq"), (scale, rate), counted or recorder is not None, t, table)
    scale = angles.scale
    if "tau" in chosen and chosen["tau"].of_motors and not q.of_motors:
        geared, about = side_of_motors(chosen["tau"], [g for g in fitting if g.of_motors], q, table, scale, time, read)
        beside.append(about)
        chosen = {"tau_m" if geared and k == "tau" else k: g for k, g in chosen.items()}
    factors = {k: (_factor(k, g, scale, counted, recorder), 0.0) for k, g in chosen.items()}
    factors |= {"q": (scale, offset)} | ({"dq": (angles.rate, 0.0)} if "dq" in chosen else {})
    mapping = _mapping(chosen, factors)
    if time.column:
        mapping["t"] = _entry(time.column, "t", time.factor)
    wanted, order_notes = references(fitting, q, table, (scale, offset))
    said = _said(chosen, time, " (counts)" if counted else angles.said, wanted)
    if recorder is not None and recorder.desired == "command":
        wanted |= {key.replace("_ref", "_cmd"): source for key, source in wanted.items() if key.startswith("q_ref")}
    used = {v if isinstance(v, str) else v["column"] for v in mapping.values()} | {c for c, *_ in wanted.values()}
    effort = EFFORTS[recorder.effort] if recorder is not None and recorder.effort and len(chosen) > 1 else ""
    told = q.joints if q.named else recorder.joints if recorder is not None and len(recorder.joints) == len(q.columns) else ()
    say = [recorder.say] if recorder is not None and recorder.say else []
    beside = [*say, *angles.notes, *beside, *_put_in_order(order, joints), *order_notes, *left_hands(q, found)]
    return RecordedChannels(
        mapping,
        wanted,
        said,
        tuple(x for x in names if x and x not in used),
        "" if recorder is None else recorder.name,
        told,
        effort,
        tuple(beside),
        None if recorder is None else recorder.rate_hz,
        time.doubt,
    )


def _seconds(time: RecordedTime, read: Reader) -> Array | None:
    """Times (N,) in s; None where none is there, or the fraction of a second stands in another column."""
    if not time.column:
        return None
    t = time.factor * np.asarray(seconds(np.asarray(read([time.column])[time.column])), float)
    return t if np.mean(np.diff(t) > 0) > _RISING else None


def _fitting_positions(
    names: Sequence[str], found: Sequence[ChannelGroup], joints: Sequence[str] | None, units: Mapping[str, str], read: Reader
) -> tuple[list[ChannelGroup], list[ChannelGroup]]:
    """The groups that fit the robot, and those of them that hold positions. Raises DataError where these must be asked for."""
    driven = driven_hands(found, read) if joints is None else frozenset[str]()
    fitting, wide = _fitting(found, joints, driven)
    positions = _positions(fitting)
    if not positions and joints:  # names that are not the robot's are names all the same
        fitting, _ = _fitting(groups(names, None, units), joints)
        positions = [g for g in _positions(fitting) if g.named and len(g.columns) == len(joints)]
    if not positions or (joints is None and all(len(g.columns) == 1 for g in positions)):
        refuse_parts(found, names)
    if not positions and wide:
        raise _other_number(wide[0], joints or ())
    return fitting, positions


def _said(chosen: Mapping[str, ChannelGroup], time: RecordedTime, unit: str, wanted: Mapping[str, tuple[str, float, float]]) -> str:
    """What is read from where, in words."""
    said = f"positions from {chosen['q']}{unit}"
    if time.column:
        said = f"time from {time.column!r}" + ("" if time.factor == 1.0 else f" (times {time.factor:g} s)") + f", {said}"
    for quantity, word in (("dq", "velocities"), ("tau", "torque"), ("tau_m", "motor torque"), ("i", "current")):
        if quantity in chosen:
            said += f", {word} from {chosen[quantity]}"
    return said + (f", desired motion from {next(iter(wanted.values()))[0]!r} …" if wanted else "")


def _positions(found: Sequence[ChannelGroup]) -> list[ChannelGroup]:
    return [g for g in found if g.quantity == "q" and not g.wanted and not g.estimated]


def _other_number(positions: ChannelGroup, joints: Sequence[str]) -> DataError:
    """Positions of another number of joints than the robot has; a hand's joints that would make up for it are named."""
    count, there = len(joints), len(positions.columns)
    if unread := next((unit for column in positions.columns if (unit := unread_in(column))), ""):
        return DataError(
            f"the robot has {counted(count, 'joint')}, but positions of {there} belong together ({positions}): they are in"
            f" {unread!r}, which is not a known unit. Write deg, rad, mm or m instead, or map the columns with their"
            f' scale under [columns] of a study file, q1 = {{ column = "{positions.columns[0]}", scale = … }} first.'
        )
    hand = [name for name in joints if words_of(name) & HANDS]
    likely = f", such as its hand: --lock {' '.join(hand)}" if count - there == len(hand) else ""
    remedy = (
        f"lock the joints that were not logged{likely} ([robot] locked, or joints for those to keep)"
        if count > there
        else "map those of the robot's joints under [columns] of a study file, q1 = … first"
    )
    return DataError(f"the robot has {counted(count, 'joint')}, but the log has positions of {there} ({positions}); {remedy}.")


def named_alike(known: Sequence[str], joints: Sequence[str]) -> tuple[str, ...]:
    """The robot's names of the joints that a recorder is known to number (`FR_hip` for `FR_hip_joint`), in its order; () where names do
    not tell each of them."""
    own = {bare_name(name): name for name in joints}
    found = tuple(own.get(bare_name(name), "") for name in known)
    return found if all(found) and len(set(found)) == len(found) == len(joints) else ()


def _put_in_order(order: Sequence[str], joints: Sequence[str] | None) -> tuple[str, ...]:
    """What is said where the recorder counts the joints in another order than the robot."""
    if not order or list(order) == list(joints or ()):
        return ()
    return (f"the log orders its joints as {', '.join(order)}; they are put into the robot's order by name.",)


def _in_si(read: Reader, found: Sequence[ChannelGroup]) -> dict[str, Array]:
    """Columns of all groups; in SI units where those of a group differ in theirs."""
    table = dict(read([c for g in found for c in g.columns]))
    for g in found:
        table |= g.in_si(table)
    return table


def _mapping(chosen: Mapping[str, ChannelGroup], factors: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """The [columns] of what was chosen; `factors`: (factor, offset) of each group."""
    return {
        f"{k}{j + 1}": _entry(column, k, *_of_column(g, j, *factors[k])) for k, g in chosen.items() for j, column in enumerate(g.columns)
    }


def _of_column(g: ChannelGroup, j: int, factor: float, offset: float) -> tuple[float, float]:
    """Factor and offset of a group's j-th column as the file holds it."""
    return (known_scale(g.units[j]), 0.0) if g.units else (factor, offset)


def _entry(column: str, quantity: str, factor: float, offset: float = 0.0) -> str | dict[str, Any]:
    """An entry of [columns]: SI value = factor * x + offset, of which the unit that the column's own name tells is taken already."""
    own = split_unit(column)[1]
    told = unit_of(own) if own is not None else None
    one = told.scale if told is not None and told.dimension in expected_units(_QUANTITIES[quantity]) else 1.0
    scale = factor / one
    return column if scale == 1.0 and not offset else {"column": column, "scale": scale, "offset": offset / one}


def _fitting(
    found: Sequence[ChannelGroup], joints: Sequence[str] | None, driven: frozenset[str] = frozenset()
) -> tuple[list[ChannelGroup], list[ChannelGroup]]:
    """Groups of as many joints as the robot has (without hands that are not `driven`, where no robot is given), and wider ones of measured
    positions."""
    if joints is None:
        return [g.arms(driven) for g in found], []
    out, wide = [], []
    for g in found:
        if g.named and set(joints) <= set(g.joints):
            out.append(g.only([g.joints.index(name) for name in joints]))
        elif len(g.columns) == len(joints):
            out.append(g)
        elif len(g.arms().columns) == len(joints):
            out.append(g.arms())
        elif g.quantity == "q" and not g.wanted and not g.estimated:
            wide.append(g)
        else:
            out.append(g)
    return out, sorted(wide, key=lambda g: -len(g.columns))


def _best(positions: Sequence[ChannelGroup], table: Mapping[str, Array]) -> ChannelGroup:
    """The measured positions: of two encoders of the same joints the motors', whose torque it is that is logged."""
    best = max(positions, key=lambda g: (_moving(table, g), g.measured, len(g.columns), not g.words & {"mot", "motor"}))
    for other in positions:
        if other.words & {"mot", "motor"} and len(other.columns) == len(best.columns) and moves(table, other):
            one, two = (np.stack([table[c] for c in g.columns]) for g in (best, other))
            if np.nanmean((one - two) ** 2) <= SAME**2 * np.nanmean((one - np.nanmean(one, axis=1, keepdims=True)) ** 2):
                return other
    return best


def _moving(table: Mapping[str, Array], group: ChannelGroup) -> int:
    """Columns that hold anything: a second encoder may be on some joints only."""
    return sum(moves(table, group.only([k])) for k in range(len(group.columns)))


def _position_scale(q: ChannelGroup, table: Mapping[str, Array], recorder: Recorder | None) -> tuple[float, float, bool]:
    """(factor, offset) to radians, and whether positions are counts: as the unit is told; else whole numbers are counts, and what goes
    beyond two turns is in degrees. Raises DataError for counts of which nobody knows how many are a turn."""
    if q.unit:
        return 1.0 if q.units else known_scale(q.unit), 0.0, False
    if recorder is not None and recorder.counts == 1:
        return 2 * np.pi, 0.0, False
    values = [np.asarray(table[c], float) for c in q.columns]
    reach = max(float(np.nanmax(np.abs(v), initial=0.0)) for v in values)
    whole = all(np.all(v[np.isfinite(v)] == np.round(v[np.isfinite(v)])) for v in values)
    if whole and reach > _TURNS * 2 * np.pi and any(len(np.unique(v)) > _WHOLE for v in values):
        if recorder is None or recorder.counts is None:
            raise DataError(
                f"positions from {q} are whole numbers up to {reach:g}: encoder counts. Give the counts per turn, and the count at"
                f" zero, under [columns] of a study file; for 4096 counts per turn and zero at 2048:"
                f' q1 = {{ column = "{q.columns[0]}", scale = 0.00153398, offset = -3.14159 }} …'
            )
        turn = 2 * np.pi / recorder.counts
        return turn, -recorder.centre * turn, True
    if q.unread:
        raise DataError(
            f"positions from {q} are in {q.unread!r}, which is not a known unit. Give its size in radians (metres) under"
            f' [columns] of a study file: q1 = {{ column = "{q.columns[0]}", scale = … }} …'
        )
    return (np.pi / 180 if reach > _TURNS * 2 * np.pi else 1.0), 0.0, False


def _factor(quantity: str, g: ChannelGroup, scale: float, counted: bool, recorder: Recorder | None) -> float:
    """Factor to SI of velocities, torques and currents, as the table holds them."""
    if g.units:
        return 1.0
    if quantity in ("tau", "tau_m", "i"):
        return known_scale(g.unit) if g.unit else recorder.effort_scale if recorder is not None else 1.0
    if g.unit:
        return known_scale(g.unit)
    if counted:  # a Dynamixel's 0.229 revolutions per minute
        return 0.229 * np.pi / 30
    return scale
