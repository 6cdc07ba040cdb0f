"""The noise of the positions beside the motion: what share of each frequency's power it is."""

from __future__ import annotations

import numpy as np

from ...signals.signals import Signals

Array = np.ndarray
#: The power of a motion is averaged over this share of all frequencies, either side.
_AVERAGED = 200


def position_noise(signals: Signals) -> Array:
    """Standard deviation (n,) of the positions' noise at full rate, joint side."""
    return np.array([j.noise if np.isfinite(j.noise) else 0.0 for j in signals.report.joints])


def noise_share(ddq: Array, rate: float, noise: Array) -> Array:
    """Share (F, n) of noise in the power of accelerations (N, n), at the frequencies of their Fourier transform, for positions with
    white noise of standard deviation `noise` (n,)."""
    return np.minimum(noise_over(ddq, rate, noise), 1.0)


def taken_out(ddq: Array, rate: float, noise: Array) -> Array:
    """The share (F, n) of noise that there was in accelerations (N, n) before it was taken out: s of s / (1 − s)², which is what there
    would be of it beside what is left."""
    over = np.maximum(noise_over(ddq, rate, noise), 1e-12)
    return np.asarray((2.0 * over + 1.0 - np.sqrt(4.0 * over + 1.0)) / (2.0 * over))


def noise_over(ddq: Array, rate: float, noise: Array) -> Array:
    """Power of the noise over that of accelerations (N, n) around each frequency, (F, n)."""
    taper = np.hanning(len(ddq) + 2)[1:-1, None]
    power = np.abs(np.fft.rfft(ddq * taper, axis=0)) ** 2 / float(np.sum(taper**2))
    near = np.ones(2 * max(1, len(ddq) // _AVERAGED) + 1)
    known = np.convolve(np.ones(len(power)), near, "same")
    power = np.stack([np.convolve(p, near, "same") / known for p in power.T], axis=1)
    f = np.fft.rfftfreq(len(ddq), 1.0 / rate)[:, None]
    return np.asarray(noise**2 * (2.0 * np.pi * f) ** 4 / np.maximum(power, 1e-300))


def told_up_to(signals: Signals, most: float) -> float:
    """Frequency (Hz) up to which noise makes up less than a share of the power of accelerations, at the median of the joints that move, in
    the longest run."""
    run = max(signals.runs, key=lambda r: r.stop - r.start)
    count = run.stop - run.start
    top = 0.5 * signals.rate
    moves = np.array([j.suggested_hz > 0 for j in signals.report.joints])
    if count <= 16 or not moves.any():
        return top
    share = np.median(noise_share(signals.ddq[run], signals.rate, position_noise(signals))[:, moves], axis=1)
    f = np.fft.rfftfreq(count, 1.0 / signals.rate)
    # From the top of the band downwards: between the harmonics of a motion there may be nothing but noise.
    good = np.flatnonzero(share < most)
    return float(f[good[-1]]) if len(good) else 0.0
