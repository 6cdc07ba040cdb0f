"""A robot with the terms of its drives, parameters fixed, in plain NumPy: the class of the compiled kernel of the same name."""

from __future__ import annotations

import numpy as np

from ..robots.tree import RigidBodyTree
from .drive_terms import DriveTerms, state_not_finite
from .numpy_dynamics import fitting, forward_dynamics, inverse_dynamics

Array = np.ndarray


class NumpyDrive:
    """Torque and acceleration of a fixed-base tree with `inertia` (10 nb,) and the terms of its drives; one state (n,) or N of them."""

    def __init__(self, tree: RigidBodyTree, inertia: Array, terms: DriveTerms) -> None:
        self._tree, self._inertia, self._terms = tree, inertia, terms
        self._back = np.linalg.inv(terms.links)

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torque of a motion, measured side. Raises DataError for what is not finite."""
        q, dq, ddq, shape = self._states(q, dq, ddq, "ddq")
        links = inverse_dynamics(self._tree, self._inertia, q, dq, ddq) @ self._terms.links.T
        return (links + self._terms.beside(q, dq) + ddq @ self._terms.acceleration.T).reshape(shape)

    def acceleration(self, q: Array, dq: Array, tau: Array) -> Array:
        """Acceleration at a torque on the measured side. Raises DataError for what is not finite, or a singular inertia matrix."""
        q, dq, tau, shape = self._states(q, dq, tau, "tau")
        force = (tau - self._terms.beside(q, dq)) @ self._back.T
        return forward_dynamics(self._tree, self._inertia, q, dq, force, self._back @ self._terms.acceleration).reshape(shape)

    def _states(self, q: Array, dq: Array, third: Array, name: str) -> tuple[Array, Array, Array, tuple[int, ...]]:
        """Arrays (N, n), and the shape of the result."""
        q, n = np.asarray(q, float), self._tree.nv
        arrays = fitting(q.shape[:-1], q=(q, n), dq=(dq, n), **{name: (third, n)})
        if not all(np.isfinite(x).all() for x in arrays):
            raise state_not_finite()
        one, two, three = (np.atleast_2d(x) for x in arrays)
        return one, two, three, q.shape


def respond(inertia: Array, force: Array, carried: Array, scale: Array, least: float) -> tuple[Array, Array]:
    """Accelerations (N, n) of inertia matrices (N, n, n) under forces (N, n), both `carried` (n, n) to where the matrix is symmetric, and
    where they are sound: no eigenvalue of its symmetric part, divided by a `scale` (n,) for each coordinate, is below `least`, (N,) bool.

    By elimination without pivots: where it is not sound the result means nothing."""
    joint = np.matmul(carried, inertia)
    shaped = (joint + joint.swapaxes(1, 2)) / (2 * np.outer(scale, scale))
    # Samples last: each step of the elimination is one operation on all of them.
    matrix = np.ascontiguousarray(np.moveaxis(shaped, 0, 2))
    sound, _ = _eliminated(matrix - least * np.eye(len(scale))[:, :, None], np.zeros((len(scale), len(force))))
    _, out = _eliminated(matrix, np.array((force @ carried.T / scale).T))
    return out.T / scale, sound


def _eliminated(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Whether symmetric matrices (n, n, N) are positive definite, (N,), and where they are the solution (n, N) for `right`.

    By elimination without pivots, in place."""
    n = len(right)
    sound = np.ones(right.shape[1], bool)
    with np.errstate(all="ignore"):  # what is not positive definite may divide by zero
        for j in range(n):
            sound &= matrix[j, j] > 0.0
            factor = matrix[j + 1 :, j] / matrix[j, j]
            matrix[j + 1 :, j + 1 :] -= factor[:, None] * matrix[j, j + 1 :]
            right[j + 1 :] -= factor * right[j]
        for j in reversed(range(n)):
            right[j] = (right[j] - np.sum(matrix[j, j + 1 :] * right[j + 1 :], axis=0)) / matrix[j, j]
    return sound, right


#: What `kernel()` calls it in either kernel.
fixed_drive = NumpyDrive
