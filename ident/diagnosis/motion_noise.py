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

Array = np.ndarray
#: The power of a motion is averaged over this share of all frequencies, either side.
_AVERAGED = 200


def position_noise(signals: Signals) -> Array:
    """Standard deviation (n,) of the positions' noise at full rate, joint side."""
    return np.array([j.noise if np.isfinite(j.noise) else 0.0 for j in signals.report.joints])


def less_noise(signals: Signals) -> Signals:
    """Signals whose motion has each frequency weighed by the share of motion in its power, run by run and joint by joint."""
    q, dq, ddq = (x.copy() for x in (signals.q, signals.dq, signals.ddq))
    noise = position_noise(signals)
    for run in signals.runs:
        if run.stop - run.start > 16:
            share = noise_share(signals.ddq[run], signals.rate, noise)
            for x in (q, dq, ddq):
                x[run] = _weighed(x[run], 1.0 - share)
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
    return np.clip(noise**2 * (2.0 * np.pi * f) ** 4 / np.maximum(power, 1e-300), 0.0, 1.0)


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
