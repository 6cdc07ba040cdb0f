"""Torque that repeats with the angle of a motor or a joint: cogging, ripple of the torque."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..robots.parameters import ShapeParameter
from ..robots.transmission import Side
from .joint_effect import JointEffect
from .kinds import Axis, Nature, Need, choice
from .motion import Coordinates, Motion
from .orders import slowest_order
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class PeriodicEffect(JointEffect):
    """What repeats with the position of the side `angle`. `order`: cycles a turn of it, whole or not (rad/m on a slide)."""

    axis: ClassVar[Axis] = Axis.MOTOR_ANGLE

    angle: Side = Side.MOTOR
    order: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "angle", choice(Side, self.angle, "angle", self.name))

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("order", "1/rad (1/m)", 0.05, 1000.0, 1.0, log=True),)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(order=(slowest_order(robot, self.at(robot), self.angle), np.inf))

    def phase(self, motion: Motion, at: list[int]) -> Array:
        """Angle times order, (N, len(at))."""
        return self.order * motion.on(self.angle).q[:, at]


@register
@dataclass(frozen=True, kw_only=True)
class Cogging(PeriodicEffect):
    """A torque that repeats with the angle, whatever the load: τ = cogs sin(n φ) + cogc cos(n φ).

    At the motor: magnets and slots; with `angle="joint"`: a gear that runs out of true.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.Cogging(joints=("joint2",), order=1.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('cogs_joint2', 'N m'), ('cogc_joint2', 'N m')]
    """

    name: ClassVar[str] = "cogging"
    title: ClassVar[str] = "cogging (torque that repeats with the angle)"
    symbols = (("cogs", "{tau}", -np.inf), ("cogc", "{tau}", -np.inf))

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """Behind a gear from twice a turn of the joint on: a conservative torque once a turn is a weight's, a spring's or a tilt's."""
        at = self.at(robot)
        geared = all(abs(float(robot.transmission.K[j, j])) != 1.0 for j in at)
        return self.bounded(order=((2.0 if geared else 1.0) * slowest_order(robot, at, self.angle), np.inf))

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        phase = self.phase(motion, at)
        yield np.sin(phase)
        yield np.cos(phase)


@register
@dataclass(frozen=True, kw_only=True)
class TorqueRipple(PeriodicEffect):
    """A torque constant that varies over a turn: τ = τ_pred (ripples sin(n φ) + ripplec cos(n φ)), τ_pred as the model predicts it.

    The reading is the torque times 1 + ripple. Hard to tell from cogging where the load hardly varies.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.TorqueRipple(joints=("joint2",), order=1.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('ripples_joint2', '1'), ('ripplec_joint2', '1')]
    """

    name: ClassVar[str] = "torque_ripple"
    title: ClassVar[str] = "torque ripple (torque constant that varies over a turn)"
    nature: ClassVar[Nature] = Nature.SENSOR
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})
    symbols = (("ripples", "1", -np.inf), ("ripplec", "1", -np.inf))

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        phase = self.phase(motion, at)
        torque = motion.predicted_on(self.side)[:, at]
        yield torque * np.sin(phase)
        yield torque * np.cos(phase)
