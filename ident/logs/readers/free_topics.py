"""Messages of an MCAP file in JSON or Protocol Buffers (Foxglove) as a table."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import DataError
from ..words import QUANTITY_WORDS, words_of
from .damage import reason
from .mcap import Channel
from .messages import flat, table_of_messages
from .protobuf import decoded_message
from .stored import Stored
from .topics import Block

Array = np.ndarray


def free_messages(blocks: Sequence[Block], path: Path, notes: Sequence[str]) -> Stored:
    """Columns of the messages of a topic, in the order of receipt: that of joints before others, one that holds positions before one that
    holds none. `received` (s) is the recorder's clock.

    Raises DataError for a message that cannot be decoded."""
    topics: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    channels: dict[str, Channel] = {}
    for channel, received, raw in blocks:
        channels.setdefault(channel.topic, channel)
        topics[channel.topic] += [(int(at), row.tobytes()) for at, row in zip(received.tolist(), raw, strict=True)]

    def decoded(topic: str, raw: bytes) -> dict[str, Any]:
        return _message(raw, channels[topic], path)

    def rank(topic: str) -> tuple[bool, bool, int]:
        held = flat(decoded(topic, topics[topic][0][1])) if len(topics) > 1 else {}
        positions = any(words_of(name) & QUANTITY_WORDS["q"] for name in held)
        return bool(words_of(topic) & {"joint", "joints"}), positions, len(topics[topic])

    chosen = max(topics, key=rank)
    messages = [decoded(chosen, raw) | {"received": 1e-9 * at} for at, raw in sorted(topics[chosen])]
    sent = [_sent(message) for message in messages]
    if None not in sent and any(b < a for a, b in pairwise(sent)):
        messages = [messages[k] for k in sorted(range(len(sent)), key=lambda k: sent[k])]
        notes = [*notes, f"log {path}: messages were out of the order of their time stamps, and are sorted by them."]
    stored = table_of_messages(iter(messages), path)
    left = sorted(set(topics) - {chosen})
    said = [f"log {path}: messages of {chosen} are read, not those of {', '.join(left)}."] if left else []
    return replace(stored, units={"received": "s"}, notes=(*notes, *said))


def _sent(message: Mapping[str, Any]) -> Any:
    """The sender's stamp as ROS and Foxglove write it, (seconds, nanoseconds); None where there is none."""
    header = message.get("header")
    told = header.get("stamp") if isinstance(header, dict) else message.get("timestamp", message.get("stamp"))
    part = next((told[k] for k in ("nanosec", "nsec", "nsecs", "nanos") if k in told), None) if isinstance(told, dict) else None
    whole = told.get("sec", told.get("secs", told.get("seconds"))) if isinstance(told, dict) else None
    return (whole, part) if isinstance(whole, int) and isinstance(part, int) else None


def _message(raw: bytes, channel: Channel, path: Path) -> dict[str, Any]:
    try:
        if channel.encoding == "protobuf":
            return decoded_message(raw, channel.definition.encode("latin-1"), channel.msgtype)
        message = json.loads(raw)
    except (ValueError, RecursionError) as error:
        kind = "is no JSON" if channel.encoding == "json" else "cannot be decoded"
        raise DataError(f"log {path}: topic {channel.topic}: a message {kind} ({reason(error)}).") from None
    if not isinstance(message, dict):
        raise DataError(f"log {path}: topic {channel.topic}: a message is JSON, but not an object.")
    return message
