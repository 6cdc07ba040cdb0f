"""Principal base parameters: orthogonal directions of the base parameters, ranked by how strongly a trajectory's torque shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._utils.singular_values import svd
from ...errors import ConfigurationError
from .expressions import expression

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class PrincipalParameters:
    """k orthogonal combinations of base parameters, the best determined first.

    `directions` (k, k): principal values = directions @ (base values / scale), rows orthonormal; `sensitivity` (k,): torque per unit
    of a principal value, root mean square over the rows of the regressor (N m, N), or its square root of the sum where the number
    of rows was not given; `scale` (k,): unit taken for each base parameter; `names` (k,) of the base parameters."""

    names: tuple[str, ...]
    directions: Array
    sensitivity: Array
    scale: Array

    @property
    def condition(self) -> float:
        """Largest over smallest sensitivity; infinite if the trajectory does not show some direction."""
        return float(self.sensitivity[0] / self.sensitivity[-1]) if len(self.names) and self.sensitivity[-1] > 0 else float("inf")

    def values(self, base_values: Array) -> Array:
        """Principal values (k,) of base values (k,)."""
        return self.directions @ (np.asarray(base_values, float) / self.scale)

    def base_values(self, values: Array) -> Array:
        """Base values (k,) of principal values; fewer than k may be given, the others count as zero."""
        values = np.asarray(values, float)
        return self.directions[: len(values)].T @ values * self.scale

    @property
    def expressions(self) -> tuple[str, ...]:
        """Each direction as text, parts below 5 % of the largest left out, coefficients in two digits."""
        out = []
        for row in self.directions:
            weight = row / self.scale
            share = np.abs(row) / np.abs(row).max()
            rounded = np.array([float(f"{w:.2g}") for w in weight])
            out.append(expression(np.where(share >= 0.05, rounded, 0.0), self.names))
        return tuple(out)

    def __str__(self) -> str:
        lines = [f"{len(self.names)} principal base parameters, condition {self.condition:.3g}"]
        lines += [f"  {s:10.3g}  {e}" for s, e in zip(self.sensitivity, self.expressions, strict=True)]
        return "\n".join(lines)


def principal_parameters(R: Any, names: Sequence[str], *, rows: int | None = None, scale: Any = None) -> PrincipalParameters:
    """Principal base parameters from the triangular factor `R` (k, k) of the base regressor (RᵀR = ΦᵀΦ; weighted if it is).

    `names` (k,); `rows`: number of rows behind R, for a root mean square; `scale` (k,): what counts as one unit of each base
    parameter (its expected size, say), by default one SI unit. Raises ConfigurationError for shapes that do not fit."""
    R = np.asarray(R, float)
    k = len(names)
    if R.ndim != 2 or R.shape[1] != k:
        raise ConfigurationError(f"R has shape {R.shape}; expected (k, {k}) for {k} names.")
    unit = np.ones(k) if scale is None else np.asarray(scale, float)
    if unit.shape != (k,) or np.any(unit <= 0):
        raise ConfigurationError(f"scale must hold {k} positive numbers.")
    _, s, Vt = svd(R * unit, full_matrices=True)
    sensitivity = np.zeros(k)
    sensitivity[: len(s)] = s
    sense = np.sign(Vt[np.arange(k), np.argmax(np.abs(Vt), axis=1)])
    return PrincipalParameters(tuple(names), Vt * sense[:, None], sensitivity / np.sqrt(rows or 1), unit)
