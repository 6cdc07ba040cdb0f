"""Between a motor's encoder and its link: an elastic gear, play (SCIENCE.md 7.1).

The position is read at the motor; the link moves by δ more. With u the torque that the link would ask for at the position
read, I its inertia and k the stiffness, I d²δ/dt² = −u − k x(δ) − damping, x(δ) the spring's deflection: δ itself, or δ less
the play. The torque at the motor then is that of the link's true motion: the prediction plus T(δ, dδ/dt, d²δ/dt²). What is
fitted is the response, by how much of this the data show: 1 if stiffness and play are right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from ..effect import Axis, Effect, Need, register
from ..errors import ConfigurationError
from ..motion import Coordinates, Motion
from ..parameters import Parameter, ShapeParameter
from ..transmission import Side

if TYPE_CHECKING:
    from ..reference import Reference
    from ..robot import Robot

Array = np.ndarray

#: Springs that are followed at a time: their coefficients take memory.
_LANES = 32
#: A joint that is slower than this share of its usual speed when a run starts is taken to start from rest.
_AT_REST = 0.02


@dataclass(frozen=True, kw_only=True)
class _Compliance(Effect):
    """`side`: the side of the transmission on which the spring is. `damping`: share of critical damping."""

    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE, Need.HISTORY})
    symbol: ClassVar[str]
    form_of: ClassVar[str] = "spring between motor and link"

    side: Side = Side.JOINT
    stiffness: float = 1e4
    damping: float = 0.1

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0.0 <= float(self.damping) <= 1.0:
            raise ConfigurationError(
                f"effect {self.name!r}: damping, a share of the critical one, must be from 0 to 1, not {self.damping!r}."
            )

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        return tuple(Parameter(self.named(self.symbol, robot, j), "1", self.name, robot.joint_names[j], 0.0) for j in self.at(robot))

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (
            ShapeParameter("stiffness", "N m/rad (N/m)", 1e-4, 1e10, 1e4, log=True, points=4),
            ShapeParameter("damping", "1", 0.01, 1.0, 0.1, log=True, points=2),
        )

    @property
    def play(self) -> float:
        """Free play, rad or m."""
        return 0.0

    def columns(self, motion: Motion, robot: Robot) -> Array:
        return self.columns_of([self], motion, robot)[0]

    @classmethod
    def columns_of(cls, effects: Sequence[Self], motion: Motion, robot: Robot) -> list[Array]:
        rate = motion.needed_rate(f"effect {cls.name!r}")
        reference = motion.needed_reference(f"effect {cls.name!r}")
        load = motion.needed_load(f"effect {cls.name!r}", Side.JOINT)
        out = [np.zeros((len(motion), robot.n, len(effect.at(robot)))) for effect in effects]
        lanes: dict[tuple[int, Side], list[tuple[Self, Array]]] = {}
        for effect, columns in zip(effects, out, strict=True):
            for column, j in enumerate(effect.at(robot)):
                lanes.setdefault((j, effect.side), []).append((effect, columns[:, :, column]))
        for (j, side), own in lanes.items():
            along = own[0][0].moves(robot, j)
            inertia = _positive(reference.inertia(motion, along))
            if inertia is None:
                continue
            pressed = load @ along / inertia
            first = own[0][0]._first_load(motion, reference) @ along / inertia[0]
            for start in range(0, len(own), _LANES):
                part = own[start : start + _LANES]
                delta = responses(pressed, inertia, *_settings([effect for effect, _ in part]), 1.0 / rate, float(first))
                for lane, (_, target) in enumerate(part):
                    moved = (delta[0][:, lane], delta[1][:, lane], delta[2][:, lane])
                    felt = reference.along(motion, along, moved, link_only=True)
                    target[:] = robot.transmission.torque(felt, Side.JOINT, side)
        return out

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """Stiffness that puts the resonance between what the run lasts and what its samples resolve."""
        if motion.reference is None or motion.rate <= 0.0:
            return self.bounded()
        found = [_positive(motion.reference.inertia(motion, self.moves(robot, j))) for j in self.at(robot)]
        inertia = [float(np.median(x)) for x in found if x is not None]
        if not inertia:
            return self.bounded()
        slow, fast = 2.0 * np.pi * 2.0, 2.0 * np.pi * min(motion.rate / 3.0, 300.0)
        return self.bounded(stiffness=(min(inertia) * slow**2, max(inertia) * fast**2), damping=(0.05, 0.5))

    def _first_load(self, motion: Motion, reference: Reference) -> Array:
        """Load (n,) under which the springs are at rest when the run starts: the static one where the robot starts from rest,
        however abruptly; else that of the first sample."""
        one = Coordinates(*(x[:1] for x in (motion.joint.q, motion.joint.dq, motion.joint.ddq)))
        usual = np.sqrt(np.mean(motion.joint.dq**2, axis=0))
        if np.all(np.abs(one.dq[0]) <= _AT_REST * usual):
            one = replace(one, ddq=np.zeros_like(one.ddq))
        start = replace(motion, t=motion.t[:1], joint=one, torque=None, load=None, reference=None)
        return reference.load(start.moved(reference.model.robot, one))[0]

    def response(self, robot: Robot) -> Array:
        return np.ones(len(self.at(robot)))

    def moves(self, robot: Robot, j: int) -> Array:
        """Joint motion (n,) per unit deflection."""
        return np.eye(robot.n)[j] if self.side == Side.JOINT else robot.transmission.K[:, j]


@register
@dataclass(frozen=True, kw_only=True)
class JointElasticity(_Compliance):
    """An elastic gear behind the encoder: τ = elastic × T(δ), δ the deflection of a spring of `stiffness` under the link.

    Seen near the anti-resonance (stiffness / inertia)^½ / 2π."""

    name: ClassVar[str] = "joint_elasticity"
    title: ClassVar[str] = "elastic joint"
    axis: ClassVar[Axis] = Axis.LOAD
    symbol: ClassVar[str] = "elastic"


@register
@dataclass(frozen=True, kw_only=True)
class Backlash(_Compliance):
    """Play in the gear behind the encoder: τ = play × T(δ), δ the link's motion in a `gap` (whole width) with springy flanks.

    Within the gap the link is free: the motor feels none of it until the other flank is reached, with a knock."""

    name: ClassVar[str] = "backlash"
    title: ClassVar[str] = "backlash (play in the gear)"
    axis: ClassVar[Axis] = Axis.LOAD
    symbol: ClassVar[str] = "play"

    gap: float = 1e-3

    def shape(self) -> tuple[ShapeParameter, ...]:
        # Where a flank is reached, and how hard, depends on the gap by fractions of it, and on what the knock loses.
        stiffness, damping = super().shape()
        return (ShapeParameter("gap", "rad (m)", 1e-8, 10.0, 1e-3, log=True, points=12), stiffness, replace(damping, points=3))

    @property
    def play(self) -> float:
        return self.gap

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """A gap up to a tenth of the range that is moved through; one of a hundred-thousandth of it no encoder shows."""
        ranges = super().search_range(motion, robot)
        q = motion.on(self.side).q[:, self.at(robot)]
        span = float(np.ptp(q, axis=0).max()) if q.size else 0.0
        return self.bounded(**{**ranges, "gap": (1e-5 * span, 0.1 * span), "damping": (0.05, 1.0)})


def _settings(effects: Sequence[_Compliance]) -> tuple[Array, Array, Array]:
    """Stiffness, damping and play (L,) of effects."""
    stiffness, damping, play = (np.array([getattr(effect, key) for effect in effects], float) for key in ("stiffness", "damping", "play"))
    return stiffness, damping, play


def response(load: Array, omega: Array, damping: float, gap: float, step: float, first: float | None = None) -> tuple[Array, Array, Array]:
    """`responses` of a single spring: `load`, `omega` (N,) → δ and its two derivatives (N,); `first`: default the first of `load`."""
    one = np.ones(1)
    start = float(load[0]) if first is None else first
    found = responses(load, 1.0 / omega**2, one, damping * one, gap * one, step, start)
    return found[0][:, 0], found[1][:, 0], found[2][:, 0]


def responses(
    load: Array, inertia: Array, stiffness: Array, damping: Array, gap: Array, step: float, first: float
) -> tuple[Array, Array, Array]:
    """Deflections δ of several springs under one load and their two derivatives, (N, L) each.

    `load` (N,): torque over inertia in rad/s² (m/s²), linear between samples; `inertia` (N,) on the spring; `stiffness`,
    `damping` (share of the critical one), `gap` (free play, whole width), (L,) each; `first`: the load under which each starts at
    rest on its flank; `step`: s. Within a step (a quarter of one where there is play) each regime is solved exactly."""
    half = 0.5 * gap
    parts = 4 if bool(np.any(half > 0.0)) else 1
    h = step / parts
    # Springs that differ in play alone share the steps on their flanks.
    kinds, kind = np.unique(np.stack([stiffness, damping]), axis=1, return_inverse=True)
    kind = kind.reshape(-1)
    omega = np.sqrt(kinds[0] / inertia[:, None])
    force = np.ascontiguousarray(np.broadcast_to(-load[:, None], (len(load), len(half))))
    position, velocity = np.empty(force.shape), np.zeros(force.shape)
    if len(force):
        at = -first / omega[0, kind] ** 2
        position[0] = at + half * np.sign(at)
        coefficients = np.stack([np.ascontiguousarray(c[:, kind]) for c in _spring_step(omega, kinds[1], h)])
        _follow(force, coefficients, half, h, parts, position, velocity)
    omega = omega[:, kind]
    outside = np.abs(position) > half
    deflection = np.where(outside, position - np.sign(position) * half, 0.0)
    slowing = np.where(outside, 2.0 * damping * omega * velocity, 0.0)
    return position, velocity, force - omega**2 * deflection - slowing


def _follow(force: Array, coefficients: Array, half: Array, h: float, parts: int, position: Array, velocity: Array) -> None:
    """Fill position and velocity (N, L) from their first rows on, for force (N, L) and step coefficients (8, N, L)."""
    try:
        from .._native import _recursions  # type: ignore[attr-defined, unused-ignore]
    except ImportError:
        _follow_plainly(force, coefficients, half, h, parts, position, velocity)
    else:
        _recursions.springs(force, coefficients, np.ascontiguousarray(half, float), h, parts, *force.shape, position, velocity)


def _follow_plainly(force: Array, coefficients: Array, half: Array, h: float, parts: int, position: Array, velocity: Array) -> None:
    """`_follow` in NumPy, all springs at a time."""
    a11, a12, a21, a22, b10, b11, b20, b21 = coefficients
    x, v = position[0], velocity[0]
    playing = bool(np.any(half > 0.0))
    for k in range(len(force) - 1):
        f0, rise = force[k], (force[k + 1] - force[k]) / parts
        for _ in range(parts):
            f1 = f0 + rise
            flank = np.copysign(half, x)
            y = x - flank
            pressed = a11[k] * y + a12[k] * v + b10[k] * f0 + b11[k] * f1 + flank
            pushed = a21[k] * y + a22[k] * v + b20[k] * f0 + b21[k] * f1
            if playing:
                free = (np.abs(x) <= half) & (half > 0.0)
                pressed = np.where(free, x + v * h + (2.0 * f0 + f1) * (h * h / 6.0), pressed)
                pushed = np.where(free, v + 0.5 * (f0 + f1) * h, pushed)
            x, v, f0 = pressed, pushed, f1
        position[k + 1], velocity[k + 1] = x, v


def _spring_step(omega: Array, damping: Array | float, h: float) -> tuple[Array, ...]:
    """Exact step h of y'' = f − ω² y − 2ζω y' with f linear in between: (y, y')_1 = A (y, y')_0 + b_0 f_0 + b_1 f_1."""
    damped = omega * np.sqrt(np.maximum(1.0 - damping**2, 1e-12))
    decay = np.exp(-damping * omega * h)
    c, s = decay * np.cos(damped * h), decay * np.sin(damped * h) / damped
    zw = damping * omega
    a11, a12, a21, a22 = c + zw * s, s, -(omega**2) * s, c - zw * s
    # A constant force shifts the rest position by f/ω²; a ramp r t moves it along (r/ω²)(t − 2ζ/ω).
    lag = 2.0 * damping / omega
    w2 = omega**2
    slope = 1.0 / (h * w2)
    b1_y = slope * (h - lag + a11 * lag - a12)
    b1_v = slope * (1.0 + a21 * lag - a22)
    b0_y = (1.0 - a11) / w2 - b1_y
    b0_v = -a21 / w2 - b1_v
    return a11, a12, a21, a22, b0_y, b1_y, b0_v, b1_v


def _positive(inertia: Array) -> Array | None:
    """The inertia where it is positive, held above a tenth of its median; None where the model gives none."""
    if not len(inertia):
        return None
    usual = float(np.median(inertia))
    return np.maximum(inertia, 0.1 * usual) if usual > 0.0 else None


def anti_resonance(effect: _Compliance, reference: Reference, motion: Motion, robot: Robot) -> dict[str, float]:
    """Frequency (Hz) at which each joint's link swings on its spring while the motor stands, at the median inertia of the run."""
    out = {}
    for j in effect.at(robot):
        inertia = _positive(reference.inertia(motion, effect.moves(robot, j)))
        if inertia is not None:
            out[robot.joint_names[j]] = float(np.sqrt(effect.stiffness / np.median(inertia)) / (2.0 * np.pi))
    return out
