"""Laws without a name: smooth functions of what a leftover follows, for what no effect of the catalogue accounts for."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..errors import ConfigurationError
from ..robots.parameters import Parameter
from ..robots.transmission import Side
from .base import Effect
from .kinds import Axis, Need, choice
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .motion import Motion

Array = np.ndarray
_DEGREE = 3


class Turned(StrEnum):
    """What a described law is multiplied by: nothing, or the direction of the joint's motion."""

    ONE = "one"
    DIRECTION = "direction"


@dataclass(frozen=True, kw_only=True)
class Described(Effect):
    """τ_j = Σ_k d_k B_k(x), B_k cubic B-splines over the knots, x a logged quantity of the joint itself or of the joint `by`.

    The function is zero at the first knot (what is the same everywhere is an offset, or Coulomb friction), and beyond the knots what it is
    at their ends. It says what the torque does, not why."""

    axis: ClassVar[Axis] = Axis.POSITION
    cause: ClassVar[bool] = False
    #: What the law follows, in words; whether it may be that of another joint.
    what: ClassVar[str]
    elsewhere: ClassVar[bool] = True

    by: str = ""
    turned: Turned = Turned.ONE
    knots: tuple[float, ...] = (-1.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "turned", choice(Turned, self.turned, "turned", self.name))
        knots = tuple(float(x) for x in self.knots)
        if len(knots) < 2 or not np.all(np.isfinite(knots)) or np.any(np.diff(knots) <= 0):
            raise ConfigurationError(f"effect {self.name!r}: knots must be at least two numbers that grow, not {self.knots!r}.")
        object.__setattr__(self, "knots", knots)

    @property
    def own_motion(self) -> bool:
        """Whether it follows the motion of the joint it sits on: then it can do whatever an effect of that motion does."""
        return not self.by and Need.TIME not in self.needs

    @property
    def followed(self) -> str:
        """Name of the joint whose quantity it follows."""
        return self.by or (self.joints or ("",))[0]

    @property
    def count(self) -> int:
        """Parameters on each joint."""
        return len(self.knots) + _DEGREE - 2

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.named(f"d{k + 1}", robot, j), robot.force_unit(j, self.side), self.name, robot.joint_names[j], -np.inf)
            for j in self.at(robot)
            for k in range(self.count)
        )

    def columns(self, motion: Motion, robot: Robot) -> Array:
        at = self.at(robot)
        out = np.zeros((len(motion), robot.n, self.count * len(at)))
        direction = motion.on(self.side).direction if self.turned == Turned.DIRECTION else None
        for i, j in enumerate(at):
            x = self.quantity(motion, robot, robot.joint_index(self.by) if self.by else j)
            values = self.splines(x)
            out[:, j, i * self.count : (i + 1) * self.count] = values if direction is None else values * direction[:, [j]]
        return out

    def splines(self, x: Array) -> Array:
        """B_k(x), (N, count)."""
        from scipy.interpolate import BSpline

        knots = np.array([*[self.knots[0]] * _DEGREE, *self.knots, *[self.knots[-1]] * _DEGREE])
        inside = np.clip(x, self.knots[0], self.knots[-1])
        return np.asarray(BSpline.design_matrix(inside, knots, _DEGREE).toarray()[:, 1:])

    @abstractmethod
    def quantity(self, motion: Motion, robot: Robot, j: int) -> Array:
        """The quantity x (N,) of joint j that the law follows."""

    @abstractmethod
    def unit(self, robot: Robot, j: int) -> str:
        """Its unit on joint j."""


@register
@dataclass(frozen=True, kw_only=True)
class DescribedPosition(Described):
    """A smooth function of a joint's position (its own, or that of the joint `by`), on the joint side of the gears.

    Examples
    --------
    >>> import ident
    >>> ident.make_effect("described_position", joints=["joint3"], by="joint2", knots=(-1.0, 0.0, 1.0)).count
    4
    """

    name: ClassVar[str] = "described_position"
    title: ClassVar[str] = "described, not explained: a smooth function of a position"
    what: ClassVar[str] = "position"

    def quantity(self, motion: Motion, robot: Robot, j: int) -> Array:
        return motion.joint.q[:, j]

    def unit(self, robot: Robot, j: int) -> str:
        return robot.position_unit(j, Side.JOINT)


@register
@dataclass(frozen=True, kw_only=True)
class DescribedSpeed(Described):
    """A smooth function of a speed (its own, or that of the joint `by`), on the side `side`."""

    name: ClassVar[str] = "described_speed"
    title: ClassVar[str] = "described, not explained: a smooth function of a speed"
    axis: ClassVar[Axis] = Axis.VELOCITY
    what: ClassVar[str] = "speed"

    def quantity(self, motion: Motion, robot: Robot, j: int) -> Array:
        return motion.on(self.side).dq[:, j]

    def unit(self, robot: Robot, j: int) -> str:
        return f"{robot.position_unit(j, self.side)}/s"


@register
@dataclass(frozen=True, kw_only=True)
class DescribedLoad(Described):
    """A smooth function of the torque that the links ask for."""

    name: ClassVar[str] = "described_load"
    title: ClassVar[str] = "described, not explained: a smooth function of the load"
    axis: ClassVar[Axis] = Axis.LOAD
    needs: ClassVar[frozenset[Need]] = frozenset({Need.LOAD})
    what: ClassVar[str] = "load"
    elsewhere: ClassVar[bool] = False

    knots: tuple[float, ...] = (-100.0, 0.0, 100.0)

    def quantity(self, motion: Motion, robot: Robot, j: int) -> Array:
        return motion.behind(robot.transmission).needed_load(f"effect {self.name!r}", self.side)[:, j]

    def unit(self, robot: Robot, j: int) -> str:
        return robot.force_unit(j, self.side)


@register
@dataclass(frozen=True, kw_only=True)
class DescribedTime(Described):
    """A smooth function of time on the run's own clock: it holds for runs that pass as this one did."""

    name: ClassVar[str] = "described_time"
    title: ClassVar[str] = "described, not explained: a smooth function of time"
    axis: ClassVar[Axis] = Axis.TIME
    needs: ClassVar[frozenset[Need]] = frozenset({Need.TIME})
    what: ClassVar[str] = "time"
    elsewhere: ClassVar[bool] = False

    def quantity(self, motion: Motion, robot: Robot, j: int) -> Array:
        return motion.clock

    def unit(self, robot: Robot, j: int) -> str:
        return "s"


#: Every kind of description.
DESCRIPTIONS: tuple[type[Described], ...] = (DescribedPosition, DescribedSpeed, DescribedLoad, DescribedTime)
