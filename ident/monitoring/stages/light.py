"""Inertia that cannot be: with a candidate in the model no joint must be lighter than nothing, nor the robot weigh next to nothing.

Noise in accelerations shrinks inertia, most where hardly any torque drives the motion: nothing at all predicts that best. A change of
the load in the middle of a log would explain a drive that was switched off there by a robot without links."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Need
from ...effects.motion import Motion
from ...robots.transmission import Side
from .refit import Refit

if TYPE_CHECKING:
    from ...robots.robot import Robot
    from .search import Judged
    from .stage import Stage

Array = np.ndarray
#: Positions at which inertia is looked at; how many of its standard deviations it must be below zero.
_POSITIONS = 60
_SURELY = 3.0
#: So many times the noise (rms) is left on a joint where the model lacks something.
_MUCH_LEFT = 2.0
#: A load that is put down leaves more than this share of the inertia about some joint.
_LEFT = 0.1
#: A time after every change in a log, s.
_LATE = 1e9
#: What such effects add depends on more than the state.
_BEYOND_STATE = frozenset({Need.HISTORY, Need.REFERENCE, Need.LOAD, Need.TORQUE})


def too_light(stage: Stage, judged: Judged) -> str:
    """Why a candidate cannot be beside a stage's model, which has no such inertia without it; "" if nothing speaks against it."""
    effect, model = judged.hit.effect, stage.problem.model
    if effect.needs & _BEYOND_STATE:
        return ""
    q = np.concatenate([motion.joint.q for _, motion in stage.motions.parts])
    q = q[np.linspace(0, len(q) - 1, min(len(q), _POSITIONS)).astype(int)]
    robot, frame = model.robot, stage.frame
    declared = np.concatenate([_inertia_columns(e, robot, q) for e in model.effects], axis=2)[:, :, stage.problem.base.independent]
    own = declared @ frame.transform
    with_it = np.concatenate([own, _inertia_columns(effect, robot, q)], axis=2)
    refit = Refit.of(frame, judged.hit.columns)
    inertia = with_it @ np.append(refit.model, refit.values)
    std = np.sqrt(np.maximum(np.einsum("Nji,ik,Njk->Nj", with_it, refit.covariance, with_it), 0.0))
    before = own @ frame.coefficients
    # What else the model lacks bends inertia as well: deviations are as large as what is left on a joint's rows, not as its noise.
    left = frame.torque - frame.columns @ refit.model - judged.hit.columns @ refit.values
    rms = np.sqrt(np.sum(left**2, axis=1) / np.maximum(stage.problem.signals.valid.sum(axis=0), 1))
    std = std * np.maximum(rms, 1.0)
    # Where much is left on a joint that the candidate does not act on, something else is missing there: through what links share that
    # bends inertia about any joint, and the one that is found first is not to pay for it.
    acts = (judged.hit.columns != 0.0).any(axis=(1, 2))
    if np.any((rms > _MUCH_LEFT) & ~acts):
        return ""
    lost = (inertia < -_SURELY * std) & (before > 0.0)
    if lost.any():
        return f"with it the inertia about {robot.joint_names[int(np.argmax(lost.sum(axis=0)))]} would be negative"
    if np.all(inertia + _SURELY * std < _LEFT * before):
        return "with it next to nothing would be left of the robot's inertia"
    return ""


def _inertia_columns(effect: Effect, robot: Robot, q: Array) -> Array:
    """What each of an effect's parameters adds to the inertia about each joint at positions q (N, n), late in the log, (N, n, k); nothing
    where that depends on more than the state."""
    N, n = q.shape
    if effect.needs & _BEYOND_STATE:
        return np.zeros((N, n, len(effect.parameters(robot))))
    # At rest; with unit acceleration of each joint in turn.
    ddq = np.concatenate([np.zeros((N, n)), np.repeat(np.eye(n), N, axis=0)])
    every = np.tile(q, (n + 1, 1))
    motion = Motion.of(robot, every, np.zeros_like(every), ddq, np.full(len(every), _LATE), start=0.0)
    columns = np.matmul(robot.transmission.torque_map(effect.side, Side.JOINT), effect.columns(motion, robot))
    torque = columns.reshape(n + 1, N, n, -1)
    return np.stack([torque[j + 1, :, j] - torque[0, :, j] for j in range(n)], axis=1)
