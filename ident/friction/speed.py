"""Friction that depends on speed beyond Coulomb and viscous: the Stribeck fall at low speed, growth other than linear."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.joint_effect import JointEffect
from ..effects.kinds import Axis, Nature
from ..effects.motion import Coordinates, Motion
from ..effects.registry import register
from ..robots.parameters import ShapeParameter

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: An exponent of speed that is closer to 1 than this is none of its own.
_OTHER_THAN_VISCOUS = 0.1


@register
@dataclass(frozen=True, kw_only=True)
class Stribeck(JointEffect):
    """Excess of friction at low speed: τ = Fs s(ω) exp(−(ω/v_s)²), s = sgn, on top of Coulomb friction.

    Fs: static less Coulomb friction; v_s: Stribeck velocity. Source: the Gaussian form is that of
    Bo and Pavelescu (1982) with exponent 2.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.Stribeck(joints=("joint2",), v_s=0.1)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fs_joint2', 'N m')]
    """

    name: ClassVar[str] = "stribeck"
    title: ClassVar[str] = "Stribeck friction"
    axis: ClassVar[Axis] = Axis.VELOCITY
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("Fs", "{tau}", 0.0),)
    formulas = ("sgn(dq) * exp(-((dq / v_s) ** 2))",)

    v_s: float = 0.1

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("v_s", "rad/s (m/s)", 1e-5, 1e4, 0.1, log=True),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.direction * np.exp(-np.square(own.dq / self.v_s))

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """From where hardly a sample is slower to where the term is nearly flat over the speeds seen."""
        top = usual_speed(self, motion, robot)
        return self.bounded(v_s=(0.003 * top, 0.7 * top))


@register
@dataclass(frozen=True, kw_only=True)
class NonlinearViscous(JointEffect):
    """Friction that grows with a power of speed: τ = Fn s(ω) |ω|^a.

    a < 1: grows more slowly than speed (as on the TX40), a > 1: faster (churning of a lubricant). Near
    a = 0 and a = 1 it is Coulomb and viscous friction over again.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.NonlinearViscous(joints=("joint2",), a=0.5)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fn_joint2', 'N m (s/rad)^0.5')]
    """

    name: ClassVar[str] = "nonlinear_viscous"
    title: ClassVar[str] = "friction that does not grow in proportion to speed"
    axis: ClassVar[Axis] = Axis.VELOCITY
    nature: ClassVar[Nature] = Nature.FRICTION
    symbols = (("Fn", "{tau} (s/{q})^{a}", 0.0),)
    formulas = ("sgn(dq) * abs(dq) ** a",)

    a: float = 0.5

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("a", "1", 0.1, 4.0, 0.5),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.direction * np.abs(own.dq) ** self.a

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(a=(0.15, 3.0))

    def implausible(self, robot: Robot, values: Array, std: Array) -> str:
        near = abs(self.a - 1.0) < _OTHER_THAN_VISCOUS
        return f"friction with an exponent of {self.a:.3g} cannot be distinguished from viscous friction" if near else ""


def usual_speed(effect: JointEffect, motion: Motion, robot: Robot) -> float:
    """Largest of the joints' 95th percentiles of |speed| on the effect's side: a speed that is reached for some time."""
    at = effect.at(robot)
    speed = np.abs(motion.on(effect.side).dq[:, at])
    return float(np.quantile(speed, 0.95, axis=0).max()) if speed.size else 0.0
