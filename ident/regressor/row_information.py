"""Rows of the regression equation over arrays of samples, and what least squares needs of them, in one pass of the kernel.

Conventions, refusals and threads as in `rigid`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, Protocol

import numpy as np

from ..errors import ConfigurationError, DataError, UnsupportedError
from ..robots.tree import RigidBodyTree
from .checked import extra_columns, finite_numbers, numbers, states
from .kernel_choice import kernel

Array = np.ndarray


class LiveInformation(Protocol):
    """Triangular factors of [Phi tau] that take one sample at a time."""

    def add(self, q: Array, dq: Array, ddq: Array, tau: Array, extra: Array, valid: Array | None) -> None:
        """A sample of finite numbers: positions and rates of the tree, torque (R,), extra columns (e,), rows that are `valid` (R,)."""

    def scale(self, factor: float) -> None:
        """Every sample so far weighted by the square of `factor`."""

    def factors(self) -> Array:
        """Upper triangular (R, k+1, k+1), as `information` has them."""


def live_information(tree: RigidBodyTree, factors: Array, rows: Array, columns: Array, pattern: Array) -> LiveInformation:
    """Information that starts with `factors` (R, k+1, k+1); `rows`, `columns`, `pattern` as in `information`."""
    q, rates = np.zeros((1, tree.nq)), np.zeros((1, tree.nv))
    work = _Work.of(tree, q, rates, rates, rows, columns, np.zeros((1, np.shape(pattern)[1])), pattern, None, 1)
    made: LiveInformation = kernel().rows.fixed_rows(tree, finite_numbers("factors", factors), work.rows, work.columns, work.pattern)
    return made


def information(
    tree: RigidBodyTree,
    q: Any,
    dq: Any,
    ddq: Any,
    tau: Any,
    *,
    rows: Any = None,
    columns: Any = None,
    extra: Any = None,
    pattern: Any = None,
    valid: Any = None,
    weight: Any = None,
    taps: Any = None,
    factor: int = 1,
    form: Literal["triangle", "gram"] = "triangle",
    split: int | None = None,
    threads: int | None = None,
) -> tuple[Array, Array]:
    """What least squares needs of N samples, for each of R rows: `(factors (R, k+1, k+1), counts (R,))`.

    Row r of a sample is `[Phi_r tau_r]` with Phi = [rows @ regressor, extra columns][:, columns]. Its factor is, with
    form="triangle", the upper triangular R_r with R_r'R_r = the sum of [Phi_r tau_r]'[Phi_r tau_r], by Householder reflections
    (error as of the data, condition not squared); with form="gram" that sum itself (about half the time; scale the columns
    before solving). The regressor of all samples is never in memory.

    `split` (form="gram"): the first `split` of the k columns are instruments Z, and only their products Z' [Phi tau] with the other
    columns are formed, half as much work: they stand at [:split, split:] of each (k+1, k+1), which is zero elsewhere.

    `taps` (T,): rows are filtered and decimated along time before anything else, on the spot: row m is the sum of taps[i] times
    the columns of sample m factor + i, for the M = (N - T) // factor + 1 rows with full support; without taps M = N.

    `tau` (M, R). `rows` (R, nv): row map, such as K' or W'; None: the joints. `columns` (k,): distinct columns chosen of the
    10 nb rigid and the e extra ones, such as a base; None: all. `extra`: (N, R, e), or (N, e) with `pattern` (R, e) such that column
    e of row r is extra[:, e] * pattern[r, e]. `valid` (M, R) bool: what is False is left out, and its torque (and, without taps, its
    extra columns given as (N, R, e)) may be NaN. `weight` (M, R): factor on each row (square root of the weight).
    Raises DataError for input that is not finite."""
    work = _Work.of(tree, q, dq, ddq, rows, columns, extra, pattern, taps, factor)
    shape = (work.count, len(work.rows))
    tau, valid, weight = _of_rows(shape, tau, valid, weight)
    if form not in ("triangle", "gram"):
        raise ConfigurationError(f"form={form!r}: must be 'triangle' or 'gram'.")
    if split is not None and (form != "gram" or not 0 <= split <= len(work.columns)):
        raise ConfigurationError(f"split={split}: must be from 0 to the {len(work.columns)} columns, with form='gram'.")
    counts = np.full(len(work.rows), work.count) if valid is None else valid.sum(axis=0)
    w = work
    factors = kernel().rows.information(
        tree, w.q, w.dq, w.ddq, tau, w.rows, w.columns, w.extra, w.pattern, valid, weight, form == "gram", threads, w.taps, w.factor, split
    )
    if not np.isfinite(factors.sum()):  # the kernel looks at every number on its way; who is to blame is only asked now
        used = np.ones(shape, bool) if valid is None else valid
        work.blame(used)
        finite_numbers("tau", np.where(used, tau, 0.0))
        raise DataError("the sum of squares over the samples overflows: some value is beyond 1e150. Check the units of the log.")
    return factors, counts


def _of_rows(shape: tuple[int, int], tau: Any, valid: Any, weight: Any) -> tuple[Array, Array | None, Array | None]:
    """Torque, which of it counts, and its weights as arrays of `shape` (M, R). Raises ConfigurationError for other shapes."""
    if valid is not None:
        valid = np.ascontiguousarray(valid)
        if valid.shape != shape or valid.dtype != bool:
            raise ConfigurationError(f"valid: expected bool of shape {shape}, but it is {valid.dtype} of shape {valid.shape}.")
    tau = np.ascontiguousarray(tau, dtype=np.float64)
    weight = None if weight is None else finite_numbers("weight", weight)
    for name, array in (("tau", tau), ("weight", weight)):
        if array is not None and array.shape != shape:
            raise ConfigurationError(f"{name}: expected shape {shape}, samples by rows, but it is {array.shape}.")
    return tau, valid, weight


def packed_columns(
    tree: RigidBodyTree,
    q: Any,
    dq: Any,
    ddq: Any,
    *,
    rows: Any = None,
    columns: Any = None,
    extra: Any = None,
    pattern: Any = None,
    taps: Any = None,
    factor: int = 1,
    threads: int | None = None,
) -> tuple[Array, tuple[Array, ...]]:
    """The columns Phi (M, R, k) themselves, of which `information` takes the products, without those that are zero in their row by
    structure: `(packed (M, w), live)`. Row map, choice of columns and extra ones, filter and decimation as there (M = N without taps).

    One row of the equation follows the other; `live[r]` says which of the k chosen columns row r has, in this order. With taps the
    columns at the full rate are never written to memory, only the M filtered rows are: what a pass that keeps rows for later ones
    needs. Raises DataError for input that is not finite."""
    work = _Work.of(tree, q, dq, ddq, rows, columns, extra, pattern, taps, factor)
    w = work
    make = kernel().rows.packed_columns
    packed, live, finite = make(tree, w.q, w.dq, w.ddq, w.rows, w.columns, w.extra, w.pattern, threads, w.taps, w.factor)
    if not finite:
        work.blame(None)
        raise DataError("a column overflows: some speed or acceleration is beyond 1e150. Check the units of the log.")
    return packed, live


@dataclass(frozen=True, eq=False)
class _Work:
    """Checked samples and what is made of them; see `information`. `count`: rows."""

    q: Array
    dq: Array
    ddq: Array
    rows: Array
    columns: Array
    extra: Array
    pattern: Array
    taps: Array | None
    factor: int
    count: int

    @classmethod
    def of(
        cls, tree: RigidBodyTree, q: Any, dq: Any, ddq: Any, rows: Any, columns: Any, extra: Any, pattern: Any, taps: Any, factor: int
    ) -> _Work:
        """Shapes and indices are checked here; whether samples are finite is seen on the way."""
        q, dq, ddq = states(tree, q, finite=False, dq=dq, ddq=ddq)
        n, rigid = len(q), 10 * tree.nb
        rows = np.eye(tree.nv) if rows is None else finite_numbers("rows", rows)
        if rows.ndim != 2 or not len(rows) or rows.shape[1] != tree.nv:
            raise ConfigurationError(f"rows: expected shape (R, {tree.nv}), rows by velocities, but it is {rows.shape}.")
        taps = None if taps is None else finite_numbers("taps", taps)
        if int(factor) != factor or factor < 1 or (taps is None and factor != 1):
            raise ConfigurationError(f"factor={factor}: must be a whole number of samples a row, 1 without taps.")
        if taps is not None and (taps.ndim != 1 or not len(taps)):
            raise ConfigurationError(f"taps: expected shape (T,), T at least 1, but it is {taps.shape}.")
        count = n if taps is None else max(0, (n - len(taps)) // int(factor) + 1)
        extra, pattern = extra_columns(extra, pattern, (n, len(rows)))
        total = rigid + pattern.shape[1]
        columns = np.arange(total) if columns is None else np.ascontiguousarray(columns, dtype=np.int64)
        if columns.ndim != 1 or (len(columns) and (columns.min() < 0 or columns.max() >= total)):
            raise ConfigurationError(f"columns: expected indices from 0 to {total - 1} ({rigid} rigid, {total - rigid} extra).")
        if len(columns) and np.bincount(columns).max() > 1:
            raise ConfigurationError("columns: a column is chosen twice.")
        return cls(q, dq, ddq, rows, columns, extra, pattern, taps, int(factor), count)

    def blame(self, used: Array | None) -> None:
        """Raise DataError for what is not finite; of extra columns given for each row, only where it is `used` (N, R)."""
        extra = self.extra
        if used is not None and extra.ndim == 3 and self.taps is None:
            extra = np.where(used[:, :, None], extra, 0.0)
        for name, array in (("q", self.q), ("dq", self.dq), ("ddq", self.ddq), ("extra", extra)):
            finite_numbers(name, array)


def stacked_information(
    columns: Any,
    tau: Any,
    *,
    valid: Any = None,
    weight: Any = None,
    form: Literal["triangle", "gram"] = "triangle",
    threads: int | None = None,
) -> tuple[Array, Array]:
    """The same for columns (N, R, k) that are there already, whatever they are of: `(factors (R, k+1, k+1), counts (R,))`.

    What `valid` leaves out may hold anything, columns too."""
    columns = numbers("columns", columns)
    if columns.ndim != 3:
        raise ConfigurationError(f"columns: expected shape (N, R, k), but it is {columns.shape}.")
    n, r, _ = columns.shape
    motion = np.zeros((n, 0))
    given = {"rows": np.zeros((r, 0)), "extra": columns, "valid": valid, "weight": weight}
    try:
        return information(_no_bodies(), motion, motion, motion, tau, **given, form=form, threads=threads)
    except DataError as error:
        raise DataError(str(error).replace("extra:", "columns:", 1)) from None


@cache
def _no_bodies() -> RigidBodyTree:
    none = np.zeros((0, 3))
    return RigidBodyTree(np.zeros(0, int), np.zeros((0, 3, 3)), none, none, np.zeros(0, bool), np.zeros(3), floating=False)


def paired(tree: RigidBodyTree) -> RigidBodyTree:
    """Two copies of a fixed-base tree side by side, which move independently: positions (N, 2 nq) are those of one, then the other.

    With `rows = [T T]` the columns of a row are those of two motions, [Z Phi], so that `information` with form="gram" gives all products
    of instruments Z with the regressor Phi and the torque in one pass (with `split`, those alone). Raises UnsupportedError for a
    free-flyer."""
    if tree.floating:
        raise UnsupportedError("a floating-base tree cannot be paired; pair the tree of its fixed-base robot.")
    parent = np.asarray(tree.parent)
    parents = np.concatenate([parent, np.where(parent < 0, -1, parent + tree.nb)])
    rotation, translation, axis, prismatic = (np.concatenate([x, x]) for x in (tree.rotation, tree.translation, tree.axis, tree.prismatic))
    return RigidBodyTree(parents, rotation, translation, axis, prismatic, tree.gravity, floating=False)
