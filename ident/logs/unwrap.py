"""Angles that jump by a full turn: joined, and what that leaves open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


def unwrapped(positions: Array) -> Array:
    """Angles (N, n) without jumps of a full turn; columns that do not jump are left as they are."""
    columns = wrapping(positions)
    if not columns:
        return positions
    out = positions.copy()
    out[:, columns] = np.unwrap(positions[:, columns], axis=0)
    return out


def within_limits(positions: Array, robot: Robot) -> tuple[Array, list[str]]:
    """Angles (N, n) moved by whole turns into their joints' limits, where they lie outside as a whole and fit inside; names of those."""
    out, moved = positions, list[str]()
    for j, joint in enumerate(robot.joints):
        if joint.prismatic or not np.isfinite(joint.lower + joint.upper) or not np.isfinite(positions[:, j]).any():
            continue
        low, high = float(np.nanmin(positions[:, j])), float(np.nanmax(positions[:, j]))
        turns = round(((joint.lower + joint.upper) - (low + high)) / (4.0 * np.pi))
        shift = 2.0 * np.pi * turns
        margin = 0.02 * (joint.upper - joint.lower)
        if turns and joint.lower - margin <= low + shift and high + shift <= joint.upper + margin:
            out = out.copy() if out is positions else out
            out[:, j] += shift
            moved.append(joint.name)
    return out, moved


def from_one_turn(positions: Array) -> tuple[Array, bool]:
    """Angles (N, n) logged within one turn from zero, joined over full turns and begun within half a turn of zero; whether they were.

    Only where one of them jumps by a turn is that the way they were logged; those that do not jump were then logged so too."""
    finite = positions[np.isfinite(positions)]
    if not finite.size or finite.min() < -1e-3 or finite.max() > 2 * np.pi + 1e-3 or not wrapping(positions):
        return positions, False
    out = unwrapped(positions)
    first = np.array([column[np.isfinite(column)][0] if np.isfinite(column).any() else 0.0 for column in out.T])
    return out - 2 * np.pi * np.round(first / (2 * np.pi)), True


def wrapping(positions: Array) -> list[int]:
    """Columns of angles (N, n) that jump by a full turn."""
    step = np.diff(positions, axis=0)
    wraps = np.abs(step) > np.pi
    columns = []
    for j in np.flatnonzero(wraps.any(axis=0)):
        # A wrapped angle stays within one turn, and all its jumps are a turn but for what is moved within one sample.
        usual = _largest(step[~wraps[:, j], j])
        whole = np.abs(np.abs(step[wraps[:, j], j]) - 2 * np.pi) <= max(0.3, 1.5 * usual)
        if usual < 2.5 and np.ptp(positions[:, j]) <= 2 * np.pi * 1.001 and whole.all():
            columns.append(int(j))
    return columns


def _largest(x: Array) -> float:
    finite = x[np.isfinite(x)]
    return float(np.abs(finite).max()) if finite.size else 0.0


def motor_turn_notes(name: str, robot: Robot, wrapping: Sequence[int]) -> list[str]:
    """What to say of a log without joint positions, of which some motors' (columns `wrapping`) jump by a full turn."""
    if not len(wrapping):
        return []
    turns = 2.0 * np.pi * np.abs(robot.transmission.K[:, wrapping]).max(axis=1)
    where = ", ".join(
        f"{joint.name} ({turn:.3g} {'m' if joint.prismatic else 'rad'} a turn)"
        for joint, turn in zip(robot.joints, turns, strict=True)
        if turn
    )
    motors = ", ".join(robot.joint_names[k] for k in wrapping)
    said = (
        f"log {name}: the motor positions of {motors} jump by a full turn; they are taken as continuous from the first sample on."
        f" The turn at the start is not known: the zero of {where} may be off by whole turns, and with it the direction of gravity."
        " Log joint positions, or give [drive] zero."
    )
    return [said]
