"""Columns of effects on the motors, as rows of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..effects.joint_effect import JointEffect
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..effects.motion import Motion

Array = np.ndarray
#: Periods of an angle after which what a disturbance adds to it averages out.
_PERIODS = 5.0
#: Frequency, as a share of the rate, at which columns of a turning angle have fallen to half.
_FADE = 0.11


def is_order(effect: Effect) -> bool:
    """The effect has one shape, and that is an order: cycles per unit of a position."""
    shape = effect.shape()
    return len(shape) == 1 and shape[0].unit.startswith("1/rad")


def on_motors(values: Array, side: Side, robot) -> Array:  # type: ignore[no-untyped-def]
    """Columns (N, n, k) of torque on a side, as torque of the motors."""
    if side == Side.MOTOR:
        return values
    return np.asarray(np.matmul(robot.transmission.torque_map(side, Side.MOTOR), values))


def motor_columns(effect: Effect, motion: Motion, robot) -> dict[int, Array]:  # type: ignore[no-untyped-def]
    """Columns (N, k) of an effect on each motor on which it acts (`effect_columns`)."""
    at = effect.at(robot)
    if not isinstance(effect, JointEffect) or type(effect).columns is not JointEffect.columns or len(at) != 1:
        dense = effect_columns(effect, motion, robot)
        return {m: dense[:, m] for m in range(robot.n) if dense[:, m].any()}
    # One joint's own torque: the motors have it in proportion.
    own = [np.broadcast_to(x, (len(motion), 1))[:, 0] for x in effect.column_values(motion, at)]
    values = np.stack(own, axis=1)
    if (fade := _fade(effect, motion, robot)) is not None:
        values *= fade[:, None]
    share = robot.transmission.torque_map(effect.side, Side.MOTOR)[:, at[0]]
    return {m: values * share[m] for m in np.flatnonzero(share).tolist()} if values.any() else {}


def effect_columns(effect: Effect, motion: Motion, robot) -> Array:  # type: ignore[no-untyped-def]
    """Columns (N, n, k) of an effect on the motors; where its angle turns faster than the motion's band, they fade like the torque does."""
    values = on_motors(effect.columns(motion, robot), effect.side, robot)
    fade = _fade(effect, motion, robot)
    return values if fade is None else values * fade[:, None, None]


def _fade(effect: Effect, motion: Motion, robot) -> Array | None:  # type: ignore[no-untyped-def]
    """What is left (N,) of the columns of a turning angle; None of an effect without an order."""
    if not is_order(effect):
        return None
    shape = effect.shape()
    side, j = getattr(effect, "angle", effect.side), effect.at(robot)[0]
    turning = np.abs(motion.on(side).dq[:, j]) * float(getattr(effect, shape[0].name)) / (2.0 * np.pi)
    fade = np.square(turning / (_FADE * motion.rate))
    return np.asarray(1.0 / (1.0 + np.square(np.square(fade))))


def turns_fast(effect: Effect, robot, motions: Sequence[Motion]) -> bool:  # type: ignore[no-untyped-def]
    """The effect has an order, of whose angle the runs hold several periods."""
    if not is_order(effect):
        return False
    shape = effect.shape()
    side, j = getattr(effect, "angle", effect.side), effect.at(robot)[0]
    q = np.concatenate([m.on(side).q[:, j] for m in motions])
    return float(np.ptp(q)) * float(getattr(effect, shape[0].name)) > 2.0 * np.pi * _PERIODS
