"""The torque that a drive with known gains gives: logs of commands become logs of torque, for every method that needs one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError, DataError
from ..logs.log import Log, LogSet
from .commands import DriveLog
from .law import DriveLaw
from .sent import at_instants, means
from .simulate import held_share
from .space import drive_logs

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


def with_torque(logs: LogSet, law: DriveLaw, robot: Robot) -> LogSet:
    """The same logs with torque on the joint side as the law gives it; NaN where it is clipped or switched off.

    Raises ConfigurationError where some constant of the law is not known."""
    return replace(logs, logs=tuple(_of(log, law.for_log(log.name), robot) for log in logs))


def _of(log: Log, law: DriveLaw, robot: Robot) -> Log:
    if law.load is not None:
        raise ConfigurationError(
            f"log {log.name}: the load in [drive.by_log] counts in fits by simulation (`ident fit` without --method); here it would"
            " be taken for the links' own."
        )
    unknown = [key for key in law.constants if law.unknown(key) or (key == "integral_start" and log.t[0] > log.began)]
    unknown = [key for key in unknown if key != "integral_start" or law.integrates.any()]
    if unknown == ["integral_start"]:
        raise ConfigurationError(
            f"log {log.name}: what the integral of the drive law begins with is not known. Fit by simulation (`ident fit` without"
            " --method), or put integral_start into [drive], 0 where the drive is switched on as the recording begins."
        )
    if unknown:
        raise ConfigurationError(
            f"log {log.name}: the drive law does not give a torque, because {', '.join(unknown)} is to be identified."
            " Fit by simulation (`ident fit` without --method), and put the values into [drive]."
        )
    if any(np.any(law.constants[key]) for key in ("gear_loss", "gear_loss_square", "gear_loss_slow")):
        raise ConfigurationError(
            f"log {log.name}: with gear_loss, friction follows the drive's torque, which is known in simulation only."
            " Fit by simulation (`ident fit` without --method)."
        )
    if np.isfinite(law.constants["joint_stiffness"]).any():
        raise ConfigurationError(f"log {log.name}: with joint_stiffness, the torque on the link is known in simulation only.")
    if log.q is None or not np.isfinite(log.q).all():
        raise DataError(f"log {log.name}: positions are missing; the drive law gives no torque without them.")
    (seen,) = drive_logs((log,), robot, law)
    read = log.velocity(robot.transmission)
    speed = np.gradient(seen.q, seen.t, axis=0) if read is None else read
    position, rate, forward = _late(seen.t, seen, law)
    constants = law.constants
    asked = constants["kp"] * _felt(constants, position - seen.q) + constants["kd"] * (rate - speed) + constants["feed_forward"] * forward
    asked = asked + _integral(seen, law, speed) if law.integrates.any() else asked
    strength = constants["torque_scale"] * (seen.supply if law.kind == "pwm" and seen.supply is not None else 1.0)
    torque = strength * asked - constants["back_emf"] * speed
    known = (asked < _limit(constants, speed)) & (-asked < _limit(constants, -speed)) & (seen.enabled == 1.0)
    torque = np.where(known, torque, np.nan)
    said = f"log {log.name}: torque computed from [drive] law {law.kind!r} with its constants; no torque was measured."
    lost = float(np.mean(~known))
    more = (
        (f"log {log.name}: {lost:.1%} of the torque samples are excluded: the command is clipped, or the torque switched off.",)
        if lost
        else ()
    )
    return replace(log, tau={"joint": torque}, notes=(*log.notes, said, *more), hint="")


def _felt(constants: Mapping[str, Array], error: Array) -> Array:
    """An error of position as the drive takes it, beyond its deadband."""
    return error - np.clip(error, -constants["deadband"], constants["deadband"])


def _limit(constants: Mapping[str, Array], along: Array) -> Array:
    """Limit of the command in the direction in which a joint moves at a speed `along`."""
    limit, none = constants["effort_limit"], np.isinf(constants["no_load_speed"])
    return np.where(none, limit, np.where(none, 0.0, limit) * (1.0 - np.maximum(along, 0.0) / constants["no_load_speed"]))


def _integral(log: DriveLog, law: DriveLaw, speed: Array) -> Array:
    """The integral's part of the command (N, n) at the samples, from piece to piece of constant commands. It stands still while the limit
    holds and the error would wind it further, and is zero while the drive is off."""
    c = law.constants
    at = np.unique(np.concatenate([log.t, *(log.t + late for late in c["delay_s"])]))
    at = at[at <= log.t[-1]]
    q, dq = (np.stack([np.interp(at, log.t, own) for own in x.T], axis=1) for x in (log.q, speed))
    sent, *commands = _pieces(at, log, law)
    on = log.enabled[np.searchsorted(log.t, at, side="right") - 1] > 0.0
    change = c["ki"] * np.diff(at)[:, None] * _felt(c, sent - 0.5 * (q[1:] + q[:-1]))
    asked, then = (
        c["kp"] * _felt(c, position - q[k]) + c["kd"] * (rate - dq[k]) + c["feed_forward"] * forward
        for k, (position, rate, forward) in zip((slice(-1), slice(1, None)), commands, strict=True)
    )
    out = np.empty_like(q)
    z = out[0] = np.where(on[0], c["integral_start"], 0.0)
    for k, one in enumerate(change):
        along = np.where(one > 0.0, 1.0, -1.0)
        held = held_share(asked[k] + z, then[k] + z, one, (_limit(c, along * dq[k]), _limit(c, along * dq[k + 1])))
        z = out[k + 1] = np.where(on[k] & on[k + 1], z + (1.0 - held) * one, 0.0)
    return out[np.searchsorted(at, log.t)]


def _pieces(at: Array, log: DriveLog, law: DriveLaw) -> tuple[Array, tuple[Array, Array, Array], tuple[Array, Array, Array]]:
    """Mean position command (K, n) of each piece, and the commands of position and velocity and the feed-forward at its two ends."""
    position, rate, forward = _late(0.5 * (at[1:] + at[:-1]), log, law)
    delay, lag = law.constants["delay_s"], law.constants["command_lag_s"]
    if not lag.any():
        return position, (position, rate, forward), (position, rate, forward)
    mean = np.where(lag > 0.0, means(log.t, log.q_cmd, delay, lag, at, np.diff(at), law.command), position)
    sent, speed, _ = _late(at, log, law)
    ends = (slice(-1), slice(1, None))
    first, last = ((np.where(lag > 0.0, sent[k], position), np.where(lag > 0.0, speed[k], rate), forward) for k in ends)
    return mean, first, last


def _late(instants: Array, log: DriveLog, law: DriveLaw) -> tuple[Array, Array, Array]:
    """Commands of position and velocity, and feed-forward (K, n) each, as they act at instants (K,): late, and the first two smoothed."""
    delay, lag = law.constants["delay_s"], law.constants["command_lag_s"]
    position, rate = (at_instants(instants, log.t, x, delay, lag, law.command) for x in (log.q_cmd, log.dq_cmd))
    return position, rate, at_instants(instants, log.t, log.tau_ff, delay, np.zeros_like(lag), law.command)
