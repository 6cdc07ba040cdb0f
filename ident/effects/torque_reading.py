"""Errors of the torque reading as functions of the torque: scale, curvature, saturation."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..robots.parameters import ShapeParameter
from .base import Effect
from .correction import SignalCorrection
from .joint_effect import JointEffect
from .kinds import Axis, Nature, Need, choice
from .motion import Coordinates, Motion
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: An excess worth looking at: so many standard deviations of the reading's noise.
_CLEAR = 6.0
#: Below a limit the reading is the torque: so much of it (correlation) must the model predict there.
_FORETOLD = 0.5


@register
@dataclass(frozen=True, kw_only=True)
class TorqueConstant(JointEffect):
    """A torque constant that is off: reading = (1 + ekt) × torque, so τ = ekt τ_pred with the torque as the model predicts it.

    Seen only where other joints anchor the scale: the joint's own inertia and friction scale with it.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.TorqueConstant(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('ekt_joint2', '1')]
    """

    name: ClassVar[str] = "torque_constant"
    title: ClassVar[str] = "error of the torque constant"
    axis: ClassVar[Axis] = Axis.TORQUE
    nature: ClassVar[Nature] = Nature.SENSOR
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})
    symbols = (("ekt", "1", -1.0),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield motion.predicted_on(self.side)[:, at]

    def applied(self, robot: Robot, values: Array) -> SignalCorrection:
        gain = np.ones(robot.n)
        gain[self.at(robot)] += values
        return SignalCorrection(self.side, gain=gain)


@register
@dataclass(frozen=True, kw_only=True)
class TorqueNonlinearity(JointEffect):
    """A reading that is not in proportion to the torque: τ = enl sgn(τ_pred) |τ_pred|^p, p = `power` (2 and 3 are usual).

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.TorqueNonlinearity(joints=("joint2",), power=3.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('enl_joint2', '(N m)^(1-3)')]
    """

    name: ClassVar[str] = "torque_nonlinearity"
    title: ClassVar[str] = "torque reading that is not in proportion"
    axis: ClassVar[Axis] = Axis.TORQUE
    nature: ClassVar[Nature] = Nature.SENSOR
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE})
    symbols = (("enl", "({tau})^(1-{power})", -np.inf),)

    power: float = 3.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("power", "1", 1.5, 5.0, 3.0),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        torque = motion.predicted_on(self.side)[:, at]
        yield np.sign(torque) * np.abs(torque) ** self.power


class Clipping(StrEnum):
    """What is cut off at the limit. DRIVE: the torque itself, while the log shows what was asked for. LOG: only the reading."""

    DRIVE = "drive"
    LOG = "log"


@register
@dataclass(frozen=True, kw_only=True)
class Saturation(JointEffect):
    """A torque limit that the log does not tell of: τ = sat × excess, excess(x) = sgn(x) max(0, |x| − limit).

    `clipped="drive"`: the drive delivers no more than the limit, the log shows the demand: the reading exceeds the torque by
    the excess of the reading. `clipped="log"`: the reading stops at the limit, the torque does not: the reading falls short
    by the excess of the prediction. Either way sat is 1 if this is what happens; far from 1 it is something else.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.Saturation(joints=("joint2",), limit=1.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('sat_joint2', '1')]
    """

    name: ClassVar[str] = "saturation"
    title: ClassVar[str] = "torque saturation"
    axis: ClassVar[Axis] = Axis.TORQUE
    nature: ClassVar[Nature] = Nature.SENSOR
    needs: ClassVar[frozenset[Need]] = frozenset({Need.TORQUE, Need.REFERENCE})
    # No approximation of first order: what is above the limit is above it one to one. Anything that drives the torque up for a while (a
    # brake that drags) goes with the reading's excess over some level, too, but not by just as much.
    tolerance: ClassVar[float] = 0.05
    symbols = (("sat", "1", 0.0),)

    limit: float = 1.0
    clipped: Clipping = Clipping.DRIVE

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "clipped", choice(Clipping, self.clipped, "clipped", self.name))

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("limit", "N m (N)", 1e-6, 1e6, 1.0, log=True),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        if self.clipped == Clipping.DRIVE:
            yield self._excess(motion.measured_on(self.side)[:, at])
        else:
            yield -self._excess(motion.predicted_on(self.side)[:, at])

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """From a torque that half of the samples exceed (of what the model predicts: a fifth) to one that the largest exceeds by more
        than the noise of the reading.

        The excess of a noisy reading contains its noise, and so correlates with it. A model that does not predict the reading below the
        limit does not know that noise."""
        torque = motion.measured_on(self.side) if self.clipped == Clipping.DRIVE else motion.predicted_on(self.side)
        at = self.at(robot)
        size = np.abs(torque[:, at])
        use = np.isfinite(size).all(axis=1)
        size = size[use]
        if not size.size:
            return self.bounded()
        top, noise = float(size.max()), 0.0
        # A drive that is mostly off has no usual torque among its zeros.
        usual = 0.5 if self.clipped == Clipping.DRIVE else 0.8
        low = min((float(np.quantile(x[x > 0.0], usual)) for x in size.T if (x > 0.0).any()), default=top)
        if motion.reference is not None and motion.torque is not None:
            measured, predicted = motion.measured_on(self.side)[:, at][use], motion.predicted_on(self.side)[:, at][use]
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # a joint without torque
                noise = 1.4826 * float(np.nanmax(np.nanmedian(np.abs(measured - predicted), axis=0)))
            if not _follows(measured, predicted, size <= low):
                low, noise = (low, 0.0) if self.clipped == Clipping.DRIVE else (top, noise)
        high = top - _CLEAR * noise
        # Nothing stands out: no limit below the largest torque is worth a look.
        return self.bounded(limit=(low, high) if high > low else (top, 2.0 * top))

    def response(self, robot: Robot) -> Array:
        """Beyond the limit the reading exceeds the torque one to one."""
        return np.ones(len(self.at(robot)))

    def denied_by(self) -> Effect:
        """Beyond the limit the torque is the limit, whatever the motion asks for."""
        return _NotAtTheLimit(joints=self.joints, side=self.side, of=self)

    def applied(self, robot: Robot, values: Array) -> SignalCorrection | None:
        """What the drive delivered, from what the log shows. A reading that was cut off cannot be restored."""
        if self.clipped == Clipping.LOG:
            return None
        limit = np.full(robot.n, np.inf)
        limit[self.at(robot)] = self.limit
        return SignalCorrection(self.side, limit=limit)

    def _excess(self, torque: Array) -> Array:
        # A missing reading (NaN) makes no excess; its rows are masked anyway.
        return np.nan_to_num(np.sign(torque) * np.maximum(np.abs(torque) - self.limit, 0.0), nan=0.0)


@dataclass(frozen=True, kw_only=True)
class _NotAtTheLimit(JointEffect):
    """What differs where a torque is cut off: in proportion to the model's prediction, or by as much throughout."""

    name: ClassVar[str] = "not_at_the_limit"
    title: ClassVar[str] = "torque that is not the limit where it is cut off"
    axis: ClassVar[Axis] = Axis.TORQUE
    nature: ClassVar[Nature] = Nature.SENSOR
    needs: ClassVar[frozenset[Need]] = Saturation.needs
    symbols = (("slope", "1", -np.inf), ("shift", "{tau}", -np.inf))

    of: Saturation

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        predicted = motion.predicted_on(self.side)[:, at]
        cut = motion.measured_on(self.side)[:, at] if self.of.clipped == Clipping.DRIVE else predicted
        beyond = np.nan_to_num(np.abs(cut), nan=0.0) > self.of.limit
        yield np.where(beyond, predicted, 0.0)
        yield np.where(beyond, np.sign(cut), 0.0)


def _follows(measured: Array, predicted: Array, where: Array) -> bool:
    """Whether readings (N, k) are those of the predicted torques (N, k) on the samples in use (N, k)."""
    x, y = np.where(where, measured, 0.0), np.where(where, predicted, 0.0)
    size = np.sqrt(np.sum(x**2, axis=0) * np.sum(y**2, axis=0))
    return bool(np.all(np.sum(x * y, axis=0) > _FORETOLD * size)) and bool(np.all(size > 0.0))
