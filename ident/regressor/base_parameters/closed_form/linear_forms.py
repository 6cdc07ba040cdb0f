"""Quantities of the closed forms as linear forms of all inertial parameters: arrays whose last axis runs over the 10 nb columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Array = np.ndarray

#: Pinocchio's indices of the inertia matrix.
_INERTIA = np.array([[4, 5, 7], [5, 6, 8], [7, 8, 9]])


class LinkForms:
    """Mass, first moment and inertia of links in the frames of a theorem, as linear forms of the URDF's parameters.

    `changes`: body → (10, 10) change of parameters from the URDF's frame to the theorem's; `size`: number of bodies."""

    def __init__(self, changes: dict[int, Array], size: int) -> None:
        self._rows: dict[int, Array] = {}
        for body, change in changes.items():
            rows = np.zeros((10, 10 * size))
            rows[:, 10 * body : 10 * body + 10] = change
            self._rows[body] = rows
        self.width = 10 * size

    def mass(self, body: int) -> Array:
        """(10 nb,)"""
        return self._rows[body][0]

    def masses(self, bodies: Sequence[int]) -> Array:
        """Sum of masses (10 nb,)."""
        total = np.zeros(self.width)
        for body in bodies:
            total += self.mass(body)
        return total

    def moment(self, body: int) -> Array:
        """First moment m r (3, 10 nb)."""
        return self._rows[body][1:4]

    def inertia(self, body: int) -> Array:
        """Inertia about the frame's origin (3, 3, 10 nb)."""
        return self._rows[body][_INERTIA]


def point_moment(mass: Array, at: Array) -> Array:
    """First moment (3, 10 nb) of a mass form at a point (3,)."""
    return np.multiply.outer(at, mass)


def point_inertia(mass: Array, at: Array) -> Array:
    """Inertia (3, 3, 10 nb) of a mass form at a point (3,)."""
    return np.multiply.outer((at @ at) * np.eye(3) - np.outer(at, at), mass)
