"""Sensors: from the true motion and torque to what a log holds."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


class Signal(StrEnum):
    """A recorded signal."""

    POSITION = "position"
    TORQUE = "torque"


@dataclass(frozen=True, eq=False)
class Readings:
    """What is read: `t` (N,) stamps, `motion` (N, n) on the encoders' `side`, `tau` (N, n) on the measured side.

    `exact_motion`, `exact_tau`: the undistorted signals at any times (N,), for sensors that look elsewhere in time."""

    robot: Robot
    side: Side
    t: Array
    motion: Coordinates
    tau: Array
    exact_motion: Callable[[Array], Coordinates] = field(repr=False)
    exact_tau: Callable[[Array], Array] = field(repr=False)


class Distortion(ABC):
    """One imperfection of the measurement. Subclass it (a frozen dataclass is best) for one's own."""

    @abstractmethod
    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        """The readings with the imperfection."""


def _each(name: str, value: object, n: int) -> Array:
    array = np.asarray(value, float)
    if array.ndim == 0:
        return np.full(n, float(array))
    if array.shape != (n,):
        raise ConfigurationError(f"sensors: {name} must be one number or {n}, one per joint, not shape {array.shape}.")
    return array


@dataclass(frozen=True)
class Jitter(Distortion):
    """Samples are taken at times off the uniform grid, by a normal deviate of `std` seconds (clipped at 0.45 periods).

    `stamped`: whether the recorded stamps tell ("true") or pretend to be uniform ("nominal")."""

    std: float
    stamped: str = "true"

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        t = readings.t
        period = float(np.median(np.diff(t)))
        at = t + np.clip(rng.normal(scale=self.std, size=len(t)), -0.45 * period, 0.45 * period)
        at = np.clip(at, t[0], t[-1])
        stamps = at if self.stamped == "true" else t
        return replace(readings, t=stamps, motion=readings.exact_motion(at), tau=readings.exact_tau(at))


@dataclass(frozen=True)
class MeasurementDelay(Distortion):
    """One signal shows what was `seconds` earlier (n,) or one number. Apply before other distortions of that signal."""

    signal: Signal | str
    seconds: tuple[float, ...] | float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        n = readings.tau.shape[1]
        late = _each("delay", self.seconds, n)
        at = [np.maximum(readings.t - late[j], readings.t[0]) for j in range(n)]
        if Signal(self.signal) == Signal.TORQUE:
            return replace(readings, tau=np.stack([readings.exact_tau(at[j])[:, j] for j in range(n)], axis=1))
        seen = [readings.exact_motion(times) for times in at]
        parts = ([getattr(c, key)[:, j] for j, c in enumerate(seen)] for key in ("q", "dq", "ddq"))
        return replace(readings, motion=Coordinates(*(np.stack(part, axis=1) for part in parts)))


@dataclass(frozen=True)
class Lag(Distortion):
    """One signal passes a first-order low-pass of time constant `seconds`, (n,) or one number (0: none)."""

    signal: Signal | str
    seconds: tuple[float, ...] | float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        times = _each("lag", self.seconds, readings.tau.shape[1])
        step = np.diff(readings.t, prepend=readings.t[0])
        if Signal(self.signal) == Signal.TORQUE:
            return replace(readings, tau=_low_pass(readings.tau, step, times))
        c = readings.motion
        return replace(readings, motion=Coordinates(*(_low_pass(x, step, times) for x in (c.q, c.dq, c.ddq))))


def _low_pass(x: Array, step: Array, times: Array) -> Array:
    """Exact response of first-order lags to the signal taken as linear between samples."""
    y = np.empty_like(x)
    y[0] = x[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        for i in range(1, len(x)):
            left = np.exp(-step[i] / times)
            slope = (x[i] - x[i - 1]) / step[i]
            y[i] = np.where(times > 0, x[i] - slope * times + (y[i - 1] - x[i - 1] + slope * times) * left, x[i])
    return y


@dataclass(frozen=True)
class TorqueWindow(Distortion):
    """Torque is the mean over a window of `seconds` centred on the sample, as drives average their current."""

    seconds: float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        offsets = (np.arange(16) + 0.5) / 16 * self.seconds - 0.5 * self.seconds
        at = np.clip(readings.t[:, None] + offsets, readings.t[0], readings.t[-1])
        tau = readings.exact_tau(at.reshape(-1)).reshape(len(readings.t), 16, -1).mean(axis=1)
        return replace(readings, tau=tau)


@dataclass(frozen=True)
class EncoderError(Distortion):
    """Positions read wrong by offset + scale q + amplitude sin(order q + phase), each one value or (n,), on the encoders' side."""

    offset: tuple[float, ...] | float = 0.0
    scale: tuple[float, ...] | float = 0.0
    amplitude: tuple[float, ...] | float = 0.0
    order: tuple[float, ...] | float = 1.0
    phase: tuple[float, ...] | float = 0.0

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        c, n = readings.motion, readings.tau.shape[1]
        offset, scale, amplitude, order, phase = (
            _each(name, getattr(self, name), n) for name in ("offset", "scale", "amplitude", "order", "phase")
        )
        angle = order * c.q + phase
        slope = 1.0 + scale + amplitude * order * np.cos(angle)
        bend = -amplitude * order**2 * np.sin(angle)
        q = c.q + offset + scale * c.q + amplitude * np.sin(angle)
        return replace(readings, motion=Coordinates(q, slope * c.dq, slope * c.ddq + bend * c.dq**2))


@dataclass(frozen=True)
class PositionNoise(Distortion):
    """White noise on positions, of `std` rad (m) on the encoders' side."""

    std: tuple[float, ...] | float

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        c = readings.motion
        noise = rng.normal(size=c.q.shape) * _each("position noise", self.std, c.q.shape[1])
        return replace(readings, motion=Coordinates(c.q + noise, c.dq, c.ddq))


@dataclass(frozen=True)
class Quantisation(Distortion):
    """Positions are rounded to multiples of `step` rad (m), one value or (n,), on the encoders' side."""

    step: tuple[float, ...] | float

    @classmethod
    def counts(cls, per_turn: float) -> Quantisation:
        """An encoder of so many counts a turn."""
        return cls(2.0 * np.pi / per_turn)

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        c = readings.motion
        step = _each("quantisation", self.step, c.q.shape[1])
        q = np.where(step > 0, np.round(c.q / np.where(step > 0, step, 1.0)) * step, c.q)
        return replace(readings, motion=Coordinates(q, c.dq, c.ddq))


@dataclass(frozen=True)
class TorqueNoise(Distortion):
    """Noise on torque of `std` N m (N) on the measured side; `colour` in [0, 1): correlation of neighbouring samples (AR(1))."""

    std: tuple[float, ...] | float
    colour: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.colour < 1.0:
            raise ConfigurationError(f"sensors: colour of the torque noise must lie in [0, 1), not {self.colour}.")

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        from scipy.signal import lfilter

        noise = rng.normal(size=readings.tau.shape)
        if self.colour > 0:
            innovation = np.sqrt(1.0 - self.colour**2) * noise
            innovation[0] = noise[0]  # stationary from the first sample
            noise = lfilter([1.0], [1.0, -self.colour], innovation, axis=0)
        return replace(readings, tau=readings.tau + noise * _each("torque noise", self.std, noise.shape[1]))


@dataclass(frozen=True)
class TorqueScale(Distortion):
    """Torque reads `factor` times what it is, plus `offset`; one value or (n,) each, on the measured side."""

    factor: tuple[float, ...] | float = 1.0
    offset: tuple[float, ...] | float = 0.0

    def apply(self, readings: Readings, rng: np.random.Generator) -> Readings:
        n = readings.tau.shape[1]
        return replace(readings, tau=readings.tau * _each("factor", self.factor, n) + _each("offset", self.offset, n))


@dataclass(frozen=True)
class Sensors:
    """What is recorded and how well: `distortions` in order, on encoders at `encoder` (motor or joint side).

    `written`: the side on which positions go into the log, carried there through K. `columns`: among "q", "dq", "ddq",
    "tau"; accelerations are written on the joint side only. Without distortions everything is exact, and recorded."""

    distortions: tuple[Distortion, ...] = ()
    encoder: Side = Side.JOINT
    written: Side = Side.JOINT
    columns: tuple[str, ...] = ("q", "dq", "ddq", "tau")

    def __post_init__(self) -> None:
        object.__setattr__(self, "encoder", Side(self.encoder))
        object.__setattr__(self, "written", Side(self.written))
        if "q" not in self.columns or not set(self.columns) <= {"q", "dq", "ddq", "tau"}:
            raise ConfigurationError(f"sensors: columns are 'q' and, if wanted, 'dq', 'ddq', 'tau', not {self.columns}.")

    @classmethod
    def typical(
        cls,
        *,
        counts: float | None = 4000.0,
        torque_noise: tuple[float, ...] | float = 0.0,
        colour: float = 0.0,
        torque_window: float = 1e-3,
        encoder: Side = Side.MOTOR,
    ) -> Sensors:
        """Encoders of `counts` a turn (None: exact) and torque noise; positions and torque alone are recorded.

        Torque that a controller holds between its instants acts half a control period late on the whole. Averaged over
        `torque_window` seconds, up to two such periods, it is recorded as it acts, and the log shows no delay."""
        rounding = () if counts is None else (Quantisation.counts(counts),)
        return cls((*rounding, TorqueWindow(torque_window), TorqueNoise(torque_noise, colour)), encoder, columns=("q", "tau"))

    def read(self, readings: Readings, seed: int) -> Readings:
        """The readings with every distortion; the same seed gives the same noise."""
        rng = np.random.default_rng(seed)
        for distortion in self.distortions:
            readings = distortion.apply(readings, rng)
        return readings
