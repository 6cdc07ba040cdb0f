"""The noise in the recorded motion, taken out as far as spectra tell it from motion.

Columns made of noisy accelerations bend every fit: what is noise in them follows no torque, so parameters shrink, most at the
frequencies where there is little motion, and that looks like an effect (an inertia that falls with frequency). If each frequency
is weighed by the share of motion in its power (N. Wiener, 1949), columns become what the motion most likely was given the log,
and what is off in them is no longer correlated with them (regression calibration: R. J. Carroll et al., Measurement Error in
Nonlinear Models, 2006)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...signals.signals import Signals
from .motion_spectrum import noise_share, position_noise
from .repeated_noise import lines, repeats

Array = np.ndarray
#: Periods of the highest frequency that is told: so far from an end the bend is all there is, and so far nothing of it.
_BENT = (1.5, 4.0)


def less_noise(signals: Signals) -> Signals:
    """Signals whose motion has each frequency weighed by the share of motion in its power, run by run and joint by joint."""
    q, dq, ddq = (x.copy() for x in (signals.q, signals.dq, signals.ddq))
    noise = position_noise(signals)
    again = repeats(signals, noise)
    noise = noise * np.where(again > 0.5, lines(signals, noise), 1.0)
    # A joint that does not move has nothing but noise, and what the scatter of its spectrum leaves of it would follow no torque either.
    still = np.array([j.suggested_hz == 0.0 for j in signals.report.joints])
    for run in signals.runs:
        if run.stop - run.start > 16:
            share = np.where(still, 1.0, noise_share(signals.ddq[run], signals.rate, noise))
            inside = _away_from_ends(run.stop - run.start, share)
            for x in (q, dq, ddq):
                x[run] -= inside * _part(x[run], share)
    known = zip(signals.report.joints, noise, again, strict=True)
    joints = tuple(replace(j, noise=float(s) if np.isfinite(j.noise) else j.noise, repeats=float(k)) for j, s, k in known)
    return replace(signals, q=q, dq=dq, ddq=ddq, report=replace(signals.report, joints=joints))


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
    """Weights (count, n): 0 near both ends of a run, 1 away from them. How a motion that was cut off went on nobody knows, and what
    continues it is bent where it joins it: at the frequencies that hold more noise than motion, most of what is there is that bend."""
    place = np.minimum(np.arange(count), np.arange(count)[::-1])[:, None]
    told = share < 0.5
    # The highest frequency that is told, in cycles per sample; a joint that none tells of does not move, and has no bend.
    last = np.where(told.any(axis=0), len(share) - 1 - np.argmax(told[::-1], axis=0), len(share) - 1)
    period = 2.0 * (len(share) - 1) / np.maximum(last, 1)
    risen = (place / period - _BENT[0]) / (_BENT[1] - _BENT[0])
    return np.asarray(np.where(told.any(axis=0), np.sin(0.5 * np.pi * np.clip(risen, 0.0, 1.0)) ** 2, 1.0))
