"""ROS 1 bags, ROS 2 bags (SQLite, MCAP) and plain MCAP files, by `rosbags`: joint states as one table."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import ConfigurationError, DataError
from .damage import reason

Array = np.ndarray
_SUFFIXES = (".bag", ".db3", ".mcap")
_FIELDS = ("position", "velocity", "effort")


def is_bag(path: Path) -> bool:
    """A bag file, or the folder of a ROS 2 bag."""
    return path.suffix.lower() in _SUFFIXES or (path.is_dir() and (path / "metadata.yaml").is_file())


def bag_columns(path: Path) -> dict[str, Array]:
    """Columns of a bag's joint states: `t` (s, the sender's stamp), `<joint>.position`, `.velocity`, `.effort` where any is there.

    Messages are ordered by their stamps, and their values by the joints' names, whatever the order in a message. The topic with
    the most joint states counts. Raises DataError, and ConfigurationError without `rosbags`."""
    if find_spec("rosbags") is None:
        raise ConfigurationError(f"log {path}: reading bags needs rosbags: pip install 'ident[bags]'. Or export the joint states as CSV.")
    try:
        states = list(_states(path))
    except DataError:
        raise
    except Exception as error:  # noqa: BLE001 - what a damaged bag brings up in another library
        raise DataError(f"log {path}: cannot be read as a bag ({type(error).__name__}: {reason(error)}).") from None
    if not states:
        raise DataError(f"log {path}: holds no message of type JointState.")
    states.sort(key=lambda s: s[0])
    names = list(dict.fromkeys(name for _, message in states for name in message.name))
    place = {name: k for k, name in enumerate(names)}
    table = {field: np.full((len(states), len(names)), np.nan) for field in _FIELDS}
    for row, (_, message) in enumerate(states):
        at = [place[name] for name in message.name]
        for field in _FIELDS:
            values = np.asarray(getattr(message, field), float)
            if len(values) == len(at):
                table[field][row, at] = values
    columns = {"t": np.array([t for t, _ in states])}
    for field, values in table.items():
        if np.isfinite(values).any():
            columns |= {f"{name}.{field}": values[:, k] for name, k in place.items()}
    return columns


def _states(path: Path) -> Iterator[tuple[float, Any]]:
    """Stamps (s) and joint states of the topic that has most of them."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        topics = [c for c in reader.connections if c.msgtype.endswith("/JointState")]
        if not topics:
            raise DataError(f"log {path}: holds no message of type JointState; its topics: {', '.join(sorted(reader.topics)) or 'none'}.")
        most = max(topics, key=lambda c: c.msgcount)
        chosen = [c for c in topics if c.topic == most.topic]
        for connection, received, raw in reader.messages(connections=chosen):
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamp = message.header.stamp
            sent = float(stamp.sec) + 1e-9 * float(stamp.nanosec)
            yield (sent if sent > 0 else 1e-9 * received), message
