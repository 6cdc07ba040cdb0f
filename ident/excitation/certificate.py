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
#: Slack (m) up to which distances are exact here, and distance (m) up to which a thing is listed.
_WITHIN, _LISTED = 0.1, 0.3


@dataclass(frozen=True, eq=False)
class ClearanceCertificate:
    """`holds`: every distance is at least what is required (to 0.1 mm) at every moment; `whole`: that was shown between the moments
    looked at, too; `what`: where it does not hold, what comes too near, and when (s)."""

    holds: bool
    whole: bool = True
    what: str = ""
    at: float = 0.0


def certify(clearance: Clearance, trajectory: Trajectory, limits: Limits) -> ClearanceCertificate:
    """Bisect in time until between no two moments any distance can fall below what is required.

    A distance changes no faster than the sum over joints of speed times the reach of what they move; speeds between two moments exceed
    those at them by at most what the acceleration limits allow."""
    if not len(clearance.constraints):
        return ClearanceCertificate(True)
    t = np.linspace(0.0, trajectory.duration, max(2, int(np.ceil(trajectory.duration / _STEP)) + 1))
    slack, dq, fault = _slack(clearance, trajectory, t)
    if fault is not None:
        return fault
    left, right, looked = (t[:-1], slack[:-1], dq[:-1]), (t[1:], slack[1:], dq[1:]), len(t)
    while len(left[0]):
        step = right[0] - left[0]
        speed = np.maximum(np.abs(left[2]), np.abs(right[2])) + 0.5 * limits.acceleration * step[:, None]
        lowest = 0.5 * (left[1] + right[1] - step[:, None] * (speed @ clearance.rates))
        open_ = (lowest < -_TOLERANCE).any(axis=1)
        if not open_.any():
            return ClearanceCertificate(True)
        looked += int(open_.sum())
        if looked > _MOST:
            return ClearanceCertificate(True, whole=False)
        a, b = (tuple(x[open_] for x in side) for side in (left, right))
        middle = 0.5 * (a[0] + b[0])
        own, dq, fault = _slack(clearance, trajectory, middle)
        if fault is not None:
            return fault
        m = (middle, own, dq)
        left = tuple(np.concatenate([x, y]) for x, y in zip(a, m, strict=True))  # type: ignore[assignment]
        right = tuple(np.concatenate([y, x]) for x, y in zip(b, m, strict=True))  # type: ignore[assignment]
    return ClearanceCertificate(True)


def _slack(clearance: Clearance, trajectory: Trajectory, t: Array) -> tuple[Array, Array, ClearanceCertificate | None]:
    """What distances have beyond what is required (N, C), speeds (N, n), and the fault where one of them has nothing."""
    motion = trajectory.sample(t)
    slack = clearance.slack(motion.q, _WITHIN)
    if slack.min(initial=0.0) >= 0.0:
        return slack, motion.dq, None
    row, c = np.unravel_index(int(slack.argmin()), slack.shape)
    return slack, motion.dq, ClearanceCertificate(False, True, clearance.constraints[c].what, float(t[row]))


def nearest(clearance: Clearance, trajectory: Trajectory) -> tuple[tuple[str, float, float], ...]:
    """What comes within 0.3 m of what along a trajectory (or all, where nothing does), how near (m) and when (s), each at its nearest, the
    least room beside what is required first."""
    t = np.linspace(0.0, trajectory.duration, max(2, int(np.ceil(trajectory.duration / (0.5 * _STEP))) + 1))
    q = trajectory.sample(t).q
    distance = clearance.distances(q, _LISTED)
    shown = distance.min(axis=0, initial=np.inf) < _LISTED
    if not shown.any():
        distance = clearance.distances(q)
        shown[:] = True
    at = distance.argmin(axis=0)
    rows = [(c.what, float(distance[i, k]), float(t[i])) for k, (c, i) in enumerate(zip(clearance.constraints, at, strict=True))]
    found: dict[str, tuple[str, float, float]] = {}
    for k in np.argsort(distance.min(axis=0) - clearance.required).tolist():
        if shown[k]:
            found.setdefault(rows[k][0], rows[k])
    return tuple(found.values())
