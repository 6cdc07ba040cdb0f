"""Messages of Protocol Buffers, by the schema that an MCAP file holds of them (a FileDescriptorSet); no generated code is needed."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

#: What stands before a value on the wire: a number of variable length, eight bytes, bytes with their count, four bytes.
_VARIABLE, _EIGHT, _BYTES, _FOUR = 0, 1, 2, 5
#: Kinds of field, as descriptors number them: those of fixed width, those of variable length, and those that are something else.
_FIXED = {1: "<d", 2: "<f", 6: "<Q", 7: "<I", 15: "<i", 16: "<q"}
_INTEGERS, _ZIGZAG, _BOOL, _TEXT, _MESSAGE = {3, 4, 5, 13, 14}, {17, 18}, 8, 9, 11
_REPEATED = 3
#: Levels to which messages are taken apart.
_DEEP = 12


@dataclass(frozen=True)
class _Field:
    """A field of a message: `kind` as the descriptor numbers it, `of`: the message's type where it is one; `optional`: it may be absent."""

    name: str
    kind: int
    repeated: bool
    of: str
    optional: bool


def decoded_message(raw: bytes, schema: bytes, msgtype: str) -> dict[str, Any]:
    """The fields of a message by name, lists and messages in it too; numbers that are not sent are zero, as the encoding has it.

    Raises ValueError for what is none."""
    types = _types(schema)
    if msgtype.lstrip(".") not in types:
        raise ValueError(f"its schema does not define {msgtype!r}")
    try:
        return _message(memoryview(raw), types, msgtype.lstrip("."), 0)
    except (struct.error, IndexError, TypeError) as error:  # what is too short, or stands on the wire as another kind
        raise ValueError(f"a message that does not match its schema ({error})") from None


@lru_cache(maxsize=16)
def _types(schema: bytes) -> dict[str, dict[int, _Field]]:
    """Fields by number of every type that a schema defines."""
    out: dict[str, dict[int, _Field]] = {}
    try:
        for number, file in _parts(memoryview(schema)):
            if number == 1:
                held = [*_parts(file)]
                package = next((bytes(x).decode() for k, x in held if k == 2), "")
                for k, x in held:
                    if k == 4:
                        _define(x, package, out)
    except (struct.error, IndexError, KeyError, StopIteration, UnicodeDecodeError, TypeError) as error:
        raise ValueError(f"its schema is not a set of descriptors ({error})") from None
    return out


def _define(descriptor: Any, scope: str, out: dict[str, dict[int, _Field]]) -> None:
    held = [*_parts(descriptor)]
    name = next(bytes(x).decode() for k, x in held if k == 1)
    full = f"{scope}.{name}" if scope else name
    out[full] = {}
    for k, x in held:
        if k == 2:
            told = dict(_parts(x))
            label, kind = int(told.get(4, 1)), int(told.get(5, 0))
            of = bytes(told.get(6, b"")).decode().lstrip(".")
            out[full][int(told[3])] = _Field(bytes(told[1]).decode(), kind, label == _REPEATED, of, 9 in told)
        elif k == 3:
            _define(x, full, out)


def _parts(raw: memoryview) -> Iterator[tuple[int, Any]]:
    """Field numbers and what stands there: a number, or bytes."""
    at = 0
    while at < len(raw):
        key, at = _varint(raw, at)
        wire = key & 7
        if wire == _VARIABLE:
            value, at = _varint(raw, at)
            yield key >> 3, value
            continue
        size = 8 if wire == _EIGHT else 4 if wire == _FOUR else -1
        if wire == _BYTES:
            size, at = _varint(raw, at)
        if size < 0 or at + size > len(raw):
            raise IndexError(f"field {key >> 3} extends beyond it")
        yield key >> 3, raw[at : at + size]
        at += size


def _varint(raw: memoryview, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        byte = raw[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
        if shift > 63:
            raise IndexError("an unterminated number")


def _message(raw: memoryview, types: dict[str, dict[int, _Field]], msgtype: str, deep: int) -> dict[str, Any]:
    fields = types[msgtype]
    out: dict[str, Any] = {}
    for own in fields.values():
        if own.repeated:
            out[own.name] = []
        elif not own.optional and own.kind not in (_MESSAGE, _TEXT):
            out[own.name] = 0.0 if own.kind in (1, 2) else 0
    for number, value in _parts(raw) if deep <= _DEEP else ():
        f = fields.get(number)
        if f is None:
            continue
        if not f.repeated:
            out[f.name] = _value(value, f, types, deep)
        elif isinstance(value, memoryview) and f.kind in _FIXED:
            out[f.name] += [x for (x,) in struct.iter_unpack(_FIXED[f.kind], value)]
        elif isinstance(value, memoryview) and f.kind not in (_MESSAGE, _TEXT, 12):
            at = 0
            while at < len(value):
                one, at = _varint(value, at)
                out[f.name].append(_value(one, f, types, deep))
        else:
            out[f.name].append(_value(value, f, types, deep))
    return out


def _value(value: Any, f: _Field, types: dict[str, dict[int, _Field]], deep: int) -> Any:
    if f.kind in _FIXED:
        return struct.unpack(_FIXED[f.kind], value)[0]
    if f.kind == _MESSAGE:
        return _message(value, types, f.of, deep + 1) if f.of in types else {}
    if f.kind == _TEXT:
        return bytes(value).decode("utf-8", "replace")
    if f.kind in _ZIGZAG:
        return (value >> 1) ^ -(value & 1)
    if f.kind in _INTEGERS:
        return value - (1 << 64) if value >= 1 << 63 else value
    return bool(value) if f.kind == _BOOL else None
