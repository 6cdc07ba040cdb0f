"""Topics of ROS 1 bags, ROS 2 bags (SQLite, MCAP) and plain MCAP files: raw messages in blocks, and what decodes those of any type."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from .mcap import Channel, McapFile

Array = np.ndarray
#: (channel, received (m,) ns, raw messages (m, L) uint8 of one length).
Block = tuple[Channel, Array, Array]
#: Messages that are gathered at a time.
_GATHERED = 16_384
_SUFFIXES = (".bag", ".db3", ".mcap")


def is_bag(path: Path) -> bool:
    """A bag file, or the folder of a ROS 2 bag."""
    return path.suffix.lower() in _SUFFIXES or (path.is_dir() and (path / "metadata.yaml").is_file())


def _parts(path: Path) -> list[Path]:
    """The MCAP files of a bag's folder, or of a path that is one."""
    if path.suffix.lower() == ".mcap" and path.is_file():
        return [path]
    found = sorted(path.glob("*.mcap")) if path.is_dir() else []
    return sorted(found, key=lambda p: [int(x) if x.isdecimal() else -1 for x in p.stem.split("_")[-1:]])


def blocks(path: Path, wanted: Callable[[Channel], bool], said: list[str] | None = None) -> Iterator[Block]:
    """Messages of the wanted topics of a bag, roughly in the order of receipt; `said`: gathers what there is to say of files that are cut
    off."""
    if files := _parts(path):
        for part in files:
            file = McapFile(part)
            yield from file.blocks(wanted)
            if file.cut and said is not None:
                said.append(
                    f"log {part}: the file is truncated in the middle of a record (the recorder was killed); the complete"
                    f" part of it is read."
                )
        return
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        kind = "cdr" if reader.is2 else "ros1"
        known = {c.id: Channel(c.id, c.topic, c.msgtype, c.msgdef.data, kind) for c in reader.connections}
        chosen = [c for c in reader.connections if wanted(known[c.id])]
        gathered: dict[tuple[int, int], list[tuple[int, bytes]]] = defaultdict(list)
        if chosen:
            for connection, received, raw in reader.messages(connections=chosen):
                own = gathered[connection.id, len(raw)]
                own.append((received, bytes(raw)))
                if len(own) >= _GATHERED:  # with those of other topics that came meanwhile
                    yield from (_block(known[number], held) for (number, _), held in gathered.items() if held)
                    gathered.clear()
        for (number, _), own in gathered.items():
            if own:
                yield _block(known[number], own)


def _block(channel: Channel, messages: list[tuple[int, bytes]]) -> Block:
    raw = np.frombuffer(b"".join(raw for _, raw in messages), np.uint8).reshape(len(messages), -1)
    return channel, np.array([received for received, _ in messages], np.int64), raw


def topics_of(path: Path) -> dict[str, str]:
    """Message type (and encoding, where it is another than ROS has) of every topic that has messages."""
    found: dict[str, str] = {}

    def noted(channel: Channel) -> bool:
        other = "" if channel.encoding in ("cdr", "ros1") else f", {channel.encoding or 'no encoding'}"
        found[channel.topic] = f"{channel.msgtype or 'no schema'}{other}"
        return False

    for _ in blocks(path, noted):
        raise DataError(f"log {path}: a topic that was not requested.")
    return found


def decoder(channel: Channel) -> Callable[[bytes], Any]:
    """A function from the raw message of a channel to an object with its fields. Raises DataError for an encoding that is not known."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if channel.encoding not in ("cdr", "ros1"):
        raise DataError(
            f"topic {channel.topic}: messages encoded as {channel.encoding or 'nothing'} are not read; only CDR, ROS 1 and JSON."
        )
    store = get_typestore(Stores.ROS2_HUMBLE if channel.encoding == "cdr" else Stores.ROS1_NOETIC)
    if channel.definition:
        read = get_types_from_idl if "module " in channel.definition else lambda text: get_types_from_msg(text, channel.msgtype)
        types = read(channel.definition)
        with suppress(Exception):  # a definition that is known already, in other words
            store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
    if channel.encoding == "ros1":
        return lambda raw: store.deserialize_ros1(raw, channel.msgtype)
    return lambda raw: store.deserialize_cdr(raw, channel.msgtype)
