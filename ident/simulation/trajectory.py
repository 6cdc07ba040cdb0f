"""Trajectories with exact derivatives: finite Fourier series, B-splines, point to point, and combinations of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..effects.motion import Coordinates
from ..errors import ConfigurationError

Array = np.ndarray


class Trajectory(ABC):
    """A desired joint-side motion of n joints from t = 0 to `duration` seconds; it stands still before and after."""

    @property
    @abstractmethod
    def duration(self) -> float:
        """Seconds."""

    @property
    @abstractmethod
    def n(self) -> int:
        """Number of joints."""

    @abstractmethod
    def _sample(self, t: Array) -> Coordinates:
        """Motion at times t (N,) within [0, duration]."""

    def sample(self, t: Array) -> Coordinates:
        """Position, velocity and acceleration, each (N, n), at times t (N,) in s."""
        t = np.atleast_1d(np.asarray(t, float))
        motion = self._sample(np.clip(t, 0.0, self.duration))
        outside = (t < 0.0) | (t > self.duration)
        if not outside.any():
            return motion
        still = np.where(outside, 0.0, 1.0)[:, None]
        return Coordinates(motion.q, motion.dq * still, motion.ddq * still)


@dataclass(frozen=True, eq=False)
class FourierTrajectory(Trajectory):
    """Finite Fourier series (Swevers et al., 1997) plus a fifth-order polynomial that makes both ends of each period stand still.

    Joint j: q(t) = offset_j + Σ_h a_hj sin(h w t)/(h w) − b_hj cos(h w t)/(h w) + polynomial, w = 2π `base_hz`, over
    `periods` periods. `sine`, `cosine` (H, n): a and b, rad/s; `offset` (n,). The polynomial, the same in each period, cancels
    velocity and acceleration of the series where a period begins and ends."""

    offset: Array
    sine: Array
    cosine: Array
    base_hz: float
    periods: int = 1

    def __post_init__(self) -> None:
        offset, sine, cosine = np.asarray(self.offset, float), np.asarray(self.sine, float), np.asarray(self.cosine, float)
        if sine.ndim != 2 or sine.shape != cosine.shape or offset.shape != sine.shape[1:]:
            shapes = f"{sine.shape}, {cosine.shape}, {offset.shape}"
            raise ConfigurationError(f"Fourier trajectory: sine and cosine must be (H, n) and offset (n,), not {shapes}.")
        if not self.base_hz > 0 or self.periods < 1:
            raise ConfigurationError("Fourier trajectory: the base frequency must be positive, and there is at least one period.")
        for name, value in (("offset", offset), ("sine", sine), ("cosine", cosine)):
            object.__setattr__(self, name, value)

    @property
    def duration(self) -> float:
        return self.periods / self.base_hz

    @property
    def n(self) -> int:
        return len(self.offset)

    def _sample(self, t: Array) -> Coordinates:
        coefficients = np.concatenate([self.sine, self.cosine])
        basis = fourier_basis(t, len(self.sine), self.base_hz, self.periods)
        q, dq, ddq = (b @ coefficients for b in basis)
        return Coordinates(q + self.offset, dq, ddq)


def fourier_basis(t: Array, harmonics: int, base_hz: float, periods: int) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (N, 2H) per unit sine and cosine coefficient, end conditions met."""
    w = 2.0 * np.pi * base_hz * np.arange(1, harmonics + 1)
    angle = np.outer(t, w)
    s, c = np.sin(angle), np.cos(angle)
    q = np.concatenate([s / w, -c / w], axis=1)
    dq = np.concatenate([c, s], axis=1)
    ddq = np.concatenate([-s * w, c * w], axis=1)
    # Where a period begins and ends, the series has velocity a and acceleration b h w.
    velocity = np.concatenate([np.ones(harmonics), np.zeros(harmonics)])
    acceleration = np.concatenate([np.zeros(harmonics), w])
    T = 1.0 / base_hz
    inside = t - T * np.minimum(np.floor(t / T), periods - 1)
    fixes = [_end_polynomial(inside, T, k) for k in range(2)]
    out = []
    for order, series in enumerate((q, dq, ddq)):
        out.append(series - np.outer(fixes[0][order], velocity) - np.outer(fixes[1][order], acceleration))
    return out[0], out[1], out[2]


def fourier_jerk(t: Array, harmonics: int, base_hz: float, periods: int) -> Array:
    """Third derivative (N, 2H) that belongs to `fourier_basis`."""
    w = 2.0 * np.pi * base_hz * np.arange(1, harmonics + 1)
    angle = np.outer(t, w)
    series = np.concatenate([-(w**2) * np.cos(angle), -(w**2) * np.sin(angle)], axis=1)
    T = 1.0 / base_hz
    inside = t - T * np.minimum(np.floor(t / T), periods - 1)
    velocity, acceleration = (_end_polynomial(inside, T, k)[3] for k in range(2))
    none = np.zeros(harmonics)
    return series - np.outer(velocity, np.concatenate([np.ones(harmonics), none])) - np.outer(acceleration, np.concatenate([none, w]))


def _end_polynomial(t: Array, T: float, kind: int) -> tuple[Array, Array, Array, Array]:
    """Fifth-order polynomial, zero at both ends, with unit velocity (kind 0) or unit acceleration (kind 1) at both ends, and its
    three derivatives."""
    s = t / T
    c = _quintic(0.0, 0.0, T, T, 0.0, 0.0) if kind == 0 else _quintic(0.0, 0.0, 0.0, 0.0, T**2, T**2)
    value, derivative = np.polynomial.polynomial.polyval, np.polynomial.polynomial.polyder
    return value(s, c), value(s, derivative(c)) / T, value(s, derivative(c, 2)) / T**2, value(s, derivative(c, 3)) / T**3


def _quintic(p0: float, p1: float, v0: float, v1: float, a0: float, a1: float) -> Array:
    """Coefficients (6,), rising powers of s in [0, 1], from position, velocity and acceleration at both ends."""
    d = p1 - p0 - v0 - 0.5 * a0
    e = v1 - v0 - a0
    f = a1 - a0
    return np.array([p0, v0, 0.5 * a0, 10 * d - 4 * e + 0.5 * f, -15 * d + 7 * e - f, 6 * d - 3 * e + 0.5 * f])


@dataclass(frozen=True, eq=False)
class BSplineTrajectory(Trajectory):
    """Uniform quintic B-spline with control points (C, n) over `seconds`; the first and last three are held, so both ends stand still."""

    control: Array
    seconds: float

    def __post_init__(self) -> None:
        control = np.asarray(self.control, float)
        if control.ndim != 2 or len(control) < 2:
            raise ConfigurationError("B-spline trajectory: control points (C, n), at least two.")
        if not self.seconds > 0:
            raise ConfigurationError("B-spline trajectory: the duration must be positive.")
        object.__setattr__(self, "control", control)

    @property
    def duration(self) -> float:
        return self.seconds

    @property
    def n(self) -> int:
        return self.control.shape[1]

    def _sample(self, t: Array) -> Coordinates:
        q, dq, ddq = (b @ self.control for b in bspline_basis(t, len(self.control), self.seconds))
        return Coordinates(q, dq, ddq)


def bspline_basis(t: Array, count: int, seconds: float) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (N, C) per unit control point of `BSplineTrajectory`."""
    spline = _bspline(count, seconds)
    return spline(t), spline.derivative(1)(t), spline.derivative(2)(t)


def bspline_jerk(t: Array, count: int, seconds: float) -> Array:
    """Third derivative (N, C) that belongs to `bspline_basis`."""
    return _bspline(count, seconds).derivative(3)(t)


def _bspline(count: int, seconds: float) -> Any:
    """The splines (C of them) of unit control points."""
    from scipy.interpolate import BSpline

    degree, held = 5, 2
    # The clamped spline's first three control points are one, which makes velocity and acceleration zero there.
    total = count + 2 * held
    inner = np.linspace(0.0, seconds, total - degree + 1)
    knots = np.concatenate([np.full(degree, 0.0), inner, np.full(degree, seconds)])
    full = np.zeros((total, count))
    rows = np.clip(np.arange(total) - held, 0, count - 1)
    full[np.arange(total), rows] = 1.0
    return BSpline(knots, full, degree)


@dataclass(frozen=True, eq=False)
class _Transfer(Trajectory):
    """From one posture to another (n,)."""

    start: Array
    end: Array
    seconds: float

    @property
    def duration(self) -> float:
        return self.seconds

    @property
    def n(self) -> int:
        return len(self.start)


@dataclass(frozen=True, eq=False)
class PointToPoint(_Transfer):
    """From one posture to another (n,) along a fifth-order polynomial that starts and ends at rest."""

    def _sample(self, t: Array) -> Coordinates:
        s = (t / self.seconds)[:, None]
        way = np.asarray(self.end, float) - np.asarray(self.start, float)
        rise = s**3 * (10 - 15 * s + 6 * s**2)
        rate = 30 * s**2 * (1 - s) ** 2 / self.seconds
        bend = 60 * s * (1 - s) * (1 - 2 * s) / self.seconds**2
        return Coordinates(np.asarray(self.start) + way * rise, way * rate, way * bend)


@dataclass(frozen=True, eq=False)
class Trapezoid(_Transfer):
    """From one posture to another (n,) with constant speed in the middle; speed rises and falls as a cosine over `ramp` seconds.

    All joints move in step. The speed in the middle is distance / (`seconds` − `ramp`)."""

    ramp: float

    def __post_init__(self) -> None:
        if not 0 < self.ramp <= 0.5 * self.seconds:
            raise ConfigurationError("trapezoid: the ramp must be positive and at most half the duration.")

    @property
    def steady(self) -> tuple[float, float]:
        """Begin and end of the constant speed, s."""
        return self.ramp, self.seconds - self.ramp

    def _sample(self, t: Array) -> Coordinates:
        r, T = self.ramp, self.seconds
        top = 1.0 / (T - r)
        u = np.minimum(t, T - t)  # by symmetry
        inside = u < r
        angle = np.pi * np.minimum(u, r) / r
        way = np.where(inside, 0.5 * top * (u - r / np.pi * np.sin(angle)), 0.5 * top * r + top * (u - r))
        q = np.where(t <= 0.5 * T, way, 1.0 - way)
        dq = np.where(inside, 0.5 * top * (1 - np.cos(angle)), top)
        ddq = np.where(inside, 0.5 * top * np.pi / r * np.sin(angle), 0.0) * np.where(t <= 0.5 * T, 1.0, -1.0)
        d = np.asarray(self.end, float) - np.asarray(self.start, float)
        return Coordinates(np.asarray(self.start) + np.outer(q, d), np.outer(dq, d), np.outer(ddq, d))


@dataclass(frozen=True, eq=False)
class Dwell(Trajectory):
    """Standing still at a posture (n,)."""

    posture: Array
    seconds: float

    @property
    def duration(self) -> float:
        return self.seconds

    @property
    def n(self) -> int:
        return len(self.posture)

    def _sample(self, t: Array) -> Coordinates:
        q = np.repeat(np.asarray(self.posture, float)[None], len(t), axis=0)
        return Coordinates(q, np.zeros_like(q), np.zeros_like(q))


@dataclass(frozen=True, eq=False)
class Chained(Trajectory):
    """Trajectories one after the other; where they meet, positions should."""

    parts: Sequence[Trajectory]

    def __post_init__(self) -> None:
        parts = tuple(self.parts)
        if not parts or len({p.n for p in parts}) > 1:
            raise ConfigurationError("a sequence needs at least one trajectory, all of the same number of joints.")
        object.__setattr__(self, "parts", parts)

    @property
    def duration(self) -> float:
        return float(self.starts[-1] + self.parts[-1].duration)

    @property
    def n(self) -> int:
        return self.parts[0].n

    @cached_property
    def starts(self) -> Array:
        """Time (P,) at which each part begins."""
        return np.cumsum([0.0] + [p.duration for p in self.parts[:-1]])

    def _sample(self, t: Array) -> Coordinates:
        part = np.clip(np.searchsorted(self.starts, t, side="right") - 1, 0, len(self.parts) - 1)
        out = [np.empty((len(t), self.n)) for _ in range(3)]
        for i in np.unique(part):
            rows = part == i
            motion = self.parts[i].sample(t[rows] - self.starts[i])
            for target, values in zip(out, (motion.q, motion.dq, motion.ddq), strict=True):
                target[rows] = values
        return Coordinates(*out)
