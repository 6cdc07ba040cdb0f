"""The band in which the reference drives the motion, as the log itself tells it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...model import Model
from ...robots.transmission import Side
from ..thresholds import DISTURBED, FEW

if TYPE_CHECKING:
    from .fit import Fit, Solved

Array = np.ndarray
#: Where the search for the band starts, and its limits, Hz.
START_HZ = 2.0
_LEAST, _LARGEST = 0.5, 10.0
#: Share of a speed's power that is the bulk of a motion.
_BULK = 0.95


def reference_band(fit: Fit, frame: Solved) -> float:
    """Frequency (Hz) up to which disturbances drive less than a small share of the acceleration, of the joint where that is least.

    The share is the residual's density over the apparent inertia squared, over the density of the acceleration before the mask: mask edges
    are broadband. One joint's disturbance moves the others through the inertia, so the least band counts for all."""
    from scipy.signal import welch

    inertia = _apparent_inertia(fit)
    raw = fit.raw_residual(frame)
    found, driven = [], []
    for m in range(fit.robot.n):
        if fit.share[m] < max(FEW, 0.05):
            continue
        shares, power, f = [], [], np.zeros(0)
        size = min(int(8 * fit.runs[0].band.row_rate), *(run.band.inner.stop - run.band.inner.start for run in fit.runs))
        for run, e in zip(fit.runs, raw, strict=True):
            inner = run.band.inner
            power.append(welch(run.band.rows(run.measured.motor.dq[:, [m]])[inner, 0], run.band.row_rate, nperseg=size)[1])
            acceleration = run.band.rows(run.measured.motor.ddq[:, [m]])[inner, 0]
            f, left = welch(e[inner, m] / np.sqrt(max(run.share[m], 1e-9)), run.band.row_rate, nperseg=size)
            _, moved = welch(acceleration, run.band.row_rate, nperseg=size)
            shares.append(left / max(inertia[m], 1e-300) ** 2 / np.maximum(moved, 1e-300))
        share = np.mean(shares, axis=0)
        smooth = np.array([np.exp(np.mean(np.log(np.maximum(share[(np.abs(f - x) <= 0.2) & (f > 0)], 1e-300)))) for x in f])
        beyond = np.flatnonzero((smooth > DISTURBED) & (f >= _LEAST))
        found.append(float(np.clip(f[beyond[0]] if len(beyond) else _LARGEST, _LEAST, _LARGEST)))
        speed = np.cumsum(np.mean(power, axis=0))
        driven.append(float(f[np.searchsorted(speed, _BULK * speed[-1])]))
    # What a model lacks is in the residual, too, and is no disturbance: where the bulk of the motion is, the reference drives it.
    return min(max(min(found, default=START_HZ), min(driven, default=START_HZ)), _LARGEST)


def _apparent_inertia(fit: Fit) -> Array:
    """Mean inertia (n,) that each motor feels along the motion."""
    assert fit.values is not None
    q = np.concatenate([run.measured.joint.q[:: max(1, len(run.use) // 40)] for run in fit.runs])
    robot = fit.robot
    n = robot.n
    still = np.zeros((len(q), n))
    links = [(e, part) for e, part in zip(fit.model.effects, fit.model.slices, strict=True) if e.name in ("rigid_body", "rotor_inertia")]
    model = Model(robot, tuple(e for e, _ in links))
    values = np.concatenate([fit.values[part] for _, part in links])
    M, _ = model.inertia_and_bias(q, still, values)
    K = robot.transmission.K
    to_motor = robot.transmission.torque_map(robot.transmission.measured, Side.MOTOR)
    return np.abs(np.diagonal(to_motor @ M @ K, axis1=1, axis2=2).mean(axis=0))
