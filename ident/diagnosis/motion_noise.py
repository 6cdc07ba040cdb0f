"""The noise in the recorded motion, taken out as far as spectra tell it from motion.

Columns made of noisy accelerations bend every fit: what is noise in them follows no torque, so parameters shrink, most at the
frequencies where there is little motion, and that looks like an effect (an inertia that falls with frequency). If each frequency
is weighed by the share of motion in its power (N. Wiener, 1949), columns become what the motion most likely was given the log,
and what is off in them is no longer correlated with them (regression calibration: R. J. Carroll et al., Measurement Error in
Nonlinear Models, 2006).

A periodic motion that comes back to the same count rounds off the same in every period: then blocks of time that were held out
hold the same noise as those fitted, and it foretells itself. Such noise counts as often as it comes again."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..prepared import Signals

if TYPE_CHECKING:
    from ..problem import Problem

Array = np.ndarray
#: The power of a motion is averaged over this share of all frequencies, either side.
_AVERAGED = 200
#: Shortest period of a motion, in samples.
_SHORTEST = 50
#: A lag at which a motion differs from itself by this share of its power at most may be its period.
_SAME = 1e-4
#: No reading of torque tells anything below this share of it (rms): drives are not linear to 80 dB.
_READABLE = 1e-4
#: Noise that comes again has at most so many times the power that is usual among the frequencies.
_MOST_LINES = 9.0
#: Samples in which a period is looked for at most; a joint that is slower than this share of its usual top speed stands still.
_LOOKED_AT = 200_000
_STILL = 0.05


def position_noise(signals: Signals) -> Array:
    """Standard deviation (n,) of the positions' noise at full rate, joint side."""
    return np.array([j.noise if np.isfinite(j.noise) else 0.0 for j in signals.report.joints])


def less_noise(signals: Signals) -> Signals:
    """Signals whose motion has each frequency weighed by the share of motion in its power, run by run and joint by joint."""
    q, dq, ddq = (x.copy() for x in (signals.q, signals.dq, signals.ddq))
    noise = position_noise(signals)
    again = repeats(signals, noise)
    noise = noise * np.where(again > 0.5, _lines(signals, noise), 1.0)
    for run in signals.runs:
        if run.stop - run.start > 16:
            share = noise_share(signals.ddq[run], signals.rate, noise)
            for x in (q, dq, ddq):
                x[run] = _weighed(x[run], 1.0 - share)
    known = zip(signals.report.joints, noise, again, strict=True)
    joints = tuple(replace(j, noise=float(s) if np.isfinite(j.noise) else j.noise, repeats=float(k)) for j, s, k in known)
    return replace(signals, q=q, dq=dq, ddq=ddq, report=replace(signals.report, joints=joints))


def _lines(signals: Signals, noise: Array) -> Array:
    """By how much the noise (n,) of positions is larger than a spectrum's usual level says: noise that comes again with a period is all
    in lines, and hardly any between. From accelerations near the cut-off, where there is little else; 1 at least."""
    run = max(signals.runs, key=lambda r: r.stop - r.start)
    cutoff = signals.report.cutoff_hz
    if cutoff is None or run.stop - run.start <= 16:
        return np.ones(len(noise))
    f = np.fft.rfftfreq(run.stop - run.start, 1.0 / signals.rate)
    over = _noise_over(signals.ddq[run], signals.rate, np.maximum(noise, 1e-300))
    near = over[(f > 0.6 * cutoff) & (f < 0.9 * cutoff)]
    return np.sqrt(np.clip(1.0 / np.maximum(np.median(near, axis=0), 1e-300), 1.0, _MOST_LINES)) if len(near) else np.ones(len(noise))


def repeats(signals: Signals, noise: Array) -> Array:
    """How often the `noise` (n,) of each joint's positions comes again (n,), as far as periods of the motion differ by less than it."""
    period = _period(signals.q[:_LOOKED_AT])
    if period is None:
        return np.zeros(signals.robot.n)
    apart, speed = np.abs(signals.q[period:] - signals.q[:-period]), np.abs(signals.dq[:-period])
    moves = speed > _STILL * np.quantile(speed, 0.95, axis=0)
    spread = np.array([1.4826 * np.median(a[m]) if m.any() else np.inf for a, m in zip(apart.T, moves.T, strict=True)])
    band = min(1.0, 2.0 * (signals.report.cutoff_hz or signals.rate) / signals.rate)
    alike = 1.0 - spread**2 / np.maximum(2.0 * noise**2 * band, 1e-300)
    return np.where(noise > 0, np.clip(alike, 0.0, 1.0), 0.0) * (len(signals.q) / period - 1.0)


def _period(q: Array) -> int | None:
    """Samples after which positions (N, n) repeat themselves best, the shortest if several do as well; None if none does."""
    N = len(q)
    most = N // 2
    if most <= _SHORTEST:
        return None
    x = q - q.mean(axis=0)
    power = np.sqrt(np.mean(x**2, axis=0))
    x = x[:, power > 0] / power[power > 0]
    if not x.shape[1]:
        return None
    wave = np.fft.rfft(x, 2 * N, axis=0)
    products = np.fft.irfft(np.sum(np.abs(wave) ** 2, axis=1))[: most + 1]
    sums = np.append(0.0, np.cumsum(np.sum(x**2, axis=1)))
    lag = np.arange(most + 1)
    apart = (sums[N - lag] + sums[N] - sums[lag] - 2.0 * products) / (N - lag) / (2.0 * x.shape[1])
    best = float(apart[_SHORTEST:].min())
    if best > _SAME:
        return None
    return int(_SHORTEST + np.argmax(apart[_SHORTEST:] <= max(4.0 * best, 1e-12)))


def doubtful_rows(problem: Problem) -> Array:
    """Rows (M, n) of what counts as noise in excess of what the residual shows.

    Torque that errors of the positions would make: as often as the same noise comes again; and of what was taken out of the motion as
    noise, which may have been motion. And the share of the torque below which no reading tells anything."""
    signals = problem.signals
    rng = np.random.default_rng(0)
    noise, again = position_noise(signals), np.array([j.repeats for j in signals.report.joints])
    power = np.sum(np.where(signals.valid, signals.tau, 0.0) ** 2, axis=0) / np.maximum(signals.valid.sum(axis=0), 1)
    out = _READABLE * np.sqrt(power) * rng.normal(size=signals.tau.shape)
    if not noise.any():
        return np.asarray(out)
    values = np.zeros(len(problem.model.names)) if problem.reference is None else problem.reference
    for block in signals.blocks(None):
        motion = problem.motion(block.samples)
        f = np.fft.rfftfreq(len(motion), 1.0 / signals.rate)[:, None]
        size = noise * np.sqrt(again + _taken_out(motion.joint.ddq, signals.rate, noise))
        wave = size * np.fft.rfft(rng.normal(size=motion.joint.ddq.shape), axis=0) * (2.0 * np.pi * f) ** 2
        ddq = np.fft.irfft(np.where(f <= (signals.report.cutoff_hz or np.inf), wave, 0.0), len(motion), axis=0)
        shaken = replace(motion, joint=replace(motion.joint, ddq=motion.joint.ddq + ddq))
        motor = replace(motion.motor, ddq=signals.robot.transmission.motor_rate(shaken.joint.ddq))
        shaken = replace(shaken, motor=motor)
        out[block.rows] += block.reduce(problem.model.torque(shaken, values) - problem.model.torque(motion, values))
    return np.asarray(out)


def noise_share(ddq: Array, rate: float, noise: Array) -> Array:
    """Share (F, n) of noise in the power of accelerations (N, n), at the frequencies of their Fourier transform, for positions with
    white noise of standard deviation `noise` (n,)."""
    return np.minimum(_noise_over(ddq, rate, noise), 1.0)


def _taken_out(ddq: Array, rate: float, noise: Array) -> Array:
    """The share (F, n) of noise that there was in accelerations (N, n) before it was taken out: s of s / (1 − s)², which is what there
    would be of it beside what is left."""
    over = np.maximum(_noise_over(ddq, rate, noise), 1e-12)
    return np.asarray((2.0 * over + 1.0 - np.sqrt(4.0 * over + 1.0)) / (2.0 * over))


def _noise_over(ddq: Array, rate: float, noise: Array) -> Array:
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
