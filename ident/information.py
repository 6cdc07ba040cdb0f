"""Information blocks: what least squares needs from the samples, per measured row, in triangular (square-root) form.

For each measured row j the upper triangular factor of [Φ_j τ_j] is kept. Weights per row, merging, forgetting, priors and
sub-sets of columns all work on the factors; the data are not needed again (Golub & Van Loan, ch. 5; DESIGN: information,
not matrices)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from .errors import ConfigurationError

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Information:
    """Triangular factors of n measured rows over k columns.

    `factors` (n, k+1, k+1): upper triangular R_j with R_jᵀR_j = [Φ_j τ_j]ᵀ[Φ_j τ_j]; `counts` (n,): samples per row;
    `names` (k,): the columns."""

    factors: Array
    counts: Array
    names: tuple[str, ...]

    @classmethod
    def empty(cls, n: int, names: tuple[str, ...]) -> Information:
        """No samples yet."""
        k = len(names) + 1
        return cls(np.zeros((n, k, k)), np.zeros(n, dtype=np.int64), names)

    @property
    def n(self) -> int:
        return len(self.counts)

    @property
    def k(self) -> int:
        return len(self.names)

    def with_rows(self, columns: Array, tau: Array, valid: Array | None = None) -> Information:
        """Add samples: `columns` (m, n, k), `tau` (m, n), `valid` (m, n) bool (rows that count)."""
        from .regressor.rigid import stacked_information

        factors, counts = stacked_information(columns, tau, valid=valid)
        return self + Information(factors, counts, self.names)

    def __add__(self, other: Information) -> Information:
        """Merge two blocks over the same columns and rows."""
        if self.names != other.names or self.n != other.n:
            raise ConfigurationError("information blocks of different models cannot be merged.")
        factors = np.stack([stack_triangles(a, b) for a, b in zip(self.factors, other.factors, strict=True)])
        return replace(self, factors=factors, counts=self.counts + other.counts)

    def scaled(self, factor: float) -> Information:
        """Every sample weighted by `factor` (forgetting)."""
        return replace(self, factors=self.factors * np.sqrt(factor))

    def selected(self, columns: Array) -> Information:
        """The block over a subset (or another order) of columns."""
        chosen = np.append(np.asarray(columns, int), self.k)
        factors = np.stack([triangle(R[:, chosen]) for R in self.factors])
        return Information(factors, self.counts, tuple(self.names[i] for i in np.asarray(columns, int)))

    def combined(self, weights: Array) -> tuple[Array, Array, float]:
        """One system of all rows, row j weighted by `weights[j]` (1/variance): `(R (k, k), z (k,), rss)`.

        The weighted least-squares solution solves R p = z; `rss` is the weighted sum of squared residuals there."""
        stacked = (np.sqrt(weights)[:, None, None] * self.factors).reshape(-1, self.k + 1)
        R = triangle(stacked)
        return R[:-1, :-1], R[:-1, -1], float(R[-1, -1] ** 2)

    def residual_squares(self, values: Array) -> Array:
        """Sum of squared residuals of each row, (n,), for parameter values (k,)."""
        x = np.append(-np.asarray(values, float), 1.0)
        return np.sum((self.factors @ x) ** 2, axis=1)

    def torque_squares(self) -> Array:
        """Sum of squared torque of each row, (n,)."""
        return np.sum(self.factors[:, :, -1] ** 2, axis=1)


def triangle(block: Array) -> Array:
    """Square upper triangular factor (c, c) of a block (m, c); rows of zeros where m < c."""
    c = block.shape[1]
    live = np.flatnonzero(block.any(axis=0))
    out = np.zeros((c, c))
    if len(live) and len(block):
        R = np.linalg.qr(block[:, live], mode="r")
        # Row i of R has its first entry in live column i: in that row the factor stays triangular over all columns.
        out[np.ix_(live[: len(R)], live)] = R
    return out


def stack_triangles(R: Array, block: Array) -> Array:
    """Factor of R (c, c) with the rows of `block` (m, c) added."""
    return triangle(np.concatenate([R, block])) if len(block) else R
