"""Positions that jump: a step that stays (an encoder or a coupling that slipped), or a single wrong sample.

What a position does from one sample to the next is looked at in second differences: acceleration, of which a jump is far more than
any other. Fast motion hides small ones. Third differences hardly see motion, and there a jump J stands out alone, as J, -2J, J, and a
wrong sample as S, -3S, 3S, -S: with a part of the other sign on either side, which a blow, a stop and a reversal of friction or of
acceleration do not have."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

Array = np.ndarray
#: How many times the usual second difference is a jump by itself.
_FAR = 50.0
#: How many times what the third differences of all but one in a thousand samples keep to is a jump, if it stands alone. Arms simulated
#: at 50 to 1000 Hz come to 1, measured ones to 2 (one with a sample read late to 4), noise with heavy tails (t of 3 degrees) to 6.
_ALONE = 8.0
#: Third differences left out before the largest is taken for usual, at least: those of two jumps.
_FEW = 9
#: A jump of fewer steps of the encoder is none.
_COUNTS = 8.0
#: It is so many times larger than what is within so many samples on either side, but for the few that it takes part in.
_ABOVE, _AROUND, _OWN = 3.0, 15, 3
#: It is no more than so many times what the joint moves in each of so many samples before and after it.
_MOVING, _NEXT = 10.0, 6
#: What has the other sign on either side of it is at least this share of it: 1/3 of a wrong sample, 1/2 of a step.
_SIDES = 0.25


def find_jumps(t: Array, x: Array, grid: float) -> Array:
    """Samples (J,) at which positions x (N,) at rising times t (N,) do what no motion does, the worst first. `grid`: step of the
    encoder, 0 where none is known."""
    steps = np.diff(t)
    usual = float(np.median(steps)) if len(steps) else 0.0
    if len(x) < 3 or not usual > 0:
        return np.zeros(0, int)
    # Across a gap, or a row that is missing, second differences are large by themselves.
    even = (steps > 0.5 * usual) & (steps < 1.5 * usual)
    second = np.abs(np.nan_to_num(np.where(even[1:] & even[:-1], np.diff(x, 2), 0.0)))
    far = float(np.percentile(second, 99))
    found = np.flatnonzero(second > _FAR * max(far, grid, 1e-9 * float(np.ptp(x)))) if far > 0 else np.zeros(0, int)
    found = np.union1d(found, _alone(x, steps, usual, _COUNTS * grid))
    return np.asarray(found[np.argsort(-second[found])] + 1)


def _alone(x: Array, steps: Array, usual: float, least: float) -> Array:
    """Places (J,) among second differences (N - 2,) of jumps that stand alone, larger than `least`. Steps in time (N - 1,) may differ
    from the `usual` one."""
    joined = (steps > 0.5 * usual) & (steps < 2.5 * usual)
    steps = np.maximum(steps, 0.1 * usual)
    bend = np.nan_to_num(np.where(joined[1:] & joined[:-1], np.diff(np.diff(x) / steps * usual), 0.0))
    third = np.diff(bend)
    size = 0.5 * np.abs(third)
    reach = _AROUND + _OWN
    if len(size) <= 2 * reach + _FEW:
        return np.zeros(0, int)
    rank = max(_FEW, len(size) // 1000)
    common = float(np.partition(size, -rank)[-rank])
    # At the ends there is nothing to compare with.
    inner = np.arange(reach, len(size) - reach)
    largest = sliding_window_view(size, _AROUND).max(axis=1)
    around = np.maximum(largest[inner - reach], largest[inner + _OWN + 1])
    limit = np.maximum(np.maximum(_ALONE * common, least), np.maximum(_ABOVE * around, _late(x, steps, usual)[inner]))
    found = inner[size[inner] > limit]
    found = found[np.maximum(third[found - 1] * third[found], third[found + 1] * third[found]) < -_SIDES * third[found] ** 2]
    # A whole move between two rests, within few samples, stands alone as well.
    moved = np.abs(np.diff(x))
    beside = [min(np.median(moved[i - _NEXT : i]), np.median(moved[i + 3 : i + 3 + _NEXT])) for i in found]
    found = found[size[found] < _MOVING * np.array(beside)]
    # Of the two second differences, the sample of the larger.
    return np.unique(found + (np.abs(bend[found + 1]) > np.abs(bend[found])))


def _late(x: Array, steps: Array, usual: float) -> Array:
    """What may look like a jump (N - 3,) where one of the three steps about a place differs from the usual one because a stamp is off:
    three times what the joint moves in that time covers all that are no gap."""
    off, speed = np.abs(steps - usual), np.abs(np.diff(x)) / steps
    return np.asarray(3.0 * sliding_window_view(off, 3).max(axis=1) * np.median(sliding_window_view(speed, 3), axis=1))
