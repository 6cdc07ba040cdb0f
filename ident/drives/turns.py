"""Angles of joints and their commands on one turn: drives count on, and logs may begin again after a full turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..logs.unwrap import unwrapped

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
_TURN = 2.0 * np.pi


def joined_turns(positions: Array, robot: Robot) -> tuple[Array, list[str]]:
    """Positions (N, n) without jumps of a full turn, and a note of the joints that had some."""
    turning = [j for j, joint in enumerate(robot.joints) if not joint.prismatic]
    out = positions.copy()
    good = np.isfinite(positions).all(axis=1)
    out[np.ix_(good, turning)] = unwrapped(positions[np.ix_(good, turning)])
    moved = [robot.joint_names[j] for j in turning if not np.array_equal(out[good, j], positions[good, j])]
    return (out, [f"positions of {', '.join(moved)} jump by a full turn; they are taken as continuous."]) if moved else (positions, [])


def of_the_same_turn(commands: Array, positions: Array, robot: Robot) -> Array:
    """Commands (N, n) on the turns of the positions (N, n): without jumps of a full turn, where joints that go on follow them then."""
    out = commands.copy()
    for j, joint in enumerate(robot.joints):
        if joint.prismatic:
            continue
        options = [commands[:, [j]], unwrapped(commands[:, [j]])]
        best = min(options, key=lambda option: float(np.std(option[:, 0] - positions[:, j])))[:, 0]
        out[:, j] = best - _TURN * np.round(np.median(best - positions[:, j]) / _TURN)
    return out
