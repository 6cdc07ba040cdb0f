"""How the robot is mounted: a base that is tilted, gravity that is not what was declared (SCIENCE.md 7.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effect import Axis, Effect, Need, register
from ..errors import ConfigurationError
from ..motion import Motion
from ..parameters import Parameter
from ..transmission import Side

if TYPE_CHECKING:
    from ..robot import Robot

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class _Mounting(Effect):
    """A correction that acts through gravity on the whole robot; `joints` is of no use to it."""

    axis: ClassVar[Axis] = Axis.POSITION
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})
    per_joint: ClassVar[bool] = False

    side: Side = Side.JOINT

    def fields(self, robot: Robot) -> list[Array]:
        """For each column the change of gravity (3,) per unit parameter. Raises ConfigurationError."""
        raise NotImplementedError

    def columns(self, motion: Motion, robot: Robot) -> Array:
        reference = motion.needed_reference(f"effect {self.name!r}")
        torque = [reference.gravity(motion, field) for field in self.fields(robot)]
        return np.stack([robot.transmission.torque(t, Side.JOINT, self.side) for t in torque], axis=2)

    def gravity(self, robot: Robot) -> Array:
        """Declared gravity (3,). Raises ConfigurationError where there is none, or joints were named."""
        self.at(robot)
        if self.joints is not None:
            raise ConfigurationError(f"effect {self.name!r} is of the whole robot: leave `joints` out.")
        gravity = np.array(robot.model.gravity.linear, float)
        if not gravity.any():
            raise ConfigurationError(f"effect {self.name!r} needs gravity, but robot {robot.name!r} is declared without any.")
        return gravity


@register
@dataclass(frozen=True, kw_only=True)
class BaseTilt(_Mounting):
    """A base that is not level: turned by tiltx, tilty (rad) about two axes of the base square to gravity.

    The axes are x and y of the base if gravity is along its z; else x (or the base axis squarest to gravity) made square to
    gravity, and the one square to both. τ = Σ tilt_i ∂τ/∂tilt_i, with gravity in the base's frame turned by −tilt; first
    order in the tilt."""

    name: ClassVar[str] = "base_tilt"
    title: ClassVar[str] = "tilted base"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        self.gravity(robot)
        return tuple(Parameter(f"tilt{axis}{self.label}", "rad", self.name) for axis in "xy")

    def fields(self, robot: Robot) -> list[Array]:
        gravity = self.gravity(robot)
        return [-np.cross(axis, gravity) for axis in tilt_axes(gravity)]

    def applied(self, robot: Robot, values: Array) -> Robot:
        """The robot in the tilted field, gravity as strong as before."""
        gravity = self.gravity(robot)
        turn = np.asarray(values) @ np.stack(tilt_axes(gravity))
        return robot.with_gravity(_rotated(gravity, -turn).tolist())


@register
@dataclass(frozen=True, kw_only=True)
class GravityMagnitude(_Mounting):
    """Gravity that is stronger than declared by g: τ = g ∂τ/∂|gravity|."""

    name: ClassVar[str] = "gravity_magnitude"
    title: ClassVar[str] = "error of gravity's magnitude"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        self.gravity(robot)
        return (Parameter(f"dg{self.label}", "m/s^2", self.name),)

    def fields(self, robot: Robot) -> list[Array]:
        gravity = self.gravity(robot)
        return [gravity / np.linalg.norm(gravity)]

    def applied(self, robot: Robot, values: Array) -> Robot:
        """The robot in the field of the magnitude found."""
        return robot.with_gravity((self.gravity(robot) + self.fields(robot)[0] * float(values[0])).tolist())


def tilt_axes(gravity: Array) -> tuple[Array, Array]:
    """Two unit vectors (3,) square to gravity and to each other, right-handed with up."""
    up = -gravity / np.linalg.norm(gravity)
    nearest = np.eye(3)[int(np.argmin(np.round(np.abs(up), 9)))]
    first = nearest - (nearest @ up) * up
    first /= np.linalg.norm(first)
    return first, np.cross(up, first)


def _rotated(v: Array, turn: Array) -> Array:
    """v (3,) turned by the rotation vector `turn` (3,), Rodrigues' formula."""
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return v
    u = turn / angle
    return v * np.cos(angle) + np.cross(u, v) * np.sin(angle) + u * (u @ v) * (1.0 - np.cos(angle))
