"""Steps between time stamps: which long ones are samples that are missing, and which are jitter.

A sampling instant that is early or late makes one step long and its neighbour short. A sample that was never written makes a step of
a whole multiple of the period, and no short one makes up for it. Steps are counted by their size, so that pieces of a log add up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray
#: A step longer than this multiple of the usual one is a gap.
GAP = 3.5
#: Hundredths of the usual step.
_SIZES = np.arange(int(100 * GAP) + 1)
#: How near to a multiple (hundredths) a step counts as one, at least and at most: rounding, and a quarter of the period.
_NEAR, _FAR = 2, 25
#: Where half of the steps are further off than this (hundredths), multiples cannot be distinguished from scatter.
_WILD = 18


@dataclass(frozen=True, eq=False)
class Spacing:
    """`counts` (351,): steps by their size in hundredths of the usual step, gaps left out."""

    counts: Array

    @classmethod
    def of(cls, steps: Array, times: Any, step: float) -> Spacing:
        """From steps (s), each occurring `times` (one number, or one for each), against the usual `step`."""
        size = np.minimum(np.rint(100 * steps / step), len(_SIZES)).astype(int)
        weight = np.broadcast_to(np.asarray(times, float), size.shape)
        return cls(np.bincount(size, weight, len(_SIZES) + 1)[: len(_SIZES)])

    def __add__(self, other: Spacing) -> Spacing:
        return Spacing(self.counts + other.counts)

    @property
    def missing(self) -> int:
        """Samples that are missing, one or two at a time; 0 where the long steps may as well be jitter."""
        counts, size = self.counts, _SIZES
        scatter = self._scatter()
        if scatter > _WILD:
            return 0
        # Six times the median deviation: four standard deviations of normal scatter.
        near = int(np.clip(6 * scatter, _NEAR, _FAR))
        whole = (size + 50) // 100
        multiple = (size > 150) & (np.abs(size - 100 * whole) <= near)
        found, lost = counts[multiple].sum(), (counts * (whole - 1))[multiple].sum()
        balance = float((counts * (whole - 1)).sum())
        # Jitter alone: as many steps near zero as near two, for what is long here is short there, and a tail that has come down
        # at two from what it is just before. Of the tail, one step more than was seen is allowed for.
        late, early = (counts[a & b].sum() for a, b in ((size > 150, size < 200 - near), (size < 50, size > near)))
        width = 2 * near / (50 - near)
        by_chance = counts[size <= near].sum() + width * max(late - early, 0.0)
        if found <= by_chance + 3 * np.sqrt(by_chance + width**2 * (late + early + 1)) or balance < 0.5 * lost:
            return 0
        # Where scatter carries steps further than a quarter of the period, those that went astray balance on both sides.
        return round(balance if near == _FAR else lost)

    def _scatter(self) -> float:
        """Median distance from the usual step of the steps about it (hundredths)."""
        about = np.abs(_SIZES - 100) <= 50
        far = np.bincount(np.abs(_SIZES - 100)[about], self.counts[about])
        ends = np.cumsum(far)
        return float(np.searchsorted(ends, 0.5 * ends[-1]))
