"""Between a motor's encoder and its link: an elastic gear, play.

The position is read at the motor; the link moves by δ more. With u the torque that the link would ask for at the position read and I its
inertia, I d²δ/dt² = −u while nothing holds it; a spring of stiffness k adds −k δ and its damping, the flanks of a gap a knock. The
torque at the motor then is that of the link's true motion: the prediction plus T(δ, dδ/dt, d²δ/dt²). What is fitted is the response,
by how much of this the data show: 1 if the shape is right.

Rigid motion does not tell the link's inertia from that of the rotor that turns with it (but through other joints): how much of what the
model gives the link is the rotor's is a shape."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from ..errors import ConfigurationError
from ..robots.parameters import Parameter, ShapeParameter
from ..robots.transmission import Side
from .base import Effect
from .flexing import responses
from .kinds import Axis, Need
from .motion import Coordinates, Motion
from .play import Flights, Jolts, played
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .motion import Prediction

Array = np.ndarray

#: Springs that are followed at a time: their coefficients take memory.
_LANES = 32
#: The link's inertia is nowhere taken for less than this share of what it usually is.
_LEAST = 0.1
#: Rotors that are worth a search, as shares of what the model gives the link; below zero: it gives the link too little.
_ROTORS = (-1.0, 0.95)
_NO_INERTIA = 1e-6
#: Share of its travel by which a link leaves its motor at most, under load or within a play; and how wide a range of stiffness is
#: sought at least.
_SAG, _WIDTH = 0.1, 10.0
#: Impacts that are worth a search, s.
_KNOCKS = (0.001, 0.03)
#: A joint that is slower than this share of its usual speed when a run starts is taken to start from rest.
_AT_REST = 0.02


@dataclass(frozen=True, eq=False)
class _Link:
    """What hangs behind the encoder of a joint, over the N samples of a run: `load` (N,) torque that it asks for at the position read,
    `first` at the very start; `inertia` (N,) about the joint; `acceleration` (N,) of the motor's side; `rate`, `cutoff_hz` of the run."""

    load: Array
    first: float
    inertia: Array
    acceleration: Array
    rate: float
    cutoff_hz: float


@dataclass(frozen=True, kw_only=True)
class _Compliance(Effect):
    """`side`: the side of the transmission on which it is. `rotor`: inertia about the joint (on that side) that the model gives to the
    link, but that is before the gear and turns with the motor."""

    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE, Need.HISTORY})
    symbol: ClassVar[str]
    form_of: ClassVar[str] = "spring between motor and link"

    side: Side = Side.JOINT
    rotor: float = 0.0

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        return tuple(Parameter(self.named(self.symbol, robot, j), "1", self.name, robot.joint_names[j], 0.0) for j in self.at(robot))

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("rotor", "kg m^2 (kg)", -1e6, 1e6, 0.0, points=1),)

    @classmethod
    @abstractmethod
    def moved(cls, effects: Sequence[Self], link: _Link) -> list[tuple[Array, Array, Array]]:
        """δ and its two derivatives (N,) of each of several effects of one link."""

    def columns(self, motion: Motion, robot: Robot) -> Array:
        (columns,) = self.columns_of([self], motion, robot)
        return columns

    @classmethod
    def columns_of(cls, effects: Sequence[Self], motion: Motion, robot: Robot) -> list[Array]:
        motion.needed_rate(f"effect {cls.name!r}")
        reference = motion.needed_reference(f"effect {cls.name!r}")
        out = [np.zeros((len(motion), robot.n, len(effect.at(robot)))) for effect in effects]
        alike: dict[tuple[int, Side, float], list[tuple[Self, Array]]] = {}
        for effect, columns in zip(effects, out, strict=True):
            for column, j in enumerate(effect.at(robot)):
                alike.setdefault((j, effect.side, effect.rotor), []).append((effect, columns[:, :, column]))
        for (j, side, _), own in alike.items():
            one = own[0][0]
            link = one._link(j, motion, reference)
            if link is None:
                continue
            for (_, target), delta in zip(own, cls.moved([effect for effect, _ in own], link), strict=True):
                felt = reference.along(motion, one.moves(robot, j), delta, link_only=True)
                target[:] = robot.transmission.torque(felt, Side.JOINT, side)
                # The rotor does not move with the link.
                target[:, j] -= one.rotor * delta[2]
        return out

    def _link(self, j: int, motion: Motion, reference: Prediction) -> _Link | None:
        """What hangs behind joint (or motor) j; None where the model gives it no inertia."""
        robot = reference.model.robot
        along = self.moves(robot, j)
        inertia = self._inertia(j, motion, reference)
        usual = _usual(inertia) - self.rotor
        if usual <= 0.0:
            return None
        acceleration = motion.on(self.side).ddq[:, j]
        load = motion.needed_load(f"effect {self.name!r}", Side.JOINT) @ along - self.rotor * acceleration
        own = np.maximum(inertia - self.rotor, _LEAST * usual)
        resting, begun = self._first_load(motion, reference)
        first = float(resting @ along) - (self.rotor * float(acceleration[0]) if begun else 0.0)
        return _Link(load, first, own, acceleration, motion.rate, motion.cutoff_hz)

    def _inertia(self, j: int, motion: Motion, reference: Prediction) -> Array:
        return reference.inertia(motion, self.moves(reference.model.robot, j))

    def _rotors(self, motion: Motion, robot: Robot) -> tuple[float, float]:
        """Rotors that are worth a search: next to none where the model gives the link no inertia."""
        usual = [0.0] if motion.reference is None else [_usual(self._inertia(j, motion, motion.reference)) for j in self.at(robot)]
        most = max([*usual, _NO_INERTIA])
        return _ROTORS[0] * most, _ROTORS[1] * most

    def _first_load(self, motion: Motion, reference: Prediction) -> tuple[Array, bool]:
        """Load (n,) under which the links are at rest when the run starts, the static one where the robot starts from rest, however
        abruptly, else that of the first sample; and whether it is in motion then."""
        one = Coordinates(*(x[:1] for x in (motion.joint.q, motion.joint.dq, motion.joint.ddq)))
        usual = np.sqrt(np.mean(motion.joint.dq**2, axis=0))
        begun = not np.all(np.abs(one.dq[0]) <= _AT_REST * usual)
        if not begun:
            one = replace(one, ddq=np.zeros_like(one.ddq))
        start = replace(motion, t=motion.t[:1], joint=one, torque=None, load=None, reference=None)
        return reference.load(start.moved(reference.model.robot, one))[0], begun

    def response(self, robot: Robot) -> Array:
        return np.ones(len(self.at(robot)))

    def moves(self, robot: Robot, j: int) -> Array:
        """Joint motion (n,) per unit deflection."""
        return np.eye(robot.n)[j] if self.side == Side.JOINT else robot.transmission.K[:, j]


@register
@dataclass(frozen=True, kw_only=True)
class JointElasticity(_Compliance):
    """An elastic gear behind the encoder: τ = elastic × T(δ), δ the deflection of a spring of `stiffness` under the link.

    `damping`: share of the critical one. Seen near the anti-resonance (stiffness / inertia)^½ / 2π.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.JointElasticity(joints=("joint2",), stiffness=10000.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('elastic_joint2', '1')]
    """

    name: ClassVar[str] = "joint_elasticity"
    title: ClassVar[str] = "elastic joint"
    axis: ClassVar[Axis] = Axis.LOAD
    symbol: ClassVar[str] = "elastic"

    stiffness: float = 1e4
    damping: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= float(self.damping) <= 1.0:
            raise ConfigurationError(
                f"effect {self.name!r}: damping, a share of the critical one, must be from 0 to 1, not {self.damping!r}."
            )

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (
            ShapeParameter("stiffness", "N m/rad (N/m)", 1e-4, 1e10, 1e4, log=True, points=8),
            *super().shape(),
            ShapeParameter("damping", "1", 0.01, 1.0, 0.1, log=True, points=1),
        )

    def told_by(self, values: Array) -> Self:
        """A spring gives in proportion to its load: what it gives beside one of this stiffness says how stiff it is."""
        value = float(np.mean(values))
        return self.nearest_shape(stiffness=self.stiffness / value) if value > 0.0 else self

    @classmethod
    def moved(cls, effects: Sequence[Self], link: _Link) -> list[tuple[Array, Array, Array]]:
        found = []
        for start in range(0, len(effects), _LANES):
            part = effects[start : start + _LANES]
            stiffness, damping = (np.array([getattr(effect, key) for effect in part], float) for key in ("stiffness", "damping"))
            delta = responses(link.load / link.inertia, link.inertia, stiffness, damping, 1.0 / link.rate, link.first / link.inertia[0])
            found += [(delta[0][:, i], delta[1][:, i], delta[2][:, i]) for i in range(len(part))]
        return found

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """Stiffness under which the link sags by no more than a tenth of its travel (a drive's play is sought as far), and that puts the
        resonance between what the run lasts and what its samples resolve."""
        ranges = {"damping": (0.05, 0.5), "rotor": self._rotors(motion, robot)}
        most = ranges["rotor"][1]
        if motion.reference is None or motion.rate <= 0.0:
            return self.bounded(**ranges)
        slow, fast = 2.0 * np.pi * 2.0, 2.0 * np.pi * min(motion.rate / 3.0, 300.0)
        low = max((1.0 - _ROTORS[1]) * most * slow**2, self._softest(motion, robot))
        return self.bounded(stiffness=(low, max(most * fast**2, _WIDTH * low)), **ranges)

    def _softest(self, motion: Motion, robot: Robot) -> float:
        """Stiffness that lets the link sag by the largest share of its travel that is sought, under its largest load."""
        if motion.load is None or not len(motion):
            return 0.0
        travel, at = np.ptp(motion.on(self.side).q, axis=0), self.at(robot)
        return min(float(np.abs(motion.load @ self.moves(robot, j)).max() / max(_SAG * travel[j], 1e-9)) for j in at)


@register
@dataclass(frozen=True, kw_only=True)
class Backlash(_Compliance):
    """Play in the gear behind the encoder: τ = play × T(δ), δ the link's motion in a `gap` (whole width) between rigid flanks.

    Within the gap the link is free: the motor feels none of it until the other flank is reached, with a knock that takes the link's
    whole speed, its middle `knock` seconds after the link touches.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.Backlash(joints=("joint2",), gap=0.001)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('play_joint2', '1')]
    """

    name: ClassVar[str] = "backlash"
    title: ClassVar[str] = "backlash (play in the gear)"
    axis: ClassVar[Axis] = Axis.LOAD
    symbol: ClassVar[str] = "play"

    gap: float = 1e-3
    knock: float = 0.005

    def shape(self) -> tuple[ShapeParameter, ...]:
        # Where a flank is reached, and how hard, depends on the gap by fractions of it. Real flanks give, and a link is braked on its way
        # between them: on simulated gears with such flanks gaps came out at 0.57 to 1.10, a fourth of them below 0.8.
        gap = ShapeParameter("gap", "rad (m)", 1e-8, 10.0, 1e-3, log=True, points=12, idealised=0.2)
        return (gap, *super().shape(), ShapeParameter("knock", "s", 1e-4, 0.1, 0.005, log=True, points=1))

    @classmethod
    def moved(cls, effects: Sequence[Self], link: _Link) -> list[tuple[Array, Array, Array]]:
        jolts = Jolts.of(link.acceleration, link.rate, link.cutoff_hz)
        free = Flights(-link.load / link.inertia, 1.0 / link.rate)
        return [played(free, effect.gap, effect.knock, jolts, -1.0 if link.first > 0.0 else 1.0) for effect in effects]

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """A gap up to a tenth of the range that is moved through; one of a hundred-thousandth of it no encoder shows."""
        q = motion.on(self.side).q[:, self.at(robot)]
        span = float(np.ptp(q, axis=0).max()) if q.size else 0.0
        return self.bounded(gap=(1e-5 * span, _SAG * span), rotor=self._rotors(motion, robot), knock=_KNOCKS)


def _usual(inertia: Array) -> float:
    return float(np.median(inertia)) if len(inertia) else 0.0
