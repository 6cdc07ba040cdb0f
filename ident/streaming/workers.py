"""Who does the work on the pieces: threads of this process, or the workers of a Dask cluster (`ident.streaming.distributed`)."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol, TypeVar

_T = TypeVar("_T")
_R = TypeVar("_R")


class Workers(Protocol):
    """Does the same to many pieces; results come in the order of the pieces, whoever is done first."""

    @property
    def threads(self) -> int:
        """Threads that a single piece may use for itself, where there is only one."""

    def map(self, work: Callable[[_T], _R], pieces: Sequence[_T]) -> Iterator[_R]:
        """`work` of every piece, in order. What it raises is raised here."""


@dataclass(frozen=True)
class Threads:
    """Threads of this process (NumPy, Arrow and the kernel let go of the interpreter lock while they compute)."""

    jobs: int = 1

    @property
    def threads(self) -> int:
        return self.jobs

    def map(self, work: Callable[[_T], _R], pieces: Sequence[_T]) -> Iterator[_R]:
        if self.jobs <= 1 or len(pieces) <= 1:
            yield from map(work, pieces)
            return
        with ThreadPoolExecutor(self.jobs) as pool:
            waiting: deque[Future[_R]] = deque()
            rest = iter(pieces)
            try:
                # A few ahead, not all: results that wait take memory.
                for piece in rest:
                    waiting.append(pool.submit(work, piece))
                    if len(waiting) > 2 * self.jobs:
                        yield waiting.popleft().result()
                while waiting:
                    yield waiting.popleft().result()
            finally:
                for future in waiting:
                    future.cancel()
