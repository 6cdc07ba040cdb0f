"""Delay of the torque against the motion: the shift at which the robot's structure explains it best, and the least one that would show."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .findings import Severity

Array = np.ndarray
Add = Callable[..., None]
#: Shifts that are tried at most.
_LAGS = 81
#: A delay must take away that share of what the structure leaves. A joint of which it leaves this share of the torque says nothing of one.
_GAIN, _UNRELATED = 0.1, 0.3


def lags_of(rate: float, margin: int) -> Array:
    """Lags to try (s), zero in the middle: up to 50 ms or ten samples, but within the `margin` given up at the ends. Whole samples: between
    two of them interpolation takes away noise, and what is left would be least where there is no delay."""
    reach = int(min(max(10.0, 0.05 * rate), max(2.0, margin - 1.0)))
    step = -(-2 * reach // (_LAGS - 1))
    most = reach // step
    return step * np.arange(-most, most + 1) / rate


def minimum(lags: Array, left: Array) -> tuple[float, bool]:
    """Where what is `left` at each lag is least, and whether that is inside of the range."""
    k = int(np.argmin(left))
    if k in (0, len(lags) - 1):
        return float(lags[k]), False
    a, b, c = left[k - 1 : k + 2]
    curve = a - 2 * b + c
    return float(lags[k] + (0.5 * (a - c) / curve if curve > 0 else 0.0) * (lags[1] - lags[0])), True


def say_delay(add: Add, lags: Array, pooled: Array, found: Sequence[tuple[float, bool, float]], rate: float) -> None:
    """`pooled`: what the structure leaves of all joints' torques at each lag; `found`, a joint: its best lag, whether that is inside of the
    range, and the share that is left without a shift."""
    if not found or not pooled.any():
        return
    lag, inside = minimum(lags, pooled)
    gain = 1 - float(pooled.min() / pooled[len(lags) // 2])
    # Only rows that the structure explains can tell a delay, and joints on one bus share it.
    told = [f[0] for f in found if f[1] and f[2] < _UNRELATED]
    enough = len(told) >= max(1, len(found) // 2)
    agree = enough and float(np.median(np.abs(np.array(told) - lag))) < 0.5 * abs(lag)
    if inside and agree and gain > _GAIN and abs(lag) > 1 / rate:
        which = "later" if lag > 0 else "earlier"
        add(
            "delay",
            Severity.WARNING,
            f"Torque fits the motion best {abs(lag) * 1e3:.3g} ms {which} than it was logged against it ({gain:.0%}"
            " less residual): a delay, which biases inertia and viscous friction, or a controller's response to disturbances, which looks"
            " like one; ident diagnose distinguishes them. If it is a delay, shift the torque, or let the effect 'delay' estimate it.",
            "",
            lag,
        )
        return
    least = _least(lags, pooled, rate) if enough else None
    unseen = f"below {least * 1e3:.3g} ms" if least else f"of up to {lags[-1] * 1e3:.3g} ms"
    text = f"No delay between torque and motion is detected in this run; one {unseen} would not be. `ident fit` looks for smaller ones."
    add("delay", Severity.INFO, text, "", 0.0)


def _least(lags: Array, pooled: Array, rate: float) -> float | None:
    """The least delay (s) that would be detected either way; None where none within the range would be.

    A delay moves what is left along the lags: what it would leave without a shift lies at its distance from the least now."""
    k = int(np.argmin(pooled))
    away = np.arange(min(k, len(lags) - 1 - k, len(lags) // 2 - 1) + 1)
    left = np.maximum.accumulate(np.minimum(pooled[k - away], pooled[k + away]))
    needed = float(pooled[k]) / (1.0 - _GAIN)
    if left[-1] <= needed:
        return None
    # About its least it grows as the square of the lag.
    return max(float(np.sqrt(np.interp(needed, left, (away * (lags[1] - lags[0])) ** 2))), 1.0 / rate)
