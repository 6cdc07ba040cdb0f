"""Springs, cables and counterbalances between a joint's two sides."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..errors import ConfigurationError
from ..robots.parameters import ShapeParameter
from ..robots.transmission import Side
from .joint_effect import JointEffect
from .kinds import Axis, Factor, Nature
from .motion import Coordinates, Motion
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class LinearSpring(JointEffect):
    """A spring in parallel with the joint: τ = ks q + ks0. Its rest position is −ks0/ks.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.LinearSpring(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('ks_joint2', 'N m/rad'), ('ks0_joint2', 'N m')]
    """

    name: ClassVar[str] = "linear_spring"
    title: ClassVar[str] = "spring in parallel with the joint"
    axis: ClassVar[Axis] = Axis.POSITION
    nature: ClassVar[Nature] = Nature.LINK
    symbols = (("ks", "{tau}/{q}", 0.0), ("ks0", "{tau}", -np.inf))
    factors = (Factor.POSITION, Factor.ONE)

    side: Side = Side.JOINT

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.q
        yield np.ones_like(own.q)


@register
@dataclass(frozen=True, kw_only=True)
class NonlinearSpring(JointEffect):
    """A cable, hose or hardening spring: τ = kc0 + kc1 q + kc2 q² + kc3 q³.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.NonlinearSpring(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('kc0_joint2', 'N m'), ('kc1_joint2', 'N m/rad'), ('kc2_joint2', 'N m/rad^2'), ('kc3_joint2', 'N m/rad^3')]
    """

    name: ClassVar[str] = "nonlinear_spring"
    title: ClassVar[str] = "cable, hose or nonlinear spring"
    axis: ClassVar[Axis] = Axis.POSITION
    nature: ClassVar[Nature] = Nature.LINK
    symbols = (
        ("kc0", "{tau}", -np.inf),
        ("kc1", "{tau}/{q}", -np.inf),
        ("kc2", "{tau}/{q}^2", -np.inf),
        ("kc3", "{tau}/{q}^3", -np.inf),
    )
    formulas = ("1", "q", "q ** 2", "q ** 3")

    side: Side = Side.JOINT

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield np.ones_like(own.q)
        yield own.q
        yield own.q**2
        yield own.q**3


@register
@dataclass(frozen=True, kw_only=True)
class Counterbalance(JointEffect):
    """A spring between a point of the base, at distance a from the joint axis, and a point of the link, at distance r.

    With α = q − q_0 (q_0 = `angle`: both points on one ray), ρ = r/a = `ratio` and the spring's length a ℓ,
    ℓ² = 1 + ρ² − 2ρ cos α, a spring of stiffness k and free length l_0 takes τ = kar sin α − kal sin α / ℓ with
    kar = k a r, kal = k r l_0. The first term alone is the ideal balancer (l_0 = 0); it looks like the gravity of the link.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.Counterbalance(joints=("joint2",), angle=0.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('kar_joint2', 'N m'), ('kal_joint2', 'N m')]
    """

    name: ClassVar[str] = "counterbalance"
    title: ClassVar[str] = "counterbalance spring on a linkage"
    axis: ClassVar[Axis] = Axis.POSITION
    nature: ClassVar[Nature] = Nature.LINK
    symbols = (("kar", "{tau}", 0.0), ("kal", "{tau}", 0.0))
    formulas = ("sin(q - angle)", "-sin(q - angle) / sqrt(1 + ratio**2 - 2 * ratio * cos(q - angle))")

    side: Side = Side.JOINT
    angle: float = 0.0
    ratio: float = 0.4

    def shape(self) -> tuple[ShapeParameter, ...]:
        # An odd number of angles: a spring's mirror image, half a turn away, is on the grid too.
        return (ShapeParameter("angle", "rad", -np.pi, np.pi, 0.0, points=13), ShapeParameter("ratio", "1", 0.02, 0.95, 0.4, points=4))

    def at(self, robot: Robot) -> list[int]:
        """The joints that turn; a slide has no angle. Raises ConfigurationError where one is asked for."""
        found = super().at(robot)
        if self.joints is not None:
            for j in found:
                if robot.joints[j].prismatic:
                    raise ConfigurationError(f"effect {self.name!r} needs a joint that turns, but {robot.joint_names[j]!r} is prismatic.")
        return [j for j in found if not robot.joints[j].prismatic]

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        alpha = own.q - self.angle
        length = np.sqrt(1.0 + self.ratio**2 - 2.0 * self.ratio * np.cos(alpha))
        yield np.sin(alpha)
        yield -np.sin(alpha) / length
