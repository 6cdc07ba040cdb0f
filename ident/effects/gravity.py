"""How the robot is mounted: a base that is tilted, gravity that is not what was declared."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..errors import ConfigurationError
from ..regressor.base_parameters.structural import base_set
from ..robots.parameters import LINK_UNITS, Parameter
from ..robots.transmission import Side
from .base import Effect
from .kinds import Axis, Need
from .motion import Motion
from .reference import Reference
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: Random positions at which columns are compared, and the share from which on one counts as there.
_POSITIONS = 40
_SHOWN = 1e-8
#: No robot stands where gravity (m/s²) is stronger, nor is it so many times what was declared.
_STRONGEST, _MORE = 11.0, 1.1


@dataclass(frozen=True, kw_only=True)
class _Mounting(Effect):
    """A correction that acts through gravity on the whole robot; `joints` is of no use to it."""

    axis: ClassVar[Axis] = Axis.POSITION
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})
    per_joint: ClassVar[bool] = False

    side: Side = Side.JOINT

    @abstractmethod
    def fields(self, robot: Robot, values: Array) -> list[Array]:
        """For each of the columns that act on the reference the change of gravity (3,) per unit parameter, at parameter values (k,): the
        values times the columns are the whole change. Raises ConfigurationError."""

    def columns(self, motion: Motion, robot: Robot) -> Array:
        reference = motion.needed_reference(f"effect {self.name!r}")
        torque = [reference.gravity(motion, field) for field in self.fields(robot, reference.values_of(self, robot))]
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
    gravity, and the one square to both. Gravity in the base's frame is turned by −tilt: τ = Σ tilt_i c_i, c_i the mean of ∂τ/∂tilt_i on
    the way from level to the tilt that the reference holds, so that at this tilt the sum is exact. A tilted base also shows first
    moments that no torque showed before (those of what turns about a vertical axis): each is a parameter of its own, its product
    with a tilt.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.BaseTilt()
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('tiltx', 'rad'), ('tilty', 'rad'), ('tiltx_mx_joint1', 'kg m'), ('tiltx_my_joint1', 'kg m')]
    """

    name: ClassVar[str] = "base_tilt"
    title: ClassVar[str] = "tilted base"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        self.gravity(robot)
        shown = [Parameter(f"tilt{'xy'[m.axis]}_{m.name}{self.label}", m.unit, self.name) for m in newly_shown(robot)]
        return (*(Parameter(f"tilt{axis}{self.label}", "rad", self.name) for axis in "xy"), *shown)

    def fields(self, robot: Robot, values: Array) -> list[Array]:
        gravity = self.gravity(robot)
        axes = tilt_axes(gravity)
        turn = values[0] * axes[0] + values[1] * axes[1]
        # Gravity there less gravity here is the integral of its change on the way (Gauss, Legendre: exact to the sixth power).
        places, shares = np.polynomial.legendre.leggauss(3)
        on_the_way = [(0.5 * share, _rotated(gravity, -0.5 * (1.0 + x) * turn)) for x, share in zip(places, shares, strict=True)]
        return [-np.sum([share * np.cross(axis, there) for share, there in on_the_way], axis=0) for axis in axes]

    def columns(self, motion: Motion, robot: Robot) -> Array:
        rigid, fields = robot.rigid_body(), tilt_fields(self.gravity(robot))
        torque = [Reference(rigid, m.inertia).gravity(motion, fields[m.axis]) for m in newly_shown(robot)]
        more = [robot.transmission.torque(t, Side.JOINT, self.side)[:, :, None] for t in torque]
        return np.concatenate([super().columns(motion, robot), *more], axis=2)

    def applied(self, robot: Robot, values: Array) -> Robot:
        """The robot in the tilted field, gravity as strong as before."""
        gravity = self.gravity(robot)
        turn = np.asarray(values)[:2] @ np.stack(tilt_axes(gravity))
        return robot.with_gravity(_rotated(gravity, -turn).tolist())


@register
@dataclass(frozen=True, kw_only=True)
class GravityMagnitude(_Mounting):
    """Gravity that is stronger than declared by g: τ = g ∂τ/∂|gravity|.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.GravityMagnitude()
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('dg', 'm/s^2')]
    """

    name: ClassVar[str] = "gravity_magnitude"
    title: ClassVar[str] = "error of gravity's magnitude"

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        declared = float(np.linalg.norm(self.gravity(robot)))
        return (Parameter(f"dg{self.label}", "m/s^2", self.name, lower=-declared, upper=max(_STRONGEST, _MORE * declared) - declared),)

    def fields(self, robot: Robot, values: Array) -> list[Array]:
        return [self._direction(robot)]

    def _direction(self, robot: Robot) -> Array:
        gravity = self.gravity(robot)
        return np.asarray(gravity / np.linalg.norm(gravity))

    def applied(self, robot: Robot, values: Array) -> Robot:
        """The robot in the field of the magnitude found."""
        return robot.with_gravity((self.gravity(robot) + self._direction(robot) * float(values[0])).tolist())


@dataclass(frozen=True, eq=False)
class Moment:
    """Link parameters (10 nb,) that no torque shows while the base is level, per unit of the one called `name` (`unit`), and the
    tilt (0, 1) that shows them."""

    axis: int
    name: str
    unit: str
    inertia: Array


@lru_cache(maxsize=32)
def newly_shown(robot: Robot) -> tuple[Moment, ...]:
    """What only a tilted base shows: independent combinations of link parameters that the declared robot's torques do not hold."""
    from scipy.linalg import qr

    base = base_set(robot)
    width = base.matrix.shape[1]
    hidden = np.setdiff1d(np.arange(width), base.kept)
    inertia = np.zeros((len(hidden), width))
    inertia[np.arange(len(hidden)), hidden] = 1.0
    inertia[:, base.kept] = -base.matrix[:, hidden].T
    # Gravity acts on masses and first moments alone.
    inertia, hidden = inertia[(hidden % 10) < 4], hidden[(hidden % 10) < 4]
    rigid, rng = robot.rigid_body(), np.random.default_rng(0)
    q = rng.uniform(-3.0, 3.0, (_POSITIONS, robot.n))
    columns, size = [], 0.0
    for field in tilt_fields(np.array(robot.model.gravity.linear, float)):
        there = robot.with_gravity(field.tolist())
        phi = rigid.effects[0].columns(Motion.of(there, q, np.zeros_like(q), np.zeros_like(q)), there).reshape(-1, width)
        columns.append(phi @ inertia.T)
        size = max(size, float(np.abs(phi).max()))
    A = np.concatenate(columns, axis=1)
    if not A.size or np.abs(A).max() <= _SHOWN * size:
        return ()
    _, R, order = qr(A, mode="economic", pivoting=True)
    rank = int(np.sum(np.abs(np.diag(R)) > _SHOWN * abs(R[0, 0])))
    found = [divmod(int(i), len(hidden)) for i in sorted(order[:rank])]
    return tuple(Moment(axis, base.parameters[hidden[i]], LINK_UNITS[hidden[i] % 10], inertia[i]) for axis, i in found)


def tilt_fields(gravity: Array) -> list[Array]:
    """Change of gravity (3,) in the base's frame per unit of either tilt."""
    return [-np.cross(axis, gravity) for axis in tilt_axes(gravity)]


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
