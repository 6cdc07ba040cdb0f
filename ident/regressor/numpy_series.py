"""Filters along time over many signals at once in plain NumPy: the functions of the compiled kernel of the same names."""

from __future__ import annotations

from collections.abc import Sequence

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


class NumpyLattice:
    """Burg's lattice over samples (N,) with NaN in the gaps: errors of prediction forwards and backwards, of the `order` that comes next,
    where the whole past is present."""

    def __init__(self, x: Array) -> None:
        present = np.isfinite(x)
        # What is not `live` is zero in both errors, and adds nothing to their products.
        self._live = present[1:] & present[:-1]
        self._ahead, self._behind = np.where(self._live, x[1:], 0.0), np.where(self._live, x[:-1], 0.0)

    @property
    def count(self) -> int:
        """Pairs of errors there are."""
        return int(np.count_nonzero(self._live))

    @property
    def squares(self) -> float:
        """Σ of the squares of both errors."""
        return float(self._ahead @ self._ahead + self._behind @ self._behind)

    @property
    def products(self) -> float:
        """Σ of their products."""
        return float(self._ahead @ self._behind)

    def reflect(self, reflection: float) -> None:
        """Take up a reflection coefficient."""
        live, ahead, behind = self._live[1:] & self._live[:-1], self._ahead, self._behind
        self._ahead, self._behind = (ahead[1:] + reflection * behind[1:]) * live, (behind[:-1] + reflection * ahead[:-1]) * live
        self._live = live


def whiten(
    predictors: Array,
    past: Array,
    age: int,
    parts: Sequence[tuple[Array, slice]],
    valid: tuple[Array, int],
    out: Array | None = None,
    products: Array | None = None,
    rows: int = 0,
) -> int:
    """Rows through the predictor of the order that the rows since the last gap allow; returns the rows since then, at most p.

    Arguments as in the compiled kernel (`native_series.whiten`)."""
    order, used = len(predictors) - 1, valid[0][:, valid[1]]
    m, p = len(used), order
    line = np.zeros((p + m, past.shape[1]))
    line[:p] = past
    first = 0
    for x, columns in parts:
        line[p:, first : first + columns.stop - columns.start] = x[:, columns]
        first += columns.stop - columns.start
    line[p:][~used] = 0.0
    past[:] = line[len(line) - p :]
    made = average(predictors[order, 3 : order + 4], line) if m else np.zeros((0, past.shape[1]))
    place = np.arange(m)
    # Rows since the last gap, before each row; those of the blocks before count on.
    gap = np.maximum.accumulate(np.where(used, -1 - age, place)) if m else place
    ages = np.minimum(np.concatenate([[age], place[1:] - gap[:-1] - 1]), p)[:m]
    made[~used] = 0.0
    for t in np.flatnonzero(used & (ages < p)).tolist():
        seen = int(ages[t])
        made[t] = predictors[seen, 3 : seen + 4][::-1] @ line[p + t - seen : p + t + 1]
    if out is not None:
        out[:] = made
    if products is not None:
        products[:rows] += made[:, :rows].T @ made
    return int(min(place[-1] - gap[-1], p)) if m else age


#: What `kernel()` calls it in either kernel.
lattice = NumpyLattice
