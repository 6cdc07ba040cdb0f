"""Friction that is not the same in both directions of motion, as a correction of the symmetric law."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..effects.joint_effect import JointEffect
from ..effects.kinds import Axis, Nature
from ..effects.motion import Coordinates, Motion
from ..effects.registry import register

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class AsymmetricCoulomb(JointEffect):
    """Half the difference of dry friction between the directions: τ = dFc s², s = sgn(ω), 0 at standstill.

    Beside `coulomb` it makes Fc + dFc forwards and Fc − dFc backwards; friction as long as |dFc| ≤ Fc. Differs from an
    offset only at standstill.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.AsymmetricCoulomb(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('dFc_joint2', 'N m')]
    """

    name: ClassVar[str] = "asymmetric_coulomb"
    title: ClassVar[str] = "Coulomb friction that depends on direction"
    axis: ClassVar[Axis] = Axis.VELOCITY
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("dFc", "{tau}", -np.inf),)
    formulas = ("abs(sgn(dq))",)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield np.abs(own.direction)


@register
@dataclass(frozen=True, kw_only=True)
class AsymmetricViscous(JointEffect):
    """Half the difference of viscous friction between the directions: τ = dFv |ω|.

    Beside `viscous` it makes Fv + dFv forwards and Fv − dFv backwards; friction as long as |dFv| ≤ Fv. Found on the EMPS
    axis.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.AsymmetricViscous(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('dFv_joint2', 'N m s/rad')]
    """

    name: ClassVar[str] = "asymmetric_viscous"
    title: ClassVar[str] = "viscous friction that depends on direction"
    axis: ClassVar[Axis] = Axis.VELOCITY
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("dFv", "{tau} s/{q}", -np.inf),)
    formulas = ("abs(dq)",)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.direction * own.dq
