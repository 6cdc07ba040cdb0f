"""The terms of a robot's drives beside its links, with fixed values: what is added to the torque of the rigid body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import DataError

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class DriveTerms:
    """τ = links τ_l + constant + position q + speed dq + acceleration ddq + level sgn(direction dq), for n joints and c contacts.

    `links`, `position`, `speed`, `acceleration` (n, n); `constant` (n,); `direction` (c, n): the speed of each contact; `level` (n, c)."""

    links: Array
    constant: Array
    position: Array
    speed: Array
    acceleration: Array
    direction: Array
    level: Array

    @property
    def contacts(self) -> int:
        return len(self.direction)

    def beside(self, q: Array, dq: Array) -> Array:
        """What is asked for beside the links and `acceleration` at states (N, n)."""
        return self.constant + q @ self.position.T + dq @ self.speed.T + np.sign(dq @ self.direction.T) @ self.level.T

    def packed(self) -> Array:
        """As the compiled kernel takes them (`drive` of ident/_native/module.cpp)."""
        back = np.linalg.inv(self.links)
        square = self.links, self.position, self.speed, self.acceleration, back, back @ self.acceleration
        return np.concatenate([np.asarray(part, float).ravel() for part in (*square, self.constant, self.direction, self.level)])


def state_not_finite() -> DataError:
    """The error for a state without a torque or an acceleration."""
    return DataError("a position, velocity, acceleration or torque of the state is not finite; hold the last good value, or leave it out.")
