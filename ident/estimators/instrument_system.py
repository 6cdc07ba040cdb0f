"""The equations of instrumental variables, ZᵀΦ δ = Zᵀe: scaled on both sides, solved by LU, never inverted."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from .._utils.singular_values import singular_values
from ..errors import DataError
from ..problem.information import triangle

Array = np.ndarray


class InstrumentSystem:
    """`cross` (b, b): ZᵀΦ; `gram` (b, b): ZᵀZ, of whitened rows. Raises DataError where the instruments cannot tell the columns apart."""

    def __init__(self, cross: Array, gram: Array, names: tuple[str, ...]) -> None:
        from scipy.linalg import lu_factor

        self.cross, self.gram = cross, gram
        self.left = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        self.right = np.linalg.norm(cross / self.left[:, None], axis=0)
        if np.any(self.right == 0):
            lost = ", ".join(names[i] for i in np.flatnonzero(self.right == 0)[:6])
            raise DataError(
                f"the instruments do not excite what {lost} depend on; simulate the experiment as it was run,"
                f" or leave these parameters out."
            )
        scaled = cross / np.outer(self.left, self.right)
        singular = singular_values(scaled)
        if singular[-1] < 1e-10 * singular[0]:
            raise DataError("the instruments cannot separate all parameters: the simulated motion does not follow the measured one.")
        self._factor = lu_factor(scaled)

    def solve(self, right: Array) -> Array:
        """(ZᵀΦ)⁻¹ applied to vectors in the last axis (…, b)."""
        from scipy.linalg import lu_solve

        flat = right.reshape(-1, right.shape[-1])
        return (lu_solve(self._factor, (flat / self.left).T).T / self.right).reshape(right.shape)

    def both_sides(self, gram: Array, other: InstrumentSystem | None = None) -> Array:
        """(ZᵀΦ)⁻¹ gram (ΦᵀZ)⁻¹; with `other`, its own on the right."""
        return (other or self).solve(self.solve(gram.T).T)

    @cached_property
    def white_std(self) -> Array:
        """Standard deviations (b,) if the noise were white with variance one."""
        return np.sqrt(np.maximum(np.diag(self.both_sides(self.gram)), 0.0))

    @property
    def information_root(self) -> Array:
        """Upper triangular root (b, b) of the information ΦᵀZ (ZᵀZ)⁻¹ ZᵀΦ."""
        from scipy.linalg import solve_triangular

        unit = self.gram / np.outer(self.left, self.left)
        lower = np.linalg.cholesky(unit + 1e-13 * np.eye(len(unit)))
        return triangle(solve_triangular(lower, self.cross / self.left[:, None], lower=True))
