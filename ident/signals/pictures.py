"""What signals show: a table of the rows, and motion and torque over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._utils.text import counted
from ..drawing.document import BlockKind, Figure, Layer, Panel, Role
from ..robots.transmission import Side
from .timeline import Timeline

if TYPE_CHECKING:
    import pandas as pd

    from ..robots.robot import Robot

Array = np.ndarray


def signals_frame(robot: Robot, t: Array, runs: Sequence[str], values: Mapping[str, Array]) -> pd.DataFrame:
    """One row for each row of the regression equation; columns `<joint>.position` and so on from `values`, (M, n) each."""
    import pandas as pd

    table: dict[str, Array] = {"run": np.array(runs, object), "t": t}
    for key, array in values.items():
        table |= {f"{name}.{key}": array[:, j] for j, name in enumerate(robot.joint_names)}
    return pd.DataFrame(table)


def signals_figure(robot: Robot, line: Timeline, dq: Array, tau: Array, valid: Array, rate: float) -> Figure:
    """For each joint its speed, and beside it its torque in the rows that are used and in those that are not; (M, n) each."""
    side = robot.transmission.measured
    panels = []
    for j, name in enumerate(robot.joint_names):
        label = "time, runs one after the other (s)" if j == robot.n - 1 else ""
        used, left = np.where(valid[:, j], tau[:, j], np.nan), np.where(valid[:, j], np.nan, tau[:, j])
        speed = Layer.of(BlockKind.BAND, Role.EFFECT, *line.envelope(dq[:, j]))
        torque = (
            Layer.of(BlockKind.BAND, Role.BEFORE, *line.envelope(left), label="not used"),
            Layer.of(BlockKind.BAND, Role.AFTER, *line.envelope(used), label="used"),
        )
        panels.append(Panel(name, label, f"speed ({robot.position_unit(j, Side.JOINT)}/s)", (speed,)))
        panels.append(Panel(name, label, f"torque ({robot.force_unit(j, side)})", torque))
    caption = f"{counted(len(tau), 'row')} a joint at {rate:.4g} Hz; torque on the {side.value} side."
    return Figure("signals", "Prepared signals", caption, tuple(panels), columns=2)
