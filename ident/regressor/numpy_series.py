"""Filters along time over many signals at once in plain NumPy: the functions of the compiled kernel of the same names."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
#: Rows that are averaged by one banded product.
_ROWS = 128


def average(polynomial: Array, x: Array) -> Array:
    """y (m, w), y[t] = a[0] x[t] + … + a[p] x[t − p], for x (p + m, w), whose first p rows are the past."""
    order = len(polynomial) - 1
    count = len(x) - order
    band = np.zeros((_ROWS, _ROWS + order))
    for row in range(_ROWS):
        band[row, row : row + order + 1] = polynomial[::-1]
    out = np.empty((count, x.shape[1]))
    for first in range(0, count, _ROWS):
        last = min(first + _ROWS, count)
        np.matmul(band[: last - first, : last - first + order], x[first : last + order], out=out[first:last])
    return out


def recursion(polynomial: Array, x: Array, before: Array) -> Array:
    """y (p + m, w), y[t] = x[t] − a[1] y[t − 1] − … − a[p] y[t − p], for x (m, w); first `before` (p, w), the results so far."""
    from scipy.signal import lfilter

    order = len(polynomial) - 1
    if not order:
        return np.array(x)
    state = np.zeros((order, x.shape[1]))
    for i in range(order):
        state[i] = -polynomial[i + 1 :] @ before[order - 1 - np.arange(order - i)]
    return np.concatenate([before, lfilter([1.0], polynomial, x, axis=0, zi=state)[0]])
