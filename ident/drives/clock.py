"""Times of a log whose samples were taken at equal steps, though their stamps are not: a bus read late stamps a reading late."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
#: Share of a step by which stamps that are equal steps differ from them at most, and that by which others may.
_EQUAL, _MOST = 1e-3, 0.45
#: Samples at least, and standard deviations by which positions have to be smoother along equal steps.
_FEW, _SURE = 50, 4.0
#: Samples over which differences of neighbours share readings.
_SHARED = 5.0


def equal_steps(t: Array, positions: Array) -> Array:
    """Times (N,) at equal steps where positions (N, n) are smoother along them than along the stamps (N,), which are kept otherwise."""
    if len(t) < _FEW:
        return t
    step = float(np.median(np.diff(t)))
    number = np.concatenate([[0], np.cumsum(np.maximum(np.rint(np.diff(t) / step), 1.0))])
    slope, first = np.polyfit(number, t, 1)
    even = first + slope * number
    apart = np.abs(t - even)
    if not _EQUAL * step < np.max(apart) < _MOST * step:
        return t
    logged, equal = _roughness(t, positions), _roughness(even, positions)
    # As a share of both: where motion itself is rough, neither clock makes it smooth.
    change = np.sum((logged - equal) / np.maximum(logged + equal, 1e-300), axis=1)
    doubt = float(np.std(change)) * np.sqrt(_SHARED / len(change))
    return np.asarray(even if np.mean(change) > _SURE * doubt else t)


def _roughness(t: Array, positions: Array) -> Array:
    """Squared distance (N - 4, n) of each position from the cubic through two neighbours at each side."""
    at = [t[k : len(t) - 4 + k] for k in range(5)]
    out = positions[2:-2].copy()
    for k in (0, 1, 3, 4):
        weight = np.ones(len(at[2]))
        for other in (0, 1, 3, 4):
            if other != k:
                weight = weight * (at[2] - at[other]) / (at[k] - at[other])
        out -= weight[:, None] * positions[k : len(t) - 4 + k]
    return np.asarray(np.square(out))
