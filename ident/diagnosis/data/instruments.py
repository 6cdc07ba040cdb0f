"""Two motions from one log: the measured one, and the part of it that no disturbance drives.

In closed loop the controller answers disturbances, so that the measured motion is correlated with them, and so is every column that is
made of it. The instrument is the motion in the band in which the reference drives it; of the desired motion, where it was logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ...effects.motion import Motion
from ...robots.transmission import Side
from ..thresholds import ENDS, SETTLE, SLOW
from .band import Band

if TYPE_CHECKING:
    from ...robots.robot import Robot
    from ...signals.signals import Signals

Array = np.ndarray
#: Rate (Hz) at which columns are made at least, share of its half that the motion keeps, and rate of the rows.
_COLUMN_RATE = 200.0
_KEPT = 0.4
_ROW_RATE = 50.0
_TOP_HZ = 20.0


@dataclass(frozen=True, eq=False)
class RunRows:
    """One run. `measured`, `instrument`: motions of N samples; `torque` (N, n) on the motor side; `reading` (N, n): the same on the side
    that is measured, as recorded; `use` (N, n): motor m's friction is a function of the motion there; `band`: makes rows."""

    measured: Motion
    instrument: Motion
    torque: Array = field(repr=False)
    reading: Array = field(repr=False)
    use: Array = field(repr=False)
    band: Band

    def masked(self, values: Array, m: int) -> Array:
        """Values (N, k) of motor m as rows (count, k): masked first, filtered second, so that nothing of a held contact leaks."""
        return self.band.rows(values, self.use[:, m])

    @property
    def share(self) -> Array:
        """Share (n,) of the samples that each motor has in use."""
        return np.asarray(self.use.mean(axis=0))


def reduced(signals: Signals) -> Signals:
    """Full-rate signals at a rate that columns need, what lies above it filtered off by the preparation before."""
    d = max(1, int(signals.rate // _COLUMN_RATE))
    if d == 1:
        return signals
    places = [np.arange(run.start, run.stop, d) for run in signals.runs]
    edges = np.cumsum([0, *map(len, places)]).tolist()
    at = np.concatenate(places)
    return replace(
        signals,
        **{key: getattr(signals, key)[at] for key in ("t", "q", "dq", "ddq", "torque", "tau", "valid")},
        runs=tuple(slice(a, b) for a, b in pairwise(edges)),
        rate=signals.rate / d,
        turning=None,
    )


def kept_hz(rate: float) -> float:
    """Cut-off (Hz) of the measured motion for a log of this rate."""
    d = max(1, int(rate // _COLUMN_RATE))
    return _KEPT * 0.5 * rate / d


def low_passed(q: Array, rate: float, cutoff_hz: float) -> tuple[Array, Array, Array]:
    """Positions (N, n) below a frequency, run both ways, with their derivatives."""
    from scipy.signal import butter, sosfiltfilt

    sos = butter(4, min(cutoff_hz / (0.5 * rate), 0.9), output="sos")
    smooth = sosfiltfilt(sos, q, axis=0, padlen=int(min(len(q) - 1, 6 * rate / cutoff_hz)))
    dq = _derivative(smooth, rate)
    return smooth, dq, _derivative(dq, rate)


def _derivative(x: Array, rate: float) -> Array:
    """Central differences of sixth order, of second order at the ends."""
    out = np.gradient(x, 1.0 / rate, axis=0)
    if len(x) > 7:
        out[3:-3] = (45 * (x[4:-2] - x[2:-4]) - 9 * (x[5:-1] - x[1:-5]) + (x[6:] - x[:-6])) * (rate / 60.0)
    return out


def run_rows(
    signals: Signals,
    robot: Robot,
    cutoff_hz: float,
    reference: Sequence[Array] | None = None,
    reading: Sequence[Array] | None = None,
) -> list[RunRows]:
    """The runs of full-rate signals with an instrument below `cutoff_hz`. `reference`: desired positions (N, n) of each run, if logged;
    `reading`: torque (N, n) of each as recorded, if that is at hand."""
    from scipy.signal import butter, sosfiltfilt

    rate, transmission = signals.rate, robot.transmission
    factor = max(1, round(rate / _ROW_RATE))
    top_hz = min(_TOP_HZ, 0.4 * rate / factor, 0.8 * kept_hz(rate) if rate >= _COLUMN_RATE else 0.6 * kept_hz(rate))
    motor_speed = transmission.motor_rate(signals.dq)
    top = usual_speed(motor_speed)
    found = []
    for i, run in enumerate(signals.runs):
        if run.stop - run.start < int(4 * rate):
            continue
        t, q = signals.t[run], signals.q[run]
        torque = transmission.torque(signals.torque[run], transmission.measured, Side.MOTOR)
        present = np.isfinite(torque)
        torque = np.where(present, torque, 0.0)
        sos = butter(4, kept_hz(rate) / (0.5 * rate), output="sos")
        torque = sosfiltfilt(sos, torque, axis=0)
        measured = Motion.of(robot, q, signals.dq[run], signals.ddq[run], t, rate=rate, start=signals.origins[i], cutoff_hz=kept_hz(rate))
        base = q if reference is None else reference[i]
        smooth = low_passed(base, rate, cutoff_hz)
        instrument = Motion.of(robot, *smooth, t, rate=rate, start=signals.origins[i], cutoff_hz=cutoff_hz)
        slow = (np.abs(measured.motor.dq) < SLOW * top) | (np.abs(instrument.motor.dq) < SLOW * top) | ~present
        ends = int(ENDS * rate)
        slow[:ends] = slow[len(slow) - ends :] = True
        use = ~_widened(slow, int(SETTLE * rate))
        raw = np.nan_to_num(signals.torque[run] if reading is None else reading[i])
        found.append(RunRows(measured, instrument, torque, raw, use.astype(float), Band(len(t), rate, factor, top_hz)))
    return found


def usual_speed(speed: Array) -> Array:
    """Speed (n,) that each motor usually reaches: the 98 % quantile while it moves."""
    size = np.abs(speed)
    top = size.max(axis=0, initial=0.0)
    return np.array([np.quantile(x[x > 0.02 * t], 0.98) if t > 0 else 0.0 for x, t in zip(size.T, top, strict=True)])


def _widened(flag: Array, reach: int) -> Array:
    """Flags (N, n), and so many samples before and after each."""
    sums = np.concatenate([np.zeros((1, flag.shape[1])), np.cumsum(flag, axis=0)])
    at = np.arange(len(flag))
    return np.asarray(sums[np.minimum(at + reach + 1, len(flag))] - sums[np.maximum(at - reach, 0)] > 0)
