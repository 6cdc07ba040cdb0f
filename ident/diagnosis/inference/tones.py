"""Tones: a line in the spectrum of what is left, at one frequency all along the log, which no motion has.

Mains, a fan, a neighbour's machine or a loop that rings show so: nothing of the catalogue keeps one frequency while speeds change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..thresholds import LEVEL

if TYPE_CHECKING:
    from ..scoring.fit import Fit, Solved

Array = np.ndarray
#: Half width (share of the frequency, and Hz) of the band that says what noise a line stands in; bins of a line itself.
_AROUND, _LEAST_HZ, _OWN = 0.25, 0.75, 3
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
            best = min(best, (float(clear[k]), m, float(frequency[k])))
    return (best[1], best[2]) if looked * best[0] < LEVEL else None


def _over_smooth(x: Array, frequency: Array) -> tuple[Array, Array]:
    """Periodogram over the mean that noise has in the neighbourhood (from its median), and the probability that noise has as much."""
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
    step = frequency[1]
    out, chance = np.zeros_like(power), np.ones_like(power)
    for k in range(len(power)):
        half = max(int(max(_AROUND * frequency[k], _LEAST_HZ) / step), 4 * _OWN)
        around = np.concatenate([power[max(k - half, 1) : max(k - _OWN, 1)], power[k + _OWN + 1 : k + half + 1]])
        level = float(np.median(around)) / np.log(2.0) if len(around) else np.inf
        out[k] = power[k] / level if level > 0 else 0.0
        # A window makes neighbours alike in pairs, and a median knows half of what a mean knows.
        known = max(len(around) / 4.0, 1.0)
        chance[k] = (1.0 + out[k] / known) ** -known
    return out, chance
