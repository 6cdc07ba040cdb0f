"""The cut-off frequency of the derivatives, chosen from the recorded positions.

Differentiating twice multiplies a position's noise by (2πf)². Per joint, the noise that a low-pass at f leaves in the
acceleration is ∫₀^f L (2πν)⁴ dν = L (2π)⁴ f⁵/5, with L the level of the position's spectrum beyond the motion; it must stay
below a small share of the acceleration's own power. Noise is seldom white (drives filter, stamps jitter), so L is the highest
level found anywhere beyond 3 f, or on any plateau. Where noise allows more than the motion needs, the motion decides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = np.ndarray

#: Share of noise in the power of the accelerations that is accepted (-30 dB: then least squares shrinks by 0.1 % at most).
NOISE_SHARE = 1e-3
#: The cut-off is not put higher than this multiple of the frequency below which 99 % of the acceleration's power lies:
#: at a quarter of its cut-off the fourth-order filter run both ways takes 2e-5 off the motion.
MOTION_MULTIPLE = 4.0
#: Rows wanted of each joint: thirty for each of the about 13 parameters it brings, so that the colour of the noise can be estimated
#: and the intervals hold (measured: with ten, 95 % intervals cover 92.6 %).
_FEWEST_ROWS = 400.0
#: Rows of each joint below which no fit of about 13 parameters a joint is worth having: five times as many.
_TOO_FEW_ROWS = 65.0
#: Highest cut-off as a share of the sample rate: differences and resampling are exact to 1e-3 up to there.
HIGHEST = 0.2
#: A joint that accelerates less than this share of the most accelerated one of its kind does not decide for all.
_WEAK = 0.02
#: The noise level at f is looked for beyond this multiple of f: nearer, the position's spectrum is still that of weak motion.
_BEYOND = 3.0
#: Once the share of noise exceeds this, higher frequencies are not looked at any more: beyond a filter in the drive the noise
#: level falls, and what is noise would pass as motion. A smaller excess may be a stretch of weak motion before a stronger one.
_TOLERATED = 1e-2
#: A cut-off of fewer periods than this in the longest piece leaves nothing of it: a joint that asks for one (its position jumps) is
#: left to its own, as long as others do not ask for it.
_PERIODS = 40.0
_WINDOW = 1 << 17
_MOST_WINDOWS = 32


@dataclass(frozen=True)
class JointSpectrum:
    """What a joint's recorded positions say. Frequencies in Hz.

    `noise`: standard deviation of the position's white noise (rad or m); `level`: noise level at the cut-off suggested
    (rad²/Hz or m²/Hz); `acceleration`: root mean square of the motion's acceleration; `suggested_hz`: the highest cut-off the
    noise allows (0: the joint does not move visibly)."""

    name: str
    noise: float
    level: float
    acceleration: float
    suggested_hz: float

    @property
    def moves(self) -> bool:
        return self.suggested_hz > 0

    def velocity_noise(self, cutoff: float) -> float:
        """Standard deviation of the velocity's noise behind a low-pass at `cutoff` (Hz)."""
        return math.sqrt(self.level * (2 * math.pi) ** 2 * cutoff**3 / 3)

    def acceleration_noise(self, cutoff: float) -> float:
        """Variance of the acceleration's noise behind a low-pass at `cutoff` (Hz)."""
        return self.level * (2 * math.pi) ** 4 * cutoff**5 / 5


@dataclass(frozen=True)
class CutoffChoice:
    """The cut-off for all joints and why. `unheard`: joints that asked for one that would have left nothing of the log."""

    cutoff_hz: float
    reason: str
    joints: tuple[JointSpectrum, ...]
    unheard: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        return {"cutoff_hz": self.cutoff_hz, "reason": self.reason}


def position_spectrum(pieces: Sequence[Array], rate: float) -> tuple[Array, Array]:
    """Frequencies (F,) and one-sided power density (F, n) of the acceleration, from second differences of uniform positions.

    Second differences flatten the spectrum, so that a window's side lobes of the slow motion do not cover the noise."""
    longest = max(len(p) for p in pieces) - 2
    size = min(longest, _WINDOW)
    windows = [(p, start) for p in pieces for start in range(0, max(1, len(p) - 2 - size + 1), max(1, size // 2)) if len(p) >= 16]
    chosen = windows if len(windows) <= _MOST_WINDOWS else [windows[i] for i in np.linspace(0, len(windows) - 1, _MOST_WINDOWS).astype(int)]
    total, weight = np.zeros((size // 2 + 1, pieces[0].shape[1])), 0.0
    taper = np.zeros((0, 1))
    for piece, start in chosen:
        second = np.diff(piece[start : start + size + 2], 2, axis=0) * rate**2
        if len(taper) != len(second):
            taper = np.hanning(len(second) + 2)[1:-1, None]
        total += np.abs(np.fft.rfft(second * taper, size, axis=0)) ** 2 * 2 / rate
        weight += float(np.sum(taper**2))
    return np.fft.rfftfreq(size, 1 / rate), total / max(weight, 1e-300)


def choose_cutoff(
    pieces: Sequence[Array], rate: float, names: Sequence[str], prismatic: Sequence[bool], *, highest: float | None = None
) -> CutoffChoice:
    """Choose a cut-off from uniform positions: `pieces` (N_i, n) each, at `rate` (Hz).

    `highest` (Hz): a bound from elsewhere, such as a run that was sampled more slowly."""
    f, power = position_spectrum(pieces, rate)
    transfer = (2 * np.sin(np.pi * f / rate) * rate) ** 4
    cap = min(HIGHEST * rate, highest or math.inf)
    found = [_joint(f, power[:, j], transfer, rate, cap, name) for j, name in enumerate(names)]
    duration = sum(len(p) for p in pieces) / rate
    strongest = {
        kind: max((s.acceleration for s, p in zip(found, prismatic, strict=True) if p == kind and s.moves), default=0.0)
        for kind in (True, False)
    }
    deciding = [s for s, p in zip(found, prismatic, strict=True) if s.moves and s.acceleration >= _WEAK * strongest[p]]
    if not deciding:
        fallback = min(cap, max(10 * f[1] if len(f) > 1 else cap, min(10.0, rate / 20)))
        return CutoffChoice(float(fallback), "no joint's motion exceeds the noise of its position; a default value is used", tuple(found))
    least = _PERIODS * rate / max(len(p) for p in pieces)
    heard = [s for s in deciding if s.suggested_hz >= least] or deciding
    unheard = tuple(s.name for s in deciding if s not in heard)
    deciding = heard
    quietest = min(deciding, key=lambda s: s.suggested_hz)
    noise = quietest.suggested_hz
    widest = max(deciding, key=lambda s: _motion_band(f, power, names.index(s.name), noise))
    band = _motion_band(f, power, names.index(widest.name), noise)
    needed = max(MOTION_MULTIPLE * band, _FEWEST_ROWS / duration)
    floor = min(_TOO_FEW_ROWS / duration, needed, cap)
    if noise < floor:
        why = (
            f"the noise of {quietest.name}'s position requires {noise:.3g} Hz, which would leave too few independent rows in"
            f" {duration:.3g} s; look for the source of that noise"
        )
        return CutoffChoice(float(floor), why, tuple(found), unheard)
    if noise <= needed:
        why = f"the noise of {quietest.name}'s position allows no more (its share in the acceleration stays below {NOISE_SHARE:g})"
        if noise >= 0.999 * cap:
            why = "a fixed share of the sample rate; neither noise nor motion requires less"
        return CutoffChoice(float(noise), why, tuple(found), unheard)
    why = f"{MOTION_MULTIPLE:g} times {band:.3g} Hz, below which 99 % of {widest.name}'s acceleration lies"
    if needed > MOTION_MULTIPLE * band:
        why = f"the log is short ({duration:.3g} s), and less would leave too few independent rows"
    return CutoffChoice(float(needed), why, tuple(found), unheard)


def _motion_band(f: Array, power: Array, j: int, upto: float) -> float:
    """Frequency below which 99 % of a joint's acceleration power lies, of that below `upto`."""
    inside = f <= upto
    total = np.cumsum(power[inside, j])
    return float(f[np.searchsorted(total, 0.99 * total[-1])])


def _joint(f: Array, power: Array, transfer: Array, rate: float, cap: float, name: str) -> JointSpectrum:
    step = f[1] - f[0] if len(f) > 1 else rate
    position = np.divide(power, transfer, out=np.zeros_like(power), where=transfer > 0)
    top = (f > 0.25 * rate) & (f < 0.45 * rate)
    # A periodogram's values are exponentially distributed: their median is ln 2 of their mean.
    white = float(np.median(position[top])) / math.log(2) if top.any() else 0.0
    noise = math.sqrt(white * rate / 2)
    signal = np.cumsum(power) * step
    inside = np.flatnonzero((f > 0) & (f <= cap))
    if not len(inside) or signal[-1] <= 0:
        return JointSpectrum(name, noise, white, 0.0, 0.0)
    # Where the motion is: half the power of its velocity, on which noise weighs less.
    speed = np.cumsum(np.divide(power, np.sqrt(transfer), out=np.zeros_like(power), where=transfer > 0)[inside])
    start = int(np.searchsorted(speed, 0.5 * speed[-1]))
    level = _noise_level(f, position, rate, _BEYOND * f[inside], _BEYOND * f[inside[start]])
    share = level * (2 * np.pi) ** 4 * f[inside] ** 5 / 5 / np.maximum(signal[inside], 1e-300)
    good = start + np.flatnonzero(share[start:] <= NOISE_SHARE)
    if not len(good):
        return JointSpectrum(name, noise, white, 0.0, 0.0)
    over = np.flatnonzero(share[good[0] :] > _TOLERATED)
    end = good[0] + int(over[0]) if len(over) else len(share)
    best = int(good[good < end][-1])
    inner = signal[: inside[best] + 1]
    return JointSpectrum(
        name,
        noise,
        float(level[best]),
        math.sqrt(inner[-1]),
        float(f[inside[best]]),
    )


def _noise_level(f: Array, position: Array, rate: float, beyond: Array, motion: float) -> Array:
    """Noise level of the position's spectrum, for each frequency of `beyond`: the highest of any octave beyond it (medians, so
    that lines do not count), or of any plateau above `motion` (Hz). A plateau (two octaves within a factor of three) is noise
    even where the spectrum falls again behind it, as behind a filter in the drive: the spectrum of a motion has none."""
    edges = 0.45 * rate * 2.0 ** np.arange(-1, -40, -0.5)
    starts, levels = [], []
    for low in edges:
        octave = (f > low) & (f <= 2 * low)
        if octave.sum() < 4:
            break
        starts.append(low)
        levels.append(float(np.median(position[octave])) / math.log(2))
    if not starts:
        return np.full(len(beyond), float(np.median(position[1:])) if len(position) > 1 else 0.0)
    floor = 0.0
    for k in range(4, len(levels)):
        three = levels[k], levels[k - 2], levels[k - 4]
        if starts[k] > motion and max(three) <= 3 * min(three):
            floor = max(floor, *three)
    highest = np.maximum.accumulate(levels)
    # The last octave whose lower edge is at or above the frequency; the topmost where there is none.
    place = np.searchsorted(-np.array(starts), -beyond, side="right") - 1
    return np.maximum(highest[np.clip(place, 0, len(highest) - 1)], floor)
