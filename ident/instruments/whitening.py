"""Noise of each motor's rows as a spectrum, and the filter that makes it white."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np

Array = np.ndarray
#: Corners (Hz) of the first-order terms that a spectrum is made of, beside white noise and 1/f.
_CORNERS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
_SEGMENT = 8.0
#: Below this frequency (Hz) a density is what the terms say: there are too few periods for an estimate of its own.
_TOLD = 1.5


def density(e: Array, rate: float, top_hz: float, average: Literal["mean", "median"] = "mean") -> Callable[[Array], Array]:
    """Two-sided spectral density of rows e (M,), as a function of frequency (Hz). `average` of the stretches of time: their "mean", or
    their "median", which what is loud in few of them does not lift.

    A sum of white noise, 1/f and first-order terms, all weights ≥ 0, fitted to Welch's estimate; not below that estimate, smoothed, from
    1.5 Hz on."""
    from scipy.optimize import nnls
    from scipy.signal import welch

    f, power = welch(e, rate, nperseg=min(int(_SEGMENT * rate), len(e)), detrend=False, average=average)
    power = power / 2.0
    inside = (f <= 0.9 * top_hz) & (f >= 0.24)
    x, y = f[inside], power[inside]
    if len(y) < 4 or not y.mean() > 1e-25:
        return np.zeros_like

    def terms(g: Array) -> Array:
        return np.stack([np.ones_like(g), 1.0 / np.maximum(g, 0.08), *(1.0 / (1.0 + (g / c) ** 2) for c in _CORNERS)], axis=1)

    near = np.abs(x - x[:, None]) <= np.maximum(0.5, 0.2 * x)[:, None]
    smooth = near @ y / near.sum(axis=1)
    columns, level = terms(x), smooth.copy()
    weights = np.zeros(columns.shape[1])
    for _ in range(8):
        weights = nnls(columns / level[:, None], y / level, maxiter=100 * columns.shape[1])[0]
        level = 0.5 * level + 0.5 * np.maximum(columns @ weights, 1e-3 * smooth)

    def told(g: Array) -> Array:
        law = terms(g) @ weights
        return np.where(g < _TOLD, np.maximum(law, 1e-6 * y.mean()), np.maximum(0.7 * law, np.interp(g, x, smooth)))

    return told
