"""Audit of a run's columns: what is missing, constant, in the wrong unit, coarse or at its limit."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .._utils.text import counted
from ..errors import IdentError
from ..logs.log import Log
from ..logs.torque import measured
from ..logs.unwrap import unwrapped
from ..robots.robot import Robot
from .findings import AuditFinding, Severity
from .jumps import find_jumps
from .torque import check_saturation, check_torque, grid_step

Array = np.ndarray
Add = Callable[..., None]
_DEG = math.pi / 180
#: A revolute joint seldom turns further than this (rad) from zero, nor does a slide go further (m).
_FAR_ANGLE, _FAR_LENGTH = 3 * math.pi, 20.0
_FAST = 60.0
#: Percentiles of positions between which nearly all of them lie.
_NEARLY_ALL = (0.5, 99.5)


def joint_names(log: Log, robot: Robot | None) -> tuple[str, ...]:
    """Names for messages: the robot's, or q1, q2 …"""
    return robot.joint_names if robot else tuple(f"q{j + 1}" for j in range(log.n))


def positions(log: Log, robot: Robot | None) -> Array:
    """Joint positions where they are known; the motors' otherwise."""
    if log.q is not None:
        return log.q
    if robot is not None:
        return log.position(robot.transmission)
    assert log.q_motor is not None
    return log.q_motor


def torque_of(log: Log, robot: Robot | None) -> tuple[Array | None, str]:
    """Torque on the measured side (or as logged, without a robot), and why there is none."""
    if robot is None:
        asked = f"; {log.hint}" if log.hint else "."
        return (next(iter(log.tau.values())), "") if log.tau else (None, f"the log holds no torque or current column{asked}")
    try:
        return measured(log, robot.transmission).torque, ""
    except IdentError as error:
        return None, str(error)


def check_columns(log: Log, robot: Robot | None) -> list[AuditFinding]:
    """Missing and constant columns, NaN, units, wraps, limits, resolution, saturation."""
    out: list[AuditFinding] = []

    def add(code: str, severity: Severity, text: str, where: str = "", value: float = float("nan")) -> None:
        out.append(AuditFinding(code, severity, text, where, log.name, value))

    names = joint_names(log, robot)
    q = positions(log, robot)
    for j, name in enumerate(names):
        if not np.isfinite(q[:, j]).all():
            bad = int((~np.isfinite(q[:, j])).sum())
            add(
                "position_missing",
                Severity.ERROR,
                f"{counted(bad, 'position', 'are')} not a number. Read the log with read_logs, which removes them.",
                name,
                bad,
            )
            return out
    for j, name in enumerate(names):
        _position(add, log, robot, j, name, q[:, j])
    torque, why = torque_of(log, robot)
    if torque is None:
        add("torque_missing", Severity.ERROR, f"No torque: {why} Nothing can be fitted to this run; it can still be used for replay.")
        return out
    for j, name in enumerate(names):
        check_torque(add, robot, j, name, log.t, torque[:, j], q[:, j])
    check_saturation(add, names, torque, q)
    return out


def _position(add: Add, log: Log, robot: Robot | None, j: int, name: str, x: Array) -> None:
    span = float(np.ptp(x))
    if span == 0:
        add(
            "constant",
            Severity.WARNING,
            "Its position never changes: friction and inertia of this joint cannot be estimated from this run.",
            name,
        )
        return
    prismatic = robot.joints[j].prismatic if robot else False
    joined = unwrapped(x[:, None])[:, 0] if not prismatic else x
    if not np.array_equal(joined, x):
        jumps = int((np.abs(np.diff(x)) > np.pi).sum())
        add("wrapped", Severity.INFO, f"Jumps by a full turn {jumps} times; unwrapped.", name, jumps)
    changes = np.abs(np.diff(joined))
    moved = changes[changes > 1e-12 * max(span, 1e-300)]
    if not _unit(add, robot, j, name, joined, prismatic, np.median(np.diff(log.t))):
        joint_limits(add, robot, j, name, joined)
    held = 1 - len(moved) / len(changes)
    step = grid_step(joined)
    unit = "m" if prismatic else "rad"
    if step > 1e-5 * span:
        noise = step / math.sqrt(12)
        # White noise of this size, low-passed at 10 Hz and differentiated twice: sqrt(2 s²/f_s (2π)⁴ f⁵/5).
        rate = 1 / float(np.median(np.diff(log.t)))
        at_ten = math.sqrt(2 * noise**2 / rate * (2 * math.pi) ** 4 * min(10.0, rate / 5) ** 5 / 5)
        coarse = step > 0.002 * span
        add(
            "quantisation",
            Severity.WARNING if coarse else Severity.INFO,
            f"Position is quantised in steps of {step:.3g} {unit}; after a 10 Hz low-pass this leaves an error of about {at_ten:.2g}"
            f" {unit}/s^2 in the acceleration."
            + (" That is coarse for the range of motion: keep the cut-off low, or record larger motion." if coarse else ""),
            name,
            step,
        )
    if held > 0.3 and _moving_share(joined) > 0.5:
        add(
            "repeated",
            Severity.INFO,
            f"{held:.0%} of positions repeat the previous one: the log is sampled faster than its source, or the encoder is coarse.",
            name,
            held,
        )
    spikes = position_jumps(log.t, joined)
    if len(spikes):
        at = log.t[spikes[0]]
        add(
            "spike",
            Severity.WARNING,
            f"Position jumps at {at:.12g} s ({len(spikes)} sample{'s stand' if len(spikes) > 1 else ' stands'} far out)."
            f" A single wrong sample corrupts velocity and acceleration around it: remove it from the log. If the position stays"
            f" offset, an encoder or a coupling slipped: cut the log there.",
            name,
            float(np.abs(np.diff(joined, 2))[spikes[0] - 1]),
        )


def position_jumps(t: Array, x: Array) -> Array:
    """Samples (J,) at which positions x (N,) at times t (N,) do what no motion does, the worst first."""
    return find_jumps(t, x, grid_step(x))


def _unit(add: Add, robot: Robot | None, j: int, name: str, x: Array, prismatic: bool, step: float) -> bool:
    """Degrees for radians, millimetres for metres: by joint limits where there are any, else by what is usual. True if suspected."""
    # A wrong sample here and there says nothing about the unit.
    low, high = (float(v) for v in np.percentile(x, _NEARLY_ALL))
    reach = max(-low, high)
    speed = float(np.percentile(np.abs(np.diff(x)), 99)) / step
    factor, wrong, right = (1e-3, "mm", "m") if prismatic else (_DEG, "degrees", "rad")
    why = ""
    if robot is not None and np.isfinite([robot.joints[j].lower, robot.joints[j].upper]).all():
        joint = robot.joints[j]
        room = joint.upper - joint.lower
        outside = max(joint.lower - low, high - joint.upper)
        margin = 0.1 * room
        fits = joint.lower - margin <= factor * low and factor * high <= joint.upper + margin
        if outside > 0.5 * room and fits:
            room_text = f"{joint.lower:.3g} to {joint.upper:.3g} {right}"
            why = f"positions reach {reach:.4g}, far outside the limits of {room_text}, but they fit as {wrong}"
    elif reach > (_FAR_LENGTH if prismatic else _FAR_ANGLE) and (robot is None or robot.joints[j].kind != "continuous"):
        why = f"positions reach {reach:.4g} {right}, more than a joint usually moves"
    if not why and not prismatic:
        limit = robot.joints[j].velocity if robot is not None and np.isfinite(robot.joints[j].velocity) else _FAST
        if speed > 5 * limit and speed * factor <= 1.5 * limit:
            why = f"speeds reach {speed:.4g} {right}/s, far above {limit:.3g} {right}/s, but they fit as {wrong} per second"
    if not why:
        return False
    suffix = "mm" if prismatic else "deg"
    add(
        "unit",
        Severity.WARNING,
        f"Looks like {wrong}, not {right}: {why}. Gravity and inertia would be estimated from a wrong motion."
        f' If so, name the column q{j + 1}_{suffix}, or map it under [columns] of a study file: q{j + 1}_{suffix} = "its name there".',
        name,
        reach,
    )
    return True


def joint_limits(add: Add, robot: Robot | None, j: int, name: str, x: Array) -> None:
    """Positions beyond the joint's limits."""
    if robot is None:
        return
    joint = robot.joints[j]
    outside = max(joint.lower - float(x.min()), float(x.max()) - joint.upper)
    if outside > 0.02:
        add(
            "outside_limits",
            Severity.WARNING,
            f"Positions go {outside:.3g} beyond the joint's limits ({joint.lower:.3g} to {joint.upper:.3g}). Check the"
            " joint's zero and sign,"
            " and the order of the columns: a wrong zero turns gravity.",
            name,
            outside,
        )


def _moving_share(x: Array) -> float:
    """Share of the run in which the position changes over 25 samples."""
    if len(x) < 30:
        return 0.0
    change = np.abs(x[25:] - x[:-25])
    return float(np.mean(change > 0.02 * np.percentile(change, 99)))
