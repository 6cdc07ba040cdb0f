"""The bytes of a file, unpacked where it is packed, within bounds."""

from __future__ import annotations

import bz2
import codecs
import gzip
import io
import lzma
from collections.abc import Callable, Iterable, Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

from ...errors import ConfigurationError, DataError
from .damage import damage_told
from .exponents import FRONT, FortranNumbers, has_fortran_numbers

#: Bytes that a packed file may always unpack to, how many times its own size beyond that, and bytes that are unpacked at a time.
_UNPACKED, _RATIO, _BLOCK = 1 << 28, 200, 1 << 20
_ZSTANDARD = b"\x28\xb5\x2f\xfd"
LONGEST_LINE = 4_000_000
_OPENERS: tuple[tuple[bytes, Callable[..., Any]], ...] = ((b"\x1f\x8b", gzip.open), (b"BZh", bz2.open), (b"\xfd7zXZ", lzma.open))


def open_binary(path: Path) -> IO[bytes]:
    """The bytes of a file, decompressed if it begins like a packed one; damage in that, wherever it is met, is a DataError. Numbers as
    Fortran writes them are rewritten."""
    stream = _opened(path)
    if isinstance(stream, io.BytesIO):
        return stream
    fortran = has_fortran_numbers(stream.read(FRONT))
    stream.seek(0)
    return io.BufferedReader(FortranNumbers(stream), _BLOCK) if fortran else stream


def _opened(path: Path) -> IO[bytes]:
    with path.open("rb") as raw:
        start = raw.read(6)
    for magic, opener in _OPENERS:
        if start.startswith(magic):
            return io.BufferedReader(_Told(opener(path, "rb"), path), _BLOCK)
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) and start[:4] != b"\xff\xff\xff\xff":
        with damage_told(path, "begins like UTF-16, but is not"):
            return io.BytesIO(path.read_bytes().decode("utf-16").encode())
    if start.startswith(_ZSTANDARD):
        return io.BufferedReader(_Told(_Zstandard(path), path), _BLOCK)
    return path.open("rb")


class _Zstandard(io.RawIOBase):
    """What a file packed by Zstandard unpacks to, by pyarrow; to go back, it begins anew."""

    def __init__(self, path: Path) -> None:
        if find_spec("pyarrow") is None:
            raise ConfigurationError(
                f"log {path}: is compressed with Zstandard, which needs pyarrow: pip install pyarrow. Or decompress it first."
            )
        self._path = path
        self._begin()

    def _begin(self) -> None:
        import pyarrow as pa

        self._inner, self._at = pa.CompressedInputStream(pa.OSFile(str(self._path)), "zstd"), 0

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        goal = offset + (self._at if whence == io.SEEK_CUR else 0)
        if goal < self._at:
            self._inner.close()
            self._begin()
        while self._at < goal and (skipped := len(self._inner.read(min(_BLOCK, goal - self._at)))):
            self._at += skipped
        return self._at

    def tell(self) -> int:
        return self._at

    def readinto(self, buffer: Any) -> int:
        data = self._inner.read(len(buffer))
        buffer[: len(data)] = data
        self._at += len(data)
        return len(data)

    def close(self) -> None:
        if not self.closed:
            self._inner.close()
        super().close()


class Expansion:
    """How many bytes a packed file may become in memory, counted as they come; more is a DataError."""

    def __init__(self, path: Path) -> None:
        self._path, self._bytes = path, 0
        self.most = max(_UNPACKED, _RATIO * path.stat().st_size)

    def add(self, count: int) -> None:
        """Count bytes before they are kept."""
        self._bytes += int(count)
        if self._bytes > self.most:
            raise DataError(
                f"log {self._path}: expands to more than {_RATIO} times its size ({self._bytes / 1e6:.0f} MB so far): a damaged"
                f" file, or one made to exhaust memory. If this is intended, decompress it first, or read it in chunks (--stream)."
            )


class _Told(io.RawIOBase):
    """A stream whose damage is a DataError."""

    def __init__(self, inner: Any, path: Path) -> None:
        self._inner, self._path = inner, path

    def readable(self) -> bool:
        return True

    def seekable(self) -> bool:
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        with damage_told(self._path, "the file is damaged"):
            return int(self._inner.seek(offset, whence))

    def readinto(self, buffer: Any) -> int:
        with damage_told(self._path, "the file is damaged"):
            return int(self._inner.readinto(buffer))

    def close(self) -> None:
        if not self.closed:
            self._inner.close()
        super().close()


class _Unpacked(_Told):
    """What a packed file unpacks to, up to a size that a table of numbers may have."""

    def __init__(self, inner: Any, path: Path) -> None:
        super().__init__(inner, path)
        self._bytes, self._counted = Expansion(path), 0

    def readinto(self, buffer: Any) -> int:
        count = super().readinto(buffer)
        if (at := self._inner.tell()) > self._counted:  # what is read again counts once
            self._bytes.add(at - self._counted)
            self._counted = at
        return count


def open_whole(path: Path) -> IO[bytes]:
    """`open_binary` for those who keep all of it in memory."""
    stream = open_binary(path)
    plain = isinstance(stream, io.BytesIO) or (isinstance(stream, io.BufferedReader) and isinstance(stream.raw, io.FileIO))
    return stream if plain else io.BufferedReader(_Unpacked(stream, path), _BLOCK)


def bounded_lines(text: Iterable[str], path: Path) -> Iterator[str]:
    """The lines of a text. Raises DataError for one that is longer than any row of a log."""
    read = getattr(text, "readline", None)
    if read is None:
        yield from text
        return
    while line := read(LONGEST_LINE + 1):
        if len(line) > LONGEST_LINE:
            raise DataError(f"log {path}: has a line of more than {LONGEST_LINE} characters: it is not a table of rows.")
        yield line
