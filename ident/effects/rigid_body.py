"""The rigid body: ten inertial parameters a link, through the joint torque regressor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..regressor.rigid import inverse_dynamics, regressor, terms
from ..robots.parameters import LINK_SYMBOLS, LINK_UNITS, Parameter
from ..robots.transmission import Side
from .base import Effect
from .kinds import Axis, Nature
from .motion import Motion
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class RigidBody(Effect):
    """The links: τ = Wᵀ Y(q, dq, ddq) π with π in Pinocchio's order, gravity included; always of the whole robot.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.RigidBody()
    >>> len(effect.parameters(ident.load_robot("scara")))
    40
    """

    name: ClassVar[str] = "rigid_body"
    title: ClassVar[str] = "rigid body"
    axis: ClassVar[Axis] = Axis.POSITION
    nature: ClassVar[Nature] = Nature.LINK
    per_joint: ClassVar[bool] = False

    side: Side = Side.JOINT

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(f"{symbol}_{joint.name}", unit, self.name, joint.name, 0.0 if symbol in ("m", "Ixx", "Iyy", "Izz") else -np.inf)
            for joint in robot.tree_joints
            for symbol, unit in zip(LINK_SYMBOLS, LINK_UNITS, strict=True)
        )

    def columns(self, motion: Motion, robot: Robot) -> Array:
        own = motion.joint
        Y = regressor(robot.tree, robot.tree_position(own.q), robot.tree_rate(own.dq), robot.tree_rate(own.ddq))
        return Y if robot.loop.is_trivial else np.einsum("tj,Ntk->Njk", robot.loop.W, Y)

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        own = motion.joint
        tau = inverse_dynamics(robot.tree, values, robot.tree_position(own.q), robot.tree_rate(own.dq), robot.tree_rate(own.ddq))
        return tau if robot.loop.is_trivial else tau @ robot.loop.W

    def affine(self, motion: Motion, robot: Robot, values: Array) -> tuple[Array, Array | None]:
        own = motion.joint
        inertia, bias = terms(robot.tree, values, robot.tree_position(own.q), robot.tree_rate(own.dq))
        if robot.loop.is_trivial:
            return bias, inertia
        return bias @ robot.loop.W, robot.loop.W.T @ inertia @ robot.loop.W
