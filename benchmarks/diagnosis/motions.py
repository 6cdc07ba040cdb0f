"""Motions of the test bed's arms beside Fourier series: point to point at speed, taught slowly, and a task over and over."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ident.simulation.trajectory import Chained, Dwell, PointToPoint, Trajectory, Trapezoid

if TYPE_CHECKING:
    from .arms import Arm

Array = np.ndarray
STYLES = ("fourier", "trapezoid", "taught", "task")


def motion(arm: Arm, style: str, seed: int, seconds: float) -> Trajectory:
    """A random motion of that style that lasts `seconds` at least."""
    rng = np.random.default_rng([seed, 8])
    return {"trapezoid": _trapezoids, "taught": _taught, "task": _task}[style](arm, rng, seconds)


def _posture(arm: Arm, rng: np.random.Generator) -> Array:
    low, high = arm.limits.T
    return low + (high - low) * rng.uniform(0.04, 0.96, arm.robot.n)


def _move(arm: Arm, rng: np.random.Generator, begin: Array, end: Array, share: float) -> Trapezoid:
    """In step, the slowest joint at `share` of its top speed."""
    ramp = float(rng.uniform(0.15, 0.4))
    steady = float(np.max(np.abs(end - begin) / (share * arm.top_speed)))
    return Trapezoid(begin, end, max(steady, ramp) + ramp, ramp)


def _trapezoids(arm: Arm, rng: np.random.Generator, seconds: float) -> Trajectory:
    parts: list[Trajectory] = [Dwell(_posture(arm, rng), 0.3)]
    at, total = parts[0].sample(np.zeros(1)).q[0], 0.3
    while total < seconds:
        to = _posture(arm, rng)
        parts += [_move(arm, rng, at, to, float(rng.uniform(0.3, 1.0))), Dwell(to, float(rng.uniform(0.1, 0.6)))]
        total += parts[-1].duration + parts[-2].duration
        at = to
    return Chained(tuple(parts))


def _taught(arm: Arm, rng: np.random.Generator, seconds: float) -> Trajectory:
    """Some joints at a time, slowly, with pauses."""
    at = _posture(arm, rng)
    parts: list[Trajectory] = [Dwell(at, 0.5)]
    total = 0.5
    while total < seconds:
        to = np.where(rng.random(arm.robot.n) < 0.5, _posture(arm, rng), at)
        share = float(rng.uniform(0.15, 0.5))
        # The peak of a fifth-order polynomial's speed is 1.875 times its mean.
        lasts = max(float(np.max(1.875 * np.abs(to - at) / (share * arm.top_speed))), 0.5)
        parts += [PointToPoint(at, to, lasts), Dwell(to, float(rng.uniform(0.3, 1.2)))]
        total += parts[-1].duration + lasts
        at = to
    return Chained(tuple(parts))


def _task(arm: Arm, rng: np.random.Generator, seconds: float) -> Trajectory:
    """A cycle of places, again and again; places and speeds vary by a little."""
    places = [_posture(arm, rng) for _ in range(int(rng.integers(5, 9)))]
    speeds = rng.uniform(0.4, 1.0, len(places))
    room = np.ptp(arm.limits, axis=1)
    at, total = places[0], 0.3
    parts: list[Trajectory] = [Dwell(at, 0.3)]
    k = 0
    while total < seconds:
        k += 1
        place = places[k % len(places)] + 0.02 * room * rng.uniform(-1, 1, arm.robot.n)
        to = np.clip(place, arm.limits[:, 0], arm.limits[:, 1])
        parts += [_move(arm, rng, at, to, float(speeds[k % len(places)])), Dwell(to, 0.2)]
        total += parts[-1].duration + parts[-2].duration
        at = to
    return Chained(tuple(parts))
