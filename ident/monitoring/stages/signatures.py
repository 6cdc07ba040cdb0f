"""Signatures: structure in what a model leaves, by the quantity it follows, whatever law is behind it.

Each is a family of smooth columns on one joint (splines of its position, speed, load, time …). Refitted with the whole model and
judged on blocks held out, like any candidate, they tell that something is left and against what it shows, also when no
catalogued effect explains it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...robots.transmission import Side

if TYPE_CHECKING:
    from .motions import Motions

Array = np.ndarray
#: A line stands so many times above the median of its neighbours on either side (so far off, at least so many), and holds this share of
#: all power: of 500 logs of autoregressive noise at each of 0, 0.7, 0.95 and 0.99, none had one.
_LINE = 20.0
_NEAR, _FAR, _FEW = 4, 20, 6
_LINE_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class Signature:
    """Columns (M, k) on the measured row of `joint`; `name` says what the structure follows."""

    name: str
    joint: int
    columns: Array = field(repr=False)

    def placed(self, n: int) -> Array:
        """Columns (M, n, k) over all measured rows."""
        out = np.zeros((len(self.columns), n, self.columns.shape[1]))
        out[:, self.joint] = self.columns
        return out


def signatures(motions: Motions) -> list[Signature]:
    """Every family for every joint."""
    problem = motions.problem
    robot = problem.model.robot
    side = robot.transmission.measured
    found: list[Signature] = []
    time = _all(motions, lambda m: m.clock[:, None])[:, 0]
    for j in range(robot.n):
        own = [m.on(side) for _, m in motions.parts]
        q, w, a = (np.concatenate([getattr(c, k)[:, j] for c in own]) for k in ("q", "dq", "ddq"))
        s = np.sign(w)
        load = np.concatenate([m.load[:, j] if m.load is not None else np.zeros(len(m)) for _, m in motions.parts])
        families: list[tuple[str, Array]] = [
            ("position", splines(q, 10)),
            ("position and direction of motion", s[:, None] * splines(q, 8)),
            ("speed", np.concatenate([splines(w, 9), s[:, None] * splines(np.abs(w), 7)], axis=1)),
            ("acceleration", splines(a, 6)),
            ("load", splines(load, 6)),
            ("load and direction of motion", s[:, None] * splines(load, 6)),
            ("time", splines(time, 12)),
            ("time and direction of motion", s[:, None] * splines(time, 9)),
            ("time and speed", w[:, None] * splines(time, 6)),
            ("hysteresis", _plays(motions, side, j)),
        ]
        for i in range(robot.n):
            if i == j:
                continue
            other = np.concatenate([m.joint.q[:, i] for _, m in motions.parts])
            rate = np.concatenate([m.joint.dq[:, i] for _, m in motions.parts])
            name = robot.joint_names[i]
            families.append((f"position of {name}", np.concatenate([splines(other, 6), s[:, None] * splines(other, 5)], axis=1)))
            families.append((f"speed of {name}", np.concatenate([splines(rate, 5), np.sign(rate)[:, None]], axis=1)))
        found += [Signature(name, j, reduced(motions, columns)) for name, columns in families]
    return found


def tones(motions: Motions, residual: Array, joint: int, count: int) -> Signature | None:
    """Sines at the so many frequencies at which a whitened residual (M,) of a joint is strongest."""
    frequencies, spectrum = _spectrum(motions, residual)
    if not len(frequencies):
        return None
    chosen: list[float] = []
    apart = 2.0 * (frequencies[1] - frequencies[0]) if len(frequencies) > 1 else 0.0
    for i in np.argsort(-spectrum):
        if all(abs(frequencies[i] - f) > 1.5 * apart for f in chosen):
            chosen.append(float(frequencies[i]))
        if len(chosen) == count:
            break
    return _sines(motions, joint, chosen)


def line(motions: Motions, residual: Array, joint: int) -> Signature | None:
    """The sine at which a residual (M,) of a joint is strongest, if it stands out from its neighbours as no smooth colour does."""
    frequencies, spectrum = _spectrum(motions, residual)
    at = int(np.argmax(spectrum)) if len(frequencies) else 0
    # On either side for itself: a colour that falls is as high on one of them.
    sides = spectrum[max(0, at - _FAR) : max(0, at - _NEAR)], spectrum[at + _NEAR + 1 : at + _FAR + 1]
    if min(len(side) for side in sides) < _FEW:
        return None
    share = 2.0 * float(spectrum[at]) / max(np.count_nonzero(residual) * float(np.sum(residual**2)), 1e-300)
    if spectrum[at] < _LINE * max(float(np.median(side)) for side in sides) or share < _LINE_SHARE:
        return None
    return _sines(motions, joint, [float(frequencies[at])])


def _spectrum(motions: Motions, residual: Array) -> tuple[Array, Array]:
    """Frequencies (F,) in Hz, two to each that the length of the log tells apart, and the power of a residual (M,) at each."""
    signals = motions.problem.signals
    rate = signals.rate / (signals.row_filter.factor if signals.row_filter else 1)
    at = signals.row_time
    if len(at) < 64:
        return np.zeros(0), np.zeros(0)
    lowest = 3.0 / max(float(at[-1] - at[0]), 1e-9)
    frequencies = np.arange(lowest, 0.45 * rate, lowest / 6.0)
    return frequencies, np.abs(np.exp(-2j * np.pi * np.outer(frequencies, at)) @ residual) ** 2


def _sines(motions: Motions, joint: int, hertz: list[float]) -> Signature:
    t = np.concatenate([m.t for _, m in motions.parts])
    columns = np.concatenate([np.stack([np.sin(2 * np.pi * f * t), np.cos(2 * np.pi * f * t)], axis=1) for f in hertz], axis=1)
    return Signature(f"time-periodic ({hertz[0]:.3g} Hz)", joint, reduced(motions, columns))


def splines(x: Array, count: int) -> Array:
    """Cubic B-splines (N, count) with knots at quantiles of x, so that each has data under it."""
    from scipy.interpolate import BSpline

    inner = max(0, count - 4)
    low, high = float(x.min()), float(x.max())
    if not high > low:
        return np.ones((len(x), 1))
    places = np.linspace(0.0, 1.0, inner + 2)[1:-1]
    # Half way between even spacing and quantiles: neither empty nor blind at the ends.
    knots = 0.5 * (np.quantile(x, places) + low + places * (high - low))
    full = np.concatenate([np.full(4, low), np.sort(knots), np.full(4, high)])
    return np.asarray(BSpline.design_matrix(np.clip(x, low, high), full, 3).toarray())


def reduced(motions: Motions, full: Array) -> Array:
    """Columns (N, k) at full rate over all runs → (M, k) at the rows."""
    out, at = [], 0
    for block, motion in motions.parts:
        out.append(block.reduce(np.ascontiguousarray(full[at : at + len(motion)])))
        at += len(motion)
    return np.concatenate(out)


def _all(motions: Motions, f) -> Array:  # type: ignore[no-untyped-def]
    return np.concatenate([f(m) for _, m in motions.parts])


def _plays(motions: Motions, side: Side, j: int) -> Array:
    """Followers that lag behind the position by up to some widths: the shapes of rate-independent hysteresis."""
    out = []
    for _, motion in motions.parts:
        q = motion.on(side).q[:, j]
        span = max(float(np.ptp(q)), 1e-12)
        out.append(np.stack([follower(q, share * span) / span for share in (0.02, 0.06, 0.12, 0.25)], axis=1))
    return np.concatenate(out)


def follower(q: Array, width: float) -> Array:
    """q less a point that is dragged along behind it by at most `width`: within ±width."""
    steps = np.diff(q, prepend=q[:1]).tolist()
    out, x = [], 0.0
    for step in steps:
        x = min(max(x + step, -width), width)
        out.append(x)
    return np.array(out)
