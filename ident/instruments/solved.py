"""A solved stage of the instrumental fit: coefficients, their covariance, and what the rows leave open."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._utils.singular_values import svd

Array = np.ndarray
#: Singular values of the instrumental equations that are as good as zero.
SINGULAR = 1e-9
#: Part that a coefficient has in directions which the equations leave open, from which on it is open itself.
_OPEN = 1e-3


@dataclass(frozen=True, eq=False)
class Solved:
    """A solved stage. R rows, n motors, p columns (base parameters, then effects).

    `X`, `Z` (R, n, p): columns of measured motion and instrument, whitened; `residual` (R, n); `theta` (p,); `scale` (p,): of Z's columns;
    `solution` (p, p): (X'Z)⁻¹ of scaled columns; `prior` (p,): what the prior's rows add to Z'e; `equations` (p, p): Z'X of scaled
    columns, `gram` (p, p): Z'Z, both with the prior's rows; `gains`: whitening filters."""

    X: Array
    Z: Array
    residual: Array
    theta: Array
    scale: Array
    solution: Array
    prior: Array
    equations: Array
    gram: Array
    gains: tuple[Array, ...]
    edges: tuple[int, ...]

    @property
    def rows(self) -> int:
        return len(self.residual)

    @cached_property
    def row_scores(self) -> Array:
        """What each row (R, p) adds to the scores of the model's own scaled columns."""
        return np.matmul(self.residual[:, None], self.Z)[:, 0] / self.scale

    @cached_property
    def covariance(self) -> Array:
        """Covariance (p, p) of the coefficients, without what the rows leave open (`open_directions`)."""
        inverse, _ = inverse_of(self.equations)
        return inverse @ self.gram @ inverse.T / np.outer(self.scale, self.scale)

    @cached_property
    def open_directions(self) -> Array:
        """Directions (k, p) of the scaled coefficients that the equations leave open."""
        return inverse_of(self.equations)[1]

    @cached_property
    def std(self) -> Array:
        """Standard deviations (p,) of the coefficients; infinite where the rows leave one open."""
        return deviations(self.equations, self.gram) / self.scale

    def knowledge(self) -> tuple[Array, Array]:
        """What the frame tells of its coefficients, as rows (k, p) of unit variance and their values (k,)."""
        w, U = np.linalg.eigh(self.gram)
        good = w > SINGULAR * w[-1]
        rows = (U[:, good] / np.sqrt(w[good])).T @ self.equations * self.scale
        return rows, rows @ self.theta


def deviations(equations: Array, gram: Array) -> Array:
    """Standard deviations (p,) of the solution of instrumental equations (p, p) whose right side has the covariance `gram` (p, p): infinite
    for coefficients that have a part in a direction which the equations leave open."""
    inverse, left_open = inverse_of(equations)
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", inverse, gram, inverse), 0.0))
    return np.where(np.sum(left_open**2, axis=0) > _OPEN, np.inf, std)


def inverse_of(equations: Array) -> tuple[Array, Array]:
    """Inverse (p, p) of instrumental equations over the directions that they determine, and the directions (k, p) that they leave open."""
    U, s, Vt = svd(equations)
    good = s > SINGULAR * max(float(s[0]), 1e-300)
    return (Vt[good].T / s[good]) @ U[:, good].T, Vt[~good]
