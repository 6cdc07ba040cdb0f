"""Structure of a MATLAB 5 to 7 file: each element lies within the one that holds it, with the parts that its flags ask for.

scipy trusts what such a file says of itself, and ends the process where that is false."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

from .packed import Expansion

_HEAD = 128
_MATRIX, _PACKED, _INTEGERS = 14, 15, 5
_CELL, _STRUCT, _OBJECT, _CHARACTERS, _SPARSE, _NUMBERS = 1, 2, 3, 4, 5, range(6, 16)
#: Bytes of a number of each type.
_BYTES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8, 16: 1, 17: 2, 18: 4}
_COMPLEX = 0x0800
_DEEPEST = 50


def check_structure(path: Path) -> None:
    """Raises ValueError for a file that is not as it says."""
    data = path.read_bytes()
    if len(data) < _HEAD or data[_HEAD - 2 : _HEAD] not in (b"IM", b"MI"):
        return  # of version 4, or none: not read by what is checked here
    order = "<" if data[_HEAD - 2 : _HEAD] == b"IM" else ">"
    outer, unpacked = _Elements(data, _HEAD, len(data), order), Expansion(path)
    while outer.more():
        kind, body = outer.next()
        if kind == _PACKED:
            stream = zlib.decompressobj()
            content = stream.decompress(body, unpacked.most)
            unpacked.add(len(content))
            inner = _Elements(content, 0, len(content), order)
            kind, body = inner.next()
        if kind == _MATRIX:
            _check_matrix(body, order, 0)


@dataclass
class _Elements:
    """Elements one after the other in `data[at:end]`."""

    data: bytes
    at: int
    end: int
    order: str

    def more(self) -> bool:
        return self.at < self.end

    def next(self) -> tuple[int, bytes]:
        """Type and bytes of the next one."""
        if self.at + 8 > self.end:
            raise ValueError("an element is cut off")
        word, size = struct.unpack_from(f"{self.order}II", self.data, self.at)
        if word >> 16:  # up to four bytes inside the tag itself
            if (size := word >> 16) > 4:
                raise ValueError(f"a small element of {size} bytes")
            begin, self.at, kind = self.at + 4, self.at + 8, word & 0xFFFF
        else:
            begin, kind = self.at + 8, word
            self.at = begin + (size if kind == _PACKED else -(-size // 8) * 8)
        if begin + size > self.end:
            raise ValueError(f"an element of {size} bytes where {self.end - begin} are left")
        return kind, self.data[begin : begin + size]


def _check_matrix(body: bytes, order: str, depth: int) -> None:
    if depth > _DEEPEST:
        raise ValueError(f"more than {_DEEPEST} nested arrays")
    if not body:
        return  # an empty one inside a cell
    parts = _Elements(body, 0, len(body), order)
    _, flags = parts.next()
    if len(flags) < 8:
        raise ValueError("the flags of an array are truncated")
    word = struct.unpack_from(f"{order}I", flags)[0]
    sort = word & 0xFF
    if sort not in (_CELL, _STRUCT, _OBJECT, _CHARACTERS, _SPARSE, *_NUMBERS):
        return  # functions and objects of MATLAB's classes: scipy keeps their bytes
    count = _count(parts, order)
    parts.next()  # the name
    if sort in _NUMBERS:
        for _ in range(2 if word & _COMPLEX else 1):
            kind, numbers = parts.next()
            if len(numbers) != count * _BYTES.get(kind, 0):
                raise ValueError(f"{len(numbers)} bytes for {count} numbers of type {kind}")
    elif sort == _CHARACTERS:
        parts.next()
    elif sort == _SPARSE:
        for _ in range(4 if word & _COMPLEX else 3):
            parts.next()
    else:
        if sort == _OBJECT:
            parts.next()  # the class's name
        if sort != _CELL:
            count *= _fields(parts, order)
        for _ in range(count):
            kind, inner = parts.next()
            if kind != _MATRIX:
                raise ValueError(f"an element of type {kind} where an array is expected")
            _check_matrix(inner, order, depth + 1)


def _count(parts: _Elements, order: str) -> int:
    """How many entries an array's dimensions make."""
    kind, sizes = parts.next()
    if kind != _INTEGERS or len(sizes) < 8 or len(sizes) % 4:
        raise ValueError("invalid dimensions")
    count = 1
    for n in struct.unpack(f"{order}{len(sizes) // 4}i", sizes):
        if n < 0:
            raise ValueError(f"a dimension of {n}")
        count *= n
    return count


def _fields(parts: _Elements, order: str) -> int:
    """How many fields a struct has."""
    _, length = parts.next()
    _, names = parts.next()
    width = struct.unpack(f"{order}i", length)[0] if len(length) == 4 else 0
    if width <= 0 or len(names) % width:
        raise ValueError("invalid names of fields")
    return len(names) // width
