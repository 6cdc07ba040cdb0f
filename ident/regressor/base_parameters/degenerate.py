"""Geometry that is almost, but not quite, degenerate: parameters that exist on paper and that no torque measurement shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ...robots.robot import Robot

Array = np.ndarray

#: rad; axes nearer than this to parallel or perpendicular, but not so, are reported.
_ANGLE = 1e-2
#: Below this an angle is rounding (products of exact rotations).
_ROUNDING = 1e-12
#: Directions that show less than this share of a unit motion are reported.
_STRENGTH = 1e-4


def near_degenerate(robot: Robot, strength: Array) -> tuple[str, ...]:
    """Notes on axes within 1e-2 rad of parallel or perpendicular, gravity included, and on base parameters hardly to be seen.

    `strength`: how strongly each identifiable direction shows, 1 being fully (see `structural.StructuralSet`)."""
    tree, first = robot.tree, int(robot.floating_base)
    notes = []
    for body in range(first, tree.nb):
        before = int(tree.parent[body])
        axis = tree.rotation[body] @ tree.axis[body]
        name = robot.tree_joints[body - first].name
        if before >= first:
            notes += _angle_note(name, axis, tree.axis[before], f"the axis of {robot.tree_joints[before - first].name}")
        elif before < 0 and tree.gravity.any():
            notes += _angle_note(name, axis, tree.gravity / np.linalg.norm(tree.gravity), "gravity")
    faint = strength[strength < _STRENGTH]
    if len(faint):
        notes.append(
            f"nearly degenerate geometry: {len(faint)} of the base parameters show only {faint.min():.1e} to {faint.max():.1e} of a unit"
            " motion; they count, but no real log will determine them. If an angle or offset is meant to be exact, write it so."
        )
    return tuple(notes)


def _angle_note(name: str, axis: Array, other: Array, what: str) -> list[str]:
    sine, cosine = float(np.linalg.norm(np.cross(axis, other))), abs(float(axis @ other))
    for deviation, relation in ((np.arctan2(sine, cosine), "parallel"), (np.arctan2(cosine, sine), "perpendicular")):
        if _ROUNDING < deviation < _ANGLE:
            fact = f"joint {name}: its axis is {deviation:.1e} rad away from {relation} to {what}. It is taken as it is written,"
            return [f"{fact} and parameters appear that exact geometry does not have; write the angle exactly if it is meant so."]
    return []
