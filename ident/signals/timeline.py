"""What figures of rows over time are drawn from: several signals one after the other, thinned so that nothing of note is lost."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

Array = np.ndarray
#: Points along a time axis, points of a cloud, bins of a mean.
_TIMES = 700
_CLOUD = 1200
_BINS = 30
#: Share of the whole length that is left free between runs.
_BETWEEN = 0.01


class Timed(Protocol):
    """Rows in runs: signals, as far as a timeline looks at them."""

    @property
    def row_time(self) -> Array:
        """Time (M,) of each row, s."""

    @property
    def row_runs(self) -> tuple[slice, ...]:
        """The rows of each run."""


@dataclass(frozen=True, eq=False)
class Timeline:
    """Rows of several signals on one axis of time, run after run. `t` (M,) s; `edges`: the rows of each run; `starts`: where on
    the axis each of the signals begins and ends."""

    t: Array
    edges: tuple[slice, ...]
    starts: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, parts: Iterable[Timed]) -> Timeline:
        """One after the other."""
        parts = list(parts)
        runs = [(signals.row_time[rows], k) for k, signals in enumerate(parts) for rows in signals.row_runs if rows.stop > rows.start]
        free = _BETWEEN * sum(float(t[-1] - t[0]) for t, _ in runs)
        times, edges, at, row = [], [], 0.0, 0
        spans: dict[int, tuple[float, float]] = {}
        for t, k in runs:
            times.append(t - t[0] + at)
            edges.append(slice(row, row + len(t)))
            spans[k] = (spans[k][0] if k in spans else at, float(times[-1][-1]))
            at, row = spans[k][1] + free, row + len(t)
        return cls(np.concatenate(times), tuple(edges), tuple(spans[k] for k in sorted(spans)))

    def envelope(self, values: Array) -> tuple[Array, Array, Array]:
        """Time, least and greatest value (K,) of values (M,) in short stretches; NaN where there is none and between runs."""
        stretch = max(float(self.t[-1] - self.t[0]) / _TIMES, 1e-9)
        t, low, high = [], [], []
        for rows in self.edges:
            own, x = self.t[rows], values[rows]
            cut = np.unique(np.searchsorted(own, np.arange(own[0], own[-1] + stretch, stretch)))
            cut = cut[cut < len(own)]
            t.append(np.append(own[cut], np.nan))
            low.append(np.append(np.minimum.reduceat(np.where(np.isfinite(x), x, np.inf), cut), np.nan))
            high.append(np.append(np.maximum.reduceat(np.where(np.isfinite(x), x, -np.inf), cut), np.nan))
        return tuple(np.where(np.isfinite(v), v, np.nan) for v in map(np.concatenate, (t, low, high)))  # type: ignore[return-value]


def cloud(x: Array, y: Array) -> tuple[Array, Array]:
    """Not more points than a figure bears, evenly spread over the rows."""
    at = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    at = at[np.linspace(0, len(at) - 1, min(len(at), _CLOUD)).astype(int)] if len(at) else at
    return x[at], y[at]


def binned(x: Array, y: Array) -> tuple[Array, Array]:
    """Mean of y over bins of x: half way between even bins and bins of equally many points."""
    use = np.isfinite(x) & np.isfinite(y)
    x, y = x[use], y[use]
    if len(x) < 2 * _BINS or np.ptp(x) <= 0:
        return x[:0], y[:0]
    places = np.linspace(0.0, 1.0, _BINS + 1)
    edges = 0.5 * (np.quantile(x, places) + x.min() + places * np.ptp(x))
    bin_ = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, _BINS - 1)
    count = np.bincount(bin_, minlength=_BINS)
    keep = count >= 5
    mean_x, mean_y = (np.bincount(bin_, v, _BINS)[keep] / count[keep] for v in (x, y))
    return mean_x, mean_y
