"""Blocks of rows of the regression equation, and rows that are kept where they need not be in memory at once."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Rows:
    """A block of rows: `columns` (m, n, b) over base parameters, `tau` (m, n), `valid` (m, n), `place` in the signals' rows, `run`."""

    columns: Array
    tau: Array
    valid: Array
    place: slice
    run: int


@runtime_checkable
class KeptRows(Protocol):
    """All rows of a model, kept outside memory: block by block, also of one run and backwards."""

    @property
    def count(self) -> int:
        """Number of columns."""

    @property
    def row_runs(self) -> tuple[slice, ...]:
        """The rows of each run."""

    def __iter__(self) -> Iterator[Rows]: ...

    def of_run(self, number: int, *, backwards: bool = False) -> Iterator[Rows]:
        """The blocks of one run, from the last to the first if asked."""
