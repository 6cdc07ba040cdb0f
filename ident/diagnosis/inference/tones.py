"""Tones: a line in the spectrum of what is left, at one frequency all along the log, which no motion has.

Mains, a fan, a neighbour's machine or a loop that rings show so: nothing of the catalogue keeps one frequency while speeds change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..thresholds import LEVEL

if TYPE_CHECKING:
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved

Array = np.ndarray
#: Half width (share of the frequency, Hz and bins at least) of the band whose median says what noise a line stands in.
_AROUND, _LEAST_HZ, _LEAST_BINS = 0.25, 0.75, 12
#: Lowest frequency looked at, in cycles of the run.
_CYCLES = 12.0
#: Share of the rows' band beyond which their filter bends the spectrum.
_TOP = 0.7


def tone(fit: Fit, frame: Solved) -> tuple[int, float] | None:
    """Motor and frequency (Hz) of the clearest tone; None where noise makes as clear a line more often than once in a hundred logs.

    Of a smooth spectrum the periodogram's ordinates over it are exponential (R. Fisher, Proc. R. Soc. A 125 (1929)); over a level that is
    known from the neighbours alone, they follow Lomax's law. A frequency that the joint's own motion has as a line, too, is no tone: what
    follows that motion has it."""
    best: tuple[float, int, float] = (1.0, 0, 0.0)
    n = frame.residual.shape[1]
    looked = 0
    for run, a, b in zip(fit.runs, frame.edges[:-1], frame.edges[1:], strict=True):
        rate = run.band.row_rate
        count = b - a
        if count < 8 * _CYCLES:
            continue
        frequency = np.fft.rfftfreq(count, 1.0 / rate)
        inside = (frequency > _CYCLES * rate / count) & (frequency < _TOP * run.band.top_hz)
        motion = run.band.rows(run.measured.motor.dq)[run.band.inner]
        looked += n * int(inside.sum())
        for m in range(n):
            if not frame.residual[a:b, m].any():
                continue
            own, chance = _over_smooth(frame.residual[a:b, m], frequency)
            moved, _ = _over_smooth(motion[:, m], frequency)
            clear = np.where(inside & (moved < own / 2.0), chance, 1.0)
            k = int(np.argmin(clear))
            if clear[k] < best[0] and _at_any_speed(frame.residual[a:b, m], motion[:, m], frequency[k] / rate):
                best = (float(clear[k]), m, float(frequency[k]))
    return (best[1], best[2]) if looked * best[0] < LEVEL else None


def _at_any_speed(x: Array, speed: Array, cycles: float) -> bool:
    """Whether a line of x (N,), `cycles` a row, is there with half its size and its phase in the slower and in the faster half of the
    rows: counts of an encoder at a constant speed make a line, too, and of that speed alone."""
    turning = x * np.exp(-2j * np.pi * cycles * np.arange(len(x)))
    live = x != 0.0
    slow = live & (np.abs(speed) <= np.median(np.abs(speed[live])))
    whole, one, other = (turning[rows].mean() if rows.any() else 0.0 for rows in (live, slow, live & ~slow))
    return bool(min(np.real(one * np.conj(whole)), np.real(other * np.conj(whole))) > 0.5 * abs(whole) ** 2)


def _over_smooth(x: Array, frequency: Array) -> tuple[Array, Array]:
    """Periodogram over the mean that noise has in the neighbourhood (from its median), and the probability that noise has as much."""
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
    centres, levels, counts = [], [], []
    k = 1
    while k < len(power):
        half = max(int(max(_AROUND * frequency[k], _LEAST_HZ) / frequency[1]), _LEAST_BINS)
        around = power[max(k - half, 1) : k + half + 1]
        centres.append(k)
        levels.append(float(np.median(around)) / np.log(2.0))
        counts.append(len(around))
        k += max(half // 2, 1)
    bins = np.arange(len(power))
    out = power / np.maximum(np.interp(bins, centres, levels), 1e-300)
    # A window makes neighbours alike in pairs, and a median knows half of what a mean knows.
    known = np.maximum(np.interp(bins, centres, counts) / 4.0, 1.0)
    return out, (1.0 + out / known) ** -known
