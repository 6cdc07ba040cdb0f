"""The compiled filters along time seen from Python: the functions of `numpy_series`, with the same numbers to round-off.

Importing this module raises ImportError where the extension was not built, or from older sources."""

from __future__ import annotations

import numpy as np

from .._native import _kernel  # type: ignore[attr-defined, unused-ignore]

Array = np.ndarray
#: Numbers that a row has a multiple of.
_LANES = 8

if not hasattr(_kernel, "filter_rows"):
    raise ImportError("the compiled kernel is of older sources: build it again.")


def average(polynomial: Array, x: Array) -> Array:
    """y (m, w), y[t] = a[0] x[t] + … + a[p] x[t − p], for x (p + m, w), whose first p rows are the past."""
    wide, width = _wide(x), x.shape[1]
    out = np.empty((len(x) - len(polynomial) + 1, wide.shape[1]))
    _kernel.filter_rows(0, np.ascontiguousarray(polynomial), wide.shape[1], len(out), wide, out)
    return out[:, :width]


def recursion(polynomial: Array, x: Array, before: Array) -> Array:
    """y (p + m, w), y[t] = x[t] − a[1] y[t − 1] − … − a[p] y[t − p], for x (m, w); first `before` (p, w), the results so far."""
    order, wide, width = len(polynomial) - 1, _wide(x), x.shape[1]
    out = np.zeros((order + len(x), wide.shape[1]))
    out[:order, :width] = before
    _kernel.filter_rows(1, np.ascontiguousarray(polynomial), wide.shape[1], len(x), wide, out)
    return out[:, :width]


def _wide(x: Array) -> Array:
    """Rows of a width that fills the registers."""
    if not x.shape[1] % _LANES:
        return np.ascontiguousarray(x, dtype=np.float64)
    out = np.zeros((len(x), -(-x.shape[1] // _LANES) * _LANES))
    out[:, : x.shape[1]] = x
    return out
