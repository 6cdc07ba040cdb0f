"""Filtered rows of the regression equation and their information in plain NumPy: the functions of the compiled kernel of the same names.

Rows are made some at a time, so that the columns of all samples are never in memory. Arguments are checked by
`ident.regressor.rigid`; `threads` has no effect here."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..robots.tree import RigidBodyTree
from .numpy_dynamics import CHUNK, regressor

Array = np.ndarray


def information(
    tree: RigidBodyTree,
    q: Array,
    dq: Array,
    ddq: Array,
    tau: Array,
    rows: Array,
    columns: Array,
    extra: Array,
    pattern: Array,
    valid: Array | None,
    weight: Array | None,
    gram: bool,
    threads: int | None = None,
    taps: Array | None = None,
    factor: int = 1,
    split: int | None = None,
) -> Array:
    """Triangular factors or Gram matrices (R, k+1, k+1) of [columns torque], one per row; see `rigid.information`.

    With `split` the products of the first so many columns with the others alone, zero elsewhere. Holds NaN where an array is not
    finite."""
    out = np.zeros((len(rows), len(columns) + 1, len(columns) + 1))
    if not all(np.isfinite(array).all() for array in ((q, dq, ddq) if extra.ndim == 3 else (q, dq, ddq, extra))):
        out[:1, 0, 0] = np.nan
        return out
    for part, filtered in _filtered_rows(tree, (q, dq, ddq), len(tau), rows, columns, extra, pattern, taps, factor):
        block = np.concatenate([filtered, tau[part, :, None]], axis=2)
        size = np.ones(tau[part].shape) if weight is None else weight[part]
        used = size != 0.0 if valid is None else valid[part] & (size != 0.0)
        block = np.where(used[:, :, None], block * size[:, :, None], 0.0)
        for r in range(len(rows)):
            with np.errstate(over="ignore", invalid="ignore"):  # the caller sees infinity in the result
                own = block[:, r]
                if split is not None:
                    out[r, :split, split:] += own[:, :split].T @ own[:, split:]
                else:
                    out[r] = out[r] + own.T @ own if gram else _triangle(np.concatenate([out[r], own]))
    return out


def packed_columns(
    tree: RigidBodyTree,
    q: Array,
    dq: Array,
    ddq: Array,
    rows: Array,
    columns: Array,
    extra: Array,
    pattern: Array,
    threads: int | None = None,
    taps: Array | None = None,
    factor: int = 1,
) -> tuple[Array, tuple[Array, ...], bool]:
    """Columns (M, R k) of the filtered rows, one row after the other, and which of the k chosen ones each row has: here all; see
    `rigid.packed_columns`. Last, whether all numbers are finite, of the arrays and of the columns."""
    count = len(q) if taps is None else max(0, (len(q) - len(taps)) // factor + 1)
    out = np.zeros((count, len(rows), len(columns)))
    with np.errstate(over="ignore", invalid="ignore"):  # the caller sees infinity in the result
        for part, filtered in _filtered_rows(tree, (q, dq, ddq), count, rows, columns, extra, pattern, taps, factor):
            out[part] = filtered
    finite = all(bool(np.isfinite(array).all()) for array in (q, dq, ddq, extra, out))
    return out.reshape(count, len(rows) * len(columns)), (np.arange(len(columns)),) * len(rows), finite


class NumpyRows:
    """Information on fixed rows and columns that takes one sample at a time (see `rigid.live_information`)."""

    def __init__(self, tree: RigidBodyTree, factors: Array, rows: Array, columns: Array, pattern: Array) -> None:
        self._tree, self._factors = tree, np.array(factors)
        self._rows, self._columns, self._pattern = rows, columns, pattern

    def add(self, q: Array, dq: Array, ddq: Array, tau: Array, extra: Array, valid: Array | None) -> None:
        """A sample of finite numbers."""
        used = None if valid is None else valid[None]
        motion = q[None], dq[None], ddq[None], tau[None]
        found = information(self._tree, *motion, self._rows, self._columns, extra[None], self._pattern, used, None, False)
        for r, R in enumerate(found):
            self._factors[r] = _triangle(np.concatenate([self._factors[r], R]))

    def scale(self, factor: float) -> None:
        """Every sample so far weighted by the square of `factor`."""
        self._factors *= factor

    def factors(self) -> Array:
        """Upper triangular (R, k+1, k+1)."""
        return self._factors.copy()


def _filtered_rows(
    tree: RigidBodyTree,
    motion: tuple[Array, Array, Array],
    count: int,
    rows: Array,
    columns: Array,
    extra: Array,
    pattern: Array,
    taps: Array | None,
    factor: int,
) -> Iterator[tuple[slice, Array]]:
    """Rows, some at a time, with their columns (m, R, k)."""
    shape = np.ones(1) if taps is None else taps
    step = max(64, min(CHUNK, 2_000_000 // max(1, tree.nv * 10 * tree.nb)), len(shape))
    for start in range(0, count, max(1, step // factor)):
        part = slice(start, min(start + max(1, step // factor), count))
        support = slice(start * factor, (part.stop - 1) * factor + len(shape))
        rigid = np.einsum("rv,nvc->nrc", rows, regressor(tree, motion[0][support], motion[1][support], motion[2][support]), optimize=True)
        beside = extra[support] if extra.ndim == 3 else extra[support, None, :] * pattern
        chosen = np.concatenate([rigid, beside], axis=2)[:, :, columns]
        yield part, chosen if taps is None else _decimated(chosen, taps, factor, part.stop - start)


def _decimated(x: Array, taps: Array, factor: int, count: int) -> Array:
    """Row m of the sum of taps[i] x[m factor + i], m < count, for x (L, …): some rows at a time by a banded matrix."""
    size = min(count, max(1, len(taps) // factor, 128 // factor))
    band = np.zeros((size, (size - 1) * factor + len(taps)))
    for m in range(size):
        band[m, m * factor : m * factor + len(taps)] = taps
    flat, out = x.reshape(len(x), -1), np.empty((count, *x.shape[1:]))
    for first in range(0, count, size):
        rows = min(size, count - first)
        support = (rows - 1) * factor + len(taps)
        np.matmul(band[:rows, :support], flat[first * factor :][:support], out=out[first : first + rows].reshape(rows, -1))
    return out


def _triangle(block: Array) -> Array:
    """Upper triangular factor (c, c) of a block (m, c), m >= c; rows and columns of zeros where the block has a column of zeros."""
    live = np.flatnonzero(block.any(axis=0))
    out = np.zeros((block.shape[1], block.shape[1]))
    if len(live):
        out[np.ix_(live, live)] = np.linalg.qr(block[:, live], mode="r")
    return out


#: What `kernel()` calls it in either kernel.
fixed_rows = NumpyRows
