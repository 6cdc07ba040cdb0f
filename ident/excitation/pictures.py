"""What an excitation shows: positions and speeds over time, between their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..drawing.document import BlockKind, Figure, Layer, Panel, Role
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from ..simulation.trajectory import Trajectory
    from .limits import Limits

Array = np.ndarray
_POINTS = 800


def excitation_figure(robot: Robot, trajectory: Trajectory, limits: Limits) -> Figure:
    """For each joint position and speed, and the limits that the design was given."""
    t = np.linspace(0.0, trajectory.duration, _POINTS)
    motion, ends = trajectory.sample(t), (0.0, trajectory.duration)
    panels = []
    for j, name in enumerate(robot.joint_names):
        label, unit = "time (s)" if j == robot.n - 1 else "", robot.position_unit(j, Side.JOINT)
        for what, values, low, high in (
            (f"position ({unit})", motion.q[:, j], limits.lower[j], limits.upper[j]),
            (f"speed ({unit}/s)", motion.dq[:, j], -limits.velocity[j], limits.velocity[j]),
        ):
            layers = (
                Layer.of(BlockKind.LINE, Role.FLOOR, (*ends, np.nan, *ends), (low, low, np.nan, high, high), label="limits"),
                Layer.of(BlockKind.LINE, Role.AFTER, t, values, label="designed"),
            )
            panels.append(Panel(name, label, what, layers))
    return Figure("excitation", "Designed motion", "Each joint between the limits that the design was given.", tuple(panels), columns=2)
