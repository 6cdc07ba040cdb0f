"""Friction that depends on where the joint or motor is, and friction on the joint side of the gears."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.joint_effect import JointEffect
from ..effects.kinds import Axis, Nature, choice
from ..effects.motion import Coordinates, Motion
from ..effects.orders import slowest_order
from ..effects.registry import register
from ..robots.parameters import ShapeParameter
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class PositionDependentFriction(JointEffect):
    """Dry friction that varies over a turn: τ = s(ω) (Fps sin(n x) + Fpc cos(n x)), s = sgn of the speed on `side`.

    `angle`: the side whose position x modulates it, the joint by default (a gear that runs out of true, a seal). `order`: n,
    cycles a turn (rad/m on a slide).

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.PositionDependentFriction(joints=("joint2",), order=1.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fps_joint2', 'N m'), ('Fpc_joint2', 'N m')]
    """

    name: ClassVar[str] = "position_dependent_friction"
    title: ClassVar[str] = "friction that varies with position"
    axis: ClassVar[Axis] = Axis.POSITION
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("Fps", "{tau}", -np.inf), ("Fpc", "{tau}", -np.inf))
    formulas = ("sgn(dq) * sin(order * x)", "sgn(dq) * cos(order * x)")

    angle: Side = Side.JOINT
    order: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "angle", choice(Side, self.angle, "angle", self.name))

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("order", "1/rad (1/m)", 0.05, 1000.0, 1.0, log=True),)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(order=(slowest_order(robot, self.at(robot), self.angle), np.inf))

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        phase = self.order * motion.on(self.angle).q[:, at]
        yield own.direction * np.sin(phase)
        yield own.direction * np.cos(phase)


@register
@dataclass(frozen=True, kw_only=True)
class JointSideFriction(JointEffect):
    """Coulomb and viscous friction of the joint's own bearings and seals: τ = Fc_link s(dq) + Fv_link dq on the joint side.

    Behind a gear that couples no joints it cannot be distinguished from the motor's friction, and base reduction joins the two; in a
    coupled wrist it can.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.JointSideFriction(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fc_link_joint2', 'N m'), ('Fv_link_joint2', 'N m s/rad')]
    """

    name: ClassVar[str] = "joint_side_friction"
    title: ClassVar[str] = "friction on the joint side of the gears"
    axis: ClassVar[Axis] = Axis.VELOCITY
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("Fc_link", "{tau}", 0.0), ("Fv_link", "{tau} s/{q}", 0.0))
    formulas = ("sgn(dq)", "dq")

    side: Side = Side.JOINT

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.direction
        yield own.dq
