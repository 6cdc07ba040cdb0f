"""Numbers as Fortran writes them in double precision (`1.5D-03`), as others do (`1.5E-03`)."""

from __future__ import annotations

import io
import re
from typing import IO, Any

#: A number with a decimal point and the exponent of double precision, by itself.
_DOUBLE = re.compile(rb"(?<![\w.])([+-]?(?:\d+\.\d*|\.\d+))[Dd]([+-]?\d{1,3})(?![\w.])")
#: Bytes in which such numbers are looked for, how many a table has there at least, and bytes that are rewritten at a time.
FRONT, _FEW, _BLOCK = 4096, 3, 1 << 20


def has_fortran_numbers(front: bytes) -> bool:
    """Whether the beginning of a file is that of a text with numbers of this kind."""
    return b"\x00" not in front and len(_DOUBLE.findall(front)) >= _FEW


class FortranNumbers(io.RawIOBase):
    """A stream with these numbers rewritten; each keeps its length, so that every place in it stays."""

    def __init__(self, inner: IO[bytes]) -> None:
        self._file = inner
        self._ready = b""

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        at = self.tell() + offset if whence == io.SEEK_CUR else offset
        self._ready = b""
        if whence == io.SEEK_END:
            return self._file.seek(offset, io.SEEK_END)
        # From the beginning of a line on, so that no number is cut in two.
        self._file.seek(max(0, at - FRONT))
        before = self._file.read(at - max(0, at - FRONT))
        begins = before.rfind(b"\n") + 1
        self._file.seek(at - len(before) + begins)
        self._ready = self._rewritten()[len(before) - begins :]
        return at

    def tell(self) -> int:
        return self._file.tell() - len(self._ready)

    def readinto(self, buffer: Any) -> int:
        if not self._ready:
            self._ready = self._rewritten()
        data, self._ready = self._ready[: len(buffer)], self._ready[len(buffer) :]
        buffer[: len(data)] = data
        return len(data)

    def close(self) -> None:
        if not self.closed:
            self._file.close()
        super().close()

    def _rewritten(self) -> bytes:
        block = self._file.read(_BLOCK)
        return _DOUBLE.sub(rb"\1E\2", block + self._file.readline())
