"""The bands in which the reference drives the motors, as the log itself tells them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..model import Model
from ..robots.transmission import Side
from .thresholds import DISTURBED, FEW

if TYPE_CHECKING:
    from .fit import Fit
    from .solved import Solved

Array = np.ndarray
#: Where the search for the band starts, and its limits, Hz.
START_HZ = 2.0
_LEAST, _LARGEST = 0.5, 10.0
#: Share of a speed's power that is the bulk of a motion.
_BULK = 0.95
#: Seconds of a segment of which spectra are taken, and Hz to which a line leaks in them.
_SEGMENT = 8.0
_LEAK = 0.25


def reference_bands(fit: Fit, frame: Solved, noise: Array) -> Array:
    """Frequencies (n,), Hz, up to which disturbances and the noise of the positions make less than a small share of each motor's motion.
    `noise` (n,): density of the motors' positions' noise, rad²/Hz.

    There are two bounds of that share, and the lower one holds. The residual's density over the apparent inertia squared, and the noise's,
    over the density of the acceleration before the mask (mask edges are broadband): as if all of the residual were a torque that no
    controller rejects. And
    the largest density of the speed beyond a frequency over the density there: a controller rejects disturbances the better the slower they
    are, so that above the reference's band they drive no less than inside it. One joint's disturbance moves the others through the inertia,
    so the least band counts for all. A motor that neither bound gives a band (a wrist that friction moves at every frequency by more than
    that share) says nothing of the others; of its own motion the reference is known to drive no more than the bulk."""
    inertia = _apparent_inertia(fit)
    raw = fit.raw_residual(frame)
    found, driven = [], []
    silent = np.full(fit.robot.n, np.inf)
    for m in range(fit.robot.n):
        if fit.share[m] < max(FEW, 0.05):
            continue
        f, left, acceleration, speed = _densities(fit, raw, m)
        other = left / max(inertia[m], 1e-300) ** 2 + noise[m] * (2.0 * np.pi * f) ** 4
        by_residual = _smooth(f, other / np.maximum(acceleration, 1e-300))
        band = max(_first_beyond(f, by_residual), _last_cliff(f, _smooth(f, speed)))
        power = np.cumsum(np.maximum(speed - noise[m] * (2.0 * np.pi * f) ** 2, 0.0))
        driven.append(float(f[np.searchsorted(power, _BULK * power[-1])]))
        if band > 0.0:
            found.append(float(np.clip(band, _LEAST, _LARGEST)))
        else:
            silent[m] = driven[-1]
    # What a model lacks is in the residual, too, and is no disturbance: where the bulk of the motion is, the reference drives it.
    common = max(min(found, default=_LEAST), min(driven, default=START_HZ))
    return np.clip(np.minimum(silent, common), _LEAST, _LARGEST)


def _densities(fit: Fit, raw: list[Array], m: int) -> tuple[Array, Array, Array, Array]:
    """Frequencies, and spectral densities of motor m's residual, acceleration and speed; means over runs."""
    from scipy.signal import welch

    size = min(int(_SEGMENT * fit.runs[0].band.row_rate), *(run.band.inner.stop - run.band.inner.start for run in fit.runs))
    found, f = [], np.zeros(0)
    for run, e in zip(fit.runs, raw, strict=True):
        inner, rate = run.band.inner, run.band.row_rate
        parts = (
            e[inner, m] / np.sqrt(max(run.share[m], 1e-9)),
            run.band.rows(run.measured.motor.ddq[:, [m]])[inner, 0],
            run.band.rows(run.measured.motor.dq[:, [m]])[inner, 0],
        )
        f = welch(parts[0], rate, nperseg=size)[0]
        found.append([welch(x, rate, nperseg=size)[1] for x in parts])
    left, acceleration, speed = np.mean(found, axis=0)
    return f, left, acceleration, speed


def _smooth(f: Array, x: Array) -> Array:
    """Geometric means of a density over 0.4 Hz."""
    # Of a short run the frequencies are further apart: beside zero there is the first.
    logs, positive = np.log(np.maximum(x, 1e-300)), f > 0
    return np.array([np.exp(np.mean(logs[positive & (np.abs(f - max(at, f[1])) <= 0.2)])) for at in f])


def _first_beyond(f: Array, share: Array) -> float:
    """First frequency at which a share is too large; 0 where none is small."""
    small = (share <= DISTURBED) & (f >= _LEAST)
    beyond = np.flatnonzero((share > DISTURBED) & (f >= _LEAST))
    if not small.any() or not len(beyond):
        return float(_LARGEST if small.any() else 0.0)
    return float(f[beyond[0]]) if small[: beyond[0]].any() else 0.0


def _last_cliff(f: Array, speed: Array) -> float:
    """Largest frequency whose density no density beyond it comes near; 0 where there is none."""
    top = np.maximum.accumulate(speed[::-1])[::-1]
    beyond = np.array([top[np.searchsorted(f, at + _LEAK)] if at + _LEAK <= f[-1] else np.inf for at in f])
    good = np.flatnonzero((beyond <= DISTURBED * speed) & (f >= _LEAST) & (f <= _LARGEST))
    return float(f[good[-1]]) if len(good) else 0.0


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
