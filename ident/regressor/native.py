"""The compiled kernel seen from Python: the functions of `numpy_dynamics` and `numpy_rows`, with the same numbers.

Importing this module raises ImportError where the extension was not built; `ident.regressor.kernel_choice` then takes NumPy."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from .._native import _kernel  # type: ignore[attr-defined, unused-ignore]
from ..errors import ConfigurationError
from ..robots.tree import RigidBodyTree
from .native_tree import compiled
from .numpy_dynamics import fitting, not_finite, singular

Array = np.ndarray

_REGRESSOR, _INVERSE, _MASS, _TERMS, _FORWARD = range(5)
_COMPUTE = _kernel.compute


def instruction_sets() -> tuple[str, ...]:
    """Instruction sets that this processor has and the extension was built for; the last is taken by default."""
    return tuple(_kernel.instruction_sets().split())


def use_instruction_set(name: str) -> int:
    """Take another instruction set (for tests and benchmarks); returns its number of lanes."""
    if name not in instruction_sets():
        raise ConfigurationError(f"instruction set {name!r} is not available here; there is {', '.join(instruction_sets())}.")
    return int(_kernel.use(name))


def thread_count(threads: int | None = None) -> int:
    """`threads`, else IDENT_NUM_THREADS, else the processors this process may use."""
    if threads is None:
        text = os.environ.get("IDENT_NUM_THREADS", "").strip()
        if not text:
            return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        if not text.isdecimal() or int(text) < 1:
            raise ConfigurationError(f"IDENT_NUM_THREADS={text!r}: must be a whole number, 1 or more.")
        return int(text)
    if threads < 1:
        raise ConfigurationError(f"threads={threads}: must be 1 or more.")
    return min(int(threads), 1024)


def regressor(tree: RigidBodyTree, q: Array, dq: Array, ddq: Array, threads: int | None = None) -> Array:
    """Joint torque regressor (N, nv, 10 nb), gravity included."""
    own = compiled(tree)
    out = np.zeros((len(q), tree.nv, 10 * tree.nb))
    _COMPUTE(_REGRESSOR, own.handle, own.whole(tree), None, None, len(q), thread_count(threads), q, dq, ddq, None, out, None)
    return out


def inverse_dynamics(tree: RigidBodyTree, inertia: Array, q: Array, dq: Array, ddq: Array | None, threads: int | None = None) -> Array:
    """Joint torque (N, nv) by the recursive Newton-Euler algorithm."""
    own = compiled(tree)
    out = np.empty((len(q), tree.nv))
    pi = own.inertia(inertia)
    _COMPUTE(_INVERSE, own.handle, None, pi, None, len(q), thread_count(threads), q, dq, ddq, None, out, None)
    return out


def bias_torque(tree: RigidBodyTree, inertia: Array, q: Array, dq: Array, threads: int | None = None) -> Array:
    """Coriolis, centrifugal and gravity torque (N, nv)."""
    return inverse_dynamics(tree, inertia, q, dq, None, threads)


def mass_matrix(tree: RigidBodyTree, inertia: Array, q: Array, threads: int | None = None) -> Array:
    """Joint-space mass matrix (N, nv, nv) by the composite-rigid-body algorithm."""
    own = compiled(tree)
    mass = np.empty((len(q), tree.nv, tree.nv))
    pi = own.inertia(inertia)
    _COMPUTE(_MASS, own.handle, None, pi, None, len(q), thread_count(threads), q, None, None, None, None, mass)
    return mass


def forward_dynamics(
    tree: RigidBodyTree, inertia: Array, q: Array, dq: Array, tau: Array, added: Array, threads: int | None = None
) -> Array:
    """Joint acceleration (N, nv) from (M + added) ddq = tau - bias."""
    own = compiled(tree)
    out = np.empty((len(q), tree.nv))
    pi = own.inertia(inertia)
    stop = _COMPUTE(_FORWARD, own.handle, None, pi, added, len(q), thread_count(threads), q, dq, None, tau, out, None)
    if stop >= 0:
        raise singular(stop)
    return out


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
    own = compiled(tree)
    plan = own.plan(tree, rows, columns, extra, pattern)
    size, taken, upper, lower = plan.unpacking
    flat = np.zeros(size)
    beside = extra if extra.shape[-1] else None
    count = thread_count(threads)
    given = plan.handle, int(gram), len(q), count, taps, factor, q, dq, ddq, tau, valid, weight, beside, flat
    if split is None:
        _kernel.information(own.handle, *given)
    else:
        _kernel.split_information(own.handle, *given, plan.instruments(split))
    out = np.zeros((len(rows), len(columns) + 1, len(columns) + 1))
    found = flat[taken]
    np.put(out, upper, found)
    if gram and split is None:
        np.put(out, lower, found)
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
    """Columns (M, w) of the filtered rows, one row after the other, and which of the k chosen ones each row has; see
    `rigid.packed_columns`. Last, whether all numbers are finite, of the arrays and of the columns."""
    own = compiled(tree)
    plan = own.plan(tree, rows, columns, extra, pattern)
    count = len(q) if taps is None else max(0, (len(q) - len(taps)) // factor + 1)
    live = tuple(shown[:-1] for shown in plan.live)
    packed = np.empty((count, sum(len(shown) for shown in live)))
    beside = extra if extra.shape[-1] else None
    finite = _kernel.row_columns(own.handle, plan.handle, len(q), thread_count(threads), taps, factor, q, dq, ddq, beside, packed)
    return packed, live, finite


class NativeRows:
    """Information on fixed rows and columns that takes one sample at a time (see `rigid.live_information`), without new memory."""

    def __init__(self, tree: RigidBodyTree, factors: Array, rows: Array, columns: Array, pattern: Array) -> None:
        own = compiled(tree)
        self._plan = own.plan(tree, rows, columns, np.zeros((1, pattern.shape[1])), pattern)
        self._tree, self._handle, self._shape = own.handle, self._plan.handle, factors.shape
        size, taken, upper, _ = self._plan.unpacking
        self._flat = np.zeros(size)
        self._flat[taken] = factors.ravel()[upper]

    def add(self, q: Array, dq: Array, ddq: Array, tau: Array, extra: Array, valid: Array | None) -> None:
        """A sample of finite numbers."""
        beside = extra if len(extra) else None
        _kernel.information(self._tree, self._handle, 0, 1, 1, None, 1, q, dq, ddq, tau, valid, None, beside, self._flat)

    def scale(self, factor: float) -> None:
        """Every sample so far weighted by the square of `factor`."""
        np.multiply(self._flat, factor, out=self._flat)

    def factors(self) -> Array:
        """Upper triangular (R, k+1, k+1)."""
        _, taken, upper, _ = self._plan.unpacking
        out = np.zeros(self._shape)
        np.put(out, upper, self._flat[taken])
        return out


def simulate(tree: RigidBodyTree, work: tuple[Any, ...], plant: tuple[Array, ...], *arrays: Any) -> int:
    """Integrate runs of a plant; arguments as `simulate` of ident/_native/module.cpp has them, but for the inertial parameters,
    which come in Pinocchio's order. For `ident.simulation.compiled` alone."""
    own = compiled(tree)
    moved = (own.inertia(np.ascontiguousarray(plant[0], float)), *plant[1:])
    return int(_kernel.simulate(own.handle, *work, thread_count(), moved, *arrays))


class NativeDynamics:
    """Dynamics of one tree with fixed parameters (see `rigid.dynamics`): arguments are only checked where the kernel refuses."""

    def __init__(self, tree: RigidBodyTree, inertia: Array, added: Array | None = None) -> None:
        own = compiled(tree)
        self._nv, self._nq = tree.nv, tree.nq
        self._handle = own.handle
        self._inertia = own.inertia(np.ascontiguousarray(inertia, float))
        self._added = None if added is None or not np.any(added) else np.ascontiguousarray(added, float)

    def forward(self, q: Array, dq: Array, tau: Array, threads: int = 1) -> Array:
        """Acceleration (nv,) for one state, or (N, nv) for a batch. Raises DataError where M is singular or a value not finite."""
        # Written out for the single state, where every tenth of a microsecond in Python counts.
        if q.ndim == 1:
            count, out = 1, np.empty(self._nv)
        else:
            count, out = len(q), np.empty((len(q), self._nv))
        try:
            stop = _COMPUTE(_FORWARD, self._handle, None, self._inertia, self._added, count, threads, q, dq, None, tau, out, None)
        except ValueError:  # not contiguous float64, or of the wrong size
            q, dq, tau = fitting(q.shape[:-1], q=(q, self._nq), dq=(dq, self._nv), tau=(tau, self._nv))
            stop = _COMPUTE(_FORWARD, self._handle, None, self._inertia, self._added, count, threads, q, dq, None, tau, out, None)
        if stop >= 0:
            raise singular(stop)
        if stop == -2:
            raise not_finite()
        return out

    def terms(self, q: Array, dq: Array, threads: int = 1) -> tuple[Array, Array]:
        """Mass matrix (nv, nv), `added` not included, and bias (nv,) for one state; (N, nv, nv) and (N, nv) for a batch."""
        n = self._nv
        if q.ndim == 1:
            count, mass, bias = 1, np.empty((n, n)), np.empty(n)
        else:
            count, mass, bias = len(q), np.empty((len(q), n, n)), np.empty((len(q), n))
        try:
            _COMPUTE(_TERMS, self._handle, None, self._inertia, None, count, threads, q, dq, None, None, bias, mass)
        except ValueError:
            q, dq = fitting(q.shape[:-1], q=(q, self._nq), dq=(dq, n))
            _COMPUTE(_TERMS, self._handle, None, self._inertia, None, count, threads, q, dq, None, None, bias, mass)
        return mass, bias


#: What `kernel()` calls them in either kernel.
fixed_rows, fixed_dynamics = NativeRows, NativeDynamics
