"""From recorded time stamps to uniform samples: even stretches, gaps, and interpolation only where it is needed.

Time stamps are believed, except for what their own resolution rounds off. Nothing is interpolated across a gap."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import add
from typing import Any

import numpy as np

from ..logs.spacing import GAP, Spacing

Array = np.ndarray
#: A stamp nearer than this share of the usual step to the one before brings no motion, only the noise of both.
_NEAREST = 0.2
#: Stamps this far apart (s) tell nothing of a motion; rates (Hz) at which robots are logged.
_SLOWEST = 0.9
_USUAL = (9.0, 30_000.0)


@dataclass(frozen=True, eq=False)
class Clock:
    """How a run was sampled: `step` (s, the usual distance of stamps), `resolution` of the stamps (s, 0 if none is seen),
    `jitter` (s, root mean square of the deviation of a step from the usual one, gaps left out); `missing`: samples that were left
    out, one or two at a time. Where some are, steps are compared with their nearest multiple of the usual one."""

    step: float
    resolution: float
    jitter: float
    missing: int = 0

    @classmethod
    def of(cls, t: Array) -> Clock:
        """The clock behind rising stamps (N,)."""
        steps = np.diff(t)
        step = float(np.median(steps))
        return cls.behind(step, stamp_resolution(t, step), lambda: [(steps, 1)])

    @classmethod
    def behind(cls, step: float, resolution: float, pieces: Callable[[], Iterable[tuple[Array, Any]]]) -> Clock:
        """The clock of which the median `step` and the `resolution` are known; `pieces`: all steps, and how often each occurs."""
        if not step > 0:
            return cls(step, resolution, 0.0)

        def total(of: Callable[[Array], Array]) -> float:
            return float(sum(np.sum(of(steps) * times) for steps, times in pieces()))

        def mean(of: Callable[[Array], Array], below: float) -> float:
            return total(lambda s: np.where(s < below, of(s), 0.0)) / total(lambda s: s < below)

        if total(lambda s: (s > 1.5 * step) & (s < GAP * step)):
            one = mean(lambda s: s, 1.5 * step)
            missing = reduce(add, (Spacing.of(steps, times, one) for steps, times in pieces())).missing
            if missing:
                # A step counts as the periods it holds, so that what stamps are rounded by cancels from one to the next.
                longest = GAP * one
                period = mean(lambda s: s, longest) / mean(lambda s: np.rint(s / one), longest)
                spread = mean(lambda s: (s - np.maximum(np.rint(s / period), 1.0) * period) ** 2, longest)
                return cls(period, resolution, float(np.sqrt(spread)), missing)
        longest = 3 * step
        low = min(float(np.min(steps, initial=np.inf)) for steps, _ in pieces())
        high = max(float(np.max(steps, initial=0.0, where=steps < longest)) for steps, _ in pieces())
        # The mean is sharper than the median where steps are alike but for rounding; else it would mix in late ones.
        if high - low < max(0.2 * step, 2.1 * resolution if resolution < 0.5 * step else 0.0):
            step = mean(lambda s: s, longest)
        return cls(step, resolution, float(np.sqrt(mean(lambda s: (s - step) ** 2, longest))))

    def tolerance(self, rate: float) -> float:
        """By how much (s, from the earliest to the latest) even stamps may lie off a grid of `rate`: 1 % of a step to either side, or what
        their resolution rounds off. The latter not where samples are missing: a single one shifts all later ones by a step, and of stamps
        that tell whole steps alone that would pass for rounding."""
        rounded = 0.0 if self.missing else 0.55 * self.resolution
        return 2 * max(0.01 / rate, rounded)


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


def slow_clock(step: float) -> str:
    """What is wrong with stamps that are so far apart (s); "" if nothing is."""
    if not step >= _SLOWEST:
        return ""
    unit = next((u for u, size in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)) if _USUAL[0] <= 1.0 / (step * size) <= _USUAL[1]), "")
    hint = f"They look like {unit}, not s: name the column t_{unit}" if unit else "Name their unit in the column (t_ms, t_us, t_ns)"
    return f"the time stamps are {step:.4g} s apart, and no motion of a robot is logged so slowly. {hint}."


def is_even(t: Array, rate: float, clock: Clock) -> bool:
    """Whether stamps (N,) of a clock lie on a uniform grid of `rate`."""
    return bool(np.ptp(t - t[0] - np.arange(len(t)) / rate) <= clock.tolerance(rate))


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


def interpolate_torque(t: Array, torque: Array, at: Array, least: Array, most: Array) -> Array:
    """`interpolate`, but straight where a value is held and on either side of that, and nowhere beyond the extremes `least`, `most` (n,) of
    the whole recording: a spline swings there, and a torque that is cut off would not show as such any more."""
    out, filled = np.clip(interpolate(t, torque, at), least, most), bridge(t, torque)
    held = np.diff(filled, axis=0) == 0.0
    straight = held.copy()
    straight[1:] |= held[:-1]
    straight[:-1] |= held[1:]
    before = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    for j in np.flatnonzero(straight.any(axis=0)):
        here = straight[before, j]
        out[here, j] = np.interp(at[here], t, filled[:, j])
    return out


def extremes(torque: Array) -> tuple[Array, Array]:
    """Least and most (n,) of torque (N, n) that is there; no bounds where none is."""
    missing = np.isnan(torque)
    least, most = np.where(missing, np.inf, torque).min(axis=0), np.where(missing, -np.inf, torque).max(axis=0)
    absent = missing.all(axis=0)
    return np.where(absent, -np.inf, least), np.where(absent, np.inf, most)


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
