"""The noise in the recorded motion, taken out as far as spectra tell it from motion.

Columns made of noisy accelerations bend every fit: what is noise in them follows no torque, so parameters shrink, most at the
frequencies where there is little motion, and that looks like an effect (an inertia that falls with frequency). If each frequency
is weighed by the share of motion in its power (N. Wiener, 1949), columns become what the motion most likely was given the log,
and what is off in them is no longer correlated with them (regression calibration: R. J. Carroll et al., Measurement Error in
Nonlinear Models, 2006)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..prepared import Signals
from .motion_spectrum import noise_share, position_noise
from .repeated_noise import lines, repeats

Array = np.ndarray


def less_noise(signals: Signals) -> Signals:
    """Signals whose motion has each frequency weighed by the share of motion in its power, run by run and joint by joint."""
    q, dq, ddq = (x.copy() for x in (signals.q, signals.dq, signals.ddq))
    noise = position_noise(signals)
    again = repeats(signals, noise)
    noise = noise * np.where(again > 0.5, lines(signals, noise), 1.0)
    for run in signals.runs:
        if run.stop - run.start > 16:
            share = noise_share(signals.ddq[run], signals.rate, noise)
            for x in (q, dq, ddq):
                x[run] = _weighed(x[run], 1.0 - share)
    known = zip(signals.report.joints, noise, again, strict=True)
    joints = tuple(replace(j, noise=float(s) if np.isfinite(j.noise) else j.noise, repeats=float(k)) for j, s, k in known)
    return replace(signals, q=q, dq=dq, ddq=ddq, report=replace(signals.report, joints=joints))


def _weighed(x: Array, gain: Array) -> Array:
    """Signals (N, n) with each frequency times a gain (F, n). Continued at both ends by what is point-symmetric to them."""
    N = len(x)
    wide = np.concatenate([2.0 * x[0] - x[:0:-1], x, 2.0 * x[-1] - x[-2::-1]])
    # The slope from end to end would leak into every frequency.
    ramp = np.linspace(0.0, 1.0, len(wide))[:, None] * (wide[-1] - wide[0]) + wide[0]
    wave = np.fft.rfft(wide - ramp, axis=0)
    at, own = np.linspace(0.0, 1.0, len(wave)), np.linspace(0.0, 1.0, len(gain))
    less = np.stack([np.interp(at, own, 1.0 - g) for g in gain.T], axis=1)
    return x - np.fft.irfft(wave * less, len(wide), axis=0)[N - 1 : 2 * N - 1]
