"""A robot with the terms of its drives, parameters fixed, by the compiled kernel: the class of `numpy_drive` with the same numbers.

Importing this module raises ImportError where the extension was not built, or from older sources."""

from __future__ import annotations

import numpy as np

from .._native import _kernel  # type: ignore[attr-defined, unused-ignore]
from ..robots.tree import RigidBodyTree
from .drive_terms import DriveTerms, state_not_finite
from .native_tree import compiled
from .numpy_dynamics import fitting, singular

Array = np.ndarray

if not hasattr(_kernel, "respond"):
    raise ImportError("the compiled kernel is of older sources: build it again.")
_DRIVE = _kernel.drive


class NativeDrive:
    """Torque and acceleration of a fixed-base tree with `inertia` (10 nb,) and the terms of its drives; one state (n,) or a batch (N, n).

    Arguments are only checked where the kernel refuses."""

    def __init__(self, tree: RigidBodyTree, inertia: Array, terms: DriveTerms) -> None:
        own = compiled(tree)
        self._n, self._handle, self._contacts = tree.nv, own.handle, terms.contacts
        self._inertia, self._terms = own.inertia(np.ascontiguousarray(inertia, float)), terms.packed()

    # Both written out for the single state, where every tenth of a microsecond in Python counts.
    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torque of a motion, measured side. Raises DataError for what is not finite."""
        try:
            out = np.empty(q.shape)
            count = 1 if q.ndim == 1 else len(q)
            stop = _DRIVE(self._handle, self._inertia, self._contacts, count, self._terms, q, dq, ddq, None, out)
        except (ValueError, AttributeError):
            q, dq, ddq, out, count = self._fitting(q, dq, ddq, "ddq")
            stop = _DRIVE(self._handle, self._inertia, self._contacts, count, self._terms, q, dq, ddq, None, out)
        if stop == -2:
            raise state_not_finite()
        return out

    def acceleration(self, q: Array, dq: Array, tau: Array) -> Array:
        """Acceleration at a torque on the measured side. Raises DataError for what is not finite, or a singular inertia matrix."""
        try:
            out = np.empty(q.shape)
            count = 1 if q.ndim == 1 else len(q)
            stop = _DRIVE(self._handle, self._inertia, self._contacts, count, self._terms, q, dq, None, tau, out)
        except (ValueError, AttributeError):
            q, dq, tau, out, count = self._fitting(q, dq, tau, "tau")
            stop = _DRIVE(self._handle, self._inertia, self._contacts, count, self._terms, q, dq, None, tau, out)
        if stop >= 0:
            raise singular(stop)
        if stop == -2:
            raise state_not_finite()
        return out

    def _fitting(self, q: Array, dq: Array, third: Array, name: str) -> tuple[Array, Array, Array, Array, int]:
        """The same as contiguous float64 of equal shapes, room for the result, and how many states they are."""
        q = np.asarray(q, float)
        q, dq, third = fitting(q.shape[:-1], q=(q, self._n), dq=(dq, self._n), **{name: (third, self._n)})
        return q, dq, third, np.empty(q.shape), 1 if q.ndim == 1 else len(q)


def respond(inertia: Array, force: Array, carried: Array, scale: Array, least: float) -> tuple[Array, Array]:
    """Accelerations of inertia matrices under forces, and where they are sound; see `numpy_drive.respond`."""
    inertia, force, carried, scale = (np.ascontiguousarray(x, dtype=np.float64) for x in (inertia, force, carried, scale))
    out, sound = np.empty(force.shape), np.empty(len(force), bool)
    _kernel.respond(inertia, force, carried, scale, float(least), *force.shape, out, sound)
    return out, sound


#: What `kernel()` calls it in either kernel.
fixed_drive = NativeDrive
