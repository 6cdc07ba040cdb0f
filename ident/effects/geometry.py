"""Geometry that is not as declared: a coupling missing from the transmission, a link of another length."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from ..errors import ConfigurationError
from ..robots.parameters import Parameter
from ..robots.transmission import Side
from .base import Effect
from .kinds import Axis, Need, choice
from .motion import Coordinates, Motion
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .motion import Prediction

Array = np.ndarray

#: Largest relative change of a motor's motion in a difference quotient.
_STEP = 1e-5
#: Change of a length (m) in a difference quotient: torques are quadratic in lengths, so that any step is exact.
_LENGTH_STEP = 0.1


@register
@dataclass(frozen=True, kw_only=True)
class GearCoupling(Effect):
    """An entry of θ = K θ_m that is not as declared: τ = Σ K_ij ∂τ/∂K_ij of the whole drive, K_ij the true less the declared entry,
    the slopes taken half way to the entries that the reference holds.

    The torque of link i appears at motor j, and the motors of joint i turn with motor j. `joints`: rows i; `motors`: columns
    j, by the names of their joints; every other motor if None. `encoder`: the side whose positions were measured; if it is
    the motor side, the joint positions themselves follow from K. `sensor`: the side whose torque was measured, whatever side it was
    converted to with the declared K: that of the motors (currents), or that of the joints (torque sensors behind the gears).

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.GearCoupling(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('K_joint2_joint1', 'rad/rad'), ('K_joint2_joint3', 'rad/rad'), ('K_joint2_joint4', 'rad/rad')]
    """

    name: ClassVar[str] = "gear_coupling"
    title: ClassVar[str] = "coupling missing from the transmission"
    axis: ClassVar[Axis] = Axis.LOAD
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})

    motors: tuple[str, ...] | None = None
    encoder: Side = Side.JOINT
    sensor: Side = Side.MOTOR

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("encoder", "sensor"):
            object.__setattr__(self, key, choice(Side, getattr(self, key), key, self.name))
        if self.motors is not None:
            object.__setattr__(self, "motors", (self.motors,) if isinstance(self.motors, str) else tuple(self.motors))

    @classmethod
    def placements(cls, robot: Robot, **configuration: Any) -> Iterator[Self]:
        """One for each entry of K beside the diagonal."""
        for joint, motor in itertools.permutations(robot.joint_names, 2):
            yield cls(joints=(joint,), motors=(motor,), **configuration)

    def pairs(self, robot: Robot) -> list[tuple[int, int]]:
        """(joint i, motor j) of each column."""
        rows = self.at(robot)
        if self.motors is None:
            return [(i, j) for i in rows for j in range(robot.n) if i != j]
        columns = [robot.joint_index(name) for name in self.motors]
        return [(i, j) for i in rows for j in columns]

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        if self.sensor == Side.JOINT and robot.transmission.measured == Side.MOTOR:
            raise ConfigurationError(f'effect {self.name!r}: sensor = "joint", but robot {robot.name!r} is logged with motor torque.')
        return tuple(
            Parameter(
                f"{self.named('K', robot, i)}_{robot.joint_names[j]}",
                f"{robot.position_unit(i, Side.JOINT)}/{robot.position_unit(j, Side.MOTOR)}",
                self.name,
                robot.joint_names[i],
            )
            for i, j in self.pairs(robot)
        )

    def columns(self, motion: Motion, robot: Robot) -> Array:
        reference = motion.needed_reference(f"effect {self.name!r}")
        declared, values = robot.transmission, reference.values_of(self, robot)
        if values.any():
            robot, motion, reference = self._half_way(motion, robot, reference, values)
        transmission, side = robot.transmission, self.sensor
        links = motion.remembered(("acting on joints", reference), lambda: reference.part(motion, Side.JOINT, acting=Side.JOINT))
        loaded = replace(motion, load=motion.remembered(("load", reference), lambda: reference.load(motion)))
        pairs = self.pairs(robot)
        out = np.zeros((len(motion), robot.n, len(pairs)))
        for column, (i, j) in enumerate(pairs):
            entry = np.zeros_like(transmission.K)
            entry[i, j] = 1.0
            # τ_m = Kᵀ τ: the motor sees the torque of the joint it now moves.
            slope = links @ entry if side == Side.MOTOR else np.zeros_like(links)
            if self.encoder == Side.MOTOR:
                # The joint moves by as much more as the motor turns.
                motor = motion.motor
                shift = (motor.q[:, j], motor.dq[:, j], motor.ddq[:, j])
                more = reference.along(motion, np.eye(robot.n)[i], shift, acting=Side.JOINT)
                slope = slope + transmission.torque(more, Side.JOINT, side)
            slope = slope + self._drive(loaded, reference, entry, (i, j))
            out[:, :, column] = declared.torque(slope, side, self.side)
        return out

    def _half_way(self, motion: Motion, robot: Robot, reference: Prediction, values: Array) -> tuple[Robot, Motion, Prediction]:
        """Robot, motion and prediction with half of what the reference holds of these entries: the torque is all but quadratic in K, and
        the slope at half way times the whole way is then the whole change."""
        there = self.applied(robot, 0.5 * values)
        moved = self._behind(motion, there)
        return there, moved, reference.of_robot(there)

    def _behind(self, motion: Motion, other: Robot) -> Motion:
        """The motion that was measured, behind another transmission."""
        if self.encoder == Side.JOINT:
            return motion.moved(other, motion.joint)
        motor, drive = motion.motor, other.transmission
        joint = Coordinates(drive.joint_position(motor.q), drive.joint_rate(motor.dq), drive.joint_rate(motor.ddq))
        return replace(motion.moved(other, joint), motor=motor)

    def _drive(self, motion: Motion, reference: Prediction, entry: Array, pair: tuple[int, int]) -> Array:
        """Slope (N, n), on the sensor's side, of what acts on the motors, over an entry of K, at the motion that was measured."""
        robot = reference.model.robot
        transmission, (i, j) = robot.transmission, pair
        size = float(np.linalg.norm(transmission.K[i]))
        h = _STEP * size / max(1.0, float(np.abs(motion.motor.q[:, j]).max(initial=0.0)))
        ends = []
        for step in (h, -h):
            other = robot.with_transmission(replace(transmission, K=transmission.K + step * entry))
            there = self._behind(motion, other)
            if self.encoder == Side.JOINT:
                there = replace(there, load=motion.load)
            ends.append(reference.part(there, self.sensor, other, acting=Side.MOTOR))
        return (ends[0] - ends[1]) / (2.0 * h)

    def applied(self, robot: Robot, values: Array) -> Robot:
        """The robot with the entries found in its transmission. Motor torque that was converted with the old K is to be converted anew."""
        K = robot.transmission.K.copy()
        for (i, j), value in zip(self.pairs(robot), values, strict=True):
            K[i, j] += value
        return robot.with_transmission(replace(robot.transmission, K=K))


@register
@dataclass(frozen=True, kw_only=True)
class LinkLength(Effect):
    """A link that is longer than declared by dL: τ = dL ∂τ/∂L, L the distance from the joint before to this joint.

    Only joints that follow another at some distance have one. Mostly absorbed by base parameters; the rest is small.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.LinkLength(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('dL_joint2', 'm')]
    """

    name: ClassVar[str] = "link_length"
    title: ClassVar[str] = "error of a link's length"
    axis: ClassVar[Axis] = Axis.POSITION
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})

    side: Side = Side.JOINT

    def at(self, robot: Robot) -> list[int]:
        """The joints at some distance from another. Raises ConfigurationError where others are asked for."""
        named = super().at(robot)
        found = [j for j in named if _offset(robot, j) is not None]
        if self.joints is not None and len(found) < len(named):
            missing = robot.joint_names[next(j for j in named if j not in found)]
            raise ConfigurationError(f"effect {self.name!r}: joint {missing!r} is at no distance from a joint before it.")
        return found

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        # A length that is wrong by more than half of itself is another robot.
        most = {j: 0.5 * _length(robot, j) for j in self.at(robot)}
        return tuple(
            Parameter(self.named("dL", robot, j), "m", self.name, robot.joint_names[j], lower=-half, upper=half) for j, half in most.items()
        )

    def columns(self, motion: Motion, robot: Robot) -> Array:
        reference = motion.needed_reference(f"effect {self.name!r}")
        at, values = self.at(robot), reference.values_of(self, robot)
        out = np.zeros((len(motion), robot.n, len(at)))
        for column, j in enumerate(at):
            # Half way to the length that the reference holds: there the slope is that of the whole way.
            steps = [0.5 * values[column] + step for step in (_LENGTH_STEP, -_LENGTH_STEP)]
            ends = [reference.load(motion, _lengthened(robot, j, step)) for step in steps]
            out[:, :, column] = robot.transmission.torque((ends[0] - ends[1]) / (2.0 * _LENGTH_STEP), Side.JOINT, self.side)
        return out

    def applied(self, robot: Robot, values: Array) -> Robot:
        """The robot with the lengths found."""
        for j, value in zip(self.at(robot), values, strict=True):
            robot = _lengthened(robot, j, float(value))
        return robot


def _length(robot: Robot, j: int) -> float:
    """Distance of joint j from the joint before it."""
    body = [joint.name for joint in robot.tree_joints].index(robot.joint_names[j]) + int(robot.floating_base)
    return float(np.linalg.norm(robot.tree.translation[body]))


def _offset(robot: Robot, j: int) -> Array | None:
    """Unit vector from the joint before to joint j, in the frame of the former; None where there is no such distance."""
    body = [joint.name for joint in robot.tree_joints].index(robot.joint_names[j]) + int(robot.floating_base)
    offset = robot.tree.translation[body]
    length = float(np.linalg.norm(offset))
    return None if robot.tree.parent[body] < 0 or length < 1e-9 else offset / length


def _lengthened(robot: Robot, j: int, by: float) -> Robot:
    model = robot.model.copy()
    placement = model.jointPlacements[model.getJointId(robot.joint_names[j])]
    direction = _offset(robot, j)
    if direction is not None:
        placement.translation = placement.translation + by * direction
    return replace(robot, model=model)
