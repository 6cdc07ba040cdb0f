"""From recorded time stamps to uniform samples: even stretches, gaps, and interpolation only where it is needed.

Time stamps are believed, except for what their own resolution rounds off. Nothing is interpolated across a gap."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Array = np.ndarray
#: A stamp nearer than this share of the usual step to the one before brings no motion, only the noise of both.
_NEAREST = 0.2


@dataclass(frozen=True, eq=False)
class Clock:
    """How a run was sampled: `step` (s, the usual distance of stamps), `resolution` of the stamps (s, 0 if none is seen),
    `jitter` (s, root mean square of the deviation of a step from the usual one, gaps left out)."""

    step: float
    resolution: float
    jitter: float

    @classmethod
    def of(cls, t: Array) -> Clock:
        """The clock behind rising stamps (N,)."""
        steps = np.diff(t)
        step = float(np.median(steps))
        resolution = stamp_resolution(t, step)
        usual = steps[steps < 3 * step]
        # The mean is sharper than the median where steps are alike but for rounding; else it would mix in dropped samples.
        if len(usual) and np.ptp(usual) < max(0.2 * step, 2.1 * resolution if resolution < 0.5 * step else 0.0):
            step = float(usual.mean())
        jitter = float(np.sqrt(np.mean((usual - step) ** 2))) if len(usual) else 0.0
        return cls(step, resolution, jitter)


def stamp_resolution(t: Array, step: float) -> float:
    """The power of ten that all stamps are multiples of, if it is no finer than a thousandth of the step; else 0."""
    sample = t[:: max(1, len(t) // 20000)] - np.floor(t[0])
    for digits in range(10):
        unit = 10.0**-digits
        if unit > 1.01 * step:
            continue
        if unit < 1e-3 * step:
            break
        ticks = sample / unit
        # Stamps may be large numbers (seconds since 1970) with few digits left behind the point.
        rounding = 1e-6 + 4 * np.spacing(max(abs(float(t[0])), abs(float(t[-1])))) / unit
        if rounding < 0.1 and np.all(np.abs(ticks - np.round(ticks)) < rounding):
            return unit
    return 0.0


def stretches(t: Array, longest_step: float) -> list[slice]:
    """Parts of a run without a step longer than `longest_step` (s)."""
    breaks = np.flatnonzero(np.diff(t) > longest_step) + 1
    edges = [0, *breaks.tolist(), len(t)]
    return [slice(a, b) for a, b in itertools.pairwise(edges)]


def common_rate(clocks: Sequence[Clock]) -> float:
    """One sample rate (Hz) for runs whose clocks differ little; the median where they differ much."""
    return 1.0 / float(np.median([c.step for c in clocks]))


def is_even(t: Array, rate: float, resolution: float = 0.0) -> bool:
    """Whether stamps (N,) lie on a uniform grid of `rate` within 1 % of a step, or within what their resolution rounds off."""
    deviation = t - t[0] - np.arange(len(t)) / rate
    return bool(np.ptp(deviation) <= 2 * max(0.01 / rate, 0.55 * resolution))


def grid(t: Array, rate: float) -> Array:
    """Uniform instants at `rate` from the first stamp to the last."""
    # 1e-6 of a step: the last instant must not be lost to rounding.
    return t[0] + np.arange(int(np.floor((t[-1] - t[0]) * rate + 1e-6)) + 1) / rate


def thin(t: Array, step: float) -> Array:
    """Indices without samples that follow the one kept before within a small part of a step."""
    close = np.diff(t) < _NEAREST * step
    if not close.any():
        return np.arange(len(t))
    keep = np.ones(len(t), bool)
    last = t[0]
    for i in np.flatnonzero(np.r_[False, close]):
        if keep[i - 1]:
            last = t[i - 1]
        keep[i] = t[i] - last >= _NEAREST * step
    return np.flatnonzero(keep)


def interpolate(t: Array, values: Array, at: Array) -> Array:
    """Cubic spline through samples (N, k) at other instants (M,), constant beyond the ends; NaN samples are bridged straight first."""
    from scipy.interpolate import CubicSpline

    filled = bridge(t, values)
    if len(t) < 4:
        return np.column_stack([np.interp(at, t, c) for c in filled.T])
    return np.asarray(CubicSpline(t, filled)(np.clip(at, t[0], t[-1])))


def bridge(t: Array, values: Array) -> Array:
    """NaN in (N, k) replaced by straight lines between neighbours (zero in a column that holds nothing)."""
    missing = np.isnan(values)
    if not missing.any():
        return values
    out = values.copy()
    for j in np.flatnonzero(missing.any(axis=0)):
        bad = missing[:, j]
        out[bad, j] = 0.0 if bad.all() else np.interp(t[bad], t[~bad], values[~bad, j])
    return out


def flag_at(t: Array, flag: Array, at: Array) -> Array:
    """Flags (N, k) at other instants (M,): set where a neighbouring sample on either side is flagged."""
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    exact_after = np.abs(t[after] - at) < 1e-9
    exact_before = np.abs(t[after - 1] - at) < 1e-9
    return np.where(exact_after[:, None], flag[after], np.where(exact_before[:, None], flag[after - 1], flag[after] | flag[after - 1]))
