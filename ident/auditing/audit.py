"""The audit: one pass over every log, and what it finds."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..robots.robot import require_robot
from .columns import check_columns
from .findings import Audit, AuditFinding, Severity, merged_findings
from .motion import check_motion
from .time import check_time

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from ..robots.robot import Robot


def audit(logs: LogSet, robot: Robot | None = None) -> Audit:
    """Audit logs: what in them would harm an estimate, what it means, and what to do about it.

    Parameters
    ----------
    logs : LogSet
        Runs as recorded. The same finding in several runs is told once, for the run where it is worst.
    robot : Robot, optional
        With it, units are checked against joint limits and torque against motion; without, what the columns tell.

    Returns
    -------
    Audit
        Findings, errors first; `ok` where none is an error. It prints as a table.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> ident.audit(train, ident.load_robot("puma560")).ok
    True
    """
    require_robot(robot)
    robot = robot or logs.robot
    if robot is not None:
        logs = logs.with_robot(robot)
    found: list[AuditFinding] = []
    for log in logs:
        in_time = check_time(log)
        found += in_time
        if any(f.severity == Severity.ERROR for f in in_time):
            continue
        in_columns = check_columns(log, robot)
        found += in_columns
        if not any(f.code == "position_missing" for f in in_columns):
            found += check_motion(log, robot)
    return Audit(tuple(merged_findings(found, len(logs))), logs.names, robot.name if robot else "")
