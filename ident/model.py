"""A model is a sum of effects on one robot; every torque row is on the measured side of the transmission."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ._utils.short_repr import ShortRepr
from .effects.base import Effect
from .effects.kinds import Nature, Need
from .effects.motion import Motion
from .effects.reduction import base_reduction
from .effects.reference import Reference
from .effects.rigid_body import RigidBody
from .effects.sums import EffectSum, terms
from .errors import ConfigurationError
from .robots.parameters import Parameter
from .robots.transmission import Side

if TYPE_CHECKING:
    from .regressor.base_parameters.reduction import BaseReduction
    from .robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Model(ShortRepr):
    """`torque = Σ effects columns @ values`, with k linear parameters in the order of the effects.

    Compose with `+`: `robot.rigid_body() + Viscous() + Coulomb()`.

    Examples
    --------
    >>> import ident
    >>> model = ident.load_robot("scara").rigid_body() + ident.friction.Viscous() + ident.friction.Coulomb()
    >>> [effect.name for effect in model.effects]
    ['rigid_body', 'viscous', 'coulomb']
    """

    robot: Robot
    effects: tuple[Effect, ...]

    def __post_init__(self) -> None:
        if not isinstance(self.effects, tuple):
            found = terms(self.effects) if isinstance(self.effects, Effect | EffectSum) else tuple(self.effects)
            object.__setattr__(self, "effects", found)
        twice = [name for name, count in Counter(p.name for p in self.parameters).items() if count > 1]
        if twice:
            raise ConfigurationError(
                f"the model holds the parameter {twice[0]!r} twice: two effects of one kind sit on the same joint."
                " If both are meant, give one of them a `label`."
            )

    @classmethod
    def of_links(cls, robot: Robot) -> Model:
        """The rigid body of a robot alone, which `robot.rigid_body()` gives."""
        return cls(robot, (RigidBody(),))

    def __add__(self, other: Effect | EffectSum[Effect] | Model) -> Model:
        if isinstance(other, Model):
            if other.robot is not self.robot:
                raise ConfigurationError("two models of different robots cannot be added.")
            return replace(self, effects=self.effects + other.effects)
        return replace(self, effects=(*self.effects, *terms(other)))

    def __radd__(self, other: Effect | EffectSum[Effect]) -> Model:
        return replace(self, effects=(*terms(other), *self.effects))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All k linear parameters."""
        return tuple(p for block in self._blocks for p in block)

    @cached_property
    def _blocks(self) -> tuple[tuple[Parameter, ...], ...]:
        return tuple(effect.parameters(self.robot) for effect in self.effects)

    @cached_property
    def slices(self) -> tuple[slice, ...]:
        """The columns of each effect."""
        ends = np.cumsum([0] + [len(block) for block in self._blocks])
        return tuple(slice(int(a), int(b)) for a, b in pairwise(ends))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(p.name for p in self.parameters)

    @property
    def needs(self) -> frozenset[Need]:
        """What the columns depend on beside the motion at the same instant."""
        return frozenset().union(*(e.needs for e in self.effects)) if self.effects else frozenset()

    @cached_property
    def base(self) -> BaseReduction:
        """Base parameters of the whole model, from its structure."""
        return base_reduction(self)

    def of(self, effects: tuple[Effect, ...]) -> Model:
        """A model of the same robot with these effects alone."""
        return replace(self, effects=effects)

    def of_robot(self, robot: Robot) -> Model:
        """The same effects on another robot."""
        return replace(self, robot=robot)

    def without(self, effect: Effect) -> Model:
        """The same model without one effect (by identity)."""
        return replace(self, effects=tuple(e for e in self.effects if e is not effect))

    def columns(self, motion: Motion) -> Array:
        """The regressor Φ on the measured side, (N, n, k)."""
        robot = self.robot
        out = np.empty((len(motion), robot.n, len(self.parameters)))
        measured = robot.transmission.measured
        for effect, part in zip(self.effects, self.slices, strict=True):
            values = effect.columns(motion, robot)
            if effect.side != measured and not robot.transmission.is_trivial:
                values = np.matmul(robot.transmission.torque_map(effect.side, measured), values)
            out[:, :, part] = values
        return out

    def torque(self, motion: Motion, values: Array) -> Array:
        """Torque (N, n) on the measured side for parameter values (k,)."""
        robot = self.robot
        out = np.zeros((len(motion), robot.n))
        for effect, part in zip(self.effects, self.slices, strict=True):
            own = effect.torque(motion, robot, values[part])
            out += robot.transmission.torque(own, effect.side, robot.transmission.measured)
        return out

    def load(self, motion: Motion, values: Array) -> Array:
        """Torque that the links ask for, (N, n) on the joint side, for parameter values (k,): what the gears transmit."""
        robot = self.robot
        out = np.zeros((len(motion), robot.n))
        for effect, part in zip(self.effects, self.slices, strict=True):
            if effect.nature == Nature.LINK and Need.REFERENCE not in effect.needs:
                out += robot.transmission.torque(effect.torque(motion, robot, values[part]), effect.side, Side.JOINT)
        return out

    def inverse_dynamics(self, q: Array, dq: Array, ddq: Array, values: Array) -> Array:
        """Torque (N, n) on the measured side for a joint-side motion (each (N, n))."""
        motion = Motion.of(self.robot, q, dq, ddq)
        if self.needs & {Need.LOAD, Need.REFERENCE}:
            motion = motion.with_reference(Reference(self, np.asarray(values, float)))
        return self.torque(motion, values)

    def inertia_and_bias(self, q: Array, dq: Array, values: Array) -> tuple[Array, Array]:
        """`(M (N, n, n), b (N, n))` with torque = M ddq + b on the measured side: the columns are affine in ddq."""
        if self.needs & {Need.LOAD, Need.REFERENCE}:
            return self._affine_whole(q, dq, values)
        robot, measured = self.robot, self.robot.transmission.measured
        inertia, bias = np.zeros((*q.shape, robot.n)), np.zeros(q.shape)
        motion = Motion.of(robot, q, dq, np.zeros_like(q))
        for effect, part in zip(self.effects, self.slices, strict=True):
            own, added = effect.affine(motion, robot, np.asarray(values)[part])
            bias += robot.transmission.torque(own, effect.side, measured)
            if added is not None:
                as_is = effect.side == measured or robot.transmission.is_trivial
                inertia += added if as_is else np.matmul(robot.transmission.torque_map(effect.side, measured), added)
        return inertia, bias

    def _affine_whole(self, q: Array, dq: Array, values: Array) -> tuple[Array, Array]:
        """`inertia_and_bias` from the whole torque, where an effect follows the others'."""
        N, n = q.shape
        accelerations = np.concatenate([np.zeros((1, n)), np.eye(n)])
        repeat = n + 1
        torque = self.inverse_dynamics(
            np.repeat(q, repeat, axis=0), np.repeat(dq, repeat, axis=0), np.tile(accelerations, (N, 1)), values
        ).reshape(N, repeat, n)
        bias = torque[:, 0]
        return np.swapaxes(torque[:, 1:] - bias[:, None], 1, 2), bias

    def forward_dynamics(self, q: Array, dq: Array, tau: Array, values: Array) -> Array:
        """Joint accelerations (N, n) for measured-side torque (N, n), from the same columns."""
        M, bias = self.inertia_and_bias(q, dq, values)
        return np.linalg.solve(M, (tau - bias)[..., None])[..., 0]

    def joint_inertia(self, q: Array, values: Array) -> Array:
        """Inertia matrix on the joint side, (N, n, n), reflected rotor inertia included."""
        M, _ = self.inertia_and_bias(q, np.zeros_like(q), values)
        return np.matmul(self.robot.transmission.torque_map(self.robot.transmission.measured, Side.JOINT), M)
