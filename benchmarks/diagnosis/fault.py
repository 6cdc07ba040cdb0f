"""What a fault of the test bed is: where it goes, how large it is, how it comes about; and the register of all of them.

Size 1 is a typical fault; the unit of torque is the joint's own root mean square torque over the motion."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ident.robots.transmission import Side
from ident.simulation.sensors import Distortion

from .arms import Arm
from .laws import Dry, Law, Smooth, Soft

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Setting:
    """Where a fault goes: the arm, joint `j`, size, a generator of random choices, and the scales of the motion.

    Motor side: `tau` (n,) rms torque, `speed` (n,) 95th percentile of speed, `torque` (N, n) that the motion asks for. `seconds` of
    the log; `reach` (n, 2) of q."""

    arm: Arm
    j: int
    size: float
    rng: np.random.Generator
    tau: Array
    speed: Array
    reach: Array
    torque: Array
    seconds: float

    @property
    def joint(self) -> str:
        return self.arm.robot.joint_names[self.j]

    @property
    def ratio(self) -> float:
        """Motor turns per joint turn."""
        return float(abs(self.arm.robot.transmission.K_inverse[self.j, self.j]))

    def sign(self) -> float:
        return float(self.rng.choice([-1.0, 1.0]))


@dataclass(frozen=True, eq=False)
class Fault:
    """`effect`: its name in the catalogue, or what it is ("outside" tells); `joints` it sits on; `truth`: parameter symbol → value.

    How it comes about: `laws`, `limit` (n,) of the drive, `loss` (n,) of the gears, `distortions` of the sensors, another true
    `arm`, or one that is `changed` at a time, or a `soft` joint; `undeclared`: an effect left out of the declared model there."""

    effect: str
    joints: tuple[str, ...]
    truth: dict[str, float] = field(default_factory=dict)
    laws: tuple[Law, ...] = ()
    limit: Array | None = None
    loss: Array | None = None
    distortions: tuple[Distortion, ...] = ()
    arm: Arm | None = None
    changed: Arm | None = None
    change_at: float = np.inf
    soft: Soft | None = None
    undeclared: str = ""
    outside: bool = False


FAULTS: dict[str, Callable[[Setting], Fault | None]] = {}
OUTSIDE: dict[str, Callable[[Setting], Fault | None]] = {}


def fault(make: Callable[[Setting], Fault | None]) -> Callable[[Setting], Fault | None]:
    """Register a fault of the catalogue under the function's name."""
    FAULTS[make.__name__] = make
    return make


def outside(make: Callable[[Setting], Fault | None]) -> Callable[[Setting], Fault | None]:
    """Register a fault that the catalogue does not hold."""
    OUTSIDE[make.__name__] = make
    return make


def smooth_law(s: Setting, effect: str, f: Callable[[float, float, float], float], side: str = "motor", **truth: float) -> Fault:
    return Fault(effect, (s.joint,), truth, laws=(Smooth(s.j, side, f),))


def dry_law(s: Setting, effect: str, f: Callable[[float, float, float], float], side: str = "motor", **truth: float) -> Fault:
    return Fault(effect, (s.joint,), truth, laws=(Dry(s.j, side, f),))


def motor_scales(s: Setting) -> tuple[float, float, float]:
    """Torque, speed and Coulomb friction of the joint's motor."""
    return float(s.tau[s.j]), float(s.speed[s.j]), float(s.arm.drive["Fc"][s.j])


def on_one(s: Setting, value: float) -> Array:
    """(n,) on the measured side with a motor-side torque at the joint's motor."""
    out = np.zeros(s.arm.robot.n)
    out[s.j] = on_measured_side(s, value)
    return out


def on_measured_side(s: Setting, motor_torque: float) -> float:
    return motor_torque if s.arm.robot.transmission.measured == Side.MOTOR else motor_torque * s.ratio
