"""The regressor as a time derivative: Φ = d/dt P + G (momentum) and rateᵀ Φ = d/dt E + D (energy), with the same columns.

P and E need positions and velocities only, so that an integrated equation needs no acceleration. For the rigid body P is the
generalised momentum M dq, G = gravity − ∂(kinetic energy)/∂q, E the kinetic energy and D the power of gravity (Lagrange).
For any other effect whose torque holds A(q) ddq: P = A dq and G = torque at rest of acceleration − dA/dt dq.
Gautier & Khalil, ICRA 1988 (energy); Slotine & Li 1989 and the integrated form of Yoshida 1995 (momentum)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import singledispatch
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Effect
from ..effects.kinds import Need
from ..effects.motion import Coordinates, Motion
from ..effects.rigid_body import RigidBody
from ..errors import UnsupportedError
from ..regressor.numpy_dynamics import CHUNK, Chunk, cross, into
from ..regressor.rigid import regressor

if TYPE_CHECKING:
    from ..model import Model
    from ..robots.robot import Robot
    from ..robots.tree import RigidBodyTree

Array = np.ndarray

#: Sixth-order central difference of spacing 1.
_DIFFERENCE = {1: 0.75, 2: -0.15, 3: 1 / 60}
#: Shift of a coordinate in it (rad, m): its error is about 1e-12 of the slope.
_STEP = 2e-3
#: What depends on more than the motion of an instant has no momentum of its own.
_WHOLE = frozenset({Need.LOAD, Need.REFERENCE, Need.HISTORY, Need.NEIGHBOURS, Need.TORQUE, Need.TIME})


@dataclass(frozen=True, eq=False)
class Parts:
    """Columns of one effect (or a model): `momentum`, `force` (N, n, k) with Φ = d/dt momentum + force on its side;
    `energy`, `power` (N, k) with rateᵀ Φ = d/dt energy + power."""

    momentum: Array
    force: Array
    energy: Array
    power: Array


def model_parts(model: Model, motion: Motion) -> Parts:
    """`Parts` of all columns on the measured side. Accelerations of the motion are used only by effects without momentum."""
    robot = model.robot
    measured = robot.transmission.measured
    N, k = len(motion), len(model.parameters)
    out = Parts(np.zeros((N, robot.n, k)), np.zeros((N, robot.n, k)), np.zeros((N, k)), np.zeros((N, k)))
    for effect, part in zip(model.effects, model.slices, strict=True):
        own = parts(effect, motion, robot)
        for source, target in ((own.momentum, out.momentum), (own.force, out.force)):
            if effect.side != measured and source.any():
                source = np.matmul(robot.transmission.torque_map(effect.side, measured), source)
            target[:, :, part] = source
        # Power is the same on both sides.
        out.energy[:, part], out.power[:, part] = own.energy, own.power
    return out


@singledispatch
def parts(effect: Effect, motion: Motion, robot: Robot) -> Parts:
    """`Parts` of one effect on its own side, each column by asking the effect how it depends on acceleration."""
    full = effect.columns(motion, robot)
    rate = motion.on(effect.side).dq
    none = np.zeros_like(full)
    if effect.needs & _WHOLE:
        return _resting(full, rate)
    still = effect.columns(_with(motion, robot, ddq=0.0), robot)
    if np.array_equal(full, still):
        return _resting(full, rate)
    momentum = _inertia_times(effect, motion, robot, motion)
    change = np.zeros_like(full)
    for i, weight in _DIFFERENCE.items():
        ahead, behind = (_inertia_times(effect, _shifted(motion, robot, sign * i), robot, motion) for sign in (1, -1))
        if i == 1 and np.array_equal(ahead, behind):
            break
        change += weight * (ahead - behind)
    # The shift was along the velocity, by _STEP in its largest coordinate at each sample.
    change *= (_speed(motion) / _STEP)[:, None, None]
    force = still - change
    energy = 0.5 * np.einsum("Nj,Njk->Nk", rate, momentum)
    power = np.einsum("Nj,Njk->Nk", rate, still - 0.5 * change)
    return Parts(momentum + none, force, energy, power)


def _resting(columns: Array, rate: Array) -> Parts:
    """Parts of columns that hold no momentum."""
    N, _, k = columns.shape
    return Parts(np.zeros_like(columns), columns, np.zeros((N, k)), np.einsum("Nj,Njk->Nk", rate, columns))


def _with(motion: Motion, robot: Robot, *, ddq: float) -> Motion:
    own = motion.joint
    return motion.moved(robot, replace(own, ddq=np.full_like(own.ddq, ddq)))


def _speed(motion: Motion) -> Array:
    """Largest joint speed (N,) at each sample; where nothing moves, 1."""
    top = np.abs(motion.joint.dq).max(axis=1)
    return np.where(top > 0, top, 1.0)


def _shifted(motion: Motion, robot: Robot, steps: int) -> Motion:
    own = motion.joint
    along = own.dq * (_STEP / _speed(motion))[:, None]
    return motion.moved(robot, replace(own, q=own.q + steps * along))


def _inertia_times(effect: Effect, place: Motion, robot: Robot, motion: Motion) -> Array:
    """A(q) dq (N, n, k) at the positions of `place` for the velocities of `motion`, from the effect's own columns."""
    at_rest = np.zeros_like(place.joint.dq)

    def columns(ddq: Array) -> Array:
        return effect.columns(place.moved(robot, Coordinates(place.joint.q, at_rest, ddq)), robot)

    return columns(motion.joint.dq) - columns(at_rest)


@parts.register(RigidBody)
def _(effect: RigidBody, motion: Motion, robot: Robot) -> Parts:
    if robot.floating_base:
        raise UnsupportedError(
            f"robot {robot.name!r} has a floating base: the momentum and energy forms are for fixed bases; use the torque form."
        )
    own = motion.joint
    q, dq = robot.tree_position(own.q), robot.tree_rate(own.dq)
    momentum, slope = momentum_regressor(robot.tree, q, dq)
    gravity = regressor(robot.tree, q, np.zeros_like(dq), np.zeros_like(dq))
    energy = 0.5 * np.einsum("Nj,Njk->Nk", dq, momentum)
    power = np.einsum("Nj,Njk->Nk", dq, gravity)
    force = gravity - slope
    if not robot.loop.is_trivial:
        momentum, force = (np.einsum("tj,Ntk->Njk", robot.loop.W, x) for x in (momentum, force))
    return Parts(momentum, force, energy, power)


def momentum_regressor(tree: RigidBodyTree, q: Array, dq: Array) -> tuple[Array, Array]:
    """Generalised momentum M dq and the slope ∂(½ dqᵀ M dq)/∂q of the kinetic energy, both (N, nv, 10 nb) per unit parameter.

    Joint j moves body i by the unit velocity S_j; a change of q_j changes body i's velocity by v_j × S_j, carried to i."""
    nb = tree.nb
    momentum, slope = np.zeros((len(q), nb, 10 * nb)), np.zeros((len(q), nb, 10 * nb))
    for start in range(0, len(q), CHUNK):
        part = slice(start, min(start + CHUNK, len(q)))
        kinematics = Chunk(tree, q[part])
        v: list[Array] = []
        w: list[Array] = []
        units: list[tuple[Array, Array]] = []  # (linear, angular), each (3, 2d, n): S of the d joints up to the base, then v × S
        rows: list[Array] = []
        for i, up in enumerate(tree.parent):
            pose, rate = kinematics.poses[i], dq[part, i]
            vi, wi = np.zeros((3, kinematics.n)), np.zeros((3, kinematics.n))
            if up >= 0:
                vi, wi = into(pose.R, v[up] + cross(w[up], np.broadcast_to(pose.p, v[up].shape))), into(pose.R, w[up])
            linear, angular = (x * np.ones(kinematics.n) for x in kinematics.subspace(i))
            vi, wi = vi + linear * rate, wi + angular * rate
            turn = cross(wi, linear) + cross(vi, angular), cross(wi, angular)
            own = tuple(np.stack([s, t], axis=1) for s, t in zip((linear, angular), turn, strict=True))
            index = np.array([i])
            if up >= 0:
                l_up, s_up = units[up]
                moved = into(pose.R, l_up + cross(s_up, np.broadcast_to(pose.p[:, None], s_up.shape)))
                turned = into(pose.R, s_up)
                own = tuple(np.concatenate([x, y], axis=1) for x, y in zip((moved, turned), own, strict=True))
                index = np.append(rows[up], i)
            v.append(vi)
            w.append(wi)
            units.append((own[0], own[1]))
            rows.append(index)
            block = _momentum_block(own[0], own[1], vi, wi).transpose(2, 1, 0)
            columns = slice(10 * i, 10 * i + 10)
            momentum[part, index, columns] = block[:, 0::2]
            slope[part, index, columns] = block[:, 1::2]
    return momentum, slope


def _momentum_block(linear: Array, angular: Array, v: Array, w: Array) -> Array:
    """Unit velocities (3, d, n) against the momentum of a body that moves with (v, w), per unit parameter: (10, d, n)."""
    block = np.empty((10, *linear.shape[1:]))
    v, w = v[:, None], w[:, None]
    block[0] = (linear * v).sum(0)
    block[1:4] = cross(linear, np.broadcast_to(w, linear.shape)) + cross(np.broadcast_to(v, linear.shape), angular)
    for row, (x, y) in zip(range(4, 10), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), strict=True):
        block[row] = angular[x] * w[y]
        if x != y:
            block[row] += angular[y] * w[x]
    return block
