"""Checks of the torque of a log: missing, constant, off, hung, coarse, in other units, cut off."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .._utils.text import counted
from ..logs.repair import usable_numbers
from ..robots.robot import Robot
from ..signals.masks import find_saturation
from .findings import Severity

Array = np.ndarray
Add = Callable[..., None]
#: A reading that stays the same for so many samples, and so many times longer than all other stretches but so many, while the joint goes
#: this share of its range.
_FROZEN, _LONGER, _OTHERS, _WAY = 50, 4.0, 4, 0.05
#: A torque is wild if it lies so many times the range of all others outside of that range, for so many samples at the most, as far from
#: so many on either side, and so seldom (share of the samples): a blow lasts longer, and what comes more often is how this torque is.
_OUTSIDE, _BRIEF, _AROUND, _SELDOM = 2.0, 3, 20, 1e-3


def check_torque(add: Add, robot: Robot | None, j: int, name: str, t: Array, x: Array, q: Array) -> None:
    """Say what is wrong with the torque x (N,) of one joint at times t (N,); q (N,): its position. `add`: takes code, severity, text,
    where, value."""
    present = _logged(add, name, x, q)
    if present is None:
        return
    _check_stretches(add, name, x, q, present)
    _check_effort(add, robot, j, name, present)
    _check_steps(add, name, _without_wild(add, name, t, x, present))


def _logged(add: Add, name: str, x: Array, q: Array) -> Array | None:
    """The readings there are (P,); None, which is said, where they tell nothing: there are none, or they stay the same throughout."""
    missing = ~usable_numbers(x)
    if missing.all():
        text = "No torque logged: rows of this joint are not used, and parameters that only they reveal stay unknown."
        add("torque_missing", Severity.WARNING, text, name)
        return None
    if missing.any():
        text = f"Torque is missing in {counted(int(missing.sum()), 'sample')}; rows that depend on them are not used."
        add("torque_nan", Severity.WARNING, text, name, missing.mean())
    present = x[~missing]
    if float(np.ptp(present)) != 0:
        return np.asarray(present)
    moves = np.ptp(q) > 0
    text = f"Torque stays at {present[0]:.4g} throughout: the channel is not connected, or not of this joint."
    text += " It is taken as not logged, if other torques change." if moves else " Leave it out."
    add("torque_constant", Severity.WARNING if moves else Severity.INFO, text, name)
    return None


def _check_stretches(add: Add, name: str, x: Array, q: Array, present: Array) -> None:
    """Stretches of zero, else of one and the same reading."""
    off = longest(present == 0) / len(present)
    if off > 0.05:
        text = (
            f"Torque is exactly zero for {off:.0%} of the run in one stretch: the drive was off, or the channel dropped out. If it"
            " dropped out, or brakes held the robot, cut the log there; if the robot swung freely, that reveals little but friction."
        )
        add("torque_zero", Severity.WARNING, text, name, off)
    elif (stuck := _frozen(x, q)) is not None:
        first, last = stuck
        text = (
            f"Torque stays at exactly {x[first]:.4g} from sample {first} to {last} while the joint moves: the channel"
            f" froze, or the drive was off. Cut the log there, or leave these cells empty."
        )
        add("torque_frozen", Severity.WARNING, text, name, (last - first + 1) / len(x))


def _check_effort(add: Add, robot: Robot | None, j: int, name: str, present: Array) -> None:
    """Torque beyond what the joint is said to give."""
    if robot is None or not np.isfinite(robot.joints[j].effort) or robot.transmission.measured != "joint":
        return
    most = float(np.percentile(np.abs(present), 99))
    if most > 1.5 * robot.joints[j].effort:
        text = (
            f"Torque reaches {most:.4g}, above the joint's effort limit of {robot.joints[j].effort:.4g}. Check its unit and side"
            " ([drive] measured)."
        )
        add("torque_large", Severity.WARNING, text, name, most)


def _without_wild(add: Add, name: str, t: Array, x: Array, present: Array) -> Array:
    """The readings that are there (P,) but for wild ones, which are said."""
    wild = wild_samples(x)
    if not len(wild):
        return present
    others = np.delete(x, wild)
    several = f"{len(wild)} samples stand" if len(wild) > 1 else "1 sample stands"
    text = (
        f"Torque is {x[wild[0]]:.4g} at {t[wild[0]]:.12g} s ({several} far outside of {np.nanmin(others):.4g} to"
        f" {np.nanmax(others):.4g}, where all others are). Least squares is sensitive to such a sample: leave its cell empty, or remove the"
        " row."
    )
    add("torque_spike", Severity.WARNING, text, name, float(x[wild[0]]))
    return np.asarray(others[np.isfinite(others)])


def _check_steps(add: Add, name: str, present: Array) -> None:
    """Torque that comes in steps."""
    step = grid_step(present)
    levels = float(np.ptp(present)) / step if step > 0 else np.inf
    if levels > 1e4:
        return
    coarse = levels < 100
    text = f"Torque is quantised in steps of {step:.3g} ({levels:.0f} levels over the range used)."
    text += " That is coarse; its error adds to the noise." if coarse else ""
    add("torque_steps", Severity.WARNING if coarse else Severity.INFO, text, name, step)


def wild_samples(x: Array) -> Array:
    """Samples (W,) of a torque x (N,) that stand far outside of all others, the farthest first. NaN where there is none."""
    present = np.flatnonzero(np.isfinite(x))
    if len(present) < 100:
        return np.zeros(0, int)
    most = int(np.ceil(_SELDOM * len(present)))
    low, high = (float(v) for v in np.partition(x[present], [most, len(present) - 1 - most])[[most, len(present) - 1 - most]])
    out = np.maximum(low - x[present], x[present] - high) > _OUTSIDE * (high - low)
    found = present[out]
    if not high > low or not 0 < len(found) <= most:
        return np.zeros(0, int)
    groups = np.split(found, np.flatnonzero(np.diff(found) > _AROUND) + 1)
    found = np.concatenate([group for group in groups if np.ptp(group) < _BRIEF and _stands_alone(x, group)] or [np.zeros(0, int)])
    return np.asarray(found[np.argsort(-np.abs(x[found] - 0.5 * (low + high)))])


def _stands_alone(x: Array, group: Array) -> bool:
    """Whether all samples of a group are far from what is on either side of it: where a joint moves but once, much is far from usual."""
    first, last = int(group[0]), int(group[-1])
    near = np.r_[x[max(first - _AROUND, 0) : first], x[last + 1 : last + 1 + _AROUND]]
    near = near[np.isfinite(near)]
    if not len(near):
        return False
    low, high = float(near.min()), float(near.max())
    return bool(np.all(np.maximum(low - x[group], x[group] - high) > _OUTSIDE * (high - low)))


def check_saturation(add: Add, names: tuple[str, ...], torque: Array, q: Array) -> None:
    """Say which of the torques (N, n) are cut off; q (N, n): positions."""
    steps = np.abs(np.diff(q, axis=0, prepend=q[:1]))
    # A slow moving average tells motion from rest even where the encoder is coarse.
    width = 25
    smooth = np.stack([np.convolve(s, np.ones(width) / width, "same") for s in steps.T], axis=1)
    moving = smooth > 0.05 * np.maximum(np.percentile(smooth, 99, axis=0), 1e-300)
    found = find_saturation(torque, moving)
    for j, name in enumerate(names):
        if found.flag[:, j].any():
            share = float(found.flag[:, j].mean())
            at = " and ".join(f"{x:.4g}" for x in found.limits[j] if np.isfinite(x))
            add(
                "saturation",
                Severity.WARNING,
                f"Torque stays at {at} in {share:.1%} of samples: it is saturated. The true torque may differ; these rows are left out."
                " Record slower motion, or raise the limit.",
                name,
                share,
            )


def grid_step(x: Array) -> float:
    """Step of the grid that values lie on (0 where they lie on none that can be seen)."""
    part = x[:200_000]
    changes = np.abs(np.diff(np.unique(part)))
    span = float(np.ptp(part))
    changes = changes[changes > 1e-9 * span]
    if len(changes) < 8:
        return 0.0
    step = float(np.percentile(changes, 5))
    # Digits written to the file shift values by their rounding; a grid shows all the same.
    ratio = changes / step
    whole = np.round(ratio)
    on_grid = (whole >= 1) & (np.abs(ratio - whole) < 0.1)
    if np.mean(on_grid) < 0.95 or step < 1e-6 * span:
        return 0.0
    return float(np.mean(changes[on_grid] / whole[on_grid]))


def longest(flag: Array) -> int:
    """Length of the longest run of set flags."""
    edges = np.flatnonzero(np.diff(np.r_[False, flag, False]))
    return int((edges[1::2] - edges[::2]).max(initial=0))


def _frozen(x: Array, q: Array) -> tuple[int, int] | None:
    """First and last sample of the longest stretch of one and the same reading, if that is no matter of coarse steps or of a limit: many
    times longer than usual, while the joint goes a part of its way."""
    same = np.r_[False, x[1:] == x[:-1]]
    edges = np.flatnonzero(np.diff(np.r_[False, same, False]))
    first, last = edges[::2] - 1, edges[1::2] - 1
    if not len(first):
        return None
    length = last - first + 1
    k = int(np.argmax(length))
    usual = float(np.sort(length)[-1 - _OTHERS]) if len(length) > _OTHERS else 1.0
    a, b = int(first[k]), int(last[k])
    at_end = x[a] in (np.nanmin(x), np.nanmax(x))
    if at_end or length[k] < max(_FROZEN, _LONGER * usual) or np.ptp(q[a : b + 1]) < _WAY * np.ptp(q):
        return None
    return a, b
