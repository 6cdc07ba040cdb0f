"""Columns of effects on the motors, as rows of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..effects.motion import Motion
    from .rows import RunRows

Array = np.ndarray
#: Periods of an angle after which what a disturbance adds to it averages out.
_PERIODS = 5.0
#: Frequency, as a share of the rate, at which columns of a turning angle have fallen to half.
_FADE = 0.11


def on_motors(values: Array, side: Side, robot) -> Array:  # type: ignore[no-untyped-def]
    """Columns (N, n, k) of torque on a side, as torque of the motors."""
    if side == Side.MOTOR:
        return values
    return np.moveaxis(np.tensordot(robot.transmission.torque_map(side, Side.MOTOR), values, (1, 1)), 0, 1)


def rows_of(values: Array, run: RunRows) -> Array:
    """Columns (N, n, k) on the motors as rows (count, n, k)."""
    out = np.zeros((run.band.count, values.shape[1], values.shape[2]))
    for m in range(values.shape[1]):
        live = np.flatnonzero(values[:, m].any(axis=0))
        if len(live):
            out[:, m, live] = run.masked(values[:, m, live], m)
    return out


def effect_columns(effect: Effect, motion: Motion, robot) -> Array:  # type: ignore[no-untyped-def]
    """Columns (N, n, k) of an effect on the motors; where its angle turns faster than the motion's band, they fade like the torque does."""
    values = on_motors(effect.columns(motion, robot), effect.side, robot)
    shape = effect.shape()
    if len(shape) == 1 and shape[0].unit.startswith("1/rad"):
        side, j = getattr(effect, "angle", effect.side), effect.at(robot)[0]
        turning = np.abs(motion.on(side).dq[:, j]) * float(getattr(effect, shape[0].name)) / (2.0 * np.pi)
        fade = np.square(turning / (_FADE * motion.rate))
        values = values / (1.0 + np.square(np.square(fade)))[:, None, None]
    return values


def turns_fast(effect: Effect, robot, motions: Sequence[Motion]) -> bool:  # type: ignore[no-untyped-def]
    """The effect has an order, of whose angle the runs hold several periods."""
    shape = effect.shape()
    if len(shape) != 1 or not shape[0].unit.startswith("1/rad"):
        return False
    side, j = getattr(effect, "angle", effect.side), effect.at(robot)[0]
    q = np.concatenate([m.on(side).q[:, j] for m in motions])
    return float(np.ptp(q)) * float(getattr(effect, shape[0].name)) > 2.0 * np.pi * _PERIODS
