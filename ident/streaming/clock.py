"""The clock behind time stamps that are on disk: the same numbers as `ident.signals.resample` gives for stamps in memory."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np

from ..signals.resample import Clock, stamp_resolution
from .disk import PASS, DiskArray

Array = np.ndarray
#: Values that are sorted in memory at most.
_SORTED = 1 << 20
_BINS = 4096
#: Different steps that are counted one by one.
_DISTINCT = 1 << 14


def clock_of(t: DiskArray) -> Clock:
    """The clock behind rising stamps (N,); see `Clock.of`."""
    few = _tally(t)
    # Steps and how often each occurs: all at once where few differ, else piece by piece, each counting once.
    tallies: Callable[[], Iterable[tuple[Array, Any]]] = lambda: [few] if few else ((steps, 1) for steps in steps_of(t))  # noqa: E731
    step = _tallied_median(*few) if few else median(lambda: steps_of(t), len(t) - 1)
    resolution = stamp_resolution(t, step)  # type: ignore[arg-type]
    return Clock.behind(step, resolution, tallies)


def _tally(t: DiskArray) -> tuple[Array, Array] | None:
    """The steps that occur, in order, and how often each does; None where there are many."""
    values, counts = np.zeros(0), np.zeros(0, int)
    for steps in steps_of(t):
        new, often = np.unique(steps, return_counts=True)
        if len(new) > _DISTINCT:
            return None
        values, place = np.unique(np.concatenate([values, new]), return_inverse=True)
        if len(values) > _DISTINCT:
            return None
        counts = np.bincount(place, np.concatenate([counts, often])).astype(int)
    return values, counts


def _tallied_median(values: Array, counts: Array) -> float:
    """Median of rising values that occur so often."""
    ends, total = np.cumsum(counts), int(counts.sum())
    return float(values[np.searchsorted(ends, [(total - 1) // 2, total // 2], side="right")].mean())


def steps_of(t: DiskArray, size: int = PASS) -> Iterator[Array]:
    """Differences of neighbouring stamps, piece by piece."""
    for piece in t.pieces(size, overlap=1):
        yield np.diff(piece)


def median(values: Callable[[], Iterator[Array]], count: int) -> float:
    """Median of `count` values that come in pieces, exactly: passes narrow it down until what is left can be sorted."""
    low, high = np.inf, -np.inf
    for piece in values():
        if len(piece):
            low, high = min(low, float(piece.min())), max(high, float(piece.max()))
    below = 0  # values under `low`
    ranks = ((count - 1) // 2, count // 2)
    while low < high:
        inside = sum(int(np.count_nonzero((piece >= low) & (piece <= high))) for piece in values())
        if inside <= _SORTED:
            left = np.sort(np.concatenate([piece[(piece >= low) & (piece <= high)] for piece in values()]))
            return float((left[ranks[0] - below] + left[ranks[1] - below]) / 2)
        edges = np.linspace(low, high, _BINS + 1)
        edges[-1] = np.nextafter(high, np.inf)
        counts, least, most = np.zeros(_BINS, np.int64), np.full(_BINS, np.inf), np.full(_BINS, -np.inf)
        for piece in values():
            x = piece[(piece >= low) & (piece <= high)]
            place = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
            counts += np.bincount(place, minlength=_BINS)
            np.minimum.at(least, place, x)
            np.maximum.at(most, place, x)
        ends = below + np.cumsum(counts)
        first, last = (int(np.searchsorted(ends, r, side="right")) for r in ranks)
        if first != last and counts[first] + counts[last] > _SORTED:
            # The two middle values are the largest of one bin and the smallest of a later one.
            return float((most[first] + least[last]) / 2)
        below = int(ends[first] - counts[first])
        low, high = float(least[first]), float(most[last])
    return low


def longer_steps(t: DiskArray, limit: float) -> list[int]:
    """Samples that follow a step longer than `limit` (s)."""
    found: list[int] = []
    at = 1
    for steps in steps_of(t):
        found += (at + np.flatnonzero(steps > limit)).tolist()
        at += len(steps)
    return found


def deviation(t: DiskArray, rate: float) -> float:
    """Range of the stamps' distance from a uniform grid of `rate` (Hz) that starts at the first, s."""
    low, high, at, start = np.inf, -np.inf, 0, float(t[0])
    for piece in t.pieces():
        off = piece - start - np.arange(at, at + len(piece)) / rate
        low, high = min(low, float(off.min())), max(high, float(off.max()))
        at += len(piece)
    return high - low


def first_at_or_after(t: DiskArray, instant: float) -> int:
    """Place of the first stamp that is not before `instant`: `np.searchsorted` by halving, a stamp at a time."""
    low, high = 0, len(t)
    while low < high:
        middle = (low + high) // 2
        if t[middle] < instant:
            low = middle + 1
        else:
            high = middle
    return low
