"""Whether the error of simulated position is more than the noise of the readings, and by how much."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .._utils.singular_values import lstsq
from ..errors import DataError
from ..signals.cutoff import choose_cutoff
from ..statistics.outliers import BY_CHANCE
from .commands import DriveLog
from .plant import DrivePlant
from .search import Fitted
from .stretches import shares

Array = np.ndarray
#: Lags at which a residual is looked at, the share of it that its past may predict, and how improbable that must be by chance.
_LAGS, FORETOLD, _CHANCE = 20, 0.1, 60.0
#: Share of the spectrum that the noise is told by.
_PART = 0.2
#: Samples from which on a log's noise is estimated.
_FEW = 64
#: Times the noise of its readings by which a joint that moves does so (standard deviation).
_MOVES = 3.0


def structure(fit: Fitted) -> float:
    """Share of the residual's square that its own past predicts, of the joint of which it predicts most; 0 where it may be chance."""
    return float(max(structures(fit)))


def structures(fit: Fitted) -> Array:
    """The same of each joint (n,)."""
    return np.array([_predicted(np.where(w > 0, e, 0.0)) for e, w in zip(fit.residual.T, fit.weights.T, strict=True)])


def _predicted(r: Array) -> float:
    r = r - r.mean()
    own = float(r @ r)
    if own <= 0.0 or len(r) <= 2 * _LAGS:
        return 0.0
    correlation = np.array([float(r[k:] @ r[:-k]) / own for k in range(1, _LAGS + 1)])
    if len(r) * float(correlation @ correlation) < _LAGS + _CHANCE:
        return 0.0
    X = np.stack([r[_LAGS - k : len(r) - k] for k in range(1, _LAGS + 1)], axis=1)
    left = r[_LAGS:] - X @ lstsq(X, r[_LAGS:], rcond=None)
    return 1.0 - float(left @ left) / max(float(r[_LAGS:] @ r[_LAGS:]), 1e-300)


def reading_noise(log: DriveLog) -> Array:
    """Standard deviation (n,) of the positions' noise, rad or m: white noise at high frequencies, where nothing moves, or that of rounding
    to the steps of an encoder; NaN of a short log."""
    n = log.q.shape[1]
    if len(log.t) < _FEW:
        return np.full(n, np.nan)
    white = choose_cutoff([log.q], 1.0 / log.period, [str(j) for j in range(n)], [False] * n).joints
    change = np.abs(np.diff(log.q, axis=0))
    steps = np.min(np.where(change > 0.0, change, np.inf), axis=0)
    return np.maximum([one.noise for one in white], np.where(np.isfinite(steps), steps, 0.0) / np.sqrt(12.0))


def require_motion(plant: DrivePlant) -> None:
    """Raise DataError where no joint moves in any log: such positions say of friction that it held, and nothing else."""
    moves = [np.std(log.q, axis=0) > _MOVES * reading_noise(log) for log in plant.logs if len(log.t) >= _FEW]
    if moves and len(moves) == len(plant.logs) and not np.any(moves):
        names = ", ".join(log.name for log in plant.logs)
        raise DataError(
            f"{names}: no joint moves by more than the noise of its readings, so that nothing can be identified under a drive law;"
            " log commands that move the joints (docs/actuators.md)." + "".join(f" {note}" for log in plant.logs for note in log.notes)
        )


def left_over(plant: DrivePlant, fit: Fitted, share: Array | float = 1.0) -> float:
    """`structure` of the joints whose error is above the noise of their readings, rounding to ticks included; 0 where none is. `share`
    (N, n): what each reading counts."""
    counted = replace(fit, residual=fit.residual * share)
    return float(np.max(structures(counted), where=_loud(plant, fit)[0], initial=0.0))


def _loud(plant: DrivePlant, fit: Fitted) -> tuple[Array, Array, Array]:
    """Which joints' (n,) error is above the noise of their readings by its size, that error and that noise; of too short a log each may be.
    Stretches that count little in the fit count little here."""
    share = shares(plant, fit.weights)
    rms = np.sqrt(np.sum(np.square(fit.residual * share), axis=0) / np.maximum(np.sum(np.square(share), axis=0), 1e-300))
    lengths = np.array([len(log.t) for log in plant.logs], float)
    noise = np.sqrt(np.average([np.square(reading_noise(log)) for log in plant.logs], axis=0, weights=lengths))
    # More than a share of its square is no noise.
    return ~(np.square(noise) >= (1.0 - FORETOLD) * np.square(rms)), rms, noise


def more_than_noise(plant: DrivePlant, fit: Fitted) -> bool:
    """Whether some joint's error remembers, or is by its size beyond the noise of its readings."""
    return left_over(plant, fit) > FORETOLD or bool(np.any(too_large(plant, fit)))


def too_large(plant: DrivePlant, fit: Fitted) -> Array:
    """Joints (n,) whose error is by its size beyond what the noise of so few readings is known to."""
    loud, rms, noise = _loud(plant, fit)
    with np.errstate(invalid="ignore", divide="ignore"):
        return loud & (noise > 0.0) & (np.square(rms / noise) > _surely(len(fit.residual)))


def _surely(count: int) -> float:
    """Ratio, which chance hardly reaches, of the variance of `count` errors to that of the noise, known by the upper part of a spectrum."""
    from scipy.special import fdtri

    return float(fdtri(count, max(_PART * count, 1.0), 1.0 - BY_CHANCE**2)) / (1.0 - FORETOLD)


def sizes_told(plant: DrivePlant, fit: Fitted, of: Array) -> str:
    """How far above the noise of its readings the error of some joints is; `of` (n,): which."""
    _, rms, noise = _loud(plant, fit)
    robot = plant.robot
    units = ["m" if joint.prismatic else "rad" for joint in robot.joints]
    told = (
        f"{robot.joint_names[j]} {rms[j] / noise[j]:.3g} times ({rms[j]:.2g} for {noise[j]:.2g} {units[j]})" for j in np.flatnonzero(of)
    )
    return f"the error of simulated position is above the noise of the readings: {', '.join(told)}."


def above_noise(plant: DrivePlant, fit: Fitted) -> tuple[str, ...]:
    """A warning of the joints whose error is above the noise of their readings, as it is where an effect is missing, or where a search
    ended beside the best values."""
    loud, _, noise = _loud(plant, fit)
    remembers = structures(replace(fit, residual=fit.residual * shares(plant, fit.weights))) > FORETOLD
    found = (remembers & loud & (noise > 0.0)) | too_large(plant, fit)
    if not found.any():
        return ()
    links = (
        ' Where the URDF\'s inertial parameters are in doubt (a load, another tool), set [drive] links = "identify".'
        if plant.law.links_known and not any(u.place in plant.law.scales for u in plant.unknowns)
        else ""
    )
    least = [float(value) for unknown, value in zip(plant.unknowns, fit.values, strict=True) if unknown.place == "delay_s"]
    early = " A delay is at 0, its least: commands may be stamped later than they were sent." if min(least, default=1.0) <= 0.0 else ""
    text = (
        f"{sizes_told(plant, fit, found)} The model lacks an effect, or the search ended beside the best values, as it may where a joint"
        " goes over the top; values may then be further off than their standard deviations say."
        f" `ident diagnose` looks for effects; further logs, or constants that are given as numbers, help a search.{links}{early}"
    )
    return (text,)
