"""Encoders that read wrong: the prediction is taken at the reading, the torque comes from the true position (SCIENCE.md 7.1).

To first order, a reading error e shifts the prediction by −T e = −(∂τ/∂q e + ∂τ/∂dq de/dt + ∂τ/∂ddq d²e/dt²). Much of this is
absorbed by base parameters: then there is nothing to find."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..correction import Harmonic, SignalCorrection
from ..effect import Axis, Effect, Nature, Need, register
from ..motion import Motion
from ..parameters import Parameter, ShapeParameter
from ..transmission import Side

if TYPE_CHECKING:
    from ..robot import Robot

Array = np.ndarray


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
        own = motion.on(self.side)
        out = []
        for j in self.at(robot):
            moves = np.eye(robot.n)[j] if self.side == Side.JOINT else transmission.K[:, j]
            for error in self.errors(own.q[:, j], own.dq[:, j], own.ddq[:, j]):
                # The torque on the measured side is what shifts; `side` is only where it is told.
                shifted = -reference.along(motion, moves, error)
                out.append(transmission.torque(shifted, transmission.measured, self.side))
        return np.stack(out, axis=2) if out else np.zeros((len(motion), robot.n, 0))

    def _spread(self, robot: Robot, values: Array, column: int) -> Array:
        out = np.zeros(robot.n)
        out[self.at(robot)] = np.reshape(values, (-1, len(self.symbols)))[:, column]
        return out


@register
@dataclass(frozen=True, kw_only=True)
class EncoderOffset(_EncoderError):
    """A zero that is off: reading = position + eoff."""

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
    """A scale that is off (wrong gear ratio or counts a turn): reading = (1 + escale) × position."""

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
    """A disc that runs out of true: reading = position + eccs sin(n x) + eccc cos(n x), x the position on `side`, n = `order`."""

    name: ClassVar[str] = "encoder_eccentricity"
    title: ClassVar[str] = "eccentricity of the encoder"
    symbols: ClassVar[tuple[tuple[str, str], ...]] = (("eccs", "{q}"), ("eccc", "{q}"))

    order: float = 1.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("order", "1/rad (1/m)", 0.05, 1000.0, 1.0, log=True),)

    def errors(self, q: Array, dq: Array, ddq: Array) -> Iterable[tuple[Array, Array, Array]]:
        n = self.order
        sine, cosine = np.sin(n * q), np.cos(n * q)
        yield sine, n * cosine * dq, n * cosine * ddq - n**2 * sine * dq**2
        yield cosine, -n * sine * dq, -n * sine * ddq - n**2 * cosine * dq**2

    def applied(self, robot: Robot, values: Array) -> SignalCorrection:
        harmonic = Harmonic(self.order, self._spread(robot, values, 0), self._spread(robot, values, 1))
        return SignalCorrection(self.side, harmonics=(harmonic,))
