"""What a target cannot express, with the error that leaving it out makes: torque on the fit's own motion, or over states within the
limits of the joints; for drive laws also simulated position on logs that are given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..drives.result import DriveFit
from ..effects.base import Effect
from ..effects.kinds import Nature, Need
from ..effects.motion import Motion
from ..effects.reference import Reference
from ..effects.rigid_body import RigidBody
from ..estimate.estimate import Estimate
from ..robots.transmission import Side
from ..signals import ZeroPhase
from .actuation import Actuation
from .closed_loop import ClosedLoop
from .target import ExportOptions, Expressed

if TYPE_CHECKING:
    from ..logs.log import LogSet
    from ..robots.robot import Robot
    from ..signals.signals import Signals
    from .identified import Identified

Array = np.ndarray
#: What of a target holds an effect.
_HOLDS: dict[str, frozenset[Expressed]] = {
    "rotor_inertia": frozenset({Expressed.ARMATURE}),
    "viscous": frozenset({Expressed.DAMPING}),
    "coulomb": frozenset({Expressed.DRY_FRICTION}),
    "joint_side_friction": frozenset({Expressed.DAMPING, Expressed.DRY_FRICTION}),
    "offset": frozenset({Expressed.OFFSET}),
    "linear_spring": frozenset({Expressed.SPRING}),
}
#: Constants of a law and places of unknowns that are put to nothing to see what each thing does to simulated position.
_SWITCH = {
    "stribeck": {"excess": 0.0},
    "load_dependent_friction": {"load": 0.0},
    "offset": {"offset": 0.0},
    "linear_spring": {"spring": 0.0, "offset": 0.0},
    "gear losses": {"gear_loss": 0.0, "gear_loss_square": 0.0, "gear_loss_slow": 0.0},
    "joint elasticity": {"joint_stiffness": np.inf},
    "delay": {"delay_s": 0.0},
    "fall of the limit with speed": {"no_load_speed": np.inf},
    "filter of commands": {"command_lag_s": 0.0},
    "deadband": {"deadband": 0.0},
    "integral of the error": {"ki": 0.0, "integral_start": 0.0},
}
_BEYOND_A_STATE = frozenset({Need.HISTORY, Need.NEIGHBOURS, Need.TORQUE, Need.TIME})
#: States at which torque is computed where no motion is known, and the speed (rad/s) and range (rad) of joints whose limits are not.
_STATES, _SPEED, _RANGE = 2000, 1.0, np.pi


@dataclass(frozen=True, eq=False)
class Omission:
    """Something that a target leaves out: `cause`; `peak`, `rms` (n,) of its torque on the joint side, NaN where a state alone does not
    tell; `hint`: what to do about it."""

    cause: str
    peak: Array
    rms: Array
    hint: str = ""


def omissions(found: Identified, expresses: frozenset[Expressed], options: ExportOptions) -> tuple[str, ...]:
    """A line for each thing that is left out of an export, with the error that it makes."""
    seen, where = _motions(found, options)
    lines = [_line(found.robot, one, where, options.logs, found.fit) for one in _found(found, expresses, seen)]
    law = found.law
    if law is not None and Expressed.DELAY not in expresses and np.any(law.delay_s > 0):
        lines.append(_delay(found, law, options.logs))
    return tuple(lines)


def _found(found: Identified, expresses: frozenset[Expressed], seen: list[Motion]) -> Iterator[Omission]:
    robot, law = found.robot, found.law
    for effect, part in zip(found.model.effects, found.model.slices, strict=True):
        if isinstance(effect, RigidBody) or not np.any(found.values[part]):
            continue
        if effect.nature == Nature.SENSOR:
            continue
        if effect.name in _HOLDS and _HOLDS[effect.name] <= expresses:
            continue
        hint = ""
        if effect.name == "stribeck" and Expressed.BREAKAWAY in expresses:
            hint = "at standstill the static friction includes it"
        elif effect.name == "offset":
            hint = "add it to the commanded torque"
        yield _omission(effect.name, [_torque(found, effect, found.values[part], motion) for motion in seen], hint)
    if not robot.transmission.is_diagonal and Expressed.COUPLING not in expresses:
        yield _omission(
            "coupling between motors and joints", [_coupling(found, motion) for motion in seen], "JSON and MJCF exports contain it"
        )
    if law is None:
        return
    if np.any(law.gear_loss + law.gear_loss_square + law.gear_loss_slow > 0):
        yield _omission("gear losses", [law.losses(_needed(found, motion), motion.joint.dq) for motion in seen])
    if np.any(np.isfinite(law.joint_stiffness)):
        twist = [_links(found, motion) / law.joint_stiffness for motion in seen]
        most = np.max([np.abs(x).max(axis=0) for x in twist], axis=0)
        told = ", ".join(f"{name} by {x:.3g} rad" for name, x in zip(robot.joint_names, most, strict=True) if x > 0)
        yield Omission(
            "joint elasticity", np.full(robot.n, np.nan), np.full(robot.n, np.nan), f"links deflect against their motors: {told}"
        )
    if law.velocity_command and Expressed.VELOCITY_COMMAND not in expresses:
        yield Omission("velocity commands", np.full(robot.n, np.nan), np.full(robot.n, np.nan), "gains act on the position command alone")
    if law.per_volt is not None and Expressed.VOLTAGE_COMMAND not in expresses:
        told = ", ".join(f"{name} {x:.4g}" for name, x in zip(robot.joint_names, law.per_volt, strict=True))
        hint = f"command voltages times torque_scale ({told} N m/V); the back-EMF is part of the damping"
        yield Omission("voltage commands", np.full(robot.n, np.nan), np.full(robot.n, np.nan), hint)
    if law.no_load_speed is not None and Expressed.SPEED_TORQUE not in expresses:
        pairs = [(name, x) for name, x in zip(robot.joint_names, law.no_load_speed, strict=True) if np.isfinite(x)]
        told = ", ".join(f"{name} {x:.3g} rad/s" for name, x in pairs)
        hint = f"the limit of a joint that is driven along its motion falls to nothing at {told}"
        yield Omission("fall of the limit with speed", np.full(robot.n, np.nan), np.full(robot.n, np.nan), hint)
    if law.command_lag_s is not None and Expressed.COMMAND_FILTER not in expresses:
        pairs = [(name, 1e3 * x) for name, x in zip(robot.joint_names, law.command_lag_s, strict=True) if x > 0.0]
        hint = f"smooth your commands by a first-order filter: {', '.join(f'{name} {x:.3g} ms' for name, x in pairs)}"
        yield Omission("filter of commands", np.full(robot.n, np.nan), np.full(robot.n, np.nan), hint)
    if law.deadband is not None:
        hint = "errors of position within " + ", ".join(
            f"±{x:.3g} ({name})" for name, x in zip(robot.joint_names, law.deadband, strict=True)
        )
        yield Omission("deadband", law.kp * law.deadband, law.kp * law.deadband, f"{hint} have no torque, larger ones that much less")
    if law.ki is not None and Expressed.INTEGRAL not in expresses:
        yield _without_integral(found, law, seen)


def _without_integral(found: Identified, law: ClosedLoop, seen: list[Motion]) -> Omission:
    """What the integral holds at rest, the other gains alone hold by an error of position."""
    robot, nothing = found.robot, np.full(found.robot.n, np.nan)
    held = []
    for motion in seen:
        still = Motion.of(robot, motion.joint.q, np.zeros_like(motion.joint.q), np.zeros_like(motion.joint.q))
        held.append(np.abs(_needed(found, still)).max(axis=0))
    most = np.max(held, axis=0) / np.where(law.kp > 0.0, law.kp, np.nan)
    units = ["m" if joint.prismatic else "rad" for joint in robot.joints]
    at = [j for j in range(robot.n) if law.ki is not None and law.ki[j] > 0.0 and np.isfinite(most[j])]
    told = ", ".join(f"{robot.joint_names[j]} by up to {most[j]:.3g} {units[j]}" for j in at)
    return Omission("integral of the error", nothing, nothing, f"at rest joints stay off their commands: {told}" if told else "")


def _omission(cause: str, torques: list[Array], hint: str = "") -> Omission:
    everything = np.concatenate(torques)
    return Omission(cause, np.abs(everything).max(axis=0), np.sqrt(np.mean(everything**2, axis=0)), hint)


def _torque(found: Identified, effect: Effect, values: Array, motion: Motion) -> Array:
    """An effect's torque (N, n) on the joint side, NaN where the states do not tell."""
    robot = found.robot
    if effect.needs & _BEYOND_A_STATE and (motion.rate <= 0.0 or Need.TORQUE in effect.needs):
        return np.full((len(motion), robot.n), np.nan)
    if effect.needs:
        motion = motion.with_reference(Reference(found.model, found.values))
    return robot.transmission.torque(effect.torque(motion, robot, values), effect.side, Side.JOINT)


def _links(found: Identified, motion: Motion) -> Array:
    """Torque (N, n) of the links, joint side."""
    return Reference(found.model, found.values).load(motion)


def _needed(found: Identified, motion: Motion) -> Array:
    """Torque (N, n) that the drives give in a motion, joint side, gear losses not counted."""
    torque = _links(found, motion)
    for effect, part in zip(found.model.effects, found.model.slices, strict=True):
        if not isinstance(effect, RigidBody):
            torque = torque + np.nan_to_num(_torque(found, effect, found.values[part], motion))
    return torque


def _coupling(found: Identified, motion: Motion) -> Array:
    """True less written torque (N, n) of rotors, friction, springs and offsets of drives that share joints."""
    robot, law = found.robot, Actuation.of(found)
    back, own = robot.transmission.K_inverse, motion.joint
    dry = np.sign(own.dq @ back.T) * found.drive()["frictionloss"]
    true = own.ddq @ law.inertia.T + own.dq @ law.drag.T + own.q @ law.spring.T + dry @ back
    alone = np.abs(back).T @ found.drive()["frictionloss"]
    written = own.ddq * np.diag(law.inertia) + own.dq * np.diag(law.drag) + own.q * np.diag(law.spring) + np.sign(own.dq) * alone
    return np.asarray(true - written)


def _motions(found: Identified, options: ExportOptions) -> tuple[list[Motion], str]:
    """Motions on which torque is computed, and what they are in words."""
    robot = found.robot
    if options.logs is not None and not isinstance(found.fit, DriveFit):
        return _of_signals(ZeroPhase(decimate=False)(options.logs, robot)), "on the logs given"
    if isinstance(found.fit, Estimate) and found.fit.problem is not None:
        return _of_signals(found.fit.problem.signals), "on the motion of the fit"
    rng = np.random.default_rng(0)
    limits = [_range(joint.lower, joint.upper) for joint in robot.joints]
    speeds = np.array([joint.velocity if 0 < joint.velocity < np.inf else _SPEED for joint in robot.joints])
    known = all(0 < joint.velocity < np.inf for joint in robot.joints)
    q = rng.uniform([low for low, _ in limits], [high for _, high in limits], (_STATES, robot.n))
    dq = rng.uniform(-1.0, 1.0, (_STATES, robot.n)) * speeds
    within = "the limits of the joints" if known else f"the joints' range and {_SPEED:g} rad/s or m/s (no speed limit is known)"
    return [Motion.of(robot, q, dq, np.zeros_like(q))], f"over states without acceleration within {within}"


def _range(lower: float, upper: float) -> tuple[float, float]:
    return (lower, upper) if np.isfinite([lower, upper]).all() else (-_RANGE, _RANGE)


def _of_signals(signals: Signals) -> list[Motion]:
    robot = signals.robot
    return [Motion.of(robot, signals.q[run], signals.dq[run], signals.ddq[run], signals.t[run], rate=signals.rate) for run in signals.runs]


def _line(robot: Robot, one: Omission, where: str, logs: LogSet | None, fit: object) -> str:
    position = _moved(fit, one.cause, logs)
    hint = f"; {one.hint}" if one.hint else ""
    if np.isnan(one.peak).any():
        also = "" if position or one.hint else ": its error cannot be computed from single states; give logs (--log)"
        return f"not expressible: {one.cause}{also}{position}{hint}."
    at = [j for j in range(robot.n) if one.peak[j] > 1e-12]
    if not at:
        return f"not expressible: {one.cause}: no torque {where}{position}{hint}."
    worst = max(at, key=lambda j: float(one.peak[j]))
    joints = ", ".join(f"{robot.joint_names[j]} {one.rms[j]:.3g}" for j in at)
    unit = robot.force_unit(worst, Side.JOINT)
    return (
        f"not expressible: {one.cause}: up to {one.peak[worst]:.3g} {unit} ({robot.joint_names[worst]}), rms by joint {joints} {unit},"
        f" {where}{position}{hint}."
    )


def _delay(found: Identified, law: ClosedLoop, logs: LogSet | None) -> str:
    worst, late = int(np.argmax(law.delay_s)), 1e3 * law.delay_s
    return (
        f"not expressible: the delay from command to torque ({late.min():.2f} to {late.max():.2f} ms). Delay your commands by as much;"
        f" else joint {found.robot.joint_names[worst]} is ahead of the robot by {late[worst]:.2f} ms{_moved(found.fit, 'delay', logs)}."
    )


def _moved(fit: object, cause: str, logs: LogSet | None) -> str:
    """What leaving it out does to the position simulated under the logs' commands, in words; nothing where that is not known."""
    if not isinstance(fit, DriveFit) or logs is None or cause not in _SWITCH:
        return ""
    neutral = _SWITCH[cause]
    values = fit.values.copy()
    for i, unknown in enumerate(fit.unknowns):
        if unknown.place in neutral:
            values[i] = neutral[unknown.place]

    def without(constants: dict[str, Array]) -> dict[str, Array]:
        return {k: np.full_like(v, neutral[k]) if k in neutral else v for k, v in constants.items()}

    by_log = {name: {**table, "constants": without(table["constants"])} for name, table in fit.law.by_log.items()}
    law = replace(fit.law, constants=without(dict(fit.law.constants)), by_log=by_log)
    there, here = replace(fit, values=values, law=law).replay(logs), fit.replay(logs)
    shift = np.concatenate([there[name] - here[name] for name in here])
    return f"; without it the simulated position changes by {np.sqrt(np.mean(shift**2)):.3g} rad (m) rms on the logs given"
