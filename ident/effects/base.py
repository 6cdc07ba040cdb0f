"""The effect contract: each term of a model is one small frozen object, and nothing asks which one it is.

To add an effect, subclass `Effect` (or `JointEffect`, for the common case of the same few columns on each joint), give it a
name and register it with `@register`. The contract tests then find it by themselves."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from ..errors import ConfigurationError, unknown_name
from ..robots.parameters import Parameter, ShapeParameter
from ..robots.transmission import Side
from .kinds import Axis, Nature, Need, choice
from .motion import Motion
from .sums import EffectSum

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .correction import SignalCorrection

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """One additive term of the torque equation, linear in its parameters.

    `joints`: names of the joints (or motors) it sits on, None for all. `side`: the side on which its torque acts.
    `label`: goes into the names of its parameters, so that two effects of one kind can sit on the same joint.
    Shape (nonlinear) parameters are further fields, declared by `shape`.

    Examples
    --------
    >>> import ident
    >>> isinstance(ident.friction.Coulomb(joints=["joint1"]), ident.Effect)
    True
    """

    name: ClassVar[str]
    title: ClassVar[str]
    axis: ClassVar[Axis]
    nature: ClassVar[Nature] = Nature.DRIVE
    needs: ClassVar[frozenset[Need]] = frozenset()
    #: Whether it sits on joints one by one. If not, it is one thing for the whole robot; `joints`, if it is of use, says where.
    per_joint: ClassVar[bool] = True
    #: Whether it is a cause that a diagnosis may name: a description is none.
    cause: ClassVar[bool] = True
    #: Whether one cause may put it on all joints alike (one clock for all readings): then it is sought on all of them at once as well.
    everywhere: ClassVar[bool] = False
    #: Whether a robot that has it on one joint mostly has it on all: joints that ask for it, each with a value of its own, get it together.
    usual: ClassVar[bool] = False
    #: Effects of one such kind are forms of the same thing: a joint has one of them at most ("": it stands for itself).
    form_of: ClassVar[str] = ""
    #: Share by which a response that must have one value may seem to be another, for what is left out of the law.
    tolerance: ClassVar[float] = 0.4

    joints: tuple[str, ...] | None = None
    side: Side = Side.MOTOR
    label: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "side", choice(Side, self.side, "side", self.name))
        if self.joints is not None:
            object.__setattr__(self, "joints", (self.joints,) if isinstance(self.joints, str) else tuple(self.joints))
        for parameter in self.shape():
            value = getattr(self, parameter.name)
            if isinstance(value, bool) or not (isinstance(value, Real) and parameter.lower <= float(value) <= parameter.upper):
                raise ConfigurationError(
                    f"effect {self.name!r}: {parameter.name} must be a number from {parameter.lower:g} to {parameter.upper:g}"
                    f" ({parameter.unit}), not {value!r}."
                )
            object.__setattr__(self, parameter.name, float(value))

    def __add__(self, other: Any) -> EffectSum[Effect]:
        return EffectSum[Effect]((self,)) + other

    @classmethod
    def placements(cls, robot: Robot, **configuration: Any) -> Iterator[Self]:
        """Every smallest thing of this kind that a robot can have: one a joint, or one for the whole robot.

        `configuration`: other fields. Raises ConfigurationError where the robot can have none at all."""
        if not cls.per_joint:
            yield cls(**configuration)
            return
        for j in cls(**configuration).at(robot):
            yield cls(joints=(robot.joint_names[j],), **configuration)

    @abstractmethod
    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        """The linear parameters, in the order of the columns."""

    @abstractmethod
    def columns(self, motion: Motion, robot: Robot) -> Array:
        """Torque per unit parameter, (N, n, k), on the effect's side."""

    @classmethod
    def columns_of(cls, effects: Sequence[Self], motion: Motion, robot: Robot) -> Iterable[Array]:
        """`columns` of several effects of this kind on one motion, one after the other; faster than one by one where work can be shared."""
        return (effect.columns(motion, robot) for effect in effects)

    def shape(self) -> tuple[ShapeParameter, ...]:
        """The nonlinear parameters: fields of this effect."""
        return ()

    def shape_unit(self, parameter: ShapeParameter, robot: Robot) -> str:
        """Unit of a shape parameter on the joints of this effect: of one that is declared for joints that turn and, in brackets, for those
        that slide, the one of their kind; both where they are of both kinds."""
        turning, _, sliding = parameter.unit.partition(" (")
        counted = getattr(self, "angle", None)  # the side whose angle an order counts
        side = counted if isinstance(counted, Side) else self.side
        kinds = {robot.position_unit(j, side) for j in self.at(robot)}
        if not sliding or len(kinds) != 1:
            return parameter.unit
        return sliding.removesuffix(")") if kinds == {"m"} else turning

    def with_shape(self, **values: float) -> Self:
        """The same effect with other shape parameters."""
        known = [p.name for p in self.shape()]
        for name in values:
            if name not in known:
                raise unknown_name(f"shape parameter of effect {self.name!r}", name, known)
        changes: dict[str, Any] = dict(values)
        return dataclasses.replace(self, **changes)

    def nearest_shape(self, **values: float) -> Self:
        """The same effect with other shape parameters, each at the nearest value that it can have."""
        ends = self.bounded()
        return self.with_shape(**{name: float(np.clip(value, *ends[name])) for name, value in values.items()})

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """For each shape parameter the range worth searching on these samples, within its bounds."""
        return self.bounded()

    def could_show(self, motion: Motion, robot: Robot) -> bool:
        """Whether a run of this length could show the effect at all, by where its physics puts it."""
        return True

    def bounded(self, **ranges: tuple[float, float]) -> dict[str, tuple[float, float]]:
        """Ranges of all shape parameters: those given, cut to the bounds; the bounds where none is given or nothing is left."""
        out = {}
        for p in self.shape():
            low, high = ranges.get(p.name, (p.lower, p.upper))
            low, high = max(low, p.lower), min(high, p.upper)
            out[p.name] = (low, high) if low < high else (p.lower, p.upper)
        return out

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        """Torque (N, n) on the effect's side for parameter values (k,)."""
        return self.columns(motion, robot) @ values

    def affine(self, motion: Motion, robot: Robot, values: Array) -> tuple[Array, Array | None]:
        """Torque (N, n) without acceleration, and what a unit of each joint's acceleration adds to it, (N, n, n) with the accelerated joint
        last, or None for nothing; on the effect's side, for parameter values (k,). Accelerations of `motion` do not count."""
        n, at_rest = robot.n, np.zeros_like(motion.joint.dq)
        bias = self.torque(accelerated(motion, robot, at_rest), robot, values)
        parts = [self.torque(accelerated(motion, robot, at_rest + np.eye(n)[j]), robot, values) - bias for j in range(n)]
        return bias, np.stack(parts, axis=2)

    def applied(self, robot: Robot, values: Array) -> Robot | SignalCorrection | None:
        """The finding made permanent, for parameter values (k,): the robot it means, or what to do to the logged signals.

        None: the effect stays a term of the model."""
        return None

    def response(self, robot: Robot) -> Array | None:
        """Values (k,) that the parameters must have for the effect to be what its shape says (a spring's whole response, a filter's own
        lag); None: they are free."""
        return None

    def told_by(self, values: Array) -> Self:
        """The effect with the shape that its own fitted values (k,) tell, where its response is that shape; else as it is."""
        return self

    def told_shape(self, robot: Robot) -> str | None:
        """Name of the shape that its values tell; None where they tell none."""
        count = len(self.parameters(robot))
        told = [self.told_by(np.full(count, value)) for value in (1.0, 2.0)]
        return next((p.name for p in self.shape() if any(getattr(t, p.name) != getattr(self, p.name) for t in told)), None)

    def denied_by(self) -> Effect | None:
        """What would not be there if this is what happens: if its columns gain anything beside this effect's, something else is. None: no
        such thing is known."""
        return None

    def unresolved(self, interval: float) -> float:
        """Size of its parameters up to which a log with `interval` seconds between its samples does not tell the effect from none."""
        return 0.0

    def memory(self, robot: Robot) -> Array:
        """Seconds (n,) for which what the prediction was at a moment is in the effect's torque on each joint's row, on the effect's side;
        negative where it is there before."""
        return np.zeros(robot.n)

    def implausible(self, robot: Robot, values: Array, std: Array) -> str:
        """Why fitted values (k,) with these standard deviations cannot be those of such an effect: a response that is not within
        `tolerance` (and 3 standard deviations) of what it must be; "" if nothing speaks against them. Bounds of parameters are looked
        at elsewhere."""
        right = self.response(robot)
        if right is None:
            return ""
        values, size = np.asarray(values), np.abs(right)
        # Where it must be nothing (a delay of zero: the slope alone) it is what fits in first order, and that may be anything.
        off = (size > 0.0) & (np.abs(values - right) > self.tolerance * size + 3.0 * np.asarray(std))
        if not off.any():
            return ""
        first = int(np.argmax(off))
        return f"the response is {float(values[first] / right[first]):.3g} times what {self.title} would give"

    def at(self, robot: Robot) -> list[int]:
        """Indices of the joints the effect sits on. Raises ConfigurationError for a name the robot does not have."""
        return list(range(robot.n)) if self.joints is None else [robot.joint_index(j) for j in self.joints]

    def named(self, symbol: str, robot: Robot, j: int) -> str:
        """Name of a parameter on joint j. Behind a gear, an effect off its usual side is marked J (joint) or M (motor)."""
        usual = type(self).__dataclass_fields__["side"].default
        mark = "" if self.side == usual or robot.is_direct(j) else self.side[0].upper()
        return f"{symbol}{mark}{self.label}_{robot.joint_names[j]}"


def accelerated(motion: Motion, robot: Robot, ddq: Array) -> Motion:
    """The same states at other joint accelerations (N, n)."""
    motor = replace(motion.motor, ddq=robot.transmission.motor_rate(ddq))
    return replace(motion, joint=replace(motion.joint, ddq=ddq), motor=motor)
