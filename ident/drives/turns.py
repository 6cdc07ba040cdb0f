"""Angles of joints and their commands on one turn: drives count on, and logs may begin again after a full turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..logs.unwrap import unwrapped

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
_TURN = 2.0 * np.pi
#: Share of a turn by which noise may leave it.
_SLACK = 0.01
#: Share of its error within which a joint follows commands that were put on its turn, where its positions do not say that they wrap.
_NEARER = 0.5


def joined_turns(positions: Array, robot: Robot) -> tuple[Array, list[str]]:
    """Positions (N, n) without jumps of a full turn, and a note of the joints that had some."""
    turning = [j for j, joint in enumerate(robot.joints) if not joint.prismatic]
    out = positions.copy()
    good = np.isfinite(positions).all(axis=1)
    out[np.ix_(good, turning)] = unwrapped(positions[np.ix_(good, turning)])
    moved = [robot.joint_names[j] for j in turning if not np.array_equal(out[good, j], positions[good, j])]
    return (out, [f"positions of {', '.join(moved)} jump by a full turn; they are taken as continuous."]) if moved else (positions, [])


def of_the_same_turn(commands: Array, positions: Array, robot: Robot, logged: Array | None = None) -> Array:
    """Commands (N, n) on the turns of the positions (N, n): without jumps of a full turn, where joints that go on follow them then.

    `logged` (N, n): the positions before jumps of a full turn were taken out of them, by default without such jumps."""
    out = commands.copy()
    for j, joint in enumerate(robot.joints):
        if joint.prismatic:
            continue
        sent, q = commands[:, j], positions[:, j]
        options = [sent, unwrapped(commands[:, [j]])[:, 0]]
        best = min(options, key=lambda option: float(np.std(option - q)))
        best = best - _TURN * np.round(np.median(best - q) / _TURN)
        near = sent - _TURN * np.round((sent - q) / _TURN)
        wraps = logged is not None and _on_its_turn(sent, logged[:, j], q)
        out[:, j] = near if wraps or (_only_jumps_part(best, q) and np.std(near - q) < _NEARER * np.std(best - q)) else best
    return out


def _on_its_turn(sent: Array, logged: Array, joined: Array) -> bool:
    """Whether a joint's positions begin again after a full turn and its commands (N,) lie within the same turn as these."""
    both = max(sent.max(), logged.max()) - min(sent.min(), logged.min())
    return bool(np.any(logged != joined) and both <= _TURN * (1.0 + _SLACK))


def _only_jumps_part(sent: Array, q: Array) -> bool:
    """Whether commands (N,) of one turn are more than half a turn from the joint wherever jumps of theirs begin and end that, and nowhere
    else: a joint that is really sent so far goes there by itself."""
    far = np.abs(sent - q) > 0.5 * _TURN
    turned = np.flatnonzero(np.diff(far.astype(int)))
    jumps = np.abs(np.diff(sent)) > 0.5 * _TURN
    return len(turned) > 1 and bool(np.ptp(sent) <= _TURN * (1.0 + _SLACK) and jumps[turned].all())
