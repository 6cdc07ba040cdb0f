"""What loads the drive beside the rigid body: a model's effects, and forces of the user's own with states of their own.

Both become `Term`s of one kind. How a term depends on acceleration and whether it jumps where a speed changes sign is found
by asking it, so that simulation treats every effect alike."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..effects.base import Effect
from ..effects.factors import coefficients
from ..effects.force import ForceModel, Simulated
from ..effects.joint_effect import JointEffect
from ..effects.kinds import Factor, Nature, Need
from ..effects.motion import Motion
from ..effects.rigid_body import RigidBody
from ..errors import ConfigurationError, UnsupportedError
from ..robots.reach import reach
from ..robots.robot import Robot
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..model import Model

Array = np.ndarray

#: A speed that has a sign and nothing else.
TINY = 1e-200
_PROBES = 48


@dataclass(frozen=True, eq=False)
class Term:
    """A force and how it behaves.

    `inertia` (n, n): the constant part of its dependence on acceleration, on its side; `implicit`: its dependence on
    acceleration is of another kind; `jumps` (n,) bool: coordinates of its side at whose zero speed it jumps, `own_rows`: each in
    its own row alone; `needs_load`: it asks for the torque of the links; `link`: it is part of that torque; `idle`: it is
    nothing but `inertia`; `states`: number of its own states; `follows_path`: they go through `ForceModel.carried`; `parts`: for an
    effect that says so, all it is: per factor the coefficients (n,) of its joints."""

    force: ForceModel
    side: Side
    inertia: Array
    implicit: bool
    jumps: Array
    own_rows: bool
    needs_load: bool
    link: bool
    idle: bool
    states: int
    follows_path: bool
    parts: Mapping[Factor, Array] | None = None


@dataclass(frozen=True, eq=False)
class EffectForce(ForceModel):
    """One effect of a model with values (k,) of its linear parameters."""

    effect: Effect
    values: Array

    @property
    def side(self) -> Side:  # type: ignore[override]
        return self.effect.side

    def torque(self, motion: Motion, state: Array, robot: Robot) -> Array:
        return self.effect.torque(motion, robot, self.values)


@dataclass(frozen=True, eq=False)
class EverywhereForce(ForceModel):
    """The same for an effect that sits on every joint: its basis is summed without picking joints, which costs more than it does."""

    effect: JointEffect
    values: Array
    at: list[int]

    @property
    def side(self) -> Side:  # type: ignore[override]
        return self.effect.side

    def torque(self, motion: Motion, state: Array, robot: Robot) -> Array:
        width = len(self.effect.symbols)
        total: Any = 0.0
        for s, basis in enumerate(self.effect.basis(motion.on(self.effect.side), motion, self.at)):
            total = total + basis * self.values[s::width]
        return total


def model_terms(model: Model, values: Array, extra: tuple[ForceModel, ...]) -> tuple[Robot, tuple[Term, ...], Array]:
    """The robot to simulate, all terms beside its rigid body, and the inertial parameters (10 nb,), zero if the model has none.

    What only concerns measuring is left out, and what means another robot (a base that is tilted) becomes that robot."""
    robot = model.robot
    for effect, part in zip(model.effects, model.slices, strict=True):
        if Need.REFERENCE in effect.needs and effect.nature != Nature.SENSOR:
            robot = _made_permanent(effect, values[part], robot)
    inertial = np.zeros(10 * robot.tree.nb)
    found: list[Term] = []
    for effect, part in zip(model.effects, model.slices, strict=True):
        own = values[part]
        if isinstance(effect, RigidBody):
            inertial = inertial + own
        elif effect.nature == Nature.SENSOR or Need.REFERENCE in effect.needs:
            continue
        elif isinstance(effect, Simulated):
            found.append(_examine(effect.name, effect.force_model(robot, own), robot))
        elif effect.needs & {Need.HISTORY, Need.NEIGHBOURS}:
            raise UnsupportedError(
                f"effect {effect.name!r} depends on the motion before and brings no forward model (`force_model`);"
                " leave it out of the simulated model, or give its force through `extra`."
            )
        elif own.any():
            term = _examine(effect.name, _effect_force(effect, own, robot), robot, effect.needs, effect.nature == Nature.LINK)
            found.append(replace(term, parts=coefficients(effect, own, robot)))
    found += [_examine(type(force).__name__, force, robot) for force in extra]
    return robot, tuple(found), inertial


def _made_permanent(effect: Effect, values: Array, robot: Robot) -> Robot:
    changed = effect.applied(robot, values) if values.any() else robot
    if not isinstance(changed, Robot):
        raise UnsupportedError(
            f"effect {effect.name!r} corrects the model's prediction and cannot be simulated; leave it out of the simulated model."
        )
    return changed


def _effect_force(effect: Effect, values: Array, robot: Robot) -> ForceModel:
    everywhere = list(range(robot.n))
    if isinstance(effect, JointEffect) and type(effect).torque is JointEffect.torque and effect.at(robot) == everywhere:
        return EverywhereForce(effect, values, everywhere)
    return EffectForce(effect, values)


def _examine(label: str, force: ForceModel, robot: Robot, needs: frozenset[Need] = frozenset(), link: bool = False) -> Term:
    """Ask a force at random states how it depends on acceleration and where it jumps."""
    n = robot.n
    probe = _random_motion(robot, np.random.default_rng(0))
    state = force.start(probe, robot)
    if state.ndim != 2 or len(state) != _PROBES:
        raise ConfigurationError(f"force {label}: `start` must give one row of states a run, shape ({_PROBES}, s), not {state.shape}.")

    def torque(ddq: Array | None = None, speed: tuple[int, float] | None = None) -> Array:
        value = np.asarray(force.torque(_changed(probe, force.side, ddq, speed), state, robot))
        if value.shape != (_PROBES, n):
            raise ConfigurationError(f"force {label}: `torque` must have shape ({_PROBES}, {n}), one column a joint, not {value.shape}.")
        return value

    rest = torque(ddq=np.zeros((_PROBES, n)))
    scale = float(np.abs(rest).max(initial=0.0))
    slopes = np.stack([torque(ddq=np.tile(row, (_PROBES, 1))) - rest for row in np.eye(n)], axis=2)
    ddq = probe.on(force.side).ddq
    inertia = slopes[0]
    tolerance = 1e-9 * max(float(np.abs(slopes).max()), 1e-6 * scale)
    constant = bool(np.all(np.abs(slopes - inertia) <= tolerance) and np.all(np.abs(torque() - rest - ddq @ inertia.T) <= 30 * tolerance))
    # What does not jump differs here by at most its slope times a speed of 1e-200.
    jump = np.stack([np.abs(torque(speed=(j, TINY)) - torque(speed=(j, -TINY))).max(axis=0) for j in range(n)])
    jumping = jump > 1e-9 * max(scale, 1e-300)
    jumps: Array = np.any(jumping, axis=1)
    own_rows = not np.any(jumping & ~np.eye(n, dtype=bool))
    inertia = np.where(np.abs(inertia) <= tolerance, 0.0, inertia) if constant else np.zeros((n, n))
    needs_load = Need.LOAD in needs
    idle = constant and not needs_load and scale == 0.0 and state.shape[1] == 0 and not jumps.any()
    follows_path = state.shape[1] > 0 and force.carried(probe, state, probe, robot) is not None
    return Term(
        force,
        force.side,
        inertia,
        needs_load or not constant,
        jumps,
        own_rows,
        needs_load,
        link,
        idle,
        state.shape[1],
        follows_path,
    )


def _random_motion(robot: Robot, rng: np.random.Generator) -> Motion:
    n = robot.n
    q = rng.uniform(*reach(robot.joints, stroke=np.pi), (_PROBES, n))
    spread = np.exp(rng.uniform(np.log(1e-3), np.log(10.0), (_PROBES, 1)))
    motion = Motion.of(robot, q, spread * rng.normal(size=q.shape), rng.normal(size=q.shape), rng.uniform(0, 100, _PROBES))
    return replace(motion, load=rng.normal(size=q.shape) * 10.0, torque=rng.normal(size=q.shape) * 10.0)


def _changed(motion: Motion, side: Side, ddq: Array | None, speed: tuple[int, float] | None) -> Motion:
    """The motion with other accelerations, or one other speed, on one side. The other side stays: a force looks at its own."""
    own = motion.on(side)
    if ddq is not None:
        own = replace(own, ddq=ddq)
    if speed is not None:
        dq = own.dq.copy()
        dq[:, speed[0]] = speed[1]
        own = replace(own, dq=dq)
    return replace(motion, joint=own) if side == Side.JOINT else replace(motion, motor=own)
