"""What the audit of a log finds in its clock and its positions, where nothing of a torque can be looked at."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..auditing.columns import check_columns
from ..errors import DataError
from ..signals.resample import slow_clock

if TYPE_CHECKING:
    from ..logs.log import Log
    from ..robots.robot import Robot
    from .commands import DriveLog

#: Findings about positions that make a fit under a drive law another one than it seems.
_TOLD = ("constant", "unit", "spike", "outside_limits")


def require_clock(log: DriveLog) -> None:
    """Raise DataError where stamps are so far apart that they are in another unit: a simulation would have no end."""
    if why := slow_clock(log.period):
        raise DataError(f"log {log.name}: {why}")


def told_of_positions(log: Log, robot: Robot) -> tuple[str, ...]:
    """One line of each finding in a log's positions that a drive's fit is misled by."""
    found = [one for one in check_columns(log, robot) if one.code in _TOLD and one.where in robot.joint_names]
    return tuple(f"log {log.name}, {one.where}: {one.text}" for one in found)
