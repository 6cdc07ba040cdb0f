"""ROS 1 bags, ROS 2 bags (SQLite, MCAP) and plain MCAP files, by `rosbags`: joint states, and what a controller asked for, as one table."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ConfigurationError, DataError
from .damage import reason
from .stored import LogFormat, Stored, register_log_format
from .wording import DESIRED

Array = np.ndarray
_SUFFIXES = (".bag", ".db3", ".mcap")
_FIELDS = ("position", "velocity", "effort")
#: Parts of a controller's state message that hold the desired motion.
_REFERENCE = ("reference", "desired")
_REFERENCE_FIELDS = {"positions": "position_reference", "velocities": "velocity_reference", "accelerations": "acceleration_reference"}
_SHOWN = 8


@dataclass(frozen=True)
class _Message:
    """Joint values of one message at a time (s): field → values in the order of `joints`."""

    time: float
    received: float
    joints: tuple[str, ...]
    values: Mapping[str, Array]


def is_bag(path: Path) -> bool:
    """A bag file, or the folder of a ROS 2 bag."""
    return path.suffix.lower() in _SUFFIXES or (path.is_dir() and (path / "metadata.yaml").is_file())


def _read(path: Path) -> Stored:
    """Columns of a bag: `t` (s, the sender's stamp), `<joint>.position`, `.velocity`, `.effort` and `.position_reference` … where any is.

    Messages are ordered by their stamps, and their values by the joints' names, whatever the order in a message. Raises DataError, and
    ConfigurationError without `rosbags`."""
    if find_spec("rosbags") is None:
        raise ConfigurationError(f"log {path}: reading bags needs rosbags: pip install 'ident[bags]'. Or export the joint states as CSV.")
    try:
        states, wanted, notes = _messages(path)
    except DataError:
        raise
    except Exception as error:  # noqa: BLE001 - what a damaged bag brings up in another library
        raise DataError(f"log {path}: cannot be read as a bag ({type(error).__name__}: {reason(error)}).") from None
    if not states:
        raise DataError(f"log {path}: holds no message of type JointState.")
    shifted = sum(m.received < n.received for m, n in zip(states[1:], states, strict=False))
    states.sort(key=lambda m: m.time)
    clock, columns = _by_publisher(states, notes, path)
    if wanted:
        columns |= _onto(clock, sorted(wanted, key=lambda m: m.time), _REFERENCE_FIELDS.values())
    if shifted:
        notes.append(f"log {path}: {shifted} messages were recorded in another order than they were stamped; the stamps count.")
    return Stored({"t": clock} | {name: v for name, v in columns.items() if np.isfinite(v).any()}, notes=tuple(notes))


def _messages(path: Path) -> tuple[list[_Message], list[_Message], list[str]]:
    """Measured joint states, what was asked for, and notes on topics that are not used."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        topics = [c for c in reader.connections if c.msgtype.endswith("/JointState")]
        if not topics:
            raise DataError(f"log {path}: holds no message of type JointState; its topics: {', '.join(sorted(reader.topics)) or 'none'}.")
        measured = [c for c in topics if not _asked_for(c.topic)] or topics
        most = max(measured, key=lambda c: (c.msgcount, -len(c.topic))).topic
        asked = [c for c in topics if _asked_for(c.topic) and c.topic != most]
        control = [c for c in reader.connections if c.msgtype.endswith("JointTrajectoryControllerState") and not asked]
        used = {most, *(c.topic for c in (*asked, *control))}
        notes = []
        if left := sorted({c.topic for c in topics} - used):
            notes.append(f"log {path}: joint states of {most} are read, not those of {', '.join(left[:_SHOWN])}.")
        states: list[_Message] = []
        wanted: list[_Message] = []
        for connection, received, raw in reader.messages(connections=[c for c in reader.connections if c.topic in used]):
            message: Any = reader.deserialize(raw, connection.msgtype)
            if connection.topic == most:
                states.append(_state(message, received, {field: field for field in _FIELDS}))
            elif connection.msgtype.endswith("/JointState"):
                wanted.append(_state(message, received, {"position": "position_reference", "velocity": "velocity_reference"}))
            elif (part := next((getattr(message, p) for p in _REFERENCE if hasattr(message, p)), None)) is not None:
                values = {own: np.asarray(getattr(part, field), float) for field, own in _REFERENCE_FIELDS.items()}
                wanted.append(_Message(_stamp(message, received), 1e-9 * received, tuple(message.joint_names), values))
    return states, wanted, notes


def _asked_for(topic: str) -> bool:
    return bool(set(re.split(r"[^a-z]+", topic.lower())) & DESIRED)


def _stamp(message: Any, received: int) -> float:
    """The sender's stamp (s); where it is zero, the time of receipt."""
    stamp = message.header.stamp
    sent = float(stamp.sec) + 1e-9 * float(stamp.nanosec)
    return sent if sent > 0 else 1e-9 * received


def _state(message: Any, received: int, fields: Mapping[str, str]) -> _Message:
    values = {own: np.asarray(getattr(message, field), float) for field, own in fields.items()}
    return _Message(_stamp(message, received), 1e-9 * received, tuple(message.name), values)


def _by_publisher(states: Sequence[_Message], notes: list[str], path: Path) -> tuple[Array, dict[str, Array]]:
    """Columns on the clock of the messages that name most joints; those of other joints on the same topic are brought to that clock."""
    groups = Counter(frozenset(m.joints) for m in states)
    main = max(groups, key=lambda joints: (groups[joints] * len(joints), len(joints)))
    rows = [m for m in states if main <= frozenset(m.joints)]
    clock = np.array([m.time for m in rows])
    order = list(dict.fromkeys(name for m in rows for name in m.joints))
    columns = _table(rows, order, _FIELDS)
    others = [m for m in states if not main <= frozenset(m.joints)]
    if others:
        names = sorted({name for m in others for name in m.joints} - set(order))
        rest = _onto(clock, others, _FIELDS)
        columns |= {name: v for name, v in rest.items() if name not in columns}
        notes.append(
            f"log {path}: {len(others)} messages on the same topic name other joints ({', '.join(names[:_SHOWN]) or 'only some of them'});"
            " they are brought to the clock of the others."
        )
    return clock, columns


def _table(rows: Sequence[_Message], joints: Sequence[str], fields: Sequence[str]) -> dict[str, Array]:
    place = {name: k for k, name in enumerate(joints)}
    table = {field: np.full((len(rows), len(joints)), np.nan) for field in fields}
    for row, message in enumerate(rows):
        at = [place[name] for name in message.joints]
        for field, values in message.values.items():
            if len(values) == len(at):
                table[field][row, at] = values
    return {f"{name}.{field}": values[:, k] for field, values in table.items() for name, k in place.items()}


def _onto(clock: Array, messages: Sequence[_Message], fields: Sequence[str] | Any) -> dict[str, Array]:
    """Columns of messages with another clock, linear between them, NaN before the first and after the last."""
    joints = list(dict.fromkeys(name for m in messages for name in m.joints))
    t = np.array([m.time for m in messages])
    out: dict[str, Array] = {}
    for name, values in _table(messages, joints, list(fields)).items():
        known = np.isfinite(values)
        if known.any():
            out[name] = np.interp(clock, t[known], values[known], left=np.nan, right=np.nan)
    return out


BAG = register_log_format(LogFormat("ROS bag", lambda path, start: is_bag(path), _read))
