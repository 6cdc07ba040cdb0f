"""Mistakes of one number that a log may have, each with how to take it out: zeros, units of one torque, late positions, the clock."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.motion import Coordinates
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: A torque of which no more than this is left was taken out whole: it contradicts the others, in whatever unit.
_ROUNDING = 1e-9


@dataclass(frozen=True)
class Misreading(ABC):
    """A mistake of one number, `value`, in a log; 0 is none. `reach`: how far the residual's derivative holds."""

    reach: ClassVar[float] = 1.0

    def motion(self, joint: Coordinates, value: float) -> Coordinates:
        """The motion of n joints, (N, n), without it."""
        return joint

    def torque(self, tau: Array, value: float) -> Array:
        """The measured torque (M, n) without it."""
        return tau

    @abstractmethod
    def noteworthy(self, value: float) -> bool:
        """Whether it is more than a matter of calibration."""

    @abstractmethod
    def told(self, value: float) -> str:
        """A clause: what seems to be wrong."""

    @property
    @abstractmethod
    def remedy(self) -> str:
        """A sentence: what to look at."""


@dataclass(frozen=True)
class ZeroOff(Misreading):
    """The position of joint number `at` reads `value` too much."""

    at: int
    name: str
    unit: str

    def motion(self, joint: Coordinates, value: float) -> Coordinates:
        q = joint.q.copy()
        q[:, self.at] -= value
        return Coordinates(q, joint.dq, joint.ddq)

    def noteworthy(self, value: float) -> bool:
        return abs(value) > 0.05

    def told(self, value: float) -> str:
        return f"the zero of {self.name} seems to be off: its position reads about {abs(value):.2g} {self.unit} too {_way(value)}"

    @property
    def remedy(self) -> str:
        return "Check the joint's zero in the log and in the URDF ([drive] zero)."


@dataclass(frozen=True)
class TorqueScaled(Misreading):
    """The torque of joint number `at` is 1 / (1 - `value`) times what it is."""

    reach: ClassVar[float] = np.inf
    at: int
    name: str

    def torque(self, tau: Array, value: float) -> Array:
        out = tau.copy()
        out[:, self.at] *= 1.0 - value
        return out

    def noteworthy(self, value: float) -> bool:
        return value < -1.0 or 0.5 < value < 1.0 - _ROUNDING

    def told(self, value: float) -> str:
        return f"the torque of {self.name} seems to be about {1.0 / (1.0 - value):.2g} times what the other joints' torques say"

    @property
    def remedy(self) -> str:
        return "Check the unit of that torque, its gear ratio and torque constant, and the order of the columns."


@dataclass(frozen=True)
class PositionLate(Misreading):
    """The position of joint number `at` comes `value` s late; `rate`: samples per second."""

    reach: ClassVar[float] = 0.05

    at: int
    name: str
    rate: float

    def motion(self, joint: Coordinates, value: float) -> Coordinates:
        return _later(joint, np.where(np.arange(joint.q.shape[1]) == self.at, value, 0.0), self.rate)

    def noteworthy(self, value: float) -> bool:
        return abs(value) > 2.0 / self.rate and abs(value) > 0.005

    def told(self, value: float) -> str:
        when = "late" if value > 0 else "early"
        return f"the position of {self.name} seems to be about {1e3 * abs(value):.2g} ms too {when} relative to the rest of the log"

    @property
    def remedy(self) -> str:
        return "Check the clock of that joint's encoder, and filters that only its signal passes."


@dataclass(frozen=True)
class TorquesLate(Misreading):
    """The torques of all joints come `value` s late against all positions; `rate`: samples per second.

    Joints on one bus share a delay. One joint's clock accounts for a part of it, and was blamed for the whole."""

    reach: ClassVar[float] = 0.05

    rate: float

    def motion(self, joint: Coordinates, value: float) -> Coordinates:
        return _later(joint, np.full(joint.q.shape[1], -value), self.rate)

    def noteworthy(self, value: float) -> bool:
        # More than the sample that one end of a period is from the other, as in the audit.
        return abs(value) > 1.0 / self.rate

    def told(self, value: float) -> str:
        when = "late" if value > 0 else "early"
        return f"the torques of all joints seem to be about {1e3 * abs(value):.2g} ms too {when} relative to the positions"

    @property
    def remedy(self) -> str:
        return (
            "Shift the torques, or let the effect 'delay' estimate it; a controller's response to disturbances looks like a delay, too"
            " (`ident diagnose` distinguishes them)."
        )


def _later(joint: Coordinates, seconds: Array, rate: float) -> Coordinates:
    """The motion (N, n) so many `seconds` (n,) later."""
    q, dq, ddq = joint.q, joint.dq, joint.ddq
    jerk = rate * np.gradient(ddq, axis=0)
    return Coordinates(q + seconds * dq + 0.5 * seconds**2 * ddq, dq + seconds * ddq + 0.5 * seconds**2 * jerk, ddq + seconds * jerk)


@dataclass(frozen=True)
class ClockOff(Misreading):
    """Time runs exp(`value`) times too slowly."""

    def motion(self, joint: Coordinates, value: float) -> Coordinates:
        faster = np.exp(value)
        return Coordinates(joint.q, faster * joint.dq, faster**2 * joint.ddq)

    def noteworthy(self, value: float) -> bool:
        return abs(value) > np.log(1.1)

    def told(self, value: float) -> str:
        return f"time seems to run about {np.exp(abs(value)):.2g} times too {'slowly' if value > 0 else 'fast'}"

    @property
    def remedy(self) -> str:
        return "Check the unit of the time, and rate_hz."


def misreadings(robot: Robot, rate: float) -> list[Misreading]:
    """Every mistake that is looked for in a log of so many samples a second."""
    zeros = [ZeroOff(j, name, robot.position_unit(j, Side.JOINT)) for j, name in enumerate(robot.joint_names)]
    scaled = [TorqueScaled(j, name) for j, name in enumerate(robot.joint_names)]
    late = [PositionLate(j, name, rate) for j, name in enumerate(robot.joint_names)]
    together = [TorquesLate(rate)] if robot.n > 1 else []  # of one joint it is its position's delay
    return [*zeros, *scaled, *late, *together, ClockOff()]


def _way(value: float) -> str:
    return "far" if value > 0 else "little"
