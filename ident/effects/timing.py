"""The torque reading comes late: a delay, or the lag of a filter."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np

from ..robots.parameters import ShapeParameter
from .correction import SignalCorrection
from .joint_effect import JointEffect
from .kinds import Axis, Nature, Need
from .motion import Coordinates, Motion
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: Delays below this share of a sample are slopes; the longest looked for, s.
_SHORT = 1e-3
_LONGEST = 0.06


@register
@dataclass(frozen=True, kw_only=True)
class Delay(JointEffect):
    """A torque reading that is late by d, or early (d < 0: the positions are late): delay × (τ(t − d) − τ(t)) / d, τ as predicted.

    `late` is d; near 0 the column is −dτ/dt, and delay is then what fits in first order. It equals d where this is what happens.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.Delay(joints=("joint2",), late=0.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('delay_joint2', 's')]
    """

    name: ClassVar[str] = "delay"
    title: ClassVar[str] = "delay between motion and torque"
    axis: ClassVar[Axis] = Axis.TIME
    nature: ClassVar[Nature] = Nature.SENSOR
    everywhere: ClassVar[bool] = True
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE, Need.NEIGHBOURS})
    symbols = (("delay", "s", -np.inf),)

    late: float = 0.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        # Of odd number, so that a first grid holds 0: the slope, in which every short delay shows.
        return (ShapeParameter("late", "s", -1.0, 1.0, 0.0, points=13),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        torque, rate = motion.predicted_on(self.side)[:, at], motion.needed_rate(f"effect {self.name!r}")
        shifted = abs(self.late) * rate > _SHORT
        yield (delayed(torque, self.late, rate) - torque) / self.late if shifted else -derivative(torque, rate)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(late=(-_LONGEST, _LONGEST))

    def response(self, robot: Robot) -> Array:
        """The delay itself."""
        return np.full(len(self.at(robot)), self.late)

    def told_by(self, values: Array) -> Self:
        return self.nearest_shape(late=float(np.mean(values)))

    def unresolved(self, interval: float) -> float:
        """Half a sample: what acted between samples, and when in it a value was held, no log tells."""
        return 0.5 * interval

    def memory(self, robot: Robot) -> Array:
        """The delay."""
        return _on(self.at(robot), self.late, robot)

    def applied(self, robot: Robot, values: Array) -> SignalCorrection:
        delay = np.zeros(robot.n)
        delay[self.at(robot)] = values
        return SignalCorrection(self.side, delay=delay)


@register
@dataclass(frozen=True, kw_only=True)
class FilterLag(JointEffect):
    """A torque reading behind a first-order low-pass of time constant T: LP[τ] − τ = −lag (τ − LP[τ])/T, τ as predicted.

    (τ − LP[τ])/T is dτ/dt behind the same low-pass, so that a small T looks like a delay. lag equals T where this is what
    happens. The filter starts at rest with the run.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.FilterLag(joints=("joint2",), T=0.01)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('lag_joint2', 's')]
    """

    name: ClassVar[str] = "filter_lag"
    title: ClassVar[str] = "lag of a filter in the torque reading"
    axis: ClassVar[Axis] = Axis.TIME
    nature: ClassVar[Nature] = Nature.SENSOR
    everywhere: ClassVar[bool] = True
    needs: ClassVar[frozenset[Need]] = frozenset({Need.REFERENCE, Need.HISTORY})
    symbols = (("lag", "s", 0.0),)

    T: float = 0.01

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("T", "s", 1e-5, 10.0, 0.01, log=True),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        torque = motion.predicted_on(self.side)[:, at]
        yield (low_pass(torque, self.T, motion.needed_rate(f"effect {self.name!r}")) - torque) / self.T

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(T=(0.3 / motion.rate, 0.2)) if motion.rate > 0.0 else self.bounded()

    def response(self, robot: Robot) -> Array:
        """The lag of the low-pass."""
        return np.full(len(self.at(robot)), self.T)

    def told_by(self, values: Array) -> Self:
        return self.nearest_shape(T=float(np.mean(values)))

    def unresolved(self, interval: float) -> float:
        """Half a sample, as of a delay."""
        return 0.5 * interval

    def memory(self, robot: Robot) -> Array:
        """Until a twentieth is left."""
        return _on(self.at(robot), 3.0 * self.T, robot)

    def applied(self, robot: Robot, values: Array) -> SignalCorrection:
        lag = np.zeros(robot.n)
        lag[self.at(robot)] = values
        return SignalCorrection(self.side, lag=lag)


def _on(joints: list[int], seconds: float, robot: Robot) -> Array:
    out = np.zeros(robot.n)
    out[joints] = seconds
    return out


def derivative(x: Array, rate: float) -> Array:
    """Time derivative of uniform samples x (N, m): central differences of fourth order, of second order at the ends."""
    if len(x) < 3:
        return np.gradient(x, axis=0) * rate
    out = np.gradient(x, axis=0, edge_order=2)
    if len(x) >= 5:
        out[2:-2] = (8.0 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])) / 12.0
    return out * rate


def delayed(x: Array, seconds: float, rate: float) -> Array:
    """Uniform samples x (N, m) as they were `seconds` before (after, if negative): cubic splines, held beyond both ends."""
    from scipy.interpolate import CubicSpline

    if len(x) < 4:
        return x
    at = np.arange(len(x), dtype=float)
    return np.asarray(CubicSpline(at, x)(np.clip(at - seconds * rate, 0.0, at[-1])))


def low_pass(x: Array, T: float, rate: float) -> Array:
    """T dy/dt + y = x for x (N, m) linear between samples, at rest before the first; exact."""
    from scipy.signal import lfilter

    step = 1.0 / (rate * T)
    keep = np.exp(-step)
    mean = -np.expm1(-step) / step
    y, _ = lfilter([1.0 - mean, mean - keep], [1.0, -keep], x, axis=0, zi=mean * x[:1])
    return y
