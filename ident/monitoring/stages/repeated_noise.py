"""Noise that comes again.

A periodic motion that comes back to the same count rounds off the same in every period: then blocks of time that were held out
hold the same noise as those fitted, and it foretells itself. Such noise counts as often as it comes again."""

from __future__ import annotations

import numpy as np

from ...signals.signals import Signals
from .motion_spectrum import noise_over

Array = np.ndarray
#: Shortest period of a motion, in samples.
_SHORTEST = 50
#: A lag at which a motion differs from itself by this share of its power at most may be its period.
_SAME = 1e-4
#: Noise that comes again has at most so many times the power that is usual among the frequencies.
_MOST_LINES = 9.0
#: Samples in which a period is looked for at most; a joint that is slower than this share of its usual top speed stands still.
_LOOKED_AT = 200_000
_STILL = 0.05


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


def lines(signals: Signals, noise: Array) -> Array:
    """By how much the noise (n,) of positions is larger than a spectrum's usual level says: noise that comes again with a period is all
    in lines, and hardly any between. From accelerations near the cut-off, where there is little else; 1 at least."""
    run = max(signals.runs, key=lambda r: r.stop - r.start)
    cutoff = signals.report.cutoff_hz
    if cutoff is None or run.stop - run.start <= 16:
        return np.ones(len(noise))
    f = np.fft.rfftfreq(run.stop - run.start, 1.0 / signals.rate)
    over = noise_over(signals.ddq[run], signals.rate, np.maximum(noise, 1e-300))
    near = over[(f > 0.6 * cutoff) & (f < 0.9 * cutoff)]
    return np.sqrt(np.clip(1.0 / np.maximum(np.median(near, axis=0), 1e-300), 1.0, _MOST_LINES)) if len(near) else np.ones(len(noise))


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
