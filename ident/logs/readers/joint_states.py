"""JointState messages as they are sent, decoded many at a time: those that name the same joints differ in stamp and numbers only."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

Array = np.ndarray
FIELDS = ("position", "velocity", "effort")


@dataclass(frozen=True, eq=False)
class JointStates:
    """m messages that name the same `joints`: `stamp` (m,) s, the sender's (of receipt, where that is zero); `received` (m,) s; `values`:
    field → (m, joints), of those that are filled; `sender`: number of the connection, where a file tells it."""

    joints: tuple[str, ...]
    stamp: Array
    received: Array
    values: Mapping[str, Array]
    sender: int = 0

    def __len__(self) -> int:
        return len(self.stamp)

    def of(self, rows: Array | slice) -> JointStates:
        """Some of them."""
        return replace(self, stamp=self.stamp[rows], received=self.received[rows], values={k: v[rows] for k, v in self.values.items()})


@dataclass(frozen=True)
class _MessageLayout:
    """Where a message holds what, in bytes: its stamp, for each field where its numbers begin and how many there are, and from … to what is
    the same in every message of this layout: names and lengths."""

    joints: tuple[str, ...]
    stamp: int
    fields: tuple[tuple[int, int], ...]
    fixed: tuple[tuple[int, int], ...]


def decoded(raw: Array, received: Array, *, ros1: bool) -> Iterator[JointStates]:
    """Messages (m, L) of one length, received at times (m,) in ns. Raises ValueError for what is no JointState.

    `ros1`: serialised as ROS 1 does it; else as CDR."""
    left = np.arange(len(raw))
    while len(left):
        own = raw if len(left) == len(raw) else raw[left]
        layout = _layout(own[0].tobytes(), ros1=ros1)
        fixed = np.concatenate([np.arange(start, stop) for start, stop in layout.fixed])
        same = np.all(own[:, fixed] == own[0, fixed], axis=1)
        yield _of_layout(own[same], received[left[same]], layout)
        left = left[~same]


def _of_layout(raw: Array, received: Array, layout: _MessageLayout) -> JointStates:
    seconds = np.ascontiguousarray(raw[:, layout.stamp : layout.stamp + 8]).view("<u4").astype(float)
    stamp = seconds[:, 0] + 1e-9 * seconds[:, 1]
    values = {
        name: np.ascontiguousarray(raw[:, at : at + 8 * count]).view("<f8")
        for name, (at, count) in zip(FIELDS, layout.fields, strict=True)
        if count and count == len(layout.joints)
    }
    received = 1e-9 * received
    return JointStates(layout.joints, np.where(stamp > 0, stamp, received), received, values)


def _layout(message: bytes, *, ros1: bool) -> _MessageLayout:
    try:
        return _parsed(message, ros1=ros1)
    except (struct.error, UnicodeDecodeError, IndexError) as error:
        raise ValueError(f"a malformed JointState message ({error})") from None


def _parsed(message: bytes, *, ros1: bool) -> _MessageLayout:
    """CDR aligns what follows to its size, counted behind four bytes that tell the order of bytes; its texts end with a zero."""
    origin = 0 if ros1 else 4
    if not ros1 and message[1] != 1:
        raise ValueError("a message in an unknown byte order")
    at = origin + 4 if ros1 else origin
    stamp = at
    at += 8

    def aligned(size: int) -> int:
        return at if ros1 else at + (origin - at) % size

    fixed: list[tuple[int, int]] = []

    def count() -> tuple[int, int]:
        start = aligned(4)
        fixed.append((start, start + 4))
        return struct.unpack_from("<I", message, start)[0], start + 4

    length, at = count()
    at += length  # the frame
    names, at = count()
    joints = []
    for _ in range(names):
        length, at = count()
        joints.append(message[at : at + length].decode().rstrip("\x00"))
        fixed.append((at, at + length))
        at += length
    fields = []
    for _ in FIELDS:
        numbers, at = count()
        if numbers:
            at = aligned(8)
        if at + 8 * numbers > len(message):
            raise ValueError("a truncated message")
        fields.append((at, numbers))
        at += 8 * numbers
    return _MessageLayout(tuple(joints), stamp, tuple(fields), tuple(fixed))
