"""Friction that depends on where the joint or motor is, and friction on the joint side of the gears."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..effects.joint_effect import JointEffect
from ..effects.kinds import Axis, Nature
from ..effects.motion import Coordinates, Motion
from ..effects.periodic import PeriodicEffect
from ..effects.registry import register
from ..robots.transmission import Side

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class PositionDependentFriction(PeriodicEffect):
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

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        phase = self.phase(motion, at)
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
