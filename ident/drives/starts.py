"""Where a search starts: sizes of what is unknown from the links' inertia and the commands, and a few starts around them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from ..simulation.rigid import RigidDynamics
from .commands import DriveLog
from .plant import DrivePlant

Array = np.ndarray
#: Natural frequencies (Hz) from which unknown gains are guessed, shares of the drive's torque that friction takes, and delays in samples.
_LOOPS_HZ = (2.0, 5.0, 12.0)
_FRICTION = (0.02, 0.2)
#: Torques of drives that are sent voltages, in those that the links take along the measured motion: the rest is friction's.
_LOADS = (1.0, 2.0, 5.0)
_DELAYS = (0.3, 1.5)
#: Time constants (s) from which an unknown filter of commands is guessed.
_LAGS_S = (2e-3, 2e-2)
#: Integral times kp / ki (s) from which unknown gains of integrals are guessed.
_INTEGRAL_S = (0.3, 3.0)
#: Limits of torque, as shares of the largest that is asked for but for a few readings (a quantile), from which unknown ones are guessed.
_REACHED, _MOST = (0.8, 0.3, 0.1, 0.03), 0.995
#: An expected value may be off by so many times its size.
_DOUBT = 3.0
#: Swings with the torque off are of about this frequency (Hz).
_FREE_HZ = 1.0
#: Inertia of an actuator whose links are unknown or next to nothing, kg m².
_BARE = 0.005
#: Resonance (Hz) of a link on a spring of unknown stiffness.
_SPRING_HZ = 12.0


def starts(plant: DrivePlant) -> tuple[Array, Array]:
    """Starts (S, p) and usual sizes (p,) of the unknowns."""
    inertia = moved_inertia(plant)
    unknown_gain = any(plant.law.unknown(key) for key in plant.law.scales)
    loops: tuple[float, ...] = _LOADS if plant.law.kind == "voltage" else _LOOPS_HZ
    loops = loops if unknown_gain else (5.0,)
    delays = _DELAYS if plant.law.unknown("delay_s") else (0.0,)
    times = _INTEGRAL_S if plant.law.unknown("ki") else _INTEGRAL_S[:1]
    lags = _LAGS_S if plant.law.unknown("command_lag_s") else _LAGS_S[:1]
    reached = _REACHED if plant.law.unknown("effort_limit") else _REACHED[:1]
    options = product(loops, _FRICTION, delays, times, lags, reached)
    found, large = np.swapaxes([_start(plant, inertia, *one) for one in options], 0, 1)
    sizes = np.maximum(np.min(large, axis=0), 1e-3 * np.max(large, axis=0))
    return found, np.maximum(sizes, 1e-9)


def expected(plant: DrivePlant) -> tuple[Array, Array]:
    """What is expected of the unknowns (p,) before any log, and how far off it may be (p,): inertials of the URDF, no offset; inf where
    nothing is. Of what the logs do not show, the simulation then keeps this."""
    at, _ = starts(plant)
    symbols = [u.name.split("_")[0][0] if u.place == "link" else "" for u in plant.unknowns]
    centre, width = at[0].copy(), np.full(len(at[0]), np.inf)
    for i, unknown in enumerate(plant.unknowns):
        if unknown.place == "link":
            alike = [abs(at[0][k]) for k, symbol in enumerate(symbols) if symbol == symbols[i]]
            width[i] = _DOUBT * max(alike)
        elif unknown.place == "offset":
            centre[i], width[i] = 0.0, 1e3 * _DOUBT * max(abs(x[i]) for x in at)
    return centre, width


def moved_inertia(plant: DrivePlant) -> Array:
    """What each joint moves (n,), kg m²."""
    if not plant.law.links_known and plant.robot.nominal is None:
        return np.full(plant.robot.n, 4 * _BARE)
    return np.maximum(plant.inertia, _BARE)


def _start(
    plant: DrivePlant, inertia: Array, hz: float, friction: float, late: float, integral_s: float, lag: float, reached: float
) -> tuple[Array, Array]:  # fmt: skip
    """Values and sizes (p,)."""
    logs = plant.logs
    # What is commanded while the torque is off moves nothing, and says nothing of the drive.
    error = np.sqrt(np.mean(np.concatenate([log.enabled * _error(plant, log) for log in logs]) ** 2, axis=0)) + 1e-6
    driven = np.any([np.any(log.enabled > 0, axis=0) for log in logs], axis=0)
    rate = np.sqrt(np.mean(np.concatenate([np.gradient(log.q, log.t, axis=0) for log in logs]) ** 2, axis=0)) + 1e-6
    spread = np.std(np.concatenate([log.q for log in logs]), axis=0)
    volts = np.mean([log.supply.mean(axis=0) for log in logs if log.supply is not None] or [np.ones(plant.robot.n)], axis=0)
    gains = np.array([plant.law.for_log(log.name).constants[plant.law.gain] for log in logs])
    known = np.where(np.isnan(gains).all(axis=0), np.nan, np.nan_to_num(gains).sum(axis=0) / np.maximum(1, np.isfinite(gains).sum(axis=0)))
    stiff = inertia * (2 * np.pi * hz) ** (2 if plant.law.sends_positions else 1)
    stiff = np.where(np.isnan(known) | plant.law.in_volts, stiff, known)
    sent = plant.law.kind == "voltage"
    torque, scale = stiff * error, stiff / np.where(np.isnan(known) | sent, 1.0, known) / volts
    if sent:
        # Here `hz` is the drive's torque in those that the links take.
        scale = plant.law.constants["torque_scale"]
        scale = np.where(np.isnan(scale), hz * _taken(plant, inertia, rate, spread) / _voltage(logs), scale)
        torque = scale * _voltage(logs)
    torque = np.where(driven, torque, inertia * rate * 2 * np.pi * _FREE_HZ)
    guess = {
        "armature": 0.3 * inertia, "viscous": friction * torque / rate, "dry": friction * torque, "offset": 1e-3 * torque,
        "load": np.full(plant.robot.n, 0.05), "spring": 0.05 * torque / np.maximum(spread, 1e-3), "gear_loss": np.full(plant.robot.n, 0.1),
        "gear_loss_square": 0.05 / np.maximum(torque, 1e-3), "gear_loss_slow": np.full(plant.robot.n, 0.03), "slow_speed": 0.3 * rate,
        "joint_stiffness": inertia * (2 * np.pi * _SPRING_HZ) ** 2, "joint_damping": 0.02 * inertia * 2 * np.pi * _SPRING_HZ,
        "feed_forward": np.ones(plant.robot.n), "excess": 0.3 * friction * torque, "kp": stiff, "kd": 0.3 * 2 * inertia * 2 * np.pi * hz,
        "delay_s": np.full(plant.robot.n, max(late * logs[0].period, 1e-3)),
        "effort_limit": reached * np.maximum(largest_asked(plant, stiff), 1e-3),
        "torque_scale": scale, "back_emf": friction * torque / rate, "ki": stiff / integral_s, "command_lag_s": np.full(plant.robot.n, lag),
        "deadband": 0.2 * error,
        "no_load_speed": 3.0 * rate,
    }  # fmt: skip
    if plant.law.gain == "kd":
        guess["kd"] = stiff
    if plant.law.kind == "pwm" and np.isnan(known).any():
        guess["kp"] = np.full(plant.robot.n, 5.0)
    nominal = plant.robot.nominal
    values, least = [], np.zeros(len(plant.unknowns))
    for i, unknown in enumerate(plant.unknowns):
        if unknown.place == "link":
            values.append(_link(plant, unknown.column, nominal, inertia))
        elif unknown.log:
            values.append(float(_begun(plant, logs[plant.labels.index(unknown.log)], stiff)[unknown.joint]))
            # Next to none is no size: friction holds as much as that.
            least[i] = friction * torque[unknown.joint]
        else:
            of = guess[unknown.place]
            values.append(float(of.mean() if unknown.joint < 0 else of[unknown.joint]) / unknown.factor)
    return np.array(values), np.maximum(np.abs(values), least)


def largest_asked(plant: DrivePlant, stiff: Array) -> Array:
    """The most (n,) that drives are asked for, but for a few readings: N m, V, or a share of full voltage; `stiff` (n,): of their gain."""
    if plant.law.kind == "voltage":
        sizes = [np.abs(log.enabled * log.tau_ff) for log in plant.logs]
    else:
        sizes = [np.abs(log.enabled * (stiff * _error(plant, log) + log.tau_ff)) for log in plant.logs]
    most = np.max([np.quantile(size, _MOST, axis=0) for size in sizes], axis=0)
    return np.asarray(np.minimum(most, 1.0) if plant.law.kind == "pwm" else most)


def _error(plant: DrivePlant, log: DriveLog) -> Array:
    """(N, n) what a drive's gain amplifies: error of position, or of speed where it is sent speeds."""
    return log.q_cmd - log.q if plant.law.sends_positions else log.dq_cmd - np.gradient(log.q, log.t, axis=0)


def _taken(plant: DrivePlant, inertia: Array, rate: Array, spread: Array) -> Array:
    """Torques (n,) that links take along the measured motion, rms: of their weight, and of their inertia at the speeds `rate` and about
    the `spread` (n,) of their positions."""
    weight = np.zeros(plant.robot.n)
    if plant.robot.nominal is not None:
        q = np.concatenate([log.q[:: max(1, len(log.q) // 20)] for log in plant.logs])
        weight = np.sqrt(np.mean(RigidDynamics(plant.robot, plant.nominal).terms(q, np.zeros_like(q))[1] ** 2, axis=0))
    return np.asarray(np.hypot(weight, inertia * rate**2 / np.maximum(spread, 1e-6)))


def _begun(plant: DrivePlant, log: DriveLog, kp: Array) -> Array:
    """What integrals (n,) begin a log with, N m of the drive's command: what holds the links at its first position, as far as is known."""
    scale = plant.law.for_log(log.name).constants["torque_scale"]
    weight = np.zeros(plant.robot.n)
    if plant.robot.nominal is not None:
        weight = RigidDynamics(plant.robot, plant.nominal).terms(log.origin[None], np.zeros((1, plant.robot.n)))[1][0]
    return np.asarray(weight / np.where(scale > 0.0, scale, 1.0) - kp * (log.q_cmd[0] - log.origin) - log.tau_ff[0])


def _voltage(logs: Sequence[DriveLog]) -> Array:
    """Voltages (n,) that drives were sent, rms, V."""
    return np.asarray(np.sqrt(np.mean(np.concatenate([log.enabled * log.tau_ff for log in logs]) ** 2, axis=0)) + 1e-6)


def _link(plant: DrivePlant, column: int, nominal: Array | None, inertia: Array) -> float:
    """A base parameter of the links from the URDF's inertials, drives left out."""
    model = plant.model
    row = list(model.base.independent).index(column)
    if nominal is None:
        return float(inertia.max()) if "zz" in model.parameters[column].name else 1e-3
    whole = np.zeros(len(model.parameters))
    whole[: len(nominal)] = nominal
    value = float(model.base.regroup[row] @ whole)
    return value if abs(value) > 1e-6 else 1e-3
