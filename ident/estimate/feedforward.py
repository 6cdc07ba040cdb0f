"""Torque and acceleration of a fitted model, one state or many: compiled where every effect declares what it is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..effects.factors import coefficients
from ..effects.kinds import Factor, Need
from ..effects.motion import Motion
from ..effects.reference import Reference
from ..effects.rigid_body import RigidBody
from ..errors import UnsupportedError
from ..regressor import rigid
from ..regressor.drive_terms import DriveTerms
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..model import Model
    from ..robots.robot import Robot

Array = np.ndarray
#: What a state alone does not tell.
_BEYOND_A_STATE = frozenset({Need.HISTORY, Need.NEIGHBOURS, Need.TORQUE, Need.TIME})


class FixedModel:
    """A model with all its parameters' `values` (k,); `torque` and `acceleration` take one state (n,) or a batch (N, n) on the joint side.

    Rigid body, rotor inertia, viscous and dry friction, offsets and linear springs are one compiled call; with other effects the general
    way is taken. Raises UnsupportedError for an effect that depends on more than the state."""

    def __init__(self, model: Model, values: Array) -> None:
        beyond = [effect.name for effect in model.effects if effect.needs & _BEYOND_A_STATE]
        if beyond:
            raise UnsupportedError(
                f"effect {beyond[0]!r} depends on more than the state at the instant (time, other instants, measured torque): predict whole"
                " signals with `predict`, or fit a model without it."
            )
        self.model, self.values = model, np.asarray(values, float)
        drive = _drive(model, self.values)
        self.compiled = drive is not None
        self.torque = self._torque if drive is None else drive.torque
        self.acceleration = self._acceleration if drive is None else drive.acceleration

    def _torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        robot = self.model.robot
        shape = np.shape(q)
        motion = Motion.of(robot, *(np.atleast_2d(np.asarray(x, float)) for x in (q, dq, ddq)))
        if self.model.needs & {Need.LOAD, Need.REFERENCE}:
            motion = motion.with_reference(Reference(self.model, self.values))
        return self.model.torque(motion, self.values).reshape(shape)

    def _acceleration(self, q: Array, dq: Array, tau: Array) -> Array:
        shape = np.shape(q)
        q, dq, tau = (np.atleast_2d(np.asarray(x, float)) for x in (q, dq, tau))
        return self.model.forward_dynamics(q, dq, tau, self.values).reshape(shape)


def _drive(model: Model, values: Array) -> rigid.Drive | None:
    """The compiled form, where there is one."""
    robot, n = model.robot, model.robot.n
    if not robot.loop.is_trivial or robot.tree.floating or robot.tree.nv != n:
        return None
    inertia = np.zeros(10 * robot.tree.nb)
    constant, square, level = np.zeros(n), {f: np.zeros((n, n)) for f in Factor}, {side: np.zeros((n, n)) for side in Side}
    measured = robot.transmission.measured
    for effect, part in zip(model.effects, model.slices, strict=True):
        if isinstance(effect, RigidBody):
            inertia = inertia + values[part]
            continue
        found = coefficients(effect, values[part], robot)
        if found is None:
            return None
        rates, to_measured = _rates(robot, effect.side), robot.transmission.torque_map(effect.side, measured)
        constant = constant + to_measured @ (found[Factor.ONE] - found[Factor.POSITION] * (rates @ _zero(robot, effect.side)))
        for factor in (Factor.POSITION, Factor.SPEED, Factor.ACCELERATION):
            square[factor] = square[factor] + to_measured @ (found[factor][:, None] * rates)
        level[effect.side] = level[effect.side] + to_measured * found[Factor.DIRECTION]
    sides = [side for side in Side if level[side].any()]
    terms = DriveTerms(
        robot.transmission.torque_map(Side.JOINT, measured),
        constant,
        square[Factor.POSITION],
        square[Factor.SPEED],
        square[Factor.ACCELERATION],
        np.concatenate([_rates(robot, side) for side in sides]) if sides else np.zeros((0, n)),
        np.concatenate([level[side] for side in sides], axis=1) if sides else np.zeros((n, 0)),
    )
    return rigid.drive(robot.tree, inertia, terms)


def _rates(robot: Robot, side: Side) -> Array:
    """Rates on a side per joint rate (n, n)."""
    return np.eye(robot.n) if side == Side.JOINT else robot.transmission.K_inverse


def _zero(robot: Robot, side: Side) -> Array:
    """Joint positions (n,) at which positions on a side are zero."""
    zero = robot.transmission.zero
    return np.zeros(robot.n) if side == Side.JOINT or zero is None else np.asarray(zero)
