"""Presliding as a force with states of its own, for forward simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.force import ForceModel
from ..effects.motion import Motion
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, eq=False, kw_only=True)
class BristleForce(ForceModel):
    """Dahl's law on the joints (or motors) `at`: `level` (len(at),) × (z − sgn of the speed), z built up over `z_s`.

    The deflections z are the states; they follow the path (see `ident.friction.presliding.deflection`), so that no step of
    integration is too long for them."""

    side: Side
    at: tuple[int, ...]
    level: Array
    z_s: float

    def start(self, motion: Motion, robot: Robot) -> Array:
        return np.zeros((len(motion), len(self.at)))

    def torque(self, motion: Motion, state: Array, robot: Robot) -> Array:
        out = np.zeros((len(motion), robot.n))
        out[:, list(self.at)] = self.level * (state - motion.on(self.side).direction[:, list(self.at)])
        return out

    def rate(self, motion: Motion, state: Array, robot: Robot) -> Array:
        speed = motion.on(self.side).dq[:, list(self.at)]
        return (speed - np.abs(speed) * state) / self.z_s

    def carried(self, before: Motion, state: Array, now: Motion, robot: Robot) -> Array:
        step = (now.on(self.side).q - before.on(self.side).q)[:, list(self.at)]
        sign = np.sign(step)
        return sign + (state - sign) * np.exp(-np.abs(step) / self.z_s)
