"""A run on disk: what `ident.Log` is in memory, read by pieces."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from ..logs.log import Log, log_of
from ..logs.torque import measured
from ..robots.transmission import Transmission
from .disk import PASS, DiskArray
from .survey import Survey, Surveyed

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class StoredLog:
    """One run as recorded, its arrays in files. `arrays`: "t" (N,), and "q" or "q_motor", "dq", "ddq", "dq_motor", "tau_joint",
    "tau_motor", "tau_current" (N, n), those that were logged, and desired motion ("q_ref" …). `blocks`: surveys of stretches of rows, in
    order (they need not cover all rows). `origin`: time at which the recording began. The rest as in `Log`."""

    name: str
    arrays: Mapping[str, DiskArray]
    source: str = ""
    sha256: str = ""
    notes: tuple[str, ...] = ()
    blocks: tuple[Surveyed, ...] = ()
    origin: float | None = None
    hint: str = ""

    def __len__(self) -> int:
        return len(self.t)

    @property
    def t(self) -> DiskArray:
        """Time stamps (N,), s."""
        return self.arrays["t"]

    @property
    def positions(self) -> DiskArray:
        """Positions (N, n) on the side on which they were logged."""
        return self.arrays["q"] if "q" in self.arrays else self.arrays["q_motor"]

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.positions.width

    @property
    def duration(self) -> float:
        """Seconds from the first to the last sample."""
        return float(self.t[-1] - self.t[0])

    @property
    def began(self) -> float:
        """Time at which the recording began."""
        return self.origin if self.origin is not None else float(self.t[0])

    def read(self, start: int, stop: int) -> Log:
        """Some rows in memory."""
        piece = {k: a[start:stop] for k, a in self.arrays.items()}
        extra = {f"{k}{j + 1}": a[:, j] for k, a in piece.items() if is_desired(k) for j in range(a.shape[1])}
        return replace(log_of(self.name, piece, self.source, self.sha256, self.notes, self.began), hint=self.hint, extra=extra)

    def part(self, start: int, stop: int, name: str | None = None) -> StoredLog:
        """Some rows, still on disk."""
        blocks = tuple(b.shifted(-start) for b in self.blocks if b.first > start and b.stop <= stop)
        arrays = {k: a.part(start, stop) for k, a in self.arrays.items()}
        return replace(self, name=self.name if name is None else name, arrays=arrays, blocks=blocks, origin=self.began)

    def survey(self, transmission: Transmission) -> Survey:
        """Facts about all rows: the blocks that are known, and what lies between them from the files."""
        return reduce(Survey.__add__, self._surveys(transmission))

    def _surveys(self, transmission: Transmission):  # type: ignore[no-untyped-def]
        at = 0
        for block in self.blocks:
            yield from self._surveyed(at, block.first, transmission)
            yield block.survey
            at = block.stop
        yield from self._surveyed(at, len(self), transmission)

    def _surveyed(self, start: int, stop: int, transmission: Transmission):  # type: ignore[no-untyped-def]
        for a in range(start, stop, PASS):
            piece = self.read(a, min(a + PASS, stop))
            yield survey_of(piece, transmission, self.positions[a - 1] if a else None)


def is_desired(name: str) -> bool:
    """Whether an array holds what was asked for, not what was measured."""
    return name.endswith(("_ref", "_cmd"))


def survey_of(log: Log, transmission: Transmission, before: Array | None = None) -> Survey:
    """Facts about the rows of a log in memory; torque on the measured side, if there is any. `before` (n,): the position before it."""
    positions = log.q if log.q is not None else log.q_motor
    assert positions is not None
    torque = measured(log, transmission).torque if log.tau else np.full(positions.shape, np.nan)
    return Survey.of(positions, torque, before)
