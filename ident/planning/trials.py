"""One test of a step-by-step plan: which joints move how, at which postures, and what is read from it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from ..robots.transmission import Side
from ..simulation.trajectory import Chained, Dwell, FourierTrajectory, PointToPoint, Trajectory, Trapezoid

Array = np.ndarray
_PAUSE = 0.25


class MotionKind(StrEnum):
    """How a test moves.

    STATIC: creeping through each posture in both directions; the mean of both torques is what holds the posture, and half
    their difference the friction. CONSTANT_VELOCITY: sweeps in both directions at several speeds; half the difference of the
    torques at one posture is friction alone. ACCELERATED: one joint or two swing, the others are frozen."""

    STATIC = "static"
    CONSTANT_VELOCITY = "constant_velocity"
    ACCELERATED = "accelerated"


@dataclass(frozen=True, eq=False)
class Sweep:
    """Through the posture along `direction` (n,), joint motion per unit of the moving coordinate, at each of the `speeds` of that
    coordinate, there and back, `reach` to either side."""

    direction: Array
    speeds: tuple[float, ...]
    reach: tuple[float, ...]

    def parts(self, posture: Array) -> list[tuple[Trajectory, int]]:
        """Trajectories and the direction of each, ±1 where it is steady in the middle."""
        found: list[tuple[Trajectory, int]] = []
        for speed, reach in zip(self.speeds, self.reach, strict=True):
            seconds, ramp = sweep_times(speed, reach)
            ends = posture - reach * self.direction, posture + reach * self.direction
            found.append((Trapezoid(ends[0], ends[1], seconds, ramp), 1))
            found.append((Dwell(ends[1], _PAUSE), 0))
            found.append((Trapezoid(ends[1], ends[0], seconds, ramp), -1))
            found.append((Dwell(ends[0], _PAUSE), 0))
            # The next speed begins where its own reach asks for.
        return found


def sweep_times(speed: float, reach: float) -> tuple[float, float]:
    """Duration of one sweep and of its ramp: a sixth of it."""
    # distance = speed (T - ramp), ramp = T / 6.
    seconds = 2.0 * reach / speed * 6.0 / 5.0
    return seconds, seconds / 6.0


@dataclass(frozen=True, eq=False)
class Swing:
    """A Fourier series about the posture, at rest at both ends: `sine`, `cosine` (H, n) in rad/s, zero for frozen joints."""

    sine: Array
    cosine: Array
    base_hz: float

    def parts(self, posture: Array) -> list[tuple[Trajectory, int]]:
        """The one trajectory; its direction counts as 1."""
        return [(FourierTrajectory(posture, self.sine, self.cosine, self.base_hz), 1)]


@dataclass(frozen=True)
class Segment:
    """A stretch of a test's log to be used: from `begin` to `end` (s) at posture number `posture`; `direction` ±1 of a sweep at
    `speed` of the moving coordinate (0 for a swing)."""

    begin: float
    end: float
    posture: int
    direction: int
    speed: float


@dataclass(frozen=True, eq=False)
class PlannedTest:
    """One test. `moving`: the joints that move (of a constant-velocity test, the motor, by its joint's name); `row`, `side`: the
    torque that is read, of this joint (or motor) on this side; `postures` (P, n): where the other joints are frozen, and about
    which the moving ones move; `reveals`: base parameters that are determined from here on; `gain`: by how much the rank
    rises, combinations of parameters included; `strength`: smallest singular value of what is new, relative to that of a
    motion of all joints; `log`: file name."""

    name: str
    kind: MotionKind
    moving: tuple[str, ...]
    row: str
    side: Side
    postures: Array = field(repr=False)
    motion: Sweep | Swing = field(repr=False)
    reveals: tuple[str, ...]
    gain: int
    strength: float
    log: str

    def trajectory(self, velocity: Array, acceleration: Array) -> tuple[Chained, tuple[Segment, ...]]:
        """The whole motion, and the stretches of it to use; between postures at most this fast, (n,) each."""
        parts: list[Trajectory] = []
        segments: list[Segment] = []
        clock, at = 0.0, None
        for p, posture in enumerate(self.postures):
            pieces = self.motion.parts(posture)
            sweeps = 0
            for piece, direction in pieces:
                start = piece.sample(np.zeros(1)).q[0]
                if at is not None and np.abs(start - at).max() > 1e-12:
                    move = PointToPoint(at, start, transfer_time(start - at, velocity, acceleration))
                    parts += [move, Dwell(start, _PAUSE)]
                    clock += move.duration + _PAUSE
                elif at is None:
                    parts.append(Dwell(start, _PAUSE))
                    clock += _PAUSE
                if direction:
                    begin, end = piece.steady if isinstance(piece, Trapezoid) else (0.0, piece.duration)
                    speed = self.motion.speeds[sweeps // 2] if isinstance(self.motion, Sweep) else 0.0
                    segments.append(Segment(clock + begin, clock + end, p, direction, speed))
                    sweeps += 1
                parts.append(piece)
                clock += piece.duration
                at = piece.sample(np.array([piece.duration])).q[0]
        return Chained(parts), tuple(segments)


def transfer_time(way: Array, velocity: Array, acceleration: Array) -> float:
    """Seconds for a quintic move over `way` (n,) within speed and acceleration."""
    distance = np.abs(way)
    # A fifth-order move peaks at 15/8 of its mean speed and 10/sqrt(3) of distance / time².
    by_speed = float(np.max(1.875 * distance / velocity))
    by_acceleration = float(np.sqrt(np.max(10.0 / np.sqrt(3.0) * distance / acceleration)))
    return max(by_speed, by_acceleration, 0.2)
