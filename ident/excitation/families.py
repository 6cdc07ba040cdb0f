"""Families of trajectories whose motion is linear in coefficients: what the search moves in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from .._utils.singular_values import svd
from ..simulation.trajectory import (
    BSplineTrajectory,
    FourierTrajectory,
    Trajectory,
    bspline_basis,
    bspline_jerk,
    fourier_basis,
    fourier_jerk,
)

Array = np.ndarray


class Family(ABC):
    """q = offset + basis @ coefficients over `duration` seconds, coefficients (C, n)."""

    duration: float

    @property
    @abstractmethod
    def size(self) -> int:
        """C, the number of coefficients per joint."""

    @property
    @abstractmethod
    def highest_hz(self) -> float:
        """The highest frequency with content worth sampling."""

    @abstractmethod
    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity, acceleration (N, C) per unit coefficient."""

    @abstractmethod
    def jerk(self, t: Array) -> Array:
        """Third derivative (N, C) per unit coefficient."""

    @abstractmethod
    def random(self, n: int, rng: np.random.Generator) -> Array:
        """Random coefficients (C, n), their size to be scaled."""

    @abstractmethod
    def build(self, offset: Array, coefficients: Array) -> Trajectory:
        """The trajectory."""


@dataclass(frozen=True)
class FourierFamily(Family):
    """Fourier series of `harmonics` over one period of `duration` seconds."""

    duration: float
    harmonics: int = 5

    @property
    def size(self) -> int:
        return 2 * self.harmonics

    @property
    def highest_hz(self) -> float:
        return self.harmonics / self.duration

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        return fourier_basis(t, self.harmonics, 1.0 / self.duration, 1)

    def jerk(self, t: Array) -> Array:
        return fourier_jerk(t, self.harmonics, 1.0 / self.duration, 1)

    def random(self, n: int, rng: np.random.Generator) -> Array:
        return rng.normal(size=(self.size, n))

    def build(self, offset: Array, coefficients: Array) -> Trajectory:
        return FourierTrajectory(offset, coefficients[: self.harmonics], coefficients[self.harmonics :], 1.0 / self.duration)


@dataclass(frozen=True)
class BSplineFamily(Family):
    """B-splines of `points` control points over `duration` seconds."""

    duration: float
    points: int = 16

    @property
    def size(self) -> int:
        return self.points

    @property
    def highest_hz(self) -> float:
        return 0.5 * self.points / self.duration

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        return bspline_basis(t, self.points, self.duration)

    def jerk(self, t: Array) -> Array:
        return bspline_jerk(t, self.points, self.duration)

    def random(self, n: int, rng: np.random.Generator) -> Array:
        return rng.normal(size=(self.points, n))

    def build(self, offset: Array, coefficients: Array) -> Trajectory:
        return BSplineTrajectory(offset + coefficients, self.duration)


class AnchoredFamily(Family):
    """The motions of a family that start and end at one posture: q = posture + basis @ coefficients, zero at both ends."""

    def __init__(self, inner: Family, posture: Array) -> None:
        self.inner, self.posture, self.duration = inner, np.asarray(posture, float), inner.duration
        (first, last), _, _ = inner.basis(np.array([0.0, inner.duration]))
        self._first = first
        # Coefficients that end where they start.
        gap = last - first
        kept = np.eye(inner.size)
        if np.abs(gap).max() > 1e-9 * max(1.0, float(np.abs(first).max())):
            kept = svd(gap[None])[2][1:].T
        self._kept = kept

    @property
    def size(self) -> int:
        return self._kept.shape[1]

    @property
    def highest_hz(self) -> float:
        return self.inner.highest_hz

    def basis(self, t: Array) -> tuple[Array, Array, Array]:
        q, dq, ddq = self.inner.basis(t)
        return (q - self._first) @ self._kept, dq @ self._kept, ddq @ self._kept

    def jerk(self, t: Array) -> Array:
        return self.inner.jerk(t) @ self._kept

    def random(self, n: int, rng: np.random.Generator) -> Array:
        return rng.normal(size=(self.size, n))

    def build(self, offset: Array, coefficients: Array) -> Trajectory:
        own = self._kept @ coefficients
        return self.inner.build(offset - self._first @ own, own)
