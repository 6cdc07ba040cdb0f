"""The compiled filters along time seen from Python: the functions of `numpy_series`, with the same numbers to round-off.

Importing this module raises ImportError where the extension was not built, or from older sources."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .._native import _kernel  # type: ignore[attr-defined, unused-ignore]

Array = np.ndarray
#: Numbers that a row has a multiple of.
_LANES = 8

if not hasattr(_kernel, "lattice"):
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

    `predictors` (p + 1, p + 7): of order 0 … p, each behind three zeros. `past` (p, w), w a multiple of 8: the last rows, `age` of which
    count; updated. The rows are the `parts` side by side, columns of arrays (m, …), then zeros; where `valid`, a column of an array
    (m, …), is false they are zero. `out` (m, w): the result; `products` (w, w): added to, products of its first `rows` columns (a
    multiple of 8) with each column from there on."""
    flags, column = valid
    given = tuple((_contiguous(x), x.shape[1], s.start, s.stop - s.start) for x, s in parts)
    flags = np.ascontiguousarray(flags)
    width = past.shape[1]
    return int(_kernel.whiten(predictors, width, past, age, len(flags), given, flags, flags.shape[1], column, out, products, rows))


class NativeLattice:
    """Burg's lattice over samples (N,) with NaN in the gaps; see `numpy_series.NumpyLattice`."""

    def __init__(self, x: Array) -> None:
        present = np.isfinite(x)
        edges = np.flatnonzero(np.diff(present, prepend=False, append=False))
        self._stretches = np.ascontiguousarray(edges.reshape(-1, 2), dtype=np.int64)
        self._lengths = np.diff(self._stretches, axis=1)[:, 0]
        self._ahead = np.where(present, x, 0.0)
        self._behind = self._ahead.copy()
        self.order = 0
        self._sums = self._step(0.0)

    @property
    def count(self) -> int:
        """Pairs of errors there are."""
        return int(np.sum(np.maximum(self._lengths - self.order, 0)))

    @property
    def squares(self) -> float:
        """Σ of the squares of both errors."""
        return self._sums[0]

    @property
    def products(self) -> float:
        """Σ of their products."""
        return self._sums[1]

    def reflect(self, reflection: float) -> None:
        """Take up a reflection coefficient."""
        self._sums = self._step(reflection)

    def _step(self, reflection: float) -> tuple[float, float]:
        ahead, behind = self._ahead, self._behind
        sums: tuple[float, float] = _kernel.lattice(ahead, behind, len(ahead), self._stretches, self.order, reflection)
        self.order += 1
        return sums


def _contiguous(x: Array) -> Array:
    return np.ascontiguousarray(x, dtype=np.float64)


def _wide(x: Array) -> Array:
    """Rows of a width that fills the registers."""
    if not x.shape[1] % _LANES:
        return np.ascontiguousarray(x, dtype=np.float64)
    out = np.zeros((len(x), -(-x.shape[1] // _LANES) * _LANES))
    out[:, : x.shape[1]] = x
    return out


#: What `kernel()` calls it in either kernel.
lattice = NativeLattice
