"""Readings that are not what they should be, written down apart from the toolkit's own effects."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from ident.effects.motion import Coordinates
from ident.robots.transmission import Side
from ident.simulation.sensors import Distortion, Readings

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Reading(Distortion):
    """Torque reads more by `f(t, motion, size)` (N, n), size (n,)."""

    size: Array
    f: Callable[[Array, Coordinates, Array], Array]

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        return replace(readings, tau=readings.tau + self.f(readings.t, readings.motion, self.size))


@dataclass(frozen=True, eq=False)
class Ripple(Distortion):
    """Torque of joint j reads 1 + share sin(order φ + phase) times too much, φ the motor's angle."""

    j: int
    share: float
    order: float
    phase: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        transmission = readings.robot.transmission
        q = readings.motion.q
        angle = q if readings.side == Side.MOTOR else transmission.motor_position(q)
        tau = readings.tau.copy()
        tau[:, self.j] *= 1.0 + self.share * np.sin(self.order * angle[:, self.j] + self.phase)
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class Bent(Distortion):
    """Torque of joint j reads τ + share |τ/τ0|^(power−1) τ."""

    j: int
    share: float
    power: float
    motor_tau: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        tau = readings.tau.copy()
        x = tau[:, self.j]
        scale = np.sqrt(np.mean(x**2))
        tau[:, self.j] = x * (1.0 + self.share * np.abs(x / scale) ** (self.power - 1.0))
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class DeadZone(Distortion):
    """Torque of joint j reads zero below `width` (motor side), and so much less above."""

    j: int
    width: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        tau = readings.tau.copy()
        transmission = readings.robot.transmission
        width = self.width if transmission.measured == Side.MOTOR else self.width * abs(transmission.K_inverse[self.j, self.j])
        x = tau[:, self.j]
        tau[:, self.j] = np.sign(x) * np.maximum(np.abs(x) - width, 0.0)
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class Late(Distortion):
    """Torque of joint j is `seconds` old. Between samples a cubic spline: a straight line would be a low-pass of its own."""

    j: int
    seconds: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        tau = readings.tau.copy()
        tau[:, self.j] = CubicSpline(readings.t, tau[:, self.j])(np.maximum(readings.t - self.seconds, readings.t[0]))
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class Lagged(Distortion):
    """Torque of joint j passes an RC low-pass of `seconds`; the exact answer to straight lines between the samples."""

    j: int
    seconds: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        x = readings.tau[:, self.j]
        y = np.empty_like(x)
        y[0] = x[0]
        step = np.diff(readings.t)
        for i in range(1, len(x)):
            keep = np.exp(-step[i - 1] / self.seconds)
            slope = (x[i] - x[i - 1]) / step[i - 1]
            # Behind a ramp the output follows, late by the time constant; what it was off by dies away.
            y[i] = x[i] - slope * self.seconds + keep * (y[i - 1] - x[i - 1] + slope * self.seconds)
        tau = readings.tau.copy()
        tau[:, self.j] = y
        return replace(readings, tau=tau)


@dataclass(frozen=True, eq=False)
class JointEncoder(Distortion):
    """The position of joint j reads wrong; the encoder's side may be the motor's."""

    j: int
    offset: float = 0.0
    scale: float = 0.0
    amplitude: float = 0.0
    order: float = 1.0
    phase: float = 0.0

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        transmission = readings.robot.transmission
        on_joint = readings.side == Side.JOINT
        q = readings.motion.q if on_joint else transmission.joint_position(readings.motion.q)
        x = q[:, self.j]
        error = np.zeros_like(q)
        error[:, self.j] = self.offset + self.scale * x + self.amplitude * np.sin(self.order * x + self.phase)
        if not on_joint:
            error = error @ transmission.K_inverse.T
        c = readings.motion
        return replace(readings, motion=Coordinates(c.q + error, c.dq, c.ddq))


@dataclass(frozen=True, eq=False)
class Slip(Distortion):
    """From `at` on the position of joint j reads `angle` too much."""

    j: int
    angle: float
    at: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        late = (readings.t >= self.at)[:, None]
        moved = JointEncoder(self.j, offset=self.angle).apply(readings, rng).motion.q
        c = readings.motion
        return replace(readings, motion=Coordinates(np.where(late, moved, c.q), c.dq, c.ddq))
