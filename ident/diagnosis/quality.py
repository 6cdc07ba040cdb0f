"""What no score sees, but anyone who looks: positions that jump, joints of which no row can be used."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..auditing.columns import position_jumps, positions
from ..logs.unwrap import unwrapped
from .result import Unexplained

if TYPE_CHECKING:
    from ..signals.signals import Signals

#: A joint of fewer usable rows than this share is lost, if it moved for so much of the time, by more than so many deviations of its
#: position's noise.
_LOST = 0.02
_MOVING = 0.2
_SPAN = 1e3


def jumps(signals: Signals) -> tuple[Unexplained, ...]:
    """Joints whose recorded position jumps (an encoder that slips, a wrong sample): what is around a jump is lost to any fit."""
    found: dict[str, Unexplained] = {}
    for log in () if signals.source is None else signals.source:
        q = positions(log, signals.robot)
        for j, joint in enumerate(signals.robot.joint_names):
            x = q[:, j] if signals.robot.joints[j].prismatic else unwrapped(q[:, j : j + 1])[:, 0]
            here = [at for at in log.t[position_jumps(log.t, x)] if _rests_on(signals, float(at))]
            if here and joint not in found:
                said = (
                    f"{joint}: its position jumps at {here[0]:.12g} s (log {log.name}), faster than any motion: a wrong sample, or, if the"
                    " offset stays, an encoder or a coupling that slipped. Cut it out: a fit across it is meaningless"
                )
                found[joint] = Unexplained(joint, "a jump of its position", said, 0.0)
    return tuple(found.values())


def _rests_on(signals: Signals, at: float) -> bool:
    """Whether rows lie on both sides of a moment; at the ends of a log the filters leave it out."""
    times = (signals.row_time[rows] for rows in signals.row_runs)
    return any(len(t) and t[0] < at < t[-1] for t in times)


def lost(signals: Signals) -> tuple[Unexplained, ...]:
    """Joints that move, but so restlessly (knocks, shaking, jumps) that next to none of their rows can be used."""
    robot, found = signals.robot, []
    rows = signals.valid.sum(axis=0)
    for j, (joint, report) in enumerate(zip(robot.joint_names, signals.report.joints, strict=True)):
        if rows[j] > _LOST * len(signals.valid) or not np.isfinite(signals.tau[:, j]).any():
            continue
        speed = np.abs(signals.dq[:, j])
        moving = float(np.mean(speed > 0.05 * np.quantile(speed, 0.95))) if len(speed) else 0.0
        if moving > _MOVING and float(np.ptp(signals.q[:, j])) > _SPAN * max(report.noise, 1e-12):
            said = (
                f"{joint}: it moves, but only {rows[j]} of {len(signals.valid)} rows can be used, because its direction of motion"
                " is uncertain (it vibrates, jumps or takes impacts). This joint is not diagnosed"
            )
            found.append(Unexplained(joint, "excluded rows", said, 0.0))
    return tuple(found)
