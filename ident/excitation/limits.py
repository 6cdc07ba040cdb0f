"""What a trajectory may do: positions, velocities, accelerations, jerks and torque."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from ..robots.reach import reach

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: Where a robot's description says nothing: half range, speed, and the time in which that speed is reached.
_HALF_TURN, _STROKE = np.pi, 0.5
_SPEED = {False: 1.5, True: 0.3}
_RISE = 0.3


@dataclass(frozen=True, eq=False)
class Limits:
    """Joint-side limits, (n,) each: positions from `lower` to `upper`, ± `velocity`, ± `acceleration`, ± `torque` (inf: none), ± `jerk`
    (rad/s^3, m/s^3; inf, the default: none)."""

    lower: Array
    upper: Array
    velocity: Array
    acceleration: Array
    torque: Array
    jerk: Array = np.inf  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name in ("lower", "upper", "velocity", "acceleration", "torque", "jerk"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), float).reshape(-1))
        if self.jerk.shape == (1,):
            object.__setattr__(self, "jerk", np.full(self.lower.shape, self.jerk[0]))
        for name in ("velocity", "acceleration", "torque", "jerk"):
            bad = np.flatnonzero(~(getattr(self, name) > 0))
            if len(bad):
                raise ConfigurationError(f"limits: {name} of joint {bad[0] + 1} must be positive, not {getattr(self, name)[bad[0]]:g}.")
        bad = np.flatnonzero(~(self.lower < self.upper) | ~np.isfinite(self.lower) | ~np.isfinite(self.upper))
        if len(bad):
            raise ConfigurationError(
                f"limits: positions of joint {bad[0] + 1} must have a finite lower limit below its upper one,"
                f" not {self.lower[bad[0]]:g} and {self.upper[bad[0]]:g}."
            )

    @classmethod
    def of(
        cls,
        robot: Robot,
        *,
        velocity: Sequence[float] | float | None = None,
        acceleration: Sequence[float] | float | None = None,
        torque: Sequence[float] | float | None = None,
        jerk: Sequence[float] | float | None = None,
        lower: Sequence[float] | None = None,
        upper: Sequence[float] | None = None,
        share: float = 0.9,
    ) -> Limits:
        """The `share` of what the robot's description allows; what is given here holds in full.

        Where the description has no range, half a turn either way (0.5 m) is taken; no speed: 1.5 rad/s (0.3 m/s);
        accelerations, which URDFs do not have: the speed is reached in 0.3 s. Torque is the effort limit, if there is one; jerk is not
        limited unless it is given."""
        n = robot.n
        prismatic = np.array([j.prismatic for j in robot.joints])
        low, high = reach(robot.joints, _HALF_TURN, _STROKE)
        middle, way = 0.5 * (low + high), 0.5 * share * (high - low)
        speed = np.array([j.velocity for j in robot.joints])
        usual = np.array([_SPEED[bool(p)] for p in prismatic])
        speed = share * np.where(np.isfinite(speed) & (speed > 0), speed, usual)
        effort = np.array([j.effort for j in robot.joints])
        effort = np.where(np.isfinite(effort) & (effort > 0), share * effort, np.inf)

        def given(name: str, value: Sequence[float] | float | None, otherwise: Array) -> Array:
            if value is None:
                return otherwise
            array = np.asarray(value, float)
            if array.ndim == 0:
                return np.full(n, float(array))
            if array.shape != (n,):
                raise ConfigurationError(f"limits: {name} must be one number or {n}, one per joint, not shape {array.shape}.")
            return array

        speed = given("velocity", velocity, speed)
        return cls(
            given("lower", lower, middle - way),
            given("upper", upper, middle + way),
            speed,
            given("acceleration", acceleration, speed / _RISE),
            given("torque", torque, effort),
            given("jerk", jerk, np.full(n, np.inf)),
        )

    @property
    def n(self) -> int:
        return len(self.lower)

    @property
    def middle(self) -> Array:
        """Middle of the positions (n,)."""
        return 0.5 * (self.lower + self.upper)

    @property
    def kinds(self) -> tuple[str, ...]:
        """What is limited of the motion itself, in the order of `shares`."""
        return ("position", "velocity", "acceleration", *(("jerk",) if np.isfinite(self.jerk).any() else ()))

    def shares(self, motion: Coordinates, jerk: Array | None = None) -> Array:
        """Each quantity over its limit, (3 or 4, N, n) for position (about the middle), velocity, acceleration and, where it is given
        (N, n), jerk; beyond ±1 is not allowed."""
        parts = [
            (motion.q - self.middle) / (0.5 * (self.upper - self.lower)),
            motion.dq / self.velocity,
            motion.ddq / self.acceleration,
        ]
        if jerk is not None:
            parts.append(jerk / self.jerk)
        return np.stack(parts)
