"""Recordings that name their channels otherwise: recognised by the structure of names, shapes and values, never by a file's name.

Columns that differ in one number (or one joint's name) are a group. What the group holds follows from the words of its name; which is
measured, wanted or estimated too. Time has its unit from its own numbers, or from positions and velocities that must agree."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Array = np.ndarray
_NUMBER = re.compile(r"\d+")
_BY_NAME = re.compile(r"^(?P<joint>.+)[./](?P<word>position|velocity|acceleration|effort|torque|current)$", re.IGNORECASE)
_WORDS = {
    "q": {"q", "pos", "position", "positions", "angle", "angles", "winkel", "mp", "ip", "qpos"},
    "dq": {"qd", "dq", "v", "vel", "velocity", "velocities", "speed", "drehzahl", "qvel", "dp"},
    "ddq": {"qdd", "ddq", "acc", "acceleration"},
    "tau": {"tau", "torque", "torques", "effort", "eff", "moment", "drehmoment", "mt", "force"},
    "i": {"current", "currents", "strom"},
}
_WANTED = {"target", "desired", "des", "cmd", "command", "commanded", "goal", "ref", "reference", "setpoint", "soll", "d", "ip"}
_ESTIMATED = {"ext", "mocap", "et", "external", "hat", "model", "gravity", "filtered"}
_MEASURED = {"actual", "measured", "present", "fb", "feedback", "state", "ist", "mp", "mt"}
_NOT_JOINTS = {"euler", "quat", "tcp", "tool", "imu", "foot", "temp", "temperature", "temperatur", "ee", "cart", "base", "voltage", "mode"}
_TIMES = ("t", "time", "timestamp", "timestamps", "tstamps", "zeit", "stamp", "secs", "sec", "seconds", "ms", "%time")
_UNITS = {
    "°": np.pi / 180, "deg": np.pi / 180, "grad": np.pi / 180, "rad": 1.0, "u/min": 2 * np.pi / 60, "rpm": 2 * np.pi / 60,
    "1/min": 2 * np.pi / 60, "°/s": np.pi / 180, "deg/s": np.pi / 180, "rad/s": 1.0, "nm": 1.0, "n": 1.0, "a": 1.0, "ma": 1e-3,
    "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "m": 1.0, "mm": 1e-3,
}  # fmt: skip
#: Positions beyond so many turns are no radians; a ratio this near to a unit's is that unit's.
_TURNS = 2.2
_NEAR = 0.25


@dataclass(frozen=True)
class RecordedChannels:
    """What a recording's columns are: `mapping` for `resolve_columns`, `reference` (key → column, factor) of what was wanted, a `text` for
    people, and what was `ignored`."""

    mapping: Mapping[str, Any]
    reference: Mapping[str, tuple[str, float]]
    text: str
    ignored: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class _Group:
    stem: str
    columns: tuple[str, ...]
    joints: tuple[str, ...]
    quantity: str
    wanted: bool
    estimated: bool
    measured: bool


def recognised(
    names: Sequence[str],
    read: Callable[[Sequence[str]], Mapping[str, Array]],
    joints: Sequence[str] | None = None,
    units: Sequence[str] = (),
) -> RecordedChannels | None:
    """What the columns of a recording are, None where no group of positions is among them.

    `read`: columns by name → values (N,); `joints`: the robot's, whose order counts where columns name joints; `units`: of the columns."""
    groups = _groups(names, joints)
    count = None if joints is None else len(joints)
    positions = [g for g in groups if g.quantity == "q" and not g.wanted and not g.estimated and count in (None, len(g.columns))]
    if not positions:
        return None
    table = read([c for g in groups for c in g.columns])
    best = max(positions, key=lambda g: (_moves(table, g), g.measured, len(g.columns)))
    n = len(best.columns)
    unit_of = dict(zip(names, units, strict=False))
    time = _time_column(names, read)
    chosen = {"q": best}
    for quantity in ("dq", "tau", "i"):
        same = [g for g in groups if g.quantity == quantity and len(g.columns) == n and not g.wanted and not g.estimated]
        same = [g for g in same if _moves(table, g)]
        partly = [g for g in groups if g.quantity == quantity and len(g.columns) != n and not g.wanted and not g.estimated]
        if quantity == "tau" and not same and any(_moves(table, g) for g in partly):
            return None  # torque of some joints only: which is which must be asked
        if same:
            chosen[quantity] = max(same, key=lambda g: (g.measured, -len(g.stem)))
    angle = _scale(unit_of, best, table, "q")
    mapping: dict[str, Any] = {}
    for quantity, g in chosen.items():
        if quantity == "i" and "tau" in chosen:
            continue
        factor = angle if quantity == "q" else _scale(unit_of, g, table, quantity, angle)
        for j, column in enumerate(g.columns):
            mapping[f"{quantity}{j + 1}"] = column if factor == 1.0 else {"column": column, "scale": factor}
    said = f"positions from {_span(best)}" + ("" if angle == 1.0 else " (in degrees)")
    if time is not None:
        speed = chosen.get("dq")
        factor = _time_scale(time, read, table, best, speed, angle, unit_of.get(time, ""))
        mapping["t"] = time if factor == 1.0 else {"column": time, "scale": factor}
        said = f"time from {time!r}" + ("" if factor == 1.0 else f" (times {factor:g} s)") + f", {said}"
    for quantity, word in (("dq", "velocities"), ("tau", "torque"), ("i", "current")):
        if quantity in chosen and (quantity != "i" or "tau" not in chosen):
            said += f", {word} from {_span(chosen[quantity])}"
    reference = _references(groups, n, table, angle)
    if reference:
        said += f", desired motion from {next(iter(reference.values()))[0]!r} …"
    used = {v if isinstance(v, str) else v["column"] for v in mapping.values()} | {c for c, _ in reference.values()}
    return RecordedChannels(mapping, reference, said, tuple(x for x in names if x not in used))


def _groups(names: Sequence[str], joints: Sequence[str] | None) -> list[_Group]:
    """Columns that differ in one number or one joint's name, in the order of the numbers or of the robot's joints."""
    stems: dict[str, list[tuple[int, str, str]]] = {}
    for name in names:
        by_name = _BY_NAME.match(name)
        if by_name:
            joint, topic = by_name["joint"].replace("/", ".").split(".")[-1], by_name["joint"].rsplit("/", 1)[0]
            place = list(joints).index(joint) if joints and joint in joints else len(stems.get(f"{topic}|{by_name['word']}", []))
            stems.setdefault(f"{topic}|{by_name['word']}", []).append((place, name, joint))
            continue
        for found in _NUMBER.finditer(name):
            stem = name[: found.start()] + "#" + name[found.end() :]
            stems.setdefault(stem, []).append((int(found.group()), name, ""))
    if not stems:
        plain = {"position": "q", "velocity": "dq", "torque": "tau", "effort": "tau", "current": "i", "angle": "q"}
        for name in names:
            if name.strip().lower() in plain:
                stems[name] = [(0, name, "")]
    out = []
    for stem, members in stems.items():
        tokens = {
            x
            for x in re.split(
                r"[^a-z%°]+",
                re.sub(r"([a-z])([A-Z])", r"\1_\2", stem).lower().replace("torques", "torque").replace("sollwinkel", "soll_winkel"),
            )
            if x
        }
        numbers = sorted({m[0] for m in members})
        if len(numbers) != len(members) or numbers != list(range(numbers[0], numbers[0] + len(numbers))) or numbers[0] > 1:
            continue
        quantity = next((k for k in ("ddq", "dq", "tau", "i", "q") if tokens & _WORDS[k]), "")
        if tokens in ({"observation", "state"}, {"action"}):  # LeRobot: positions, and what was asked for
            quantity = "q"
        if not quantity or tokens & _NOT_JOINTS:
            continue
        members.sort()
        wanted = bool(tokens & _WANTED) or tokens == {"action"}
        columns, own = tuple(m[1] for m in members), tuple(m[2] for m in members)
        out.append(_Group(stem, columns, own, quantity, wanted, bool(tokens & _ESTIMATED), bool(tokens & _MEASURED)))
    return out


def _moves(table: Mapping[str, Array], group: _Group) -> bool:
    """Whether a group holds anything: arrays that are present and all zero are none."""
    return any(np.nanmax(np.abs(table[c]), initial=0.0) > 0.0 for c in group.columns)


def _scale(units: Mapping[str, str], group: _Group, table: Mapping[str, Array], quantity: str, angle: float = 1.0) -> float:
    """Factor to SI: what a row of units says; positions beyond two turns are degrees, and their velocities with them."""
    unit = units.get(group.columns[0], "").strip().lower()
    if unit in _UNITS:
        return _UNITS[unit]
    if unit and quantity == "q":
        return np.pi / 180 if max(float(np.nanmax(np.abs(table[c]))) for c in group.columns) > _TURNS * 2 * np.pi else 1.0
    if quantity == "q":
        reach = max(float(np.nanmax(np.abs(table[c]), initial=0.0)) for c in group.columns)
        return np.pi / 180 if reach > _TURNS * 2 * np.pi else 1.0
    return angle if quantity == "dq" else 1.0


def _time_column(names: Sequence[str], read: Callable[[Sequence[str]], Mapping[str, Array]]) -> str | None:
    """The time: the sender's stamp before the recorder's, and one that rises."""
    lower = {n.lower(): n for n in names}
    found = [lower[k] for k in lower if k.endswith("header.stamp")] + [lower[k] for k in _TIMES if k in lower]
    for name in found:
        values = np.asarray(read([name])[name], float)
        step = np.diff(values[np.isfinite(values)])
        if len(step) and np.mean(step >= 0) > 0.9 and np.any(step > 0):
            return name
    return None


def _time_scale(
    time: str,
    read: Callable[[Sequence[str]], Mapping[str, Array]],
    table: Mapping[str, Array],
    q: _Group,
    dq: _Group | None,
    angle: float,
    unit: str,
) -> float:
    """Seconds in one unit of the time column."""
    if unit.strip().lower() in _UNITS:
        return _UNITS[unit.strip().lower()]
    t = np.asarray(read([time])[time], float)
    step = float(np.median(np.diff(t)[np.diff(t) > 0])) if np.any(np.diff(t) > 0) else 1.0
    size = float(np.nanmedian(np.abs(t)))
    for bound, factor in ((1e17, 1e-9), (1e14, 1e-6), (1e11, 1e-3)):
        if size > bound:
            return factor
    if dq is not None:
        ratios = []
        for a, b in zip(q.columns, dq.columns, strict=True):
            rate = np.gradient(np.asarray(table[a], float), np.maximum.accumulate(t) + 1e-12 * np.arange(len(t)))
            logged = np.asarray(table[b], float)
            big = np.abs(logged) > 0.3 * np.nanmax(np.abs(logged), initial=0.0)
            if big.sum() > 10 and np.any(np.abs(rate[big]) > 0):
                ratios.append(float(np.nanmedian(np.abs(rate[big]) / np.abs(logged[big]))))
        if ratios:
            ratio = float(np.median(ratios))
            for factor in (1.0, 1e-3, 1e-6, 1e-9):
                if abs(np.log(ratio / factor)) < _NEAR:
                    return factor
    whole = bool(np.all(t == np.round(t)))
    return 1e-3 if time.lower() == "ms" or (whole and 1.0 <= step <= 200.0) else 1.0


def _references(groups: Sequence[_Group], n: int, table: Mapping[str, Array], angle: float) -> dict[str, tuple[str, float]]:
    """Desired positions and velocities: key (`q_ref1`) → column and factor."""
    out: dict[str, tuple[str, float]] = {}
    for quantity in ("q", "dq"):
        wanted = [g for g in groups if g.quantity == quantity and g.wanted and len(g.columns) == n and _moves(table, g)]
        if wanted:
            for j, column in enumerate(wanted[0].columns):
                out[f"{quantity}_ref{j + 1}"] = column, angle
    return out


def _span(group: _Group) -> str:
    return repr(group.columns[0]) if len(group.columns) == 1 else f"{group.columns[0]!r} … {group.columns[-1]!r}"
