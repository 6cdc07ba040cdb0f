"""Whether a trajectory keeps its clearance at every moment, between samples too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..simulation.trajectory import Trajectory
    from .clearance import Clearance
    from .limits import Limits

Array = np.ndarray
#: Seconds of a first step, how far (m) distances may fall short between samples, and moments that are looked at in all.
_STEP, _TOLERANCE, _MOST = 0.02, 1e-4, 60_000


@dataclass(frozen=True, eq=False)
class ClearanceCertificate:
    """`holds`: every distance is at least what is required (to 0.1 mm) at every moment; `whole`: that was shown between the moments
    looked at, too. `nearest`: see `Safety`."""

    holds: bool
    whole: bool
    nearest: tuple[tuple[str, float, float], ...]


def certify(clearance: Clearance, trajectory: Trajectory, limits: Limits) -> ClearanceCertificate:
    """Bisect in time until between no two moments any distance can fall below what is required.

    A distance changes no faster than the sum over joints of speed times reach; speeds between two moments exceed those at them by at most
    what the acceleration limits allow."""
    t = np.linspace(0.0, trajectory.duration, max(2, int(np.ceil(trajectory.duration / _STEP)) + 1))
    motion = trajectory.sample(t)
    first = clearance.distances(motion.q)
    nearest = _nearest(clearance, first, t)
    slack = (first - clearance.required).min(axis=1, initial=np.inf)
    if not len(clearance.constraints):
        return ClearanceCertificate(True, True, ())
    if slack.min() < 0.0:
        return ClearanceCertificate(False, True, nearest)
    left, right, looked = (t[:-1], slack[:-1], motion.dq[:-1]), (t[1:], slack[1:], motion.dq[1:]), len(t)
    while len(left[0]):
        step = right[0] - left[0]
        speed = np.maximum(np.abs(left[2]), np.abs(right[2])) + 0.5 * limits.acceleration * step[:, None]
        lowest = 0.5 * (left[1] + right[1] - step * (speed @ clearance.speed))
        open_ = lowest < -_TOLERANCE
        if not open_.any():
            return ClearanceCertificate(True, True, nearest)
        looked += int(open_.sum())
        if looked > _MOST:
            return ClearanceCertificate(True, False, nearest)
        a, b = (tuple(x[open_] for x in side) for side in (left, right))
        middle = 0.5 * (a[0] + b[0])
        motion = trajectory.sample(middle)
        distance = clearance.distances(motion.q, clearance.surroundings.clearance + 0.1)
        own = (distance - clearance.required).min(axis=1)
        nearest = _nearer(nearest, _nearest(clearance, distance, middle))
        if own.min() < 0.0:
            return ClearanceCertificate(False, True, nearest)
        m = (middle, own, motion.dq)
        left = tuple(np.concatenate([x, y]) for x, y in zip(a, m, strict=True))  # type: ignore[assignment]
        right = tuple(np.concatenate([y, x]) for x, y in zip(b, m, strict=True))  # type: ignore[assignment]
    return ClearanceCertificate(True, True, nearest)


def _nearest(clearance: Clearance, distance: Array, t: Array) -> tuple[tuple[str, float, float], ...]:
    """Each thing at its nearest, the least room beside what is required first."""
    at = distance.argmin(axis=0)
    rows = [(c.what, float(distance[i, k]), float(t[i])) for k, (c, i) in enumerate(zip(clearance.constraints, at, strict=True))]
    order = np.argsort(distance.min(axis=0) - clearance.required)
    found: dict[str, tuple[str, float, float]] = {}
    for k in order.tolist():
        found.setdefault(rows[k][0], rows[k])
    return tuple(found.values())


def _nearer(old: tuple[tuple[str, float, float], ...], new: tuple[tuple[str, float, float], ...]) -> tuple[tuple[str, float, float], ...]:
    """The nearer of two moments of each thing, in the order of the first."""
    other = {row[0]: row for row in new}
    return tuple(min(row, other.get(row[0], row), key=lambda r: r[1]) for row in old)
