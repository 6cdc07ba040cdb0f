"""Two motions from one log: the measured one, and the part of it that no disturbance drives.

In closed loop the controller answers disturbances, so that the measured motion is correlated with them, and so is every column that is
made of it. The instrument is the motion in the band in which the reference drives it; of the desired motion, where it was logged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Motion
from ..robots.transmission import Side
from .band import Band
from .thresholds import BOUND, ENDS, SETTLE, SLOW

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from ..robots.transmission import Transmission
    from ..signals.signals import Signals

Array = np.ndarray
#: Rate (Hz) at which columns are made at least, share of its half that the motion keeps, and rate of the rows.
_COLUMN_RATE = 200.0
_KEPT = 0.4
_ROW_RATE = 50.0
_TOP_HZ = 20.0


@dataclass(frozen=True, eq=False)
class RunRows:
    """One run. `measured`, `instrument`: motions of N samples; `torque` (N, n) on the motor side; `reading` (N, n): the same on the side
    that is measured, as recorded; `use` (N, n): motor m's friction is a function of the motion there; `band`: makes rows; `cutoffs_hz`
    (n,): of each motor's motion in the instrument; `interval`: seconds between samples as they were recorded."""

    measured: Motion
    instrument: Motion
    torque: Array = field(repr=False)
    reading: Array = field(repr=False)
    use: Array = field(repr=False)
    band: Band
    cutoffs_hz: Array = field(repr=False)
    interval: float

    def masked_spectra(self, values: Array, m: int, precision: type[np.floating] = np.float64) -> Array:
        """Spectra (k, F) of values (N, k) of motor m as rows: masked first, filtered second, so that nothing of a held contact leaks."""
        return self.band.spectra(values, self.use[:, m], precision)

    @property
    def share(self) -> Array:
        """Share (n,) of the samples that each motor has in use."""
        return np.asarray(self.use.mean(axis=0))


def reduced(signals: Signals) -> Signals:
    """Full-rate signals at a rate that columns need, the torque below the cut-off that the preparation gave the motion before
    samples are left out, so that nothing above half the new rate is taken for something below."""
    d = max(1, int(signals.rate // _COLUMN_RATE))
    signals = replace(signals, torque=_low_passed_torque(signals))
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
        near_reversal=None,
    )


def _low_passed_torque(signals: Signals) -> Array:
    """Torque (N, n) below the motion's cut-off, run by run and both ways; NaN where it was missing, past which it is drawn straight."""
    from scipy.signal import butter, sosfiltfilt

    cutoff = kept_hz(signals.rate)
    sos = butter(4, cutoff / (0.5 * signals.rate), output="sos")
    out = np.full_like(signals.torque, np.nan)
    for run in signals.runs:
        at = np.arange(run.start, run.stop)
        for m, x in enumerate(signals.torque[run].T):
            there = np.isfinite(x)
            if there.any():
                whole = np.interp(at, at[there], x[there])
                out[run, m] = np.where(there, sosfiltfilt(sos, whole, padlen=int(min(len(at) - 1, 6 * signals.rate / cutoff))), np.nan)
    return out


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


def _motors_low_passed(q: Array, rate: float, cutoffs_hz: Array, transmission: Transmission) -> tuple[Array, Array, Array]:
    """Joint positions (N, n) with each motor's part below a frequency of its own (n,), with their derivatives."""
    if np.all(cutoffs_hz == cutoffs_hz[0]):
        return low_passed(q, rate, float(cutoffs_hz[0]))
    motors = transmission.motor_position(q)
    position, speed, acceleration = (np.empty_like(motors) for _ in range(3))
    for hz in np.unique(cutoffs_hz):
        own = np.flatnonzero(cutoffs_hz == hz)
        position[:, own], speed[:, own], acceleration[:, own] = low_passed(motors[:, own], rate, float(hz))
    return transmission.joint_position(position), transmission.joint_rate(speed), transmission.joint_rate(acceleration)


def _derivative(x: Array, rate: float) -> Array:
    """Central differences of sixth order, of second order at the ends."""
    out = np.gradient(x, 1.0 / rate, axis=0)
    if len(x) > 7:
        out[3:-3] = (45 * (x[4:-2] - x[2:-4]) - 9 * (x[5:-1] - x[1:-5]) + (x[6:] - x[:-6])) * (rate / 60.0)
    return out


def run_rows(
    signals: Signals,
    robot: Robot,
    cutoffs_hz: Array,
    position_noise: Array,
    reference: Sequence[Array] | None = None,
    reading: Sequence[Array] | None = None,
) -> list[RunRows]:
    """The runs of `reduced` signals with an instrument of each motor's motion below `cutoffs_hz` (n,). `position_noise` (n,): density of
    the motors' positions' noise, rad²/Hz; `reference`: desired positions (N, n) of each run, if logged; `reading`: torque (N, n) of each
    as recorded, if that is at hand."""
    rate, transmission = signals.rate, robot.transmission
    factor = max(1, round(rate / _ROW_RATE))
    top_hz = min(_TOP_HZ, 0.4 * rate / factor, 0.8 * kept_hz(rate) if rate >= _COLUMN_RATE else 0.6 * kept_hz(rate))
    motor_speed = transmission.motor_rate(signals.dq)
    top = usual_speed(motor_speed)
    # Friction is no function of a motion whose direction is not known.
    least = np.maximum(SLOW * top, BOUND * speed_noise(position_noise, kept_hz(rate)))
    least_below = np.maximum(SLOW * top, BOUND * speed_noise(position_noise, cutoffs_hz) if reference is None else 0.0)
    interval = 1.0 / float(signals.report.rate_hz or rate)
    found = []
    for i, run in enumerate(signals.runs):
        if run.stop - run.start < int(4 * rate):
            continue
        t, q = signals.t[run], signals.q[run]
        torque = transmission.torque(signals.torque[run], transmission.measured, Side.MOTOR)
        present = np.isfinite(torque)
        torque = np.where(present, torque, 0.0)
        measured = Motion.of(robot, q, signals.dq[run], signals.ddq[run], t, rate=rate, start=signals.origins[i], cutoff_hz=kept_hz(rate))
        base = q if reference is None else reference[i]
        smooth = _motors_low_passed(base, rate, cutoffs_hz, transmission)
        instrument = Motion.of(robot, *smooth, t, rate=rate, start=signals.origins[i], cutoff_hz=float(cutoffs_hz.max()))
        slow = (np.abs(measured.motor.dq) < least) | (np.abs(instrument.motor.dq) < least_below) | ~present
        ends = int(ENDS * rate)
        slow[:ends] = slow[len(slow) - ends :] = True
        use = ~_widened(slow, int(SETTLE * rate))
        raw = np.nan_to_num(signals.torque[run] if reading is None else reading[i])
        band = Band(len(t), rate, factor, top_hz)
        found.append(RunRows(measured, instrument, torque, raw, use.astype(float), band, cutoffs_hz, interval))
    return found


def speed_noise(density: Array, cutoff_hz: float | Array) -> Array:
    """Standard deviation (n,) of speeds, rad/s, that positions with white noise of this density (n,), rad²/Hz, have below a frequency."""
    return np.asarray(2.0 * np.pi * np.sqrt(density * cutoff_hz**3 / 3.0))


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
