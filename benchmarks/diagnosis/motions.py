"""Motions of the test bed's arms beside Fourier series: point to point at speed, taught slowly, and a task over and over."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.simulation.trajectory import Chained, Dwell, PointToPoint, Trajectory, Trapezoid

Array = np.ndarray
STYLES = ("fourier", "trapezoid", "taught", "task")


@dataclass(frozen=True, eq=False)
class Room:
    """Where motions may go: `limits` (n, 2) of the joints' positions, and how fast, `top_speed` (n,)."""

    limits: Array
    top_speed: Array


def motion(room: Room, style: str, seed: int, seconds: float) -> Trajectory:
    """A random motion of that style that lasts `seconds` at least."""
    rng = np.random.default_rng([seed, 8])
    return {"trapezoid": _trapezoids, "taught": _taught, "task": _task}[style](room, rng, seconds)


def _posture(room: Room, rng: np.random.Generator) -> Array:
    low, high = room.limits.T
    return low + (high - low) * rng.uniform(0.04, 0.96, len(room.limits))


def _move(room: Room, rng: np.random.Generator, begin: Array, end: Array, share: float) -> Trapezoid:
    """In step, the slowest joint at `share` of its top speed."""
    ramp = float(rng.uniform(0.15, 0.4))
    steady = float(np.max(np.abs(end - begin) / (share * room.top_speed)))
    return Trapezoid(begin, end, max(steady, ramp) + ramp, ramp)


def _trapezoids(room: Room, rng: np.random.Generator, seconds: float) -> Trajectory:
    parts: list[Trajectory] = [Dwell(_posture(room, rng), 0.3)]
    at, total = parts[0].sample(np.zeros(1)).q[0], 0.3
    while total < seconds:
        to = _posture(room, rng)
        parts += [_move(room, rng, at, to, float(rng.uniform(0.3, 1.0))), Dwell(to, float(rng.uniform(0.1, 0.6)))]
        total += parts[-1].duration + parts[-2].duration
        at = to
    return Chained(tuple(parts))


def _taught(room: Room, rng: np.random.Generator, seconds: float) -> Trajectory:
    """Some joints at a time, slowly, with pauses."""
    at = _posture(room, rng)
    parts: list[Trajectory] = [Dwell(at, 0.5)]
    total = 0.5
    while total < seconds:
        to = np.where(rng.random(len(room.limits)) < 0.5, _posture(room, rng), at)
        share = float(rng.uniform(0.15, 0.5))
        # The peak of a fifth-order polynomial's speed is 1.875 times its mean.
        lasts = max(float(np.max(1.875 * np.abs(to - at) / (share * room.top_speed))), 0.5)
        parts += [PointToPoint(at, to, lasts), Dwell(to, float(rng.uniform(0.3, 1.2)))]
        total += parts[-1].duration + lasts
        at = to
    return Chained(tuple(parts))


def _task(room: Room, rng: np.random.Generator, seconds: float) -> Trajectory:
    """A cycle of places, again and again; places and speeds vary by a little."""
    places = [_posture(room, rng) for _ in range(int(rng.integers(5, 9)))]
    speeds = rng.uniform(0.4, 1.0, len(places))
    span = np.ptp(room.limits, axis=1)
    at, total = places[0], 0.3
    parts: list[Trajectory] = [Dwell(at, 0.3)]
    k = 0
    while total < seconds:
        k += 1
        place = places[k % len(places)] + 0.02 * span * rng.uniform(-1, 1, len(room.limits))
        to = np.clip(place, room.limits[:, 0], room.limits[:, 1])
        parts += [_move(room, rng, at, to, float(speeds[k % len(places)])), Dwell(to, 0.2)]
        total += parts[-1].duration + parts[-2].duration
        at = to
    return Chained(tuple(parts))
