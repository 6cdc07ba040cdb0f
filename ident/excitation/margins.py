"""What a motion leaves of a robot's own limits, joint by joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.document import Table, percent, plain
from ..robots.transmission import Side
from ..statistics.torque_error import number

if TYPE_CHECKING:
    from ..effects.motion import Coordinates
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class Margin:
    """What one joint leaves of the limits in its robot's description: the least distance to an end of its range (rad, m; inf: no end), and
    the largest shares of speed and effort limits (NaN: no limit, or no parameter values to predict torque with); of what no URDF limits,
    the largest `acceleration` (rad/s^2, m/s^2) and `jerk` (rad/s^3, m/s^3)."""

    joint: str
    unit: str
    to_end: float
    speed: float
    effort: float
    acceleration: float
    jerk: float

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        shares = {"share_of_speed": number(self.speed), "share_of_effort": number(self.effort)}
        largest = {"largest_acceleration": self.acceleration, "largest_jerk": self.jerk}
        return {"joint": self.joint, "unit": self.unit, "to_end": number(self.to_end), **shares, **largest}


def margins_of(robot: Robot, joint: Coordinates, jerk: Array, torque: Array | None) -> tuple[Margin, ...]:
    """Margins of a motion with its largest jerk (n,), and with joint-side torque (N, n) where that is known."""
    out = []
    for j, own in enumerate(robot.joints):
        to_end = min(float(np.min(joint.q[:, j])) - own.lower, own.upper - float(np.max(joint.q[:, j])))
        speed = float(np.abs(joint.dq[:, j]).max()) / own.velocity if 0 < own.velocity < np.inf else np.nan
        known = torque is not None and 0 < own.effort < np.inf
        effort = float(np.abs(torque[:, j]).max()) / own.effort if known and torque is not None else np.nan
        bend = float(np.abs(joint.ddq[:, j]).max())
        out.append(Margin(own.name, robot.position_unit(j, Side.JOINT), to_end, speed, effort, bend, float(jerk[j])))
    return tuple(out)


def margins_section(margins: tuple[Margin, ...]) -> Table:
    """The same for a report."""
    rows = tuple(
        (m.joint, plain(m.to_end), m.unit, percent(m.speed), percent(m.effort), plain(m.acceleration), plain(m.jerk)) for m in margins
    )
    head = ("joint", "to end of range", "unit", "speed, %", "effort, %", "largest acceleration", "largest jerk")
    return Table("Margins against the robot's own limits", head, rows, note="Acceleration and jerk per s^2 and s^3; no URDF limits them.")


def margin_lines(margins: tuple[Margin, ...]) -> list[str]:
    """A table for people."""
    width = max((len(m.joint) for m in margins), default=5)

    def share(x: float) -> str:
        return f"{100 * x:.1f} %" if np.isfinite(x) else "no limit"

    head = f"  {'joint':<{width}}  {'to end of range':>16} {'speed':>10} {'effort':>10} {'acceleration':>14} {'jerk':>12}"
    lines = ["margins against the limits of the robot's own description:", head]
    for m in margins:
        end = f"{m.to_end:.3f} {m.unit}" if np.isfinite(m.to_end) else "no end"
        largest = f"{f'{m.acceleration:.3g} {m.unit}/s²':>14} {f'{m.jerk:.3g} {m.unit}/s³':>12}"
        lines.append(f"  {m.joint:<{width}}  {end:>16} {share(m.speed):>10} {share(m.effort):>10} {largest}")
    return lines
