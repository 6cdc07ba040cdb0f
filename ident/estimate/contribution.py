"""An effect within an estimate: the torque that it makes, and the quantity against which it shows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Effect
from ..effects.kinds import Axis, Need
from ..problem.problem import Problem
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..signals.signals import Signals
    from .record import EstimateRecord

Array = np.ndarray


def contribution(estimate: EstimateRecord, effect: Effect, signals: Signals) -> Array:
    """Torque (M, n) of one of an estimate's effects at the rows of signals, on the measured side, filtered like the rows."""
    model, robot = estimate.model, estimate.model.robot
    part = next(s for e, s in zip(model.effects, model.slices, strict=True) if e is effect)
    problem = Problem(model, signals, reference=estimate.all_values)
    out = np.zeros_like(signals.tau)
    for block in signals.blocks(None):
        motion = problem.motion(block.samples, frozenset({Need.LOAD, Need.REFERENCE}))
        own = effect.torque(motion, robot, estimate.all_values[part])
        out[block.rows] = block.reduce(robot.transmission.torque(own, effect.side, robot.transmission.measured))
    return out


def revealing(estimate: EstimateRecord, effect: Effect, joint: int, signals: Signals) -> tuple[str, Array]:
    """The quantity (M,) at the rows against which an effect on `joint` shows, and its name with unit."""
    robot, side = estimate.model.robot, effect.side
    where = robot.joint_names[joint]
    q_unit = robot.position_unit(joint, side)
    on = f"{'motor of ' if side == Side.MOTOR and not robot.is_direct(joint) else ''}{where}"
    order = next((float(getattr(effect, p.name)) for p in effect.shape() if p.name == "order"), None)
    if order is not None:
        angle = Side(getattr(effect, "angle", side))
        q = signals.q if angle == Side.JOINT else robot.transmission.motor_position(signals.q)
        return f"phase at order {order:.4g} of {where} (rad)", np.mod(order * q[:, joint], 2 * np.pi)[signals.centres]
    match effect.axis:
        case Axis.VELOCITY | Axis.ACCELERATION | Axis.POSITION | Axis.MOTOR_ANGLE:
            side = Side.MOTOR if effect.axis == Axis.MOTOR_ANGLE else side
            name, unit, values = {
                Axis.VELOCITY: ("speed", f"{q_unit}/s", signals.dq),
                Axis.ACCELERATION: ("acceleration", f"{q_unit}/s^2", signals.ddq),
            }.get(effect.axis, ("position", q_unit, signals.q))
            carried = robot.transmission.motor_position if name == "position" else robot.transmission.motor_rate
            return f"{name} of {on} ({unit})", (values if side == Side.JOINT else carried(values))[:, joint][signals.centres]
        case Axis.TIME:
            clock = np.concatenate([signals.t[run] - origin for run, origin in zip(signals.runs, signals.origins, strict=True)])
            return "time since the run began (s)", clock[signals.centres]
        case Axis.TORQUE:
            return f"measured torque of {where} ({robot.force_unit(joint, robot.transmission.measured)})", signals.tau[:, joint]
        case _:
            load = _load(estimate, signals)
            return f"predicted load of {where} ({robot.force_unit(joint, Side.JOINT)})", load[:, joint]


def _load(estimate: EstimateRecord, signals: Signals) -> Array:
    problem = Problem(estimate.model, signals, reference=estimate.all_values)
    out = np.zeros_like(signals.tau)
    for block in signals.blocks(None):
        motion = problem.motion(block.samples, frozenset({Need.LOAD}))
        out[block.rows] = block.reduce(motion.needed_load("the report", Side.JOINT))
    return out
