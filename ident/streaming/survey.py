"""What must be known of a whole log before its samples are used, gathered block by block and merged in order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .disk import over_rows

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Survey:
    """Facts about `rows` samples of n joints; all (n,).

    `low`, `high`: extremes of the position. `step`: largest change of position from one sample to the next that is no jump
    (≤ π); `jumps`: how many changes exceed π, and by how much the oddest of them differs from a full turn (`odd`).
    `missing`: samples without torque; `least`, `most`: extremes of the torque that is there."""

    rows: int
    low: Array
    high: Array
    step: Array
    jumps: Array
    odd: Array
    missing: Array
    least: Array
    most: Array

    @classmethod
    def of(cls, q: Array, torque: Array, before: Array | None = None) -> Survey:
        """From positions and torque (N, n) on any side; `before` (n,): the position just before the first."""
        n = q.shape[1]
        joined = q if before is None else np.concatenate([before[None], q])
        steps = np.abs(np.diff(joined, axis=0))
        jump = steps > np.pi
        step, odd = np.zeros(n), np.zeros(n)
        if len(steps):
            step = over_rows(np.maximum, steps if not jump.any() else np.where(jump, 0.0, steps))
        if jump.any():
            odd = np.where(jump, np.abs(steps - 2 * np.pi), 0.0).max(axis=0)
        absent = np.isnan(torque)
        if absent.any() or not len(q):
            least, most = _least(np.where(absent, np.inf, torque)), _most(np.where(absent, -np.inf, torque))
        else:
            least, most = over_rows(np.minimum, torque), over_rows(np.maximum, torque)
        jumps = jump.sum(axis=0) if jump.any() else np.zeros(n, int)
        missing = absent.sum(axis=0) if absent.any() else np.zeros(n, int)
        return cls(len(q), _least(q), _most(q), step, jumps, odd, missing, least, most)

    def __add__(self, other: Survey) -> Survey:
        """Of both, one after the other."""
        return Survey(
            self.rows + other.rows,
            np.minimum(self.low, other.low),
            np.maximum(self.high, other.high),
            np.maximum(self.step, other.step),
            self.jumps + other.jumps,
            np.maximum(self.odd, other.odd),
            self.missing + other.missing,
            np.minimum(self.least, other.least),
            np.maximum(self.most, other.most),
        )

    @property
    def wrapped(self) -> Array:
        """Columns whose jumps are full turns of a counter, by the rule of `ident.logs.log.unwrapped`, (n,) bool."""
        whole = self.odd <= np.maximum(0.3, 1.5 * self.step)
        return (self.jumps > 0) & (self.step < 2.5) & (self.high - self.low <= 2 * np.pi * 1.001) & whole

    def to_dict(self) -> dict[str, Any]:
        """For checkpoints: every number exactly."""
        return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self).items()}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Survey:
        """What `to_dict` wrote."""
        arrays = {k: np.array(v) for k, v in data.items() if k != "rows"}
        return cls(rows=int(data["rows"]), **arrays)


@dataclass(frozen=True, eq=False)
class Surveyed:
    """The survey of a block of stored rows that begins at `first`."""

    first: int
    survey: Survey

    @property
    def stop(self) -> int:
        return self.first + self.survey.rows

    def shifted(self, by: int) -> Surveyed:
        return replace(self, first=self.first + by)


def _least(x: Array) -> Array:
    return over_rows(np.minimum, x) if len(x) else np.full(x.shape[1], np.inf)


def _most(x: Array) -> Array:
    return over_rows(np.maximum, x) if len(x) else np.full(x.shape[1], -np.inf)
