"""Messages in JSON of an MCAP file (Foxglove) as a table."""

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
from ..words import words_of
from .damage import reason
from .messages import table_of_messages
from .stored import Stored
from .topics import Block

Array = np.ndarray


def json_messages(blocks: Sequence[Block], path: Path, notes: Sequence[str]) -> Stored:
    """Columns of the messages of a topic, that of joints before others, in the order of receipt; `received` (s) is the recorder's clock.

    Raises DataError for a message that is no JSON object."""
    topics: dict[str, list[tuple[int, bytes]]] = defaultdict(list)
    for channel, received, raw in blocks:
        topics[channel.topic] += [(int(at), row.tobytes()) for at, row in zip(received.tolist(), raw, strict=True)]
    chosen = max(topics, key=lambda topic: (bool(words_of(topic) & {"joint", "joints"}), len(topics[topic])))
    messages = [_message(raw, chosen, path) | {"received": 1e-9 * at} for at, raw in sorted(topics[chosen])]
    sent = [_sent(message) for message in messages]
    if None not in sent and any(b < a for a, b in pairwise(sent)):
        messages = [messages[k] for k in sorted(range(len(sent)), key=lambda k: sent[k])]
        notes = [*notes, f"log {path}: messages were recorded in another order than they were stamped; the stamps count."]
    stored = table_of_messages(iter(messages), path)
    left = sorted(set(topics) - {chosen})
    said = [f"log {path}: messages of {chosen} are read, not those of {', '.join(left)}."] if left else []
    return replace(stored, units={"received": "s"}, notes=(*notes, *said))


def _sent(message: Mapping[str, Any]) -> Any:
    """The sender's stamp as ROS and Foxglove write it, (seconds, nanoseconds); None where there is none."""
    header = message.get("header")
    told = header.get("stamp") if isinstance(header, dict) else message.get("timestamp", message.get("stamp"))
    part = next((told[k] for k in ("nanosec", "nsec", "nsecs") if k in told), None) if isinstance(told, dict) else None
    whole = told.get("sec", told.get("secs")) if isinstance(told, dict) else None
    return (whole, part) if isinstance(whole, int) and isinstance(part, int) else None


def _message(raw: bytes, topic: str, path: Path) -> dict[str, Any]:
    try:
        message = json.loads(raw)
    except (ValueError, RecursionError) as error:
        raise DataError(f"log {path}: topic {topic}: a message is no JSON ({reason(error)}).") from None
    if not isinstance(message, dict):
        raise DataError(f"log {path}: topic {topic}: a message is JSON, but no object.")
    return message
