"""Position and speed of joints where a log begins, from its first readings."""

from __future__ import annotations

import numpy as np

from .._utils.singular_values import lstsq

Array = np.ndarray
#: Samples at the start of a log from which its initial speed is taken where none was logged.
_FIRST = 6
#: Standard deviations from which on a first speed is one.
_SURE = 4.0


def first_state(t: Array, q: Array) -> tuple[Array, Array]:
    """Position and speed (n,) at the first sample. A joint at rest: the mean of its readings there, and no speed, because a simulation
    that starts where noise has put it stays there until friction is overcome. One that moves: its first reading, and a straight line."""
    origin, speed = q[0].copy(), np.zeros(q.shape[1])
    few = min(_FIRST, len(t))
    for j, values in enumerate(q.T):
        slope, doubt = _line(t[:few], values[:few])
        if abs(slope) > _SURE * doubt and _goes_on(t[: 2 * few], values[: 2 * few], few):
            origin[j], speed[j] = _moving(t[:few], values[:few], slope)
            continue
        count = few
        while 2 * count <= len(t):
            slope, doubt = _line(t[: 2 * count], values[: 2 * count])
            if abs(slope) > _SURE * doubt or _beyond(values[:count], values[count : 2 * count]):
                break
            count *= 2
        origin[j] = float(np.mean(values[:count]))
    return origin, speed


def _beyond(before: Array, behind: Array) -> bool:
    """Whether readings are elsewhere than as many before them, at rest, whose spread is that of both. Few readings know their spread badly:
    in units of it the limit is that of Student's distribution, as rarely exceeded by chance as the sure one of known spread."""
    from scipy.special import ndtr, stdtrit

    count = len(before)
    sure = -float(stdtrit(count - 1, ndtr(-_SURE)))
    doubt = float(np.std(before, ddof=1)) * np.sqrt(2.0 / count)
    return abs(float(np.mean(behind) - np.mean(before))) > sure * doubt + 1e-12


def _goes_on(t: Array, values: Array, few: int) -> bool:
    """Whether the readings behind the first few are elsewhere. A line through few readings is never quite level, and its doubt, taken from
    the same few, is by chance several times too small: of one joint at rest in sixty that would be a speed."""
    if len(t) < 2 * few:
        return True
    halves = (slice(0, few), slice(few, 2 * few))
    spread = sum((_line(t[at], values[at])[1] ** 2) * float(np.sum((t[at] - t[at].mean()) ** 2)) for at in halves) / 2.0
    apart = abs(float(np.mean(values[halves[1]]) - np.mean(values[halves[0]])))
    return bool(apart > _SURE * np.sqrt(2.0 * spread / few))


def _moving(t: Array, values: Array, slope: float) -> tuple[float, float]:
    """Position and speed at the first of a few readings of a joint that moves: of a parabola where they are bent for sure."""
    powers = np.vander(t - t[0], 3, increasing=True)
    found = lstsq(powers, values, rcond=None)
    left = values - powers @ found
    spread = float(left @ left) / max(len(t) - 3, 1) * np.linalg.inv(powers.T @ powers)
    bent = abs(found[2]) > _SURE * np.sqrt(spread[2, 2])
    return (float(found[0]), float(found[1])) if bent else (float(values[0]), slope)


def _line(t: Array, values: Array) -> tuple[float, float]:
    """Slope of a straight line, and its standard deviation."""
    time = t - t.mean()
    size = max(float(time @ time), 1e-300)
    slope = float(time @ values) / size
    left = values - values.mean() - slope * time
    return slope, float(np.sqrt(left @ left / max(len(t) - 2, 1) / size))
