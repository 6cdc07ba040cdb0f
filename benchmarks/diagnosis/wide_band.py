"""The signals that the oracle looks at: as wide a band as the noise of the positions allows, that noise taken out of the motion.

Columns made of noisy accelerations bend every fit. If each frequency is weighed by the share of motion in its power (N. Wiener, 1949),
columns become what the motion most likely was given the log (regression calibration: R. J. Carroll et al., Measurement Error in Nonlinear
Models, 2006)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.signals import Signals
from ident.signals.cutoff import HIGHEST
from ident.signals.preparation import make_preparation

Array = np.ndarray
#: The rows' low-pass lies where the noise of the positions is one thousandth of the power of the accelerations; that of the
#: positions themselves lies higher by the share that a preparation puts between the two.
_ROWS_BELOW = 0.4
#: A band that is not wider than this is as good as another. Accelerations count as told where noise makes up this share of their power.
_WIDER = 1.05
_TOLD = 0.2
#: The power of a motion is averaged over this share of all frequencies, either side.
_AVERAGED = 200
#: Periods of the highest frequency that is told: so far from an end the bend is all there is, and so far nothing of it.
_BENT = (1.5, 4.0)


def analysis_signals(signals: Signals, held: Signals | None) -> tuple[Signals, Signals | None]:
    """Fit and held-out signals in a wide band, the noise in the motion taken out as far as can be."""
    signals, held = _in_wide_band(signals, held)
    return less_noise(signals), None if held is None else less_noise(held)


def _in_wide_band(signals: Signals, held: Signals | None) -> tuple[Signals, Signals | None]:
    """Both prepared anew, with a wider band, where the cut-off was not given and the logs are at hand; else as they are."""
    narrow = signals.report.cutoff_hz
    if signals.source is None or signals.report.config.get("cutoff_hz") is not None or narrow is None:
        return signals, held
    if held is not None and held.source is None:
        return signals, held
    own = [j.suggested_hz for j in signals.report.joints if j.suggested_hz > 0]
    cutoff = min(HIGHEST * signals.report.rate_hz, max(float(np.median(own)) / _ROWS_BELOW if own else np.inf, narrow))
    if cutoff <= _WIDER * narrow:
        return signals, held
    # Motion that comes in bursts allows a band in which there is mostly noise the rest of the time.
    calmer = max(_told_up_to(_prepared(signals, signals, cutoff)) / _ROWS_BELOW, narrow)
    cutoff = min(cutoff, calmer)
    if cutoff <= _WIDER * narrow:
        return signals, held
    return _prepared(signals, signals, cutoff), None if held is None else _prepared(held, signals, cutoff)


def _prepared(signals: Signals, like: Signals, cutoff: float) -> Signals:
    assert signals.source is not None
    return make_preparation(**{**like.report.config, "cutoff_hz": cutoff, "row_cutoff_hz": None})(signals.source, signals.robot)


def less_noise(signals: Signals) -> Signals:
    """Signals whose motion has each frequency weighed by the share of motion in its power, run by run and joint by joint."""
    q, dq, ddq = (x.copy() for x in (signals.q, signals.dq, signals.ddq))
    noise = _position_noise(signals)
    still = np.array([j.suggested_hz == 0.0 for j in signals.report.joints])
    for run in signals.runs:
        if run.stop - run.start > 16:
            share = np.where(still, 1.0, noise_share(signals.ddq[run], signals.rate, noise))
            inside = _away_from_ends(run.stop - run.start, share)
            for x in (q, dq, ddq):
                x[run] -= inside * _part(x[run], share)
    return replace(signals, q=q, dq=dq, ddq=ddq)


def noise_share(ddq: Array, rate: float, noise: Array) -> Array:
    """Share (F, n) of noise in the power of accelerations (N, n), at the frequencies of their Fourier transform, for positions with
    white noise of standard deviation `noise` (n,)."""
    taper = np.hanning(len(ddq) + 2)[1:-1, None]
    power = np.abs(np.fft.rfft(ddq * taper, axis=0)) ** 2 / float(np.sum(taper**2))
    near = np.ones(2 * max(1, len(ddq) // _AVERAGED) + 1)
    known = np.convolve(np.ones(len(power)), near, "same")
    power = np.stack([np.convolve(p, near, "same") / known for p in power.T], axis=1)
    f = np.fft.rfftfreq(len(ddq), 1.0 / rate)[:, None]
    return np.asarray(np.minimum(noise**2 * (2.0 * np.pi * f) ** 4 / np.maximum(power, 1e-300), 1.0))


def _position_noise(signals: Signals) -> Array:
    """Standard deviation (n,) of the positions' noise at full rate, joint side."""
    return np.array([j.noise if np.isfinite(j.noise) else 0.0 for j in signals.report.joints])


def _told_up_to(signals: Signals) -> float:
    """Frequency (Hz) up to which noise makes up a small share of the power of accelerations, at the median of the joints that move, in
    the longest run."""
    run = max(signals.runs, key=lambda r: r.stop - r.start)
    count = run.stop - run.start
    moves = np.array([j.suggested_hz > 0 for j in signals.report.joints])
    if count <= 16 or not moves.any():
        return 0.5 * signals.rate
    share = np.median(noise_share(signals.ddq[run], signals.rate, _position_noise(signals))[:, moves], axis=1)
    # From the top of the band downwards: between the harmonics of a motion there may be nothing but noise.
    good = np.flatnonzero(share < _TOLD)
    return float(np.fft.rfftfreq(count, 1.0 / signals.rate)[good[-1]]) if len(good) else 0.0


def _part(x: Array, share: Array) -> Array:
    """A share (F, n) of each frequency in signals (N, n). Continued at both ends by what is point-symmetric to them."""
    N = len(x)
    wide = np.concatenate([2.0 * x[0] - x[:0:-1], x, 2.0 * x[-1] - x[-2::-1]])
    # The slope from end to end would leak into every frequency.
    ramp = np.linspace(0.0, 1.0, len(wide))[:, None] * (wide[-1] - wide[0]) + wide[0]
    wave = np.fft.rfft(wide - ramp, axis=0)
    at, own = np.linspace(0.0, 1.0, len(wave)), np.linspace(0.0, 1.0, len(share))
    taken = np.stack([np.interp(at, own, s) for s in share.T], axis=1)
    return np.asarray(np.fft.irfft(wave * taken, len(wide), axis=0)[N - 1 : 2 * N - 1])


def _away_from_ends(count: int, share: Array) -> Array:
    """Weights (count, n): 0 near both ends of a run, 1 away from them: what continues a motion that was cut off is bent where it joins."""
    place = np.minimum(np.arange(count), np.arange(count)[::-1])[:, None]
    told = share < 0.5
    # The highest frequency that is told, in cycles per sample; a joint that none tells of does not move, and has no bend.
    last = np.where(told.any(axis=0), len(share) - 1 - np.argmax(told[::-1], axis=0), len(share) - 1)
    period = 2.0 * (len(share) - 1) / np.maximum(last, 1)
    risen = (place / period - _BENT[0]) / (_BENT[1] - _BENT[0])
    return np.asarray(np.where(told.any(axis=0), np.sin(0.5 * np.pi * np.clip(risen, 0.0, 1.0)) ** 2, 1.0))
