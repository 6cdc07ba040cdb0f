"""Motion: positions, velocities and accelerations on both sides of the transmission, as effects see them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .transmission import Side

if TYPE_CHECKING:
    from .robot import Robot

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Coordinates:
    """Position, velocity and acceleration, each (N, n), on one side of the transmission."""

    q: Array
    dq: Array
    ddq: Array


@dataclass(frozen=True, eq=False)
class Motion:
    """N samples of a robot's motion, in time order.

    `t` (N,) s; `joint` and `motor`: the same motion on both sides of the transmission. `load` (N, n), if known: the torque
    of the rigid body on the joint side, as the model predicts it (effects that depend on load must not use the noisy
    measured torque). `torque` (N, n), if known: the measured torque on the measured side. `rate`: samples per second
    where the samples are one uniform run, else 0."""

    t: Array
    joint: Coordinates
    motor: Coordinates
    load: Array | None = None
    torque: Array | None = None
    rate: float = 0.0

    @classmethod
    def of(
        cls, robot: Robot, q: Array, dq: Array, ddq: Array, t: Array | None = None, *, rate: float = 0.0, torque: Array | None = None
    ) -> Motion:
        """From joint-side arrays (N, n). Without `t` the samples are unrelated in time (t = 0)."""
        transmission = robot.transmission
        motor = Coordinates(transmission.motor_position(q), transmission.motor_rate(dq), transmission.motor_rate(ddq))
        return cls(np.zeros(len(q)) if t is None else t, Coordinates(q, dq, ddq), motor, None, torque, rate)

    def __len__(self) -> int:
        return len(self.joint.q)

    def on(self, side: Side) -> Coordinates:
        """The motion on one side."""
        return self.joint if side == Side.JOINT else self.motor

    def with_load(self, load: Array | None) -> Motion:
        """The same motion with the rigid body's predicted torque (N, n), joint side."""
        return replace(self, load=load)
