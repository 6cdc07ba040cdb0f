"""SHA-256 of a log beside its reading: from the pieces that are read anyway, so that the file is not read twice."""

from __future__ import annotations

import hashlib
from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import TracebackType

#: Pieces that may wait to be digested, so that they do not fill the memory.
_AHEAD = 4
_PIECE = 1 << 18


class FileDigest:
    """A thread that digests a file in order. What nobody shows it (the header, what an earlier process read, a file whose bytes are not
    those that are parsed) it reads itself. Use it as a context."""

    def __init__(self, path: Path, *, shown: bool) -> None:
        """`shown`: pieces of the file will be shown; else it is read at once."""
        self._path, self._digest = path, hashlib.sha256()
        self._pool = ThreadPoolExecutor(1)
        self._tasks: deque[Future[None]] = deque()
        #: Bytes given to the thread so far; None: all.
        self._end: int | None = 0
        if not shown:
            self._submit_range(None)

    def show(self, start: int, piece: memoryview) -> None:
        """The bytes of the file from `start` on, after all that was shown before."""
        if self._end is None or start < self._end:
            raise ValueError(f"{self._path}: bytes from {start} on were digested before.")
        if start > self._end:
            self._submit_range(start)
        self._tasks.append(self._pool.submit(self._digest.update, piece))
        self._end = start + len(piece)
        while len(self._tasks) > _AHEAD:
            self._tasks.popleft().result()

    def hexdigest(self) -> str:
        """The digest of the whole file."""
        self._submit_range(None)
        for task in self._tasks:
            task.result()
        return self._digest.hexdigest()

    def _submit_range(self, stop: int | None) -> None:
        if self._end is not None:
            self._tasks.append(self._pool.submit(self._read, self._end, stop))
            self._end = stop

    def _read(self, start: int, stop: int | None) -> None:
        buffer = memoryview(bytearray(_PIECE))
        with self._path.open("rb", buffering=0) as file:
            file.seek(start)
            left = stop - start if stop is not None else None
            while count := file.readinto(buffer if left is None else buffer[: min(left, _PIECE)]):
                self._digest.update(buffer[:count])
                left = None if left is None else left - count

    def __enter__(self) -> FileDigest:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._pool.shutdown(cancel_futures=True)
