"""ROS 1 bags, ROS 2 bags (SQLite, MCAP) and plain MCAP files: joint states, and what a controller asked for, as one table."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ..._utils.text import counted
from ...errors import ConfigurationError, DataError, IdentError, UnsupportedError
from ..words import DESIRED
from .arrays import CHUNK, STRETCH, stretches
from .damage import reason
from .free_topics import free_messages
from .joint_states import FIELDS, JointStates, decoded
from .mcap import Channel
from .senders import by_publisher, onto, recent, table_of
from .stored import Chunked, LogFormat, Stored, register_log_format
from .topics import Block, blocks, decoder, is_bag, topics_of

Array = np.ndarray
#: Parts of a controller's state message that hold the desired motion.
_REFERENCE = ("reference", "desired")
_REFERENCE_FIELDS = {"positions": "position_reference", "velocities": "velocity_reference", "accelerations": "acceleration_reference"}
_ASKED_FIELDS = {"position": "position_reference", "velocity": "velocity_reference"}
_ASKED = tuple(_REFERENCE_FIELDS.values())
_FAR = "log {path}: messages are far out of the order of their time stamps; read the log into memory (--no-stream)."
_SHOWN = 8
#: Encodings of messages that need not be ROS's.
_FREE = ("json", "protobuf")
#: How topics of joint states end.
_STATES = re.compile(r"joint_?states?$", re.IGNORECASE)
#: Messages that wait, in reading by chunks, for others that were stamped before them.
_WAITING = 4096


def _read(path: Path) -> Stored:
    """Columns of a bag: `t` (s, the sender's stamp), `<joint>.position`, `.velocity`, `.effort` and `.position_reference` … where any is.

    Messages are ordered by their stamps, and their values by the joints' names, whatever the order in a message. Raises DataError, and
    ConfigurationError without `rosbags`."""
    found = _messages(path)
    if isinstance(found, Stored):
        return found
    states, wanted, notes = found
    clock, columns = by_publisher(states, notes, path)
    if wanted:
        columns |= onto(clock, wanted)
    sent = np.concatenate([s.stamp for s in states])[np.argsort(np.concatenate([s.received for s in states]), kind="stable")]
    if shifted := int(np.sum(np.diff(sent) < 0)):
        notes.append(f"log {path}: {counted(shifted, 'message', 'were')} out of the order of their time stamps, and sorted by them.")
    return Stored({"t": clock} | {name: v for name, v in columns.items() if np.isfinite(v).any()}, notes=tuple(notes))


def _is_state(channel: Channel) -> bool:
    """Whether a topic holds joint states; one without a schema goes by its name."""
    told = channel.msgtype.endswith("/JointState") or (not channel.msgtype and _STATES.search(channel.topic) is not None)
    return told and channel.encoding in ("cdr", "ros1", "")


def _is_control(channel: Channel) -> bool:
    return channel.msgtype.endswith("JointTrajectoryControllerState")


def _messages(path: Path) -> tuple[list[JointStates], list[JointStates], list[str]] | Stored:
    """Measured joint states, what was asked for, and notes on topics that are not used; where there are only messages in
    JSON or Protocol Buffers, these."""
    states: dict[str, list[JointStates]] = defaultdict(list)
    control: list[Block] = []
    free: list[Block] = []
    notes: list[str] = []
    for channel, received, raw in _by_library(path, lambda c: _is_state(c) or _is_control(c) or c.encoding in _FREE, notes):
        if _is_state(channel):
            states[channel.topic] += _states(channel, received, raw)
        else:
            (free if channel.encoding in _FREE else control).append((channel, received, raw))
    if not states and free:
        return free_messages(free, path, notes)
    if not states:
        raise _without_states(path)
    most = _measured({topic: sum(map(len, found)) for topic, found in states.items()})
    asked = [topic for topic in states if _asked_for(topic) and topic != most]
    wanted = [_renamed(s, _ASKED_FIELDS) for topic in asked for s in states[topic]]
    if not asked:
        wanted = [s for block in control for s in _controllers(*block)]
    left = sorted(set(states) - {most, *asked})
    if left:
        notes.append(f"log {path}: joint states of {most} are read, not those of {', '.join(left[:_SHOWN])}.")
    return states[most], wanted, notes


def _without_states(path: Path) -> DataError:
    topics = [f"{topic} ({kind})" for topic, kind in sorted(topics_of(path).items())]
    return DataError(
        f"log {path}: holds no message of type JointState; its topics: {', '.join(topics) or 'none'}. Record /joint_states, or"
        f" export the joints' data as CSV."
    )


def _measured(counts: Mapping[str, int]) -> str:
    """The topic of joint states that were measured: of several the one with most messages, then that with the shortest name."""
    measured = [topic for topic in counts if not _asked_for(topic)] or [*counts]
    return max(measured, key=lambda topic: (counts[topic], -len(topic)))


def _asked_for(topic: str) -> bool:
    return bool(set(re.split(r"[^a-z]+", topic.lower())) & DESIRED)


def _states(channel: Channel, received: Array, raw: Array) -> Iterator[JointStates]:
    if channel.encoding not in ("cdr", "ros1"):
        decoder(channel)  # which says what is read
    try:
        for states in decoded(raw, received, ros1=channel.encoding == "ros1"):
            yield replace(states, sender=channel.number)
    except ValueError as error:
        raise DataError(f"topic {channel.topic}: {error}.") from None


def _renamed(states: JointStates, names: Mapping[str, str]) -> JointStates:
    return replace(states, values={names[k]: v for k, v in states.values.items() if k in names})


def _controllers(channel: Channel, received: Array, raw: Array) -> Iterator[JointStates]:
    """Desired motion in the state messages of a controller."""
    read = decoder(channel)
    for at, row in zip(received.tolist(), raw, strict=True):
        message: Any = read(row.tobytes())
        part = next((getattr(message, p) for p in _REFERENCE if hasattr(message, p)), None)
        if part is not None:
            stamp = message.header.stamp
            sent = float(stamp.sec) + 1e-9 * float(stamp.nanosec)
            values = {own: np.asarray(getattr(part, field), float)[None] for field, own in _REFERENCE_FIELDS.items()}
            values = {own: v for own, v in values.items() if v.shape[1] == len(message.joint_names)}
            yield JointStates(tuple(message.joint_names), np.array([sent if sent > 0 else 1e-9 * at]), np.array([1e-9 * at]), values)


def _chunks(path: Path) -> Chunked:
    """The messages that name most joints, in the order of their stamps, of the topic that is measured, and what was asked for of these
    joints, brought to their clock. A topic on which others stand too is read whole."""
    said: list[str] = []
    topics, joints, filled, rows = _surveyed(path, said)
    names = ("t", *(f"{joint}.{field}" for field in (*FIELDS, *_ASKED) if field in filled for joint in joints))

    def read(wanted: Sequence[str], first: int) -> Iterator[dict[str, Array]]:
        after = 0
        asked = any(name.endswith(tuple(_ASKED)) for name in wanted)
        for clock, columns in _in_order(path, topics[0], topics[1] if asked else None):
            start, after = max(0, first - after), after + len(clock)
            missing = np.full(len(clock), np.nan)
            found = {"t": clock} | columns
            if start < len(clock):
                yield {name: found.get(name, missing)[start:] for name in wanted}

    def sample(wanted: Sequence[str]) -> dict[str, Array]:
        parts: list[dict[str, Array]] = []
        every = max(1, rows // (CHUNK * len(stretches(rows))))
        for k, part in enumerate(read(wanted, 0)):
            if k % every == 0:
                parts.append(part if every == 1 and rows <= 2 * CHUNK else {name: v[:STRETCH] for name, v in part.items()})
        return {name: np.concatenate([part[name] for part in parts]) for name in wanted}

    return Chunked(names, read, sample, rows, notes=tuple(said))


#: Topics of joint states that were asked for; () where the messages of a controller tell it.
Asked = frozenset[str]


def _surveyed(path: Path, said: list[str]) -> tuple[tuple[str, Asked], tuple[str, ...], set[str], int]:
    """The topic that is measured and those that were asked for, joints in the order in which they are first named, fields that hold
    anything, and number of messages; `said` as of `blocks`."""
    senders: dict[str, set[tuple[int, tuple[str, ...]]]] = defaultdict(set)
    seen: dict[str, Counter[tuple[str, ...]]] = defaultdict(Counter)
    filled: dict[str, set[str]] = defaultdict(set)
    for channel, received, raw in _by_library(path, _is_state, said):
        for s in _states(channel, received, raw):
            senders[channel.topic].add((s.sender, tuple(sorted(s.values))))
            seen[channel.topic][s.joints] += len(s)
            filled[channel.topic] |= {field for field, v in s.values.items() if np.isfinite(v).any()}
    if not seen:
        raise _without_states(path)
    topic = _measured({name: sum(own.values()) for name, own in seen.items()})
    groups: Counter[frozenset[str]] = Counter()
    for joints, count in seen[topic].items():
        groups[frozenset(joints)] += count
    if len(groups) > 1 or len(senders[topic]) > 1:
        raise UnsupportedError(
            f"log {path}: messages on {topic} name different joints, or come from several senders; read the log into memory"
            f" (--no-stream), which merges them."
        )
    asked = frozenset(name for name in seen if _asked_for(name) and name != topic)
    first = next(iter(seen[topic]))
    fields = {_ASKED_FIELDS[f] for name in asked for f in filled[name] & set(_ASKED_FIELDS)} if asked else _controlled(path, first)
    return (topic, asked), first, filled[topic] | fields, sum(groups.values())


def _controlled(path: Path, joints: Sequence[str]) -> set[str]:
    """Fields of the desired motion of these joints that the messages of a controller hold."""
    found: set[str] = set()
    for block in _by_library(path, _is_control):
        found |= {
            field for s in _controllers(*block) if set(s.joints) & set(joints) for field, v in s.values.items() if np.isfinite(v).any()
        }
    return found


def _in_order(path: Path, topic: str, asked: Asked | None) -> Iterator[tuple[Array, dict[str, Array]]]:
    """Times and columns of a topic's messages, chunk by chunk: the last of each wait for those that were stamped before them. What was
    asked for (None: nothing) is brought to their times."""
    waiting, beside = list[JointStates](), list[JointStates]()
    told = -np.inf

    def wanted(channel: Channel) -> bool:
        if _is_state(channel):
            return channel.topic == topic or channel.topic in (asked or ())
        return asked is not None and not asked and _is_control(channel)

    for channel, received, raw in _by_library(path, wanted):
        if channel.topic != topic:
            found = [*_states(channel, received, raw)] if _is_state(channel) else []
            found = [_renamed(s, _ASKED_FIELDS) for s in found] if found else [*_controllers(channel, received, raw)]
            if any(s.stamp.min() < told for s in found):
                raise UnsupportedError(_FAR.format(path=path))
            beside += found
            continue
        if sum(map(len, waiting)) >= CHUNK + _WAITING:  # when all that came beside them is there
            stamps = np.concatenate([s.stamp for s in waiting])
            until = float(np.partition(stamps, len(stamps) - _WAITING)[len(stamps) - _WAITING])
            ready = [s.of(s.stamp < until) for s in waiting]
            yield _with(beside, _after(told, table_of([s for s in ready if len(s)]), path))
            told, beside = until, recent(beside, until)
            waiting = [later for s in waiting if len(later := s.of(s.stamp >= until))]
        waiting += _states(channel, received, raw)
    if waiting:
        yield _with(beside, _after(told, table_of(waiting), path))


def _with(beside: Sequence[JointStates], part: tuple[Array, dict[str, Array]]) -> tuple[Array, dict[str, Array]]:
    clock, columns = part
    return clock, columns | (onto(clock, beside) if beside else {})


def _after(told: float, part: tuple[Array, dict[str, Array]], path: Path) -> tuple[Array, dict[str, Array]]:
    if len(part[0]) and part[0][0] < told:
        raise UnsupportedError(_FAR.format(path=path))
    return part


def _by_library(path: Path, wanted: Callable[[Channel], bool], said: list[str] | None = None) -> Iterator[Block]:
    """`blocks`, with what other libraries say of damaged files as DataError."""
    if find_spec("rosbags") is None:
        raise ConfigurationError(f"log {path}: reading bags needs rosbags: pip install 'ident[bags]'. Or export the joint states as CSV.")
    try:
        yield from blocks(path, wanted, said)
    except IdentError:
        raise
    except Exception as error:  # noqa: BLE001 - what a damaged bag brings up in another library
        raise DataError(f"log {path}: cannot be read as a bag ({type(error).__name__}: {reason(error)}).") from None


BAG = register_log_format(LogFormat("ROS bag", lambda path, start: is_bag(path), _read, chunks=_chunks))
