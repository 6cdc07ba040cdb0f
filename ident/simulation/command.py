"""What drives a simulated plant: torque that is given, or a controller in the loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ..effects.motion import Coordinates
from ..robots.transmission import Side
from .controller import Controller, Law
from .script import Script

if TYPE_CHECKING:
    from .dynamics import PlantDynamics, State
    from .plant import Plant

Array = np.ndarray


class Command(Protocol):
    """Torque (B, n) on the measured side at control instant k, and the same as a script for compiled simulation, where it is one."""

    def __call__(self, k: int, state: State, dynamics: PlantDynamics) -> Array: ...

    def script(self) -> Script | None: ...


@dataclass(frozen=True, kw_only=True)
class Feedback:
    """What a controller sees: drive positions rounded to `counts` a motor turn (None: exact) and, with `counts`, speeds as
    their difference quotient through a low-pass of `speed_lag` seconds."""

    counts: float | None = None
    speed_lag: float = 0.002


class GivenTorque:
    """Torque (K, B, n) on the measured side, whatever the state."""

    def __init__(self, torque: Array, measured: Side) -> None:
        self.torque, self.measured = np.ascontiguousarray(torque, float), measured

    def __call__(self, k: int, state: State, dynamics: PlantDynamics) -> Array:
        return self.torque[k]

    def script(self) -> Script:
        return Script(self.measured, self.torque)


class Tracking:
    """A controller in the loop: from the drive's state to torque on the measured side."""

    def __init__(self, plant: Plant, controller: Controller, motion: Coordinates, feedback: Feedback, period: float) -> None:
        self.controller, self.robot, self.motion = controller, plant.robot, motion
        self._law: Law | None = None
        self.side, self.transmission = controller.side, plant.robot.transmission
        self.feedback, self.period = feedback, period
        self._last: Array | None = None
        self._speed: Array | None = None

    def __call__(self, k: int, state: State, dynamics: PlantDynamics) -> Array:
        if self._law is None:
            self._law = self.controller.law(self.robot, self.motion, self.period)
        motor = dynamics.motion(state).motor
        q, dq = motor.q, motor.dq
        if self.feedback.counts is not None:
            size = 2.0 * np.pi / self.feedback.counts
            q = np.round(q / size) * size
            if self._last is None or self._speed is None:
                self._speed = dq
            else:
                weight = 1.0 - np.exp(-self.period / max(self.feedback.speed_lag, 1e-9))
                self._speed = self._speed + weight * ((q - self._last) / self.period - self._speed)
            self._last, dq = q, self._speed
        if self.side == Side.JOINT:
            q, dq = self.transmission.joint_position(q), self.transmission.joint_rate(dq)
        return self.transmission.torque(self._law(k, q, dq), self.side, self.transmission.measured)

    def script(self) -> Script | None:
        kind = type(self.controller)
        # A subclass with a law of its own does not inherit the script of its base.
        says, does = (next(k for k in kind.__mro__ if name in vars(k)) for name in ("script", "law"))
        if self.feedback.counts is not None or says is not does or kind.saturated is not Controller.saturated:
            return None
        return self.controller.script(self.robot, self.motion)
