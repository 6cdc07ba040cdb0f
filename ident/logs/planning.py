"""Which column of a file is what: by our own names, by the user's mapping, or as a recording is recognised."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import ConfigurationError, DataError
from .channel_group import ChannelGroup, unit_suffix
from .channels import groups
from .column_plan import ColumnPlan
from .columns import resolve_columns
from .long_tables import long_table
from .names import KEYS, Column, JointNames, parse_name
from .rates import with_rates
from .readers.header import Header, UnreadableRows
from .readers.moments import MOMENT
from .recognise import RecordedChannels, recognised
from .recorders import recorder_of
from .references import numbered_reference, references
from .sampling import sampling_of, with_summed_time
from .source import TableSource
from .stamps import fraction_beside, since_1970
from .told_units import unread_unit
from .unnamed import proposal
from .unread_units import unread_beside

Array = np.ndarray
#: The time of a log that has none, counted from its rate.
COUNTED = "\x00counted"
_TIMES = ("t", "time", "timestamp")
_MOTION = ("q", "dq", "ddq")
_IS_REFERENCE = re.compile(r"^(q|dq|ddq)_(ref|cmd)\d+")
#: Rows by which a table without names is described.
_LOOKED_AT = 2000


@dataclass(frozen=True, eq=False)
class PlannedLog:
    """The columns of a log, and what it was recognised as, if it had to be. `reference`: key (`q_ref1`) → column, factor, offset of desired
    motion; `table`: the columns where the file had to be rearranged."""

    plan: ColumnPlan
    recording: RecordedChannels | None = None
    reference: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)
    table: Mapping[str, Array] | None = None


def with_desired(found: PlannedLog) -> ColumnPlan:
    """The plan of a log, with the columns of its desired motion where each joint has one, as `read_logs` keeps them beside the log."""
    told = {key: Column(name, "", 0, scale, offset) for key, (name, scale, offset) in found.reference.items()}
    told |= {name: Column(name, "", 0) for name in found.plan.extra if _IS_REFERENCE.fullmatch(name)}
    named = {key: name for name in found.plan.extra if (key := numbered_reference(name, found.plan.joints))}
    told |= {key: Column(name, "", 0) for key, name in named.items()}
    columns: dict[str, list[Column]] = {}
    for key, column in told.items():
        quantity = key.rstrip("0123456789")
        columns.setdefault(quantity, []).append(replace(column, quantity=quantity, joint=int(key[len(quantity) :]) - 1))
    whole = [own for own in columns.values() if sorted(c.joint for c in own) == list(range(found.plan.n))]
    return replace(found.plan, wanted=tuple(c for own in whole for c in own))


def planned(
    source: TableSource, joints: JointNames | None, columns: Mapping[str, Any] | None = None, rate_hz: float | None = None
) -> PlannedLog:
    """The plan for a table. Raises DataError where something must be asked, ConfigurationError for a mapping that does not fit."""
    if rate_hz is not None and not rate_hz > 0:
        raise ConfigurationError(f"rate_hz must be a positive number of samples per second, not {rate_hz!r}.")
    if rate_hz is not None or "t" in (columns or {}) or (told := sampling_of(source)) is None:
        return _planned(source, joints, columns, rate_hz, ())
    if told.rate_hz is not None:
        return _planned(source, joints, columns, told.rate_hz, (told.said,))
    source = with_summed_time(source, told)
    found = _planned(source, joints, columns, None, (told.said,))
    return replace(found, table=found.table or source.read(found.plan.sources, found.plan.extra))


def _planned(
    source: TableSource, joints: JointNames | None, columns: Mapping[str, Any] | None, rate_hz: float | None, said: tuple[str, ...]
) -> PlannedLog:
    """`planned` for a table with a time, or counted by a rate; `said` of that."""
    where, header = source.where, source.header
    names, notes = _of_driven_joints(header.names, joints, where)
    notes = [*said, *notes]
    if rate_hz is not None and not any(n.lower() in _TIMES for n in names) and "t" not in (columns or {}):
        names = (*names, COUNTED)
        columns = {**columns, "t": COUNTED} if columns else None
    counted = columns or ({"t": COUNTED} if COUNTED in names else None)
    rate = rate_hz if COUNTED in names else None
    try:
        if header.unnamed and not columns:
            raise DataError(_unnamed(source))
        if not columns and recorder_of(header.names) is not None and (known := _recognised(source, joints, rate, said)):
            return known  # whose names and units are known better than the words tell
        plan = resolve_columns(names, joints, counted, where=where, units=_told_units(header, where))
        plan = _on_its_clock(plan, source)
        plan = plan if columns or rate is not None else with_rates(plan, source)
        reference, more = _beside(source, plan)
        unread = () if columns else unread_beside(plan, dict(zip(header.names, header.units, strict=False)))
        if unread and not any(c.quantity.startswith("tau") for c in plan.columns):
            plan = replace(plan, hint=plan.hint or " ".join(unread))
        more = (*more, *(f"{where}: {said}" for said in unread))
        return PlannedLog(replace(plan, notes=(*notes, *plan.notes, *more), rate_hz=rate), None, reference)
    except DataError:
        if columns or header.unnamed:
            raise
        own = any((p := parse_name(n, joints, [])) is not None and p.quantity in ("q", "q_motor") for n in names)
        try:
            found = _recognised(source, joints, rate, said)
        except DataError as error:
            if not own or isinstance(error, UnreadableRows):
                raise
            found = None  # what our own names lack is said better by them
        if found is None:
            raise
        return found


def _recognised(source: TableSource, joints: JointNames | None, rate: float | None, before: tuple[str, ...]) -> PlannedLog | None:
    """A recording as it is recognised, None where it is not; `rate`: by which its time is counted; `before`: said of that. Raises DataError
    with a question."""
    where, header, counted = source.where, source.header, rate is not None
    known: dict[str, Array] = {}
    rearranged = long_table(source)
    names = tuple(rearranged) if rearranged is not None else header.names

    def read(wanted: Sequence[str]) -> dict[str, Array]:
        new = [n for n in dict.fromkeys(wanted) if n not in known]
        if new:
            known.update({n: rearranged[n] for n in new} if rearranged is not None else source.read(new, ()))
        return known

    try:
        found = recognised(names, read, None if joints is None else joints.names, header.units, rate)
    except DataError as error:
        kind = UnreadableRows if isinstance(error, UnreadableRows) else DataError
        raise kind(str(error) if str(error).startswith("log ") else f"{where}: {error}") from None
    if found is None:
        looks = _looks_like(source) if source.whole else ""
        if looks:
            raise DataError(f"{where}: the names of its columns ({', '.join(names[:4])} …) do not say what they hold. {looks}")
        return None
    mapping = dict(found.mapping)
    if counted:
        mapping["t"] = COUNTED
    elif "t" not in mapping:
        raise (UnreadableRows if found.untimed else DataError)(f"{where}: {_without_time(found)}")
    plan = resolve_columns((*names, COUNTED) if counted else names, joints, mapping, where=where)
    plan = _on_its_clock(plan, source) if rearranged is None else plan
    said = f"{where}: recognised by its columns{f' as {found.recorder}' if found.recorder else ''}: {found.text}."
    more = tuple(f"{where}: {note}" for note in found.notes)
    plan = replace(plan, notes=(said, *before, *more, *plan.notes), joints=found.joints or plan.joints, rate_hz=rate)
    return PlannedLog(plan, found, found.reference, rearranged)


def _told_units(header: Header, where: str) -> dict[str, str]:
    """Units that the file tells beside its columns of our own names, as suffixes. Raises DataError for one that is not known."""
    out = {}
    for name, told in zip(header.names, header.units, strict=False):
        named = parse_name(name, None, [])
        if told and named is not None and (told != MOMENT or named.quantity == "t"):
            out[name] = "s" if told == MOMENT else unit_suffix(told)
            if not out[name] and (unread := unread_unit(told)):
                raise DataError(
                    f"{where}: column {name!r} is in {unread!r}, which is not a known unit. Give its size in SI units under"
                    f" [columns] of a study file: {KEYS[named.quantity]}{named.joint + 1 if named.quantity != 't' else ''} = {{ column ="
                    f' "{name}", scale = … }}.'
                )
    return out


def _on_its_clock(plan: ColumnPlan, source: TableSource) -> ColumnPlan:
    """The plan with the fraction of a second that stands in a column of its own, and with the unit of a time that counts since 1970."""
    (clock, *_) = plan.quantity("t") or (None,)
    if clock is None or clock.source == COUNTED:
        return plan
    if clock.scale == 1.0 and (part := fraction_beside(clock.source, source.header.names, lambda names: source.read(names, ()))):
        said = f"{plan.where}: the time is {clock.source!r} and {part[0]!r} (times {part[1]:g} s)."
        extra = tuple(name for name in plan.extra if name != part[0])
        return replace(plan.on_clock(clock, Column(part[0], "t", 1, part[1])), extra=extra, notes=(*plan.notes, said))
    factor = since_1970(source.usual_size(clock.source)) if not clock.unit and clock.scale == 1.0 else 1.0
    if factor == 1.0:
        return plan
    said = f"{plan.where}: column {clock.source!r} counts from 1970, judging by its size: one unit is {factor:g} s."
    return replace(plan.on_clock(replace(clock, scale=factor)), notes=(*plan.notes, said))


def _without_time(found: RecordedChannels) -> str:
    """What is wrong with the time of a file that is recognised but for that, and what to do."""
    usual = "500" if found.rate_hz is None else f"{found.rate_hz:g}"
    such = ", for example" if found.rate_hz is None else ":"
    rate = f"give its sample rate{such} [logs] rate_hz = {usual} (--rate-hz {usual})"
    if found.untimed:
        return f"{found.untimed} Or, if samples are even, {rate}."
    said = f"recognised{f' as {found.recorder}' if found.recorder else ''} ({found.text}), but it holds no time: {rate}"
    return said + (f"; {usual} is usual for it." if found.rate_hz is not None else ".")


def _beside(source: TableSource, plan: ColumnPlan) -> tuple[dict[str, tuple[str, float, float]], tuple[str, ...]]:
    """Desired motion beside columns that go by our own names, and what was noticed."""
    own = plan.quantity("q")
    found = groups(plan.extra, None, dict(zip(source.header.names, source.header.units, strict=False)))
    wanted = [g for g in found if g.wanted and g.quantity in _MOTION]
    wanted = [g for g in wanted if len(g.columns) == len(own) and not _IS_REFERENCE.match(g.columns[0])]
    if not own or not wanted or any(c.scale != own[0].scale or c.offset for c in own):
        return {}, ()
    q = ChannelGroup("", tuple(c.source for c in own), plan.joints, "q", frozenset())
    try:
        table = source.read([*q.columns, *(c for g in wanted for c in g.columns)], ())
    except DataError:
        return {}, ()
    return references(wanted, q, table, (own[0].scale, 0.0))


def _of_driven_joints(names: tuple[str, ...], joints: JointNames | None, where: str) -> tuple[tuple[str, ...], list[str]]:
    """Without a robot: the columns without joints of which only positions are there where the others have a torque (grippers)."""
    if joints is not None:
        return names, []
    known: list[str] = []
    told: dict[int, set[str]] = {}
    of: dict[str, int] = {}
    for name in names:
        found = parse_name(name, None, known)
        if found is not None and not found.numbered and found.quantity != "t":
            told.setdefault(found.joint, set()).add(found.quantity)
            of[name] = found.joint
    driven = {j for j, quantities in told.items() if any(x.startswith("tau") for x in quantities)}
    idle = set(told) - driven
    if not driven or not idle:
        return names, []
    out = ", ".join(known[j] for j in sorted(idle))
    note = f"{where}: no torque is logged for {out}, which are left out; to keep them, name a robot that has them."
    return tuple(n for n in names if of.get(n) not in idle), [note]


def _unnamed(source: TableSource) -> str:
    where, header = source.where, source.header
    looks = _looks_like(source) or "Map them under [columns] of a study file, or add a header row."
    return (
        f"{where}: line {header.line + 1} holds numbers where a header row should name the {len(header.names)} columns;"
        f" {header.names[0]} … {header.names[-1]} are their names here, from the left. {looks}"
    )


def _looks_like(source: TableSource) -> str:
    header = source.header
    try:
        table = source.read(header.names, ())
    except DataError:
        return ""
    said = proposal(header.names, [table[name][:_LOOKED_AT] for name in header.names])
    torque = [str(g) for g in groups(header.names, None, {}) if g.quantity in ("tau", "i")]
    return f"{said} Torque or current may be {' or '.join(torque)}." if said and torque else said
