"""Positions on disk without jumps of a full turn, and carried from the motors to the joints; as `ident.logs.log.unwrapped` does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from ..logs.unwrap import motor_turn_notes, within_limits
from ..robots.robot import Robot
from .disk import DiskArray, DiskWriter
from .stored import StoredLog

Array = np.ndarray


def joined_positions(log: StoredLog, robot: Robot, path: Path) -> StoredLog:
    """A run of which only motor positions were logged, with joint positions beside them."""
    drive = robot.transmission
    wrapping = np.flatnonzero(log.survey(drive).wrapped)
    joined = unwrapped(log.arrays["q_motor"], wrapping, path.with_suffix(".motor"))
    writer = DiskWriter(path.with_suffix(".f64"), log.n)
    for piece in joined.pieces():
        writer.append(drive.joint_position(piece))
    notes = (*log.notes, *motor_turn_notes(log.name, robot, wrapping.tolist()))
    return replace(log, arrays={**log.arrays, "q": writer.close()}, blocks=(), notes=notes)


def moved_into_limits(log: StoredLog, robot: Robot, path: Path) -> StoredLog:
    """A run whose joint positions lie within the joints' limits, where whole turns are all that keeps them out, as `read_logs` does."""
    if log.n != robot.n:
        return log
    found = unwrapped(log.arrays["q"], np.flatnonzero(log.survey(robot.transmission).wrapped), path.with_suffix(".joined"))
    bounds = np.array([[np.inf] * log.n, [-np.inf] * log.n])
    for piece in found.pieces():
        bounds = np.stack([np.fmin(bounds[0], np.fmin.reduce(piece)), np.fmax(bounds[1], np.fmax.reduce(piece))])
    inside, moved = within_limits(bounds, robot)
    if not moved:
        return log
    writer = DiskWriter(path.with_suffix(".f64"), log.n)
    for piece in found.pieces():
        writer.append(piece + (inside - bounds)[0])
    said = f"log {log.name}: positions of {', '.join(moved)} are unwrapped, and shifted by full turns into the joint limits."
    return replace(log, arrays={**log.arrays, "q": writer.close()}, blocks=(), notes=(*log.notes, said))


def unwrapped(positions: DiskArray, columns: Array, path: Path) -> DiskArray:
    """Positions (N, n) whose `columns` count on through full turns, in a file of their own; the same array where there are none."""
    if not len(columns):
        return positions
    writer = DiskWriter(path, positions.width)
    last: Array | None = None
    turns = np.zeros(len(columns))
    for piece in positions.pieces():
        raw = piece[:, columns]
        step = np.diff(raw, axis=0, prepend=raw[:1] if last is None else last)
        back = np.where(np.abs(step) > np.pi, -np.round(step / (2 * np.pi)), 0.0)
        counted = turns + np.cumsum(back, axis=0)
        piece[:, columns] = raw + 2 * np.pi * counted
        turns, last = counted[-1], raw[-1:]
        writer.append(piece)
    return writer.close()
