"""MCAP files, record by record: channels, and blocks of raw messages of one length. No summary, no index and no profile is needed.

Records of equal length that follow each other are taken together, so that a million messages take about as long as their bytes."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from ...errors import ConfigurationError, DataError

Array = np.ndarray
MAGIC = b"\x89MCAP0\r\n"
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 0x02, 0x03, 0x04, 0x05, 0x06, 0x0F
#: Bytes of a record's opcode and length, and of a message's channel, number and two times.
_HEAD, _FRONT = 9, 22
#: Bytes of a chunk, unpacked, that are believed.
_LARGEST = 1 << 30


@dataclass(frozen=True)
class Channel:
    """A topic of a file: `number` there, message type, text of its definition, encoding ("cdr", "ros1", "json", "protobuf" …). A definition
    that is no text has a letter (of Latin 1) for each byte."""

    number: int
    topic: str
    msgtype: str
    definition: str
    encoding: str


class McapFile:
    """A file, read from its beginning; its channels are learnt on the way."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, Channel] = {}
        self.cut = False

    def blocks(self, wanted: Callable[[Channel], bool]) -> Iterator[tuple[Channel, Array, Array]]:
        """Messages of the wanted channels as they stand in the file: received (m,) ns, and raw (m, L) uint8, all of one length.

        Of a file that is cut off, what is whole; `cut` then is true. Raises DataError for one that is damaged."""
        for number, received, raw in self._blocks():
            channel = self._channels.get(number)
            if channel is not None and wanted(channel):
                yield channel, received, raw

    def _blocks(self) -> Iterator[tuple[int, Array, Array]]:
        with self._path.open("rb") as file:
            if file.read(len(MAGIC)) != MAGIC:
                raise DataError(f"log {self._path}: is not an MCAP file.")
            pending: list[bytes] = []
            while len(head := file.read(_HEAD)) == _HEAD and head[0] not in (_FOOTER, _DATA_END):
                (length,) = struct.unpack_from("<Q", head, 1)
                body = file.read(length) if length <= _LARGEST else b""
                if len(body) < length:
                    self.cut = True  # as a recorder leaves it that was ended
                    break
                if head[0] == _CHUNK:
                    yield from self._records(self._unpacked(body))
                elif head[0] == _MESSAGE:
                    pending.append(head + body)
                    if len(pending) >= 4096:
                        yield from self._records(b"".join(pending))
                        pending = []
                else:
                    self._told(head[0], body)
            else:
                self.cut = len(head) < _HEAD
            yield from self._records(b"".join(pending))

    def _unpacked(self, body: bytes) -> bytes:
        size, _, name = struct.unpack_from("<QII", body, 16)
        kind = body[32 : 32 + name].decode()
        (length,) = struct.unpack_from("<Q", body, 32 + name)
        packed = body[40 + name : 40 + name + length]
        if size > _LARGEST or kind not in ("", "lz4", "zstd"):
            raise DataError(f"log {self._path}: a chunk has an unknown compression ({kind or 'none'}, {size} bytes).")
        content = packed if not kind else _lz4(packed) if kind == "lz4" else _zstandard(packed, size)
        if len(content) != size:
            raise DataError(f"log {self._path}: the file is damaged: a chunk unpacks to {len(content)} bytes, not {size}.")
        return content

    def _records(self, content: bytes) -> Iterator[tuple[int, Array, Array]]:
        """Messages among the records of a chunk, those of a channel and of one length together, in their order."""
        at, whole = 0, np.frombuffer(content, np.uint8)
        single: dict[tuple[int, int], list[Array]] = {}
        while at + _HEAD <= len(content):
            kind, length = content[at], struct.unpack_from("<Q", content, at + 1)[0]
            stride = _HEAD + length
            if at + stride > len(content):
                raise DataError(f"log {self._path}: the file is damaged: a record extends beyond its chunk.")
            if kind != _MESSAGE:
                self._told(kind, content[at + _HEAD : at + stride])
                at += stride
                continue
            if length < _FRONT:
                raise DataError(f"log {self._path}: the file is damaged: a message of {length} bytes.")
            alike = self._alike(whole, at, stride)
            if alike == 1:
                own = single.setdefault((struct.unpack_from("<H", content, at + _HEAD)[0], stride), [])
                own.append(whole[at : at + stride][None])
            else:
                table = whole[at : at + alike * stride].reshape(alike, stride)
                numbers = _column(table, _HEAD, "<u2")
                several = np.unique(numbers)
                for number in several.tolist():
                    single.setdefault((number, stride), []).append(table[numbers == number] if len(several) > 1 else table)
            at += alike * stride
        for (number, _), parts in single.items():
            yield self._block(number, np.concatenate(parts) if len(parts) > 1 else parts[0])

    def _alike(self, whole: Array, at: int, stride: int) -> int:
        """How many records from one on are messages of its length."""
        most = (len(whole) - at) // stride
        for look in (2, 64, most):
            count = min(look, most)
            table = whole[at : at + count * stride].reshape(count, stride)[:, :_HEAD]
            same = np.all(table == table[0], axis=1)
            if not same.all():
                return int(np.argmin(same))
        return most

    def _block(self, number: int, table: Array) -> tuple[int, Array, Array]:
        return number, _column(table, _HEAD + 6, "<u8").astype(np.int64), table[:, _HEAD + _FRONT :]

    def _told(self, kind: int, body: bytes) -> None:
        """Learn of a schema or a channel."""
        if kind == _SCHEMA:
            (number,) = struct.unpack_from("<H", body)
            name, at = _text(body, 2)
            written, at = _text(body, at)
            told = body[at + 4 : at + 4 + struct.unpack_from("<I", body, at)[0]]
            self._schemas[number] = name, told.decode("latin-1") if written == "protobuf" else told.decode("utf-8", "replace")
        elif kind == _CHANNEL:
            number, schema = struct.unpack_from("<HH", body)
            topic, at = _text(body, 4)
            encoding, _ = _text(body, at)
            self._channels[number] = Channel(number, topic, *self._schemas.get(schema, ("", "")), encoding)


def _column(table: Array, at: int, kind: str) -> Array:
    """Numbers (m,) of a kind that stand at a place of each row (m, bytes)."""
    return np.ascontiguousarray(table[:, at : at + np.dtype(kind).itemsize]).view(kind)[:, 0]


def _text(body: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", body, at)
    return body[at + 4 : at + 4 + length].decode("utf-8", "replace"), at + 4 + length


def _lz4(packed: bytes) -> bytes:
    import lz4.frame

    return bytes(lz4.frame.decompress(packed))


def _zstandard(packed: bytes, size: int) -> bytes:
    if find_spec("pyarrow") is not None:
        import pyarrow as pa

        return bytes(pa.Codec("zstd").decompress(packed, size, asbytes=True))
    if find_spec("backports") is not None and find_spec("backports.zstd") is not None:
        from backports import zstd

        return bytes(zstd.decompress(packed))
    raise ConfigurationError("chunks packed by Zstandard need pyarrow: pip install pyarrow.")
