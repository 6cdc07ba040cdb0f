"""What a simulated run exceeds of its robot's own limits: a drive of the plant knows none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .result import Simulation

Array = np.ndarray
#: Excess that rounding may make (relative).
_ROUNDING = 1e-9


@dataclass(frozen=True)
class ExceededLimit:
    """A limit in the robot's description that a run exceeds: `kind` is position, speed or effort; `largest` and `limit` in `unit`."""

    joint: str
    kind: str
    largest: float
    limit: float
    unit: str


def exceeded_limits(run: Simulation) -> tuple[ExceededLimit, ...]:
    """The limits of range, speed and effort that the true motion and the drives' torque exceed, joint side, joint by joint.

    Examples
    --------
    >>> import ident
    >>> from ident.robots import nominal_values
    >>> from ident.simulation import Plant, exceeded_limits
    >>> model = ident.load_robot("scara").rigid_body()
    >>> run = ident.simulate(Plant(model, nominal_values(model)), torque=[[0.0] * 4] * 51, start=([0.0] * 4, [0.0] * 4), rate=100)
    >>> [e.kind for e in exceeded_limits(run)]
    []
    """
    robot = run.robot
    torque = robot.transmission.torque(run.tau, robot.transmission.measured, Side.JOINT)
    out = []
    for j, joint in enumerate(robot.joints):
        unit = robot.position_unit(j, Side.JOINT)
        low, high = float(run.q[:, j].min()), float(run.q[:, j].max())
        if joint.lower < joint.upper:
            slack = _ROUNDING * (1.0 + abs(joint.lower) + abs(joint.upper))
            out += [ExceededLimit(joint.name, "position", high, joint.upper, unit)] if high > joint.upper + slack else []
            out += [ExceededLimit(joint.name, "position", low, joint.lower, unit)] if low < joint.lower - slack else []
        efforts = (("speed", run.dq, joint.velocity, f"{unit}/s"), ("effort", torque, joint.effort, "N" if joint.prismatic else "N m"))
        for kind, values, limit, own in efforts:
            largest = float(np.abs(values[:, j]).max())
            if 0 < limit < np.inf and largest > limit * (1.0 + _ROUNDING):
                out.append(ExceededLimit(joint.name, kind, largest, limit, own))
    return tuple(out)


def exceeded_lines(found: tuple[ExceededLimit, ...], robot: Robot) -> list[str]:
    """The same for people: one line for each kind of limit, the worst joint of it."""
    lines = []
    for kind in ("position", "speed", "effort"):
        own = [e for e in found if e.kind == kind]
        if not own:
            continue
        worst = max(own, key=lambda e: abs(e.largest - e.limit) if kind == "position" else e.largest / e.limit)
        joints = list(dict.fromkeys(e.joint for e in own))
        who = joints[0] if len(joints) == 1 else f"{len(joints)} of {robot.n} joints, most of all {worst.joint}"
        lines.append(f"exceeds the {kind} limits of {robot.name}: {who} ({worst.largest:.4g} of {worst.limit:.4g} {worst.unit})")
    return lines
