"""What simulators ask of each joint's actuator, derived once from an identified model: numbers on the joint side, in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.offset import Offset
from ..effects.springs import LinearSpring
from ..friction.speed import Stribeck
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .identified import Identified

Array = np.ndarray


@dataclass(frozen=True)
class JointActuator:
    """One joint's actuator: torque = gains and limits of the drive, less armature ddq, damping dq, dry friction, offset and spring.

    `armature` (kg m²), `damping` (N m s/rad, back-EMF included), `dry` (N m, in motion), `breakaway` (N m that dry friction has more at
    rest), `offset` (N m to be held at every position), `stiffness` (N m/rad about zero); `kp` (N m/rad), `kd` (N m s/rad), None where
    torque is commanded; `ki` (N m/(rad s)), None where the drive does not integrate its error; `effort_limit` (N m), `delay_s`; `lower`,
    `upper` (rad), `velocity` (rad/s); infinite where unknown. `command_lag_s`: of the filter of commands, `deadband`
    (rad) of errors, None where no drive has one. Metres and newtons where the joint is prismatic."""

    joint: str
    prismatic: bool
    armature: float
    damping: float
    dry: float
    breakaway: float
    offset: float
    stiffness: float
    kp: float | None
    kd: float | None
    effort_limit: float
    delay_s: float
    lower: float
    upper: float
    velocity: float
    ki: float | None = None
    command_lag_s: float | None = None
    deadband: float | None = None

    @property
    def limited(self) -> bool:
        return bool(np.isfinite(self.effort_limit))

    @property
    def torque_unit(self) -> str:
        return "N" if self.prismatic else "N m"


@dataclass(frozen=True, eq=False)
class Actuation:
    """Every joint's actuator, in the robot's order of joints, and the law they follow (None: torque is commanded, in the place of a voltage
    as well).

    `inertia`, `drag`, `spring` (n, n), `offset` (n,): rotors, damping and springs of the joints together where the transmission couples
    them; the actuators hold the diagonals, and the dry friction of each joint moving alone."""

    robot: Robot
    actuators: tuple[JointActuator, ...]
    law: str | None
    velocity_command: bool
    inertia: Array
    drag: Array
    spring: Array
    offset: Array

    @classmethod
    def of(cls, found: Identified) -> Actuation:
        robot, law = found.robot, found.law
        back = robot.transmission.K_inverse
        motor, own = found.drive(), found.beside()
        inertia, drag = (back.T @ np.diag(motor[key]) @ back + np.diag(own[key]) for key in ("armature", "damping"))
        dry = np.abs(back).T @ motor["frictionloss"] + own["frictionloss"]
        spring, offset = _held(found)
        gains = None if law is None or law.per_volt is not None else law
        breakaway = _breakaway(found)
        actuators = tuple(
            JointActuator(
                name,
                robot.joints[j].prismatic,
                float(inertia[j, j]),
                float(drag[j, j]),
                float(dry[j]),
                float(breakaway[j]),
                float(offset[j]),
                float(spring[j, j]),
                None if gains is None else float(gains.kp[j]),
                None if gains is None else float(gains.kd[j]),
                _limit(robot, j) if law is None else float(law.effort_limit[j]),
                0.0 if law is None else float(law.delay_s[j]),
                robot.joints[j].lower,
                robot.joints[j].upper,
                robot.joints[j].velocity if robot.joints[j].velocity > 0 else float("inf"),
                None if law is None or law.ki is None else float(law.ki[j]),
                None if law is None or law.command_lag_s is None else float(law.command_lag_s[j]),
                None if law is None or law.deadband is None else float(law.deadband[j]),
            )
            for j, name in enumerate(robot.joint_names)
        )
        rates = law is not None and law.velocity_command
        return cls(robot, actuators, None if gains is None else gains.kind, rates, inertia, drag, spring, offset)

    @property
    def coupled(self) -> bool:
        """Whether joints share motors."""
        return not self.robot.transmission.is_diagonal


def _limit(robot: Robot, j: int) -> float:
    effort = robot.joints[j].effort
    return float(effort) if effort > 0 else float("inf")


def _held(found: Identified) -> tuple[Array, Array]:
    """Stiffness (n, n) and constant torque (n,) of springs and offsets, joint side: τ = stiffness q + constant."""
    robot = found.robot
    transmission, n = robot.transmission, robot.n
    stiffness, constant = np.zeros((n, n)), np.zeros(n)
    for effect, part in zip(found.model.effects, found.model.slices, strict=True):
        if not isinstance(effect, Offset | LinearSpring):
            continue
        at, each = effect.at(robot), np.zeros((2, n))
        values = found.values[part].reshape(len(at), -1)
        each[1, at] = values[:, -1]
        if isinstance(effect, LinearSpring):
            each[0, at] = values[:, 0]
        rates = np.eye(n) if effect.side == Side.JOINT else transmission.K_inverse
        zero = np.zeros(n) if effect.side == Side.JOINT else rates @ transmission.zero
        stiffness += rates.T @ np.diag(each[0]) @ rates
        constant += rates.T @ (each[1] - each[0] * zero)
    return stiffness, constant


def _breakaway(found: Identified) -> Array:
    """What dry friction (n,) is more at rest, joint side."""
    robot = found.robot
    out = np.zeros(robot.n)
    for effect, part in zip(found.model.effects, found.model.slices, strict=True):
        if isinstance(effect, Stribeck):
            level = np.zeros(robot.n)
            level[effect.at(robot)] = found.values[part]
            out += level if effect.side == Side.JOINT else np.abs(robot.transmission.K_inverse).T @ level
    return out


def named(actuators: Sequence[JointActuator], key: str) -> dict[str, float]:
    """Joint → one number of its actuator."""
    return {actuator.joint: getattr(actuator, key) for actuator in actuators}
