"""What a link carries: a payload, one picked up during the run, a force from outside."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from ..errors import ConfigurationError
from ..regressor.rigid import inverse_dynamics, regressor
from ..robots.parameters import LINK_SYMBOLS, LINK_UNITS, Parameter, ShapeParameter
from ..robots.transmission import Side
from .base import Effect
from .drift import after, inside, step_time
from .kinds import Axis, Nature, Need
from .motion import Motion
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from ..robots.tree import RigidBodyTree

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class _Carried(Effect):
    """`joints`: the joints whose links carry it; the last joint's if None. Where it is sought, that is each end of a branched tree."""

    nature: ClassVar[Nature] = Nature.LINK
    per_joint: ClassVar[bool] = False

    side: Side = Side.JOINT

    @classmethod
    def placements(cls, robot: Robot, **configuration: Any) -> Iterator[Self]:
        names = [joint.name for joint in robot.tree_joints]
        carrying = [names[body - int(robot.floating_base)] for body in robot.tree.ends if body >= int(robot.floating_base)]
        # Bodies that a loop or a mimic joint moves are not sought on their own: what they carry, the joint that moves them shows.
        ends = [name for name in carrying if name in robot.joint_names]
        if len(ends) < 2:
            yield from super().placements(robot, **configuration)
            return
        for name in ends:
            yield cls(joints=(name,), **configuration)

    def at(self, robot: Robot) -> list[int]:
        return [robot.n - 1] if self.joints is None else super().at(robot)

    def bodies(self, robot: Robot) -> list[int]:
        """Indices of the carrying bodies in the tree."""
        names = [joint.name for joint in robot.tree_joints]
        return [names.index(robot.joint_names[j]) + int(robot.floating_base) for j in self.at(robot)]


@register
@dataclass(frozen=True, kw_only=True)
class Payload(_Carried):
    """A body fixed to a link: τ = Y_link(q, dq, ddq) π, π its ten inertial parameters about the link's joint frame.

    In one log a payload cannot be distinguished from its link: base reduction joins the two. It is of use where the link is known
    (fixed values, a fit without payload).

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.Payload(joints=("joint2",))
    >>> len(effect.parameters(ident.load_robot("scara")))
    10
    """

    name: ClassVar[str] = "payload"
    title: ClassVar[str] = "payload"
    axis: ClassVar[Axis] = Axis.POSITION
    #: What goes before the symbols of the ten parameters in their names.
    prefix: ClassVar[str] = "payload_"
    smallest_mass: ClassVar[float] = 0.0

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        lowest = {"m": self.smallest_mass}
        return tuple(
            Parameter(self.named(self.prefix + symbol, robot, j), unit, self.name, robot.joint_names[j], lowest.get(symbol, -np.inf))
            for j in self.at(robot)
            for symbol, unit in zip(LINK_SYMBOLS, LINK_UNITS, strict=True)
        )

    def columns(self, motion: Motion, robot: Robot) -> Array:
        Y = regressor(robot.tree, *_tree_motion(motion, robot))
        own = [10 * body + s for body in self.bodies(robot) for s in range(10)]
        return self._on_side(np.einsum("tj,Ntk->Njk", robot.loop.W, Y[:, :, own]), robot)

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        inertia = np.zeros(10 * robot.tree.nb)
        for i, body in enumerate(self.bodies(robot)):
            inertia[10 * body : 10 * body + 10] += values[10 * i : 10 * i + 10]
        tau = inverse_dynamics(robot.tree, inertia, *_tree_motion(motion, robot)) @ robot.loop.W
        return robot.transmission.torque(tau, Side.JOINT, self.side)

    def implausible(self, robot: Robot, values: Array, std: Array) -> str:
        """Why there is no body that added, or taken away, would change the ten parameters by so much; "" if one might."""
        blocks = zip(np.reshape(values, (-1, 10)), np.reshape(std, (-1, 10)), strict=True)
        for own, deviation in blocks:
            added, taken_away = _no_body(own, deviation), _no_body(-own, deviation)
            if added and taken_away:
                return added if own[0] >= 0.0 else taken_away
        return ""

    def _on_side(self, columns: Array, robot: Robot) -> Array:
        return columns if self.side == Side.JOINT else np.matmul(robot.transmission.torque_map(Side.JOINT, self.side), columns)


@register
@dataclass(frozen=True, kw_only=True)
class PayloadStep(Payload):
    """A payload picked up (or put down) at t_0: τ = Y_link π for t ≥ t_0, t the run's own clock.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.PayloadStep(joints=("joint2",), t_0=10.0)
    >>> len(effect.parameters(ident.load_robot("scara")))
    10
    """

    name: ClassVar[str] = "payload_step"
    title: ClassVar[str] = "payload picked up or put down during the run"
    axis: ClassVar[Axis] = Axis.TIME
    needs: ClassVar[frozenset[Need]] = frozenset({Need.TIME})
    prefix: ClassVar[str] = "payload_step_"
    smallest_mass: ClassVar[float] = -np.inf

    t_0: float = 10.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (step_time(),)

    def columns(self, motion: Motion, robot: Robot) -> Array:
        return super().columns(motion, robot) * after(motion, self.t_0)[:, None, None]

    @classmethod
    def columns_of(cls, effects: Sequence[Self], motion: Motion, robot: Robot) -> Iterable[Array]:
        always, of = np.zeros(0), None
        for effect in effects:
            # Picked up at whatever moment, it is the same body on the same link.
            if of is None or replace(of, t_0=effect.t_0) != effect:
                always, of = super(PayloadStep, effect).columns(motion, robot), effect
            yield always * after(motion, effect.t_0)[:, None, None]

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        return super().torque(motion, robot, values) * after(motion, self.t_0)[:, None]

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(t_0=inside(motion))


def _no_body(values: Array, std: Array) -> str:
    """Why no body has inertial parameters (10,) within three standard deviations of these; "" if one may. Looked at are conditions that
    every body meets: no mass nor moment of inertia below zero, and no first moment beyond what both allow (Cauchy and Schwarz, of the
    distances of its masses from each axis). A parameter of infinite deviation may be anything."""
    reach = 3.0 * np.asarray(std)
    most, moment = (values + reach).tolist(), np.maximum(np.abs(values) - reach, 0.0).tolist()
    for k in (0, 4, 6, 9):
        if most[k] < 0.0:
            return f"{LINK_SYMBOLS[k]} = {values[k]:.3g} {LINK_UNITS[k]} is that of no body"
    for inertia, across in ((4, (2, 3)), (6, (1, 3)), (9, (1, 2))):
        # Nothing times what may be anything is not known, and so not beyond it.
        if sum(moment[k] ** 2 for k in across) > most[0] * most[inertia]:
            at = " and ".join(LINK_SYMBOLS[k] for k in across)
            return f"{at} are beyond what a body of such mass and such {LINK_SYMBOLS[inertia]} can have"
    return ""


@register
@dataclass(frozen=True, kw_only=True)
class ExternalForce(_Carried):
    """A constant force that the surroundings exert on a link (a hose, a tool that is pulled): τ = −Jᵀ f.

    f = (fx, fy, fz) in the base frame, at `point` (m, in the frame of the link's joint; its origin if not given).

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.ExternalForce(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('fx_joint2', 'N'), ('fy_joint2', 'N'), ('fz_joint2', 'N')]
    """

    name: ClassVar[str] = "external_force"
    title: ClassVar[str] = "constant force on a link"
    axis: ClassVar[Axis] = Axis.POSITION

    point: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        point = tuple(float(x) for x in self.point)
        if len(point) != 3 or not np.all(np.isfinite(point)):
            raise ConfigurationError(f"effect {self.name!r}: point must be three finite numbers (m), not {self.point!r}.")
        object.__setattr__(self, "point", point)

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.named(f"f{axis}", robot, j), "N", self.name, robot.joint_names[j]) for j in self.at(robot) for axis in "xyz"
        )

    def columns(self, motion: Motion, robot: Robot) -> Array:
        bodies = self.bodies(robot)
        forces = [(body, unit) for body in bodies for unit in np.eye(3)]
        return np.stack([self._holding(motion, robot, body, force) for body, force in forces], axis=2)

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        forces = zip(self.bodies(robot), np.reshape(values, (-1, 3)), strict=True)
        return np.sum([self._holding(motion, robot, body, force) for body, force in forces], axis=0)

    def _holding(self, motion: Motion, robot: Robot, body: int, force: Array) -> Array:
        """Torque (N, n) on the effect's side that holds against a force (3,): a unit mass at the point, in a field of that strength."""
        still = np.zeros_like(motion.joint.q)
        mass = np.zeros(10 * robot.tree.nb)
        mass[10 * body : 10 * body + 4] = (1.0, *self.point)
        state = _tree_motion(replace(motion, joint=replace(motion.joint, dq=still, ddq=still)), robot)
        tau = inverse_dynamics(_in_field(robot.tree, tuple(np.asarray(force, float).tolist())), mass, *state) @ robot.loop.W
        return robot.transmission.torque(tau, Side.JOINT, self.side)


@lru_cache(maxsize=64)
def _in_field(tree: RigidBodyTree, field: tuple[float, float, float]) -> RigidBodyTree:
    """The tree in a field of gravity (m/s²): kept, since the kernel prepares every tree that it sees anew."""
    return replace(tree, gravity=np.array(field))


def _tree_motion(motion: Motion, robot: Robot) -> tuple[Any, Any, Any]:
    """Positions, velocities and accelerations of all joints of the tree."""
    own = motion.joint
    return robot.tree_position(own.q), robot.tree_rate(own.dq), robot.tree_rate(own.ddq)
