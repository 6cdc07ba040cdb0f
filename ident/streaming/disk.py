"""Arrays that stay in files: written once, in order, and read by slices."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import UnsupportedError

Array = np.ndarray
#: Samples that are read at a time in a pass over a whole array.
PASS = 1 << 17


#: Settings of the GNU C library (malloc.h), and bytes below which it reuses freed memory instead of asking the system for it again.
_TRIM_THRESHOLD, _MMAP_THRESHOLD, _ARENA_MAX, _REUSED = -1, -3, -8, 1 << 23


def reuse_memory() -> None:
    """Have the C library keep the memory of one piece for the next (where it can): the system would clear it page by page each time.

    All threads draw on one store: pieces are few and large, and stores of their own would each keep some."""
    with suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_MMAP_THRESHOLD, _REUSED)
        library.mallopt(_TRIM_THRESHOLD, _REUSED)
        library.mallopt(_ARENA_MAX, 1)


def give_back_memory() -> None:
    """Hand memory that is free, but still held by the C library, back to the system (where it can): a peak then stays what is in use."""
    with suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


def over_rows(reduction: np.ufunc, x: Array) -> Array:
    """`reduction.reduce(x, axis=0)` of (N, n), n small: many rows at once, so that the inner loop is long."""
    width, lanes = x.shape[1], 64
    whole = len(x) // lanes * lanes
    if not whole or not x.flags.c_contiguous:
        return np.asarray(reduction.reduce(x, axis=0))
    head = reduction.reduce(x[:whole].reshape(-1, lanes * width), axis=0).reshape(lanes, width)
    return np.asarray(reduction.reduce(np.concatenate([head, x[whole:]]), axis=0))


@dataclass(frozen=True)
class DiskArray:
    """Rows of float64 in a file: (N,) where `width` is 0, else (N, width). `first`: row of the file with which it begins.

    Takes slices and single rows; what asks for the whole of it as an array is refused (UnsupportedError), because it may be
    larger than memory."""

    path: Path
    rows: int
    width: int = 0
    first: int = 0

    def __len__(self) -> int:
        return self.rows

    @property
    def shape(self) -> tuple[int, ...]:
        return (self.rows, self.width) if self.width else (self.rows,)

    @property
    def ndim(self) -> int:
        return len(self.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        return np.dtype(np.float64)

    def __getitem__(self, key: Any) -> Any:
        if isinstance(key, (int, np.integer)):
            row = int(key) + (self.rows if key < 0 else 0)
            if not 0 <= row < self.rows:
                raise IndexError(row)
            return self._read(row, row + 1)[0]
        if not isinstance(key, slice):
            raise UnsupportedError("an array in a file is read by slices only.")
        start, stop, step = key.indices(self.rows)
        if step == 1:
            return self._read(start, max(start, stop))
        if step < 1:
            raise UnsupportedError("an array in a file is not read backwards.")
        # Only the rows asked for are kept of each piece.
        size = max(step, PASS // step * step)
        parts = [self._read(a, min(a + size, stop))[::step] for a in range(start, stop, size)]
        return np.concatenate(parts) if parts else self._read(0, 0)

    def __array__(self, *_: Any, **__: Any) -> Array:
        raise UnsupportedError("this needs the whole log in memory at once; run it without streaming (--no-stream), or on a shorter log.")

    def part(self, start: int, stop: int) -> DiskArray:
        """Rows `start` … `stop` - 1, still in the file."""
        return replace(self, first=self.first + start, rows=stop - start)

    def pieces(self, size: int = PASS, overlap: int = 0) -> Iterator[Array]:
        """All rows in order, piece by piece, each with the last `overlap` rows of the one before."""
        for start in range(0, self.rows, size):
            yield self._read(max(0, start - overlap), min(start + size, self.rows))

    def _read(self, start: int, stop: int) -> Array:
        across = max(1, self.width)
        found = np.fromfile(self.path, np.float64, (stop - start) * across, offset=(self.first + start) * across * 8)
        if len(found) != (stop - start) * across:
            raise OSError(f"{self.path} is shorter than it should be: the scratch folder was changed while it was in use.")
        return found.reshape(-1, self.width) if self.width else found


class DiskWriter:
    """Appends rows to a file; `rows` of those it may hold already are kept (a run that was interrupted goes on there)."""

    def __init__(self, path: Path, width: int = 0, rows: int = 0) -> None:
        self.path, self.width, self.rows = Path(path), width, rows
        self._file = self.path.open("r+b" if rows else "wb")
        self._file.truncate(rows * max(1, width) * 8)
        self._file.seek(0, os.SEEK_END)

    def append(self, values: Array) -> None:
        """Add rows (m,) or (m, width)."""
        self._file.write(np.ascontiguousarray(values, np.float64).data)
        self.rows += len(values)

    def flush(self) -> None:
        """Hand everything to the operating system: from here on it survives the end of this process."""
        self._file.flush()

    def close(self) -> DiskArray:
        """The finished array."""
        self._file.close()
        return DiskArray(self.path, self.rows, self.width)
