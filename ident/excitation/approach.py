"""The way from where a robot stands to where a motion starts: slow, at rest at both ends, clear of everything."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from ..simulation.trajectory import Chained, PointToPoint, Trajectory
from .certificate import certify

if TYPE_CHECKING:
    from .clearance import Clearance
    from .information import MotionInformation
    from .limits import Limits

Array = np.ndarray
#: Share of the limits of speed, acceleration and jerk that an approach uses, its shortest part (s), and the largest step (rad, m) between
#: postures that are looked at on the way.
SLOW, _SHORTEST, _STEP = 0.3, 0.5, 0.05
#: Postures that a search for a way grows to, how far (share of the range) it grows at once, how often it tries the goal, and shortcuts.
_NODES, _GROW, _GOAL, _SHORTCUTS = 3000, 0.1, 0.2, 60
#: Peaks of a fifth-order polynomial's derivatives, per unit way and time.
_PEAKS = (1.875, 10.0 / np.sqrt(3.0), 60.0)


@dataclass(frozen=True, eq=False)
class _Space:
    """Postures that a robot may pass: clear, and held by its torque limits."""

    clearance: Clearance | None
    limits: Limits
    information: MotionInformation

    def holding(self, q: Array) -> Array:
        """Shares (N, n) of the torque limits that holding postures q (N, n) still takes; zeros where torque is not limited."""
        if self.information.values is None or not np.isfinite(self.limits.torque).any():
            return np.zeros_like(q)
        still = Coordinates(q, np.zeros_like(q), np.zeros_like(q))
        return np.abs(self.information.torque(np.arange(len(q)) * 0.01, still) / self.limits.torque)

    def free(self, start: Array, end: Array) -> bool:
        """Whether postures along a straight line are held and keep clear, with the margin at all but the first and last."""
        q = _line(start, end)
        if self.holding(q).max(initial=0.0) > 1.0:
            return False
        if self.clearance is None:
            return True
        slack = self.clearance.slack(q, 0.01)
        return bool((slack[1:-1] > self.clearance.margin).all() and (slack[[0, -1]] >= 0.0).all())

    def blocking(self, start: Array, end: Array) -> str:
        """What is in the way on a straight line."""
        q = _line(start, end)
        holding = self.holding(q).max(axis=0)
        if holding.max(initial=0.0) > 1.0:
            name = self.information.model.robot.joint_names[int(holding.argmax())]
            return f"joint {name} would need {100 * holding.max():.0f} % of its torque limit"
        assert self.clearance is not None
        slack = self.clearance.slack(q, 0.01).min(axis=0)
        worst = int(slack.argmin())
        return (
            f"{self.clearance.constraints[worst].what} come to {1000 * (slack[worst] + self.clearance.constraints[worst].required):.0f} mm"
        )


class NoWay(ConfigurationError):
    """No way to a motion's start was found."""


def approach(
    start: Array, end: Array, limits: Limits, clearance: Clearance | None, information: MotionInformation, seed: int = 0
) -> Trajectory:
    """A motion from posture `start` to posture `end`, (n,) each, along straight lines in joint space, at rest at every corner.

    Speed, acceleration and jerk stay within `SLOW` of their limits, torque (where it is known) within its own, and distances above what is
    required at every moment. Raises NoWay, saying what is in the way."""
    rng = np.random.default_rng(seed)
    space = _Space(clearance, limits, information)
    held = space.holding(start[None])[0]
    if held.max(initial=0.0) > 1.0:
        raise NoWay(
            f"excitation: in the present posture joint {information.model.robot.joint_names[int(held.argmax())]} takes"
            f" {100 * held.max():.0f} % of its torque limit merely to hold still; start elsewhere, or raise the limit."
        )
    corners = _way(start, end, space, rng)
    motion = Chained([_part(a, b, limits, information) for a, b in pairwise(corners)])
    if clearance is not None:
        proof = certify(clearance, motion, limits)
        if not proof.holds:
            raise NoWay(f"excitation: on the way from the present posture {proof.what} come too near at {proof.at:.2f} s; start elsewhere.")
    return motion


def require_clear(posture: Array, what: str, clearance: Clearance, margin: float, remedy: str) -> None:
    """Raise NoWay, saying what is how near, where a posture (n,) does not keep what is required and a share of the search's margin."""
    slack = clearance.slack(posture[None], 0.05)[0] - margin * clearance.margin
    if slack.min(initial=1.0) >= 0.0:
        return
    worst = int(slack.argmin())
    near = 1000.0 * float(clearance.distances(posture[None])[0, worst])
    apart = f"are {near:.1f} mm apart" if near > 0.0 else f"overlap by {-near:.1f} mm"
    wanted = 1000.0 * (clearance.required + margin * clearance.margin)[worst]
    raise NoWay(f"excitation: in {what} {clearance.constraints[worst].what} {apart}; {wanted:.1f} mm are needed. {remedy}")


def _part(start: Array, end: Array, limits: Limits, information: MotionInformation) -> Trajectory:
    """One straight line, as slow as its limits ask for."""
    way = np.abs(end - start)
    seconds = _SHORTEST
    for order, (peak, limit) in enumerate(zip(_PEAKS, (limits.velocity, limits.acceleration, limits.jerk), strict=True), 1):
        seconds = max(seconds, float(((peak * way / (SLOW * limit)) ** (1.0 / order)).max()))
    if information.values is None or not np.isfinite(limits.torque).any():
        return PointToPoint(start, end, seconds)
    share = np.ones(1)
    for _ in range(12):
        part = PointToPoint(start, end, seconds)
        t = np.linspace(0.0, seconds, max(200, int(1000 * seconds)))
        share = np.abs(information.torque(t, part.sample(t)) / limits.torque) * (1.0 + 1e-6)
        if share.max() <= 1.0:
            return part
        seconds *= 1.3
    worst = int(share.max(axis=0).argmax())
    raise NoWay(
        f"excitation: on the way from the present posture joint {information.model.robot.joint_names[worst]} would need"
        f" {100 * share.max():.0f} % of its torque limit however slowly it goes; start elsewhere, or raise the limit."
    )


def _way(start: Array, end: Array, space: _Space, rng: np.random.Generator) -> list[Array]:
    """Corners of a free way: the straight line, or what two trees of random postures that grow towards each other find (RRT-Connect,
    Kuffner & LaValle 2000), shortened."""
    if space.free(start, end):
        return [start, end]
    low, high = np.minimum(space.limits.lower, start), np.maximum(space.limits.upper, start)
    trees = [([start], [-1]), ([end], [-1])]
    for count in range(_NODES):
        here, there = trees[count % 2], trees[1 - count % 2]
        goal = there[0][0] if rng.random() < _GOAL else rng.uniform(low, high)
        new = _grow(here, goal, high - low, space)
        if new is None:
            continue
        reached: Array | None = new
        while reached is not None:
            reached = _grow(there, new, high - low, space)
            if reached is not None and np.array_equal(reached, new):
                parts = [_back(here), _back(there)]
                first, second = parts if count % 2 == 0 else parts[::-1]
                return _shortened([*first[::-1], *second[1:]], space, rng)
    raise NoWay(
        f"excitation: {_NODES} tries found no way from the present posture to the start of the motion; on the straight line"
        f" {space.blocking(start, end)}. Start nearer (--start-posture), or allow more room."
    )


def _grow(tree: tuple[list[Array], list[int]], goal: Array, whole: Array, space: _Space) -> Array | None:
    """The tree's nearest posture moved towards a goal by one step, if that is free."""
    nodes, parents = tree
    away = np.abs((np.array(nodes) - goal) / whole).max(axis=1)
    nearest = int(away.argmin())
    share = min(1.0, _GROW / max(float(away[nearest]), 1e-12))
    new = goal if share == 1.0 else nodes[nearest] + share * (goal - nodes[nearest])
    if not space.free(nodes[nearest], new):
        return None
    nodes.append(new)
    parents.append(nearest)
    return new


def _back(tree: tuple[list[Array], list[int]]) -> list[Array]:
    """From the last posture of a tree back to its root."""
    nodes, parents = tree
    out, at = [], len(nodes) - 1
    while at >= 0:
        out.append(nodes[at])
        at = parents[at]
    return out


def _line(start: Array, end: Array) -> Array:
    count = max(2, int(np.ceil(np.abs(end - start).max() / _STEP)) + 1)
    return start + np.linspace(0.0, 1.0, count)[:, None] * (end - start)


def _shortened(corners: list[Array], space: _Space, rng: np.random.Generator) -> list[Array]:
    """The corners less those that a free straight line passes by."""
    for _ in range(_SHORTCUTS):
        if len(corners) < 3:
            break
        i, j = sorted(rng.choice(len(corners), 2, replace=False).tolist())
        if j - i > 1 and space.free(corners[i], corners[j]):
            corners = [*corners[: i + 1], *corners[j:]]
    return corners
