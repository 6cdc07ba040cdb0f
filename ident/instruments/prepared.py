"""From signals to rows and their instrument: the log at full rate, the band that the reference drives, the fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DataError
from ..signals.preparation import ZeroPhase
from .fit import Fit
from .reference_band import START_HZ, reference_bands
from .rows import RunRows, kept_hz, reduced, run_rows, usual_speed

if TYPE_CHECKING:
    from ..model import Model
    from ..signals.signals import Signals

Array = np.ndarray
#: The instrument's filter lies an octave above the reference's band, so that its slope leaves the band as it is.
_ABOVE = 2.0
#: Desired positions count as such where the joints follow them to this share of their motion (rms).
_FOLLOWED = 0.2
#: Cut-off of what counts as recorded, as a share of the rate.
_RAW = 0.45


@dataclass(frozen=True)
class Instrument:
    """What the instrument is: `kind` "q_ref" (desired motion) or "low_band" (measured motion), below `band_hz`; `narrower`: joints whose
    motor's motion in it ends lower → where (Hz), because disturbances move it by a noticeable share at every frequency."""

    kind: str
    band_hz: float
    narrower: Mapping[str, float] = field(default_factory=dict)

    @property
    def motion(self) -> str:
        """Which motion it is, in words."""
        what = "the desired motion" if self.kind == "q_ref" else "the measured motion"
        apart = f" ({', '.join(f'{joint} below {hz:.2g} Hz' for joint, hz in self.narrower.items())})" if self.narrower else ""
        return f"{what} below {self.band_hz:.2g} Hz{apart}"

    def __str__(self) -> str:
        return f"instrument: {self.motion}; faster motion responds to disturbances and is not used to decide"

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        return {"kind": self.kind, "band_hz": self.band_hz, "narrower_hz": dict(self.narrower)}


def full_rate(signals: Signals) -> Signals:
    """The logs at full rate in the widest band, where they are at hand; else the signals as they were prepared."""
    wide = _below(signals, kept_hz(_rate(signals)))
    if wide is None and len(signals.tau) != len(signals.t):
        raise DataError("signals whose rows are fewer than their samples need the logs they were made of, and these are not at hand.")
    return reduced(signals if wide is None else wide)


def _below(signals: Signals, cutoff_hz: float) -> Signals | None:
    """The logs at full rate below a frequency; None where they are not at hand, or too short."""
    if signals.source is None:
        return None
    config = signals.report.config
    options = {k: config[k] for k in ("resample_hz", "max_gap_s") if config.get(k) is not None}
    prepare = ZeroPhase(cutoff_hz=cutoff_hz, decimate=False, standstill=None, saturated="keep", **options)
    try:
        return prepare(signals.source, signals.robot)
    except DataError:
        return None


def readings(signals: Signals, full: Signals) -> list[Array] | None:
    """The torque's reading (N, n) along each run as it was recorded: what is cut off is cut off before any filter. None where the logs are
    not at hand."""
    raw = _below(signals, _RAW * _rate(signals))
    if raw is None or len(raw.runs) != len(full.runs):
        return None
    pairs = zip(raw.runs, full.runs, strict=True)
    return [np.stack([np.interp(full.t[at], raw.t[run], x) for x in raw.torque[run].T], axis=1) for run, at in pairs]


def _rate(signals: Signals) -> float:
    """Samples per second of the logs' uniform runs."""
    return float(signals.report.rate_hz or signals.rate)


def _position_noise(signals: Signals) -> Array:
    """Density (n,) of the noise of the motors' positions, rad²/Hz, white over the logs' rate."""
    joints = np.array([j.noise for j in signals.report.joints])
    joints = np.where(np.isfinite(joints), joints, 0.0)
    return np.asarray(2.0 / _rate(signals) * signals.robot.transmission.K_inverse**2 @ joints**2)


def desired(signals: Signals) -> list[Array] | None:
    """Desired positions (N, n) along each run, where every log has them and the joints follow them."""
    if signals.source is None:
        return None
    logs = {log.name: log for log in signals.source}
    found = []
    for name, run in zip(signals.run_names, signals.runs, strict=True):
        log = logs.get(name) or next((x for x in signals.source if name.startswith(x.name)), None)
        columns = None if log is None else _reference_columns(log, signals.robot.n)
        if columns is None or log is None:
            return None
        t, q = signals.t[run], signals.q[run]
        wanted = np.stack([np.interp(t, log.t, x) for x in columns.T], axis=1)
        moved = np.sqrt(np.mean((q - q.mean(axis=0)) ** 2, axis=0))
        if np.any(np.sqrt(np.mean((q - wanted) ** 2, axis=0)) > _FOLLOWED * np.maximum(moved, 1e-9)):
            return None
        found.append(wanted)
    return found


def _reference_columns(log, n: int) -> Array | None:  # type: ignore[no-untyped-def]
    q = getattr(log, "q_ref", None)
    if q is not None:
        return np.asarray(q)
    names = [f"q_ref{j + 1}" for j in range(n)]
    return np.stack([log.extra[k] for k in names], axis=1) if all(k in log.extra for k in names) else None


def prepared(model: Model, signals: Signals, values: Array | None = None, *, without: Array | None = None) -> tuple[Fit, Instrument, Array]:
    """The fit that a decision starts from, at `values` (k,), its instrument, and the motors' usual speeds (n,). `without` (n,) bool: joints
    whose torque is left out. Raises DataError where no run is long enough or no joint has rows."""
    robot = model.robot
    full = full_rate(signals)
    if without is not None and without.any():
        full = replace(full, torque=np.where(without, np.nan, full.torque))
    reference = desired(full)
    reading = readings(signals, full)
    noise = _position_noise(signals)
    runs = _runs(full, model, np.full(robot.n, START_HZ), noise, reference, reading)
    first = Fit(runs, model, (), values)
    bands = _ABOVE * reference_bands(first, first.solved(2), noise)
    fit = Fit(_runs(full, model, bands, noise, reference, reading), model, (), values)
    if not fit.share.any():
        raise DataError(
            "no stretch of the logs with a moving joint and its torque is long enough for a diagnosis; `ident check` says what"
            " is missing for which joint."
        )
    widest = float(bands.max())
    narrower = {joint: float(hz) for joint, hz in zip(robot.joint_names, bands, strict=True) if hz < widest}
    instrument = Instrument("low_band" if reference is None else "q_ref", widest, narrower)
    return fit, instrument, usual_speed(robot.transmission.motor_rate(full.dq))


def _runs(
    full: Signals, model: Model, bands_hz: Array, noise: Array, reference: Sequence[Array] | None, reading: Sequence[Array] | None
) -> list[RunRows]:
    runs = run_rows(full, model.robot, bands_hz, noise, reference, reading)
    if not runs:
        raise DataError("no stretch of the logs is long enough for a diagnosis: 4 s without a gap are needed.")
    return runs
