"""Families of trajectories whose motion is linear in coefficients: what the search moves in."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from ..simulation.trajectory import BSplineTrajectory, FourierTrajectory, Trajectory, bspline_basis, fourier_basis

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

    def random(self, n: int, rng: np.random.Generator) -> Array:
        return rng.normal(size=(self.points, n))

    def build(self, offset: Array, coefficients: Array) -> Trajectory:
        return BSplineTrajectory(offset + coefficients, self.duration)
