"""Encoders that read wrong: the prediction is taken at the reading, the torque comes from the true position.

A reading error e shifts the prediction by −T e = −(∂τ/∂q e + ∂τ/∂dq de/dt + ∂τ/∂ddq d²e/dt²): to first order with T at the reading;
to second with T halfway to the true position, once an error is known. Much of it is absorbed by base parameters: then there is nothing
to find."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..robots.parameters import Parameter, ShapeParameter
from ..robots.transmission import Side
from .base import Effect
from .correction import Harmonic, SignalCorrection
from .kinds import Axis, Nature, Need
from .motion import Coordinates, Motion
from .orders import slowest_order
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: Part by which the scale of an encoder that runs out of true may swing: discs and magnets sit far better than a tenth of their radius.
_SWING = 0.1
#: The true position is sought in so many repetitions: each leaves a share of what is off that is the error's own relative size.
_REPETITIONS = 6


@dataclass(frozen=True, kw_only=True)
class _EncoderError(Effect):
    """`side`: where the encoder sits."""

    axis: ClassVar[Axis] = Axis.POSITION
    nature: ClassVar[Nature] = Nature.SENSOR
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})
    #: Symbol and unit ({q}: unit of position) of each column.
    symbols: ClassVar[tuple[tuple[str, str], ...]]

    side: Side = Side.JOINT

    @abstractmethod
    def errors(self, q: Array, dq: Array, ddq: Array) -> Iterable[tuple[Array, Array, Array]]:
        """For each column the reading error of one encoder and its two derivatives, (N,) each."""

    def parameters(self, robot: Robot) -> tuple[Parameter, ...]:
        return tuple(
            Parameter(self.named(symbol, robot, j), unit.format(q=robot.position_unit(j, self.side)), self.name, robot.joint_names[j])
            for j in self.at(robot)
            for symbol, unit in self.symbols
        )

    def columns(self, motion: Motion, robot: Robot) -> Array:
        reference = motion.needed_reference(f"effect {self.name!r}")
        transmission = robot.transmission
        values = np.reshape(reference.values_of(self, robot), (-1, len(self.symbols)))
        errors = [self._at_truth(motion.on(self.side).of([j]), own) for j, own in zip(self.at(robot), values, strict=True)]
        moves = [np.eye(robot.n)[j] if self.side == Side.JOINT else transmission.K[:, j] for j in self.at(robot)]
        halfway = motion
        if values.any():
            known = [
                [sum(v * e[i] for v, e in zip(own, each, strict=True)) for i in range(3)] for own, each in zip(values, errors, strict=True)
            ]
            off = [sum(np.outer(e[i], along) for e, along in zip(known, moves, strict=True)) for i in range(3)]
            joint = motion.joint
            there = Coordinates(joint.q - 0.5 * off[0], joint.dq - 0.5 * off[1], joint.ddq - 0.5 * off[2])
            halfway = replace(motion.moved(robot, there), load=motion.load, reference=reference)
        out = []
        for along, each in zip(moves, errors, strict=True):
            for error in each:
                # The torque on the measured side is what shifts; `side` is only where it is told.
                shifted = -reference.along(halfway, along, error)
                out.append(transmission.torque(shifted, transmission.measured, self.side))
        return np.stack(out, axis=2) if out else np.zeros((len(motion), robot.n, 0))

    def _at_truth(self, reading: Coordinates, values: Array) -> list[tuple[Array, Array, Array]]:
        """The errors of one encoder, (N,) each, where it truly is if they have these values (c,)."""
        own = [x[:, 0] for x in (reading.q, reading.dq, reading.ddq)]
        truth, found = own, list(self.errors(*own))
        for _ in range(_REPETITIONS if values.any() else 0):
            truth = [x - sum(v * e[i] for v, e in zip(values, found, strict=True)) for i, x in enumerate(own)]
            found = list(self.errors(*truth))
        return found

    def _spread(self, robot: Robot, values: Array, column: int) -> Array:
        out = np.zeros(robot.n)
        out[self.at(robot)] = np.reshape(values, (-1, len(self.symbols)))[:, column]
        return out


@register
@dataclass(frozen=True, kw_only=True)
class EncoderOffset(_EncoderError):
    """A zero that is off: reading = position + eoff.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.EncoderOffset(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('eoff_joint2', 'rad')]
    """

    name: ClassVar[str] = "encoder_offset"
    title: ClassVar[str] = "offset of the encoder"
    symbols: ClassVar[tuple[tuple[str, str], ...]] = (("eoff", "{q}"),)

    def errors(self, q: Array, dq: Array, ddq: Array) -> Iterable[tuple[Array, Array, Array]]:
        yield np.ones_like(q), np.zeros_like(q), np.zeros_like(q)

    def applied(self, robot: Robot, values: Array) -> SignalCorrection:
        return SignalCorrection(self.side, offset=self._spread(robot, values, 0))


@register
@dataclass(frozen=True, kw_only=True)
class EncoderScale(_EncoderError):
    """A scale that is off (wrong gear ratio or counts a turn): reading = (1 + escale) × position.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.EncoderScale(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('escale_joint2', '1')]
    """

    name: ClassVar[str] = "encoder_scale"
    title: ClassVar[str] = "scale error of the encoder"
    symbols: ClassVar[tuple[tuple[str, str], ...]] = (("escale", "1"),)

    def errors(self, q: Array, dq: Array, ddq: Array) -> Iterable[tuple[Array, Array, Array]]:
        yield q, dq, ddq

    def applied(self, robot: Robot, values: Array) -> SignalCorrection:
        return SignalCorrection(self.side, scale=self._spread(robot, values, 0))


@register
@dataclass(frozen=True, kw_only=True)
class EncoderEccentricity(_EncoderError):
    """A disc that runs out of true: reading = position + eccs sin(n x) + eccc cos(n x), x the position on `side`, n = `order`.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.EncoderEccentricity(joints=("joint2",), order=1.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('eccs_joint2', 'rad'), ('eccc_joint2', 'rad')]
    """

    name: ClassVar[str] = "encoder_eccentricity"
    title: ClassVar[str] = "eccentricity of the encoder"
    symbols: ClassVar[tuple[tuple[str, str], ...]] = (("eccs", "{q}"), ("eccc", "{q}"))

    order: float = 1.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("order", "1/rad (1/m)", 0.05, 1000.0, 1.0, log=True),)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(order=(slowest_order(robot, self.at(robot), self.side), np.inf))

    def errors(self, q: Array, dq: Array, ddq: Array) -> Iterable[tuple[Array, Array, Array]]:
        n = self.order
        sine, cosine = np.sin(n * q), np.cos(n * q)
        yield sine, n * cosine * dq, n * cosine * ddq - n**2 * sine * dq**2
        yield cosine, -n * sine * dq, -n * sine * ddq - n**2 * cosine * dq**2

    def implausible(self, robot: Robot, values: Array, std: Array) -> str:
        for sine, cosine, s in zip(values[::2], values[1::2], np.hypot(std[::2], std[1::2]), strict=True):
            swing = self.order * np.hypot(sine, cosine)
            if swing - 3.0 * self.order * s > _SWING:
                return f"the encoder's scale would swing by {100 * swing:.0f} % along a turn: no disc runs out of true by that much"
        return ""

    def applied(self, robot: Robot, values: Array) -> SignalCorrection:
        harmonic = Harmonic(self.order, self._spread(robot, values, 0), self._spread(robot, values, 1))
        return SignalCorrection(self.side, harmonics=(harmonic,))
