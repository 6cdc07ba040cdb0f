"""What makes a trajectory good: scalar measures of the information matrix, with their gradients.

A (b, b) is the information on the base parameters, Φᵀ W Φ over the trajectory. A measure returns its value, to be made
small, and its derivative with respect to A."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import unknown_name

Array = np.ndarray


class Measure(ABC):
    """A figure of merit, smaller is better."""

    @abstractmethod
    def evaluate(self, A: Array, names: tuple[str, ...]) -> tuple[float, Array]:
        """Value, and derivative (b, b) with respect to the symmetric A, for base parameters `names`; inf where A is singular."""

    def exact(self, A: Array, names: tuple[str, ...]) -> float:
        """The value by which trajectories are compared, where `evaluate` smooths it for the sake of the search."""
        return self.evaluate(A, names)[0]


@dataclass(frozen=True)
class DOptimality(Measure):
    """The volume of the confidence ellipsoid: −log det A / b. With `parameters`, that of these parameters alone, whatever
    happens to the others (D_s-optimality): name one to sharpen it, or those of two effects to tell them apart."""

    parameters: Sequence[str] | None = None

    def evaluate(self, A: Array, names: tuple[str, ...]) -> tuple[float, Array]:
        scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
        try:
            L = np.linalg.cholesky(scale[:, None] * A * scale)
        except np.linalg.LinAlgError:
            return np.inf, np.zeros_like(A)
        half = np.linalg.solve(L, np.diag(scale))  # L⁻¹ D, with A⁻¹ = halfᵀ half
        b = len(A)
        if self.parameters is None:
            value = -2.0 * float(np.sum(np.log(np.diag(L)) - np.log(scale)))
            return value / b, -(half.T @ half) / b
        chosen = chosen_parameters(self.parameters, names)
        columns = half[:, chosen]
        covariance = columns.T @ columns
        sign, value = np.linalg.slogdet(covariance)
        if sign <= 0:
            return np.inf, np.zeros_like(A)
        back = half.T @ columns  # columns of A⁻¹
        return value / len(chosen), -(back @ np.linalg.solve(covariance, back.T)) / len(chosen)


@dataclass(frozen=True)
class ConditionNumber(Measure):
    """log10 of the condition number of the regressor with its columns scaled to equal length.

    At a good trajectory several extreme eigenvalues meet and the condition number has a kink, at which descent gets stuck; the
    search therefore uses the bound from p-norms of all eigenvalues."""

    power: float = 8.0

    def evaluate(self, A: Array, names: tuple[str, ...]) -> tuple[float, Array]:
        scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
        C = scale[:, None] * A * scale
        values, vectors = np.linalg.eigh(C)
        if values[0] <= 1e-15 * values[-1]:
            return np.inf, np.zeros_like(A)
        p, half = self.power, 0.5 / np.log(10.0)
        up, down = (values / values[-1]) ** p, (values[0] / values) ** p
        value = half * (np.log(values[-1] / values[0]) + (np.log(up.sum()) + np.log(down.sum())) / p)
        dC = (vectors * (half * (up / up.sum() - down / down.sum()) / values)) @ vectors.T
        dA = scale[:, None] * dC * scale
        # The scale moves with the diagonal: C_ij = A_ij (A_ii A_jj)^-1/2.
        dA[np.diag_indices(len(A))] -= np.sum(dC * C, axis=1) * scale**2
        return float(value), dA

    def exact(self, A: Array, names: tuple[str, ...]) -> float:
        number = condition_number(A)
        return float(np.log10(number)) if np.isfinite(number) else np.inf


@dataclass(frozen=True)
class Both(Measure):
    """The volume of the confidence ellipsoid and, `weight` times, its shape: D-optimality plus weight × ln of the condition number."""

    weight: float = 1.0

    def evaluate(self, A: Array, names: tuple[str, ...]) -> tuple[float, Array]:
        volume, d_volume = DOptimality().evaluate(A, names)
        shape, d_shape = ConditionNumber().evaluate(A, names)
        factor = self.weight * float(np.log(10.0))
        return volume + factor * shape, d_volume + factor * d_shape

    def exact(self, A: Array, names: tuple[str, ...]) -> float:
        return DOptimality().exact(A, names) + self.weight * float(np.log(10.0)) * ConditionNumber().exact(A, names)


def chosen_parameters(wanted: Sequence[str], names: tuple[str, ...]) -> list[int]:
    """Places of named base parameters. Raises ConfigurationError for a name that is none of them."""
    for name in wanted:
        if name not in names:
            raise unknown_name("base parameter", name, names)
    return [names.index(name) for name in wanted]


def condition_number(A: Array) -> float:
    """Condition number of the regressor whose information is A, columns scaled to equal length."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    values = np.linalg.eigvalsh(scale[:, None] * A * scale)
    return float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else np.inf
