"""The drive train every arm has: reflected rotor inertia, viscous and Coulomb friction (Yoshida, 1995, eq. 3.13)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..effects.joint_effect import JointEffect
from ..effects.kinds import Axis, Factor, Nature
from ..effects.motion import Coordinates, Motion
from ..effects.registry import register

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class RotorInertia(JointEffect):
    """Inertia that turns with the motor: τ_m = Ia dω/dt. Through K it couples joints that share motors.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.RotorInertia(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Ia_joint2', 'kg m^2')]
    """

    name: ClassVar[str] = "rotor_inertia"
    title: ClassVar[str] = "rotor inertia"
    axis: ClassVar[Axis] = Axis.ACCELERATION
    usual: ClassVar[bool] = True
    symbols = (("Ia", "{inertia}", 0.0),)
    factors = (Factor.ACCELERATION,)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.ddq


@register
@dataclass(frozen=True, kw_only=True)
class Viscous(JointEffect):
    """Friction proportional to speed: τ = Fv ω.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.Viscous(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fv_joint2', 'N m s/rad')]
    """

    name: ClassVar[str] = "viscous"
    title: ClassVar[str] = "viscous friction"
    axis: ClassVar[Axis] = Axis.VELOCITY
    usual: ClassVar[bool] = True
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("Fv", "{tau} s/{q}", 0.0),)
    factors = (Factor.SPEED,)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.dq


@register
@dataclass(frozen=True, kw_only=True)
class Coulomb(JointEffect):
    """Dry friction: τ = Fc sgn(ω). At rest the torque is any value within ±Fc; the column is zero there.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.Coulomb(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fc_joint2', 'N m')]
    """

    name: ClassVar[str] = "coulomb"
    title: ClassVar[str] = "Coulomb friction"
    axis: ClassVar[Axis] = Axis.VELOCITY
    usual: ClassVar[bool] = True
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("Fc", "{tau}", 0.0),)
    factors = (Factor.DIRECTION,)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.direction
