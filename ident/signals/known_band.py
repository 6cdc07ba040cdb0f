"""The band in which a motion is known: what a fit on raw differences of positions is judged by.

Second differences of an encoder's steps hold more noise than motion. Torque predicted from them is off by the noise times the inertia, so a
right model looks worse than one that least squares has shrunk. Within the band that the positions' noise allows, both sides of the equation
are low-passed, and what is left is the error of the model."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .assemble import half_gain
from .cutoff import choose_cutoff
from .filters import RowFilter, butterworth_transient, central_differences, zero_phase_lowpass
from .masks import Standstill
from .resample import bridge
from .sound import REVERSAL_SHARE, UNSOUND, filtered_share

if TYPE_CHECKING:
    from .signals import Signals

Array = np.ndarray
_ORDER, _ACCURACY = 4, 6
#: As a preparation chooses them by itself: row cut-off over the derivatives', rows a second over their cut-off's inverse.
_ROW_SHARE = 0.4


def has_raw_derivatives(signals: Signals) -> bool:
    """Whether accelerations are differences of positions that nothing was filtered from."""
    report = signals.report
    return report.cutoff_hz is None and report.config.get("method") == "central_difference"


def unjudged(signals: Signals) -> str:
    """What to say of an error on these signals that raw accelerations spoil, because they are on disk; "" of others."""
    if not has_raw_derivatives(signals) or isinstance(signals.q, np.ndarray):
        return ""
    return (
        "the torque error is computed with raw accelerations, because the logs are streamed: a correct model may look"
        " worse than a wrong one. Compare fits with `ident validate` or `ident compare` on logs that are read into memory (--no-stream)."
    )


def within_known_band(signals: Signals, cutoff_hz: float | None = None) -> Signals:
    """The same motion and torque, low-passed where the motion is known; the signals themselves where they are not raw, or too short.

    `cutoff_hz` of the derivatives; None: chosen from the positions' noise, as a preparation does."""
    if not has_raw_derivatives(signals) or not isinstance(signals.q, np.ndarray):
        return signals
    robot, rate = signals.robot, signals.rate
    cutoff_hz = cutoff_hz or signals.report.config.get("cutoff_hz")
    if cutoff_hz is None:
        pieces = [signals.q[run] for run in signals.runs if run.stop - run.start >= 32]
        if not pieces:
            return signals
        cutoff_hz = choose_cutoff(pieces, rate, robot.joint_names, [j.prismatic for j in robot.joints]).cutoff_hz
    row_filter = RowFilter.lowpass(_ROW_SHARE * cutoff_hz, rate, max(1, int(rate / cutoff_hz + 1e-9)))
    sound, near = _at_samples(signals, signals.valid), _at_samples(signals, signals.near_reversal)
    parts = [_run(signals, run, cutoff_hz, row_filter, sound, near) for run in signals.runs]
    kept = [(i, part) for i, part in enumerate(parts) if part is not None]
    if not kept:
        return signals
    joined: dict[str, Any] = {k: np.concatenate([part[k] for _, part in kept]) for k in kept[0][1]}
    resting = joined.pop("resting")
    missing = joined.pop("missing") > UNSOUND
    valid = ~missing & (resting <= Standstill().allowed(resting))
    joined["tau"][missing] = np.nan
    edges = np.cumsum([0, *(len(part["t"]) for _, part in kept)]).tolist()
    report = replace(
        signals.report, cutoff_hz=cutoff_hz, cutoff_reason="where the motion is known", row_cutoff_hz=half_gain(row_filter, rate),
        row_rate_hz=rate / row_filter.factor, samples=edges[-1], rows=len(valid),
    )  # fmt: skip
    return replace(
        signals, **joined, valid=valid, runs=tuple(slice(a, b) for a, b in itertools.pairwise(edges)),
        run_names=tuple(signals.run_names[i] for i, _ in kept), origins=tuple(signals.origins[i] for i, _ in kept),
        row_filter=row_filter, report=report, source=None,
    )  # fmt: skip


def _at_samples(signals: Signals, flag: Array | None) -> Array:
    """Flags of rows (M, n) at the samples (N, n): that of the nearest row."""
    if flag is None:
        return np.zeros(signals.torque.shape, bool)
    if signals.row_filter is None:
        return flag
    found = np.zeros(signals.torque.shape, bool)
    for run, rows in zip(signals.runs, signals.row_runs, strict=True):
        if rows.stop > rows.start:
            centres = signals.centres[rows]
            found[run] = flag[rows][np.searchsorted((centres[:-1] + centres[1:]) / 2, np.arange(run.start, run.stop))]
    return found


def _run(signals: Signals, run: slice, cutoff: float, row_filter: RowFilter, sound: Array, near: Array) -> dict[str, Array] | None:
    """One run: samples and rows; None where it is too short for the filters."""
    rate, p = signals.rate, _ACCURACY // 2
    margin = int(np.ceil(butterworth_transient(cutoff, _ORDER) * rate))
    inner = slice(p + margin, run.stop - run.start - p - margin)
    if inner.stop - inner.start < len(row_filter.taps):
        return None
    q = zero_phase_lowpass(signals.q[run], cutoff, rate, _ORDER)
    dq, ddq = (x[margin : len(x) - margin] for x in central_differences(q, rate, _ACCURACY))
    t, torque = signals.t[run][inner], signals.torque[run][inner]
    found = {"t": t, "q": q[inner], "dq": dq, "ddq": ddq, "torque": torque, "tau": row_filter.apply(bridge(t, torque))}
    missing = ~np.isfinite(torque)
    shares = {"missing": missing, "resting": ~sound[run][inner] & ~missing}
    found |= {name: filtered_share(row_filter, flag) for name, flag in shares.items()}
    if signals.near_reversal is not None:
        found["near_reversal"] = filtered_share(row_filter, near[run][inner]) > REVERSAL_SHARE
    return found
