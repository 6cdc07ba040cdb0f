"""Information blocks: what least squares needs from the samples, per measured row, in triangular (square-root) form.

For each measured row j the upper triangular factor of [Φ_j τ_j] is kept. Weights per row, merging, forgetting, priors and
sub-sets of columns all work on the factors; the data are not needed again (Golub & Van Loan, ch. 5; information,
not matrices).

Triangles come from Householder reflections, or, in half the time, from sums of products (Gram matrices), whose rounding is that of
the square of the condition number. `Accumulation` takes products once the data so far show that this square is harmless."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import singular_values
from ..errors import ConfigurationError
from ..regressor.row_information import stacked_information

Array = np.ndarray
#: Square of a relative error below which it is round-off.
_ROUND_OFF = 1e-24
#: Largest condition of [Φ τ], columns of equal length, at which products may stand for rows. Rounding then moves an estimate by about
#: κ² ε = 2e-10 standard deviations: κ holds the residual too, whose share of the torque is at least 1/κ.
GRAM_CONDITION = 1e3


class Form(StrEnum):
    """How samples were reduced: by reflections (QR), or by products (Gram matrices) where the condition allowed it."""

    TRIANGLE = "triangle"
    GRAM = "gram"


@dataclass(frozen=True, eq=False, repr=False)
class Information(ShortRepr):
    """Triangular factors of n measured rows over k columns.

    `factors` (n, k+1, k+1): upper triangular R_j with R_jᵀR_j = [Φ_j τ_j]ᵀ[Φ_j τ_j]; `counts` (n,): samples per row;
    `names` (k,): the columns; `form`: GRAM if some of the samples came as products.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> twice = estimate.information + estimate.information
    >>> bool((twice.counts == 2 * estimate.information.counts).all())
    True
    """

    factors: Array
    counts: Array
    names: tuple[str, ...]
    form: Form = Form.TRIANGLE

    @classmethod
    def empty(cls, n: int, names: tuple[str, ...]) -> Information:
        """No samples yet."""
        k = len(names) + 1
        return cls(np.zeros((n, k, k)), np.zeros(n, dtype=np.int64), names)

    @classmethod
    def of_products(cls, products: Array, counts: Array, names: tuple[str, ...]) -> Information:
        """From Gram matrices (n, k+1, k+1) of [Φ_j τ_j], singular ones too."""
        return cls(np.stack([_root(G) for G in products]), counts, names, Form.GRAM)

    @property
    def n(self) -> int:
        return len(self.counts)

    @property
    def k(self) -> int:
        return len(self.names)

    def with_rows(self, columns: Array, tau: Array, valid: Array | None = None) -> Information:
        """Add samples: `columns` (m, n, k), `tau` (m, n), `valid` (m, n) bool (rows that count)."""
        factors, counts = stacked_information(columns, tau, valid=valid)
        return self + Information(factors, counts, self.names)

    def __add__(self, other: Information) -> Information:
        """Merge two blocks over the same columns and rows."""
        if self.names != other.names or self.n != other.n:
            raise ConfigurationError("information blocks of different models cannot be merged.")
        factors = np.stack([stack_triangles(a, b) for a, b in zip(self.factors, other.factors, strict=True)])
        form = Form.GRAM if Form.GRAM in (self.form, other.form) else Form.TRIANGLE
        return replace(self, factors=factors, counts=self.counts + other.counts, form=form)

    def scaled(self, factor: float) -> Information:
        """Every sample weighted by `factor` (forgetting)."""
        return replace(self, factors=self.factors * np.sqrt(factor))

    def selected(self, columns: Array) -> Information:
        """The block over a subset (or another order) of columns."""
        chosen = np.append(np.asarray(columns, int), self.k)
        factors = np.stack([triangle(R[:, chosen]) for R in self.factors])
        return Information(factors, self.counts, tuple(self.names[i] for i in np.asarray(columns, int)), self.form)

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

    def relative_errors(self, values: Array) -> Array:
        """Relative error of each row, (n,), for parameter values (k,): 1 where there is no torque, never below round-off."""
        torque = self.torque_squares()
        share = np.where(torque > 0, self.residual_squares(values) / np.where(torque > 0, torque, 1.0), 1.0)
        return np.sqrt(np.maximum(share, _ROUND_OFF))

    @property
    def condition(self) -> float:
        """Condition number of [Φ τ], every row weighted by its torque and every column scaled to the same length: infinite where a
        column is nil or the torque is fitted exactly."""
        squares = self.torque_squares()
        live = squares > 0
        if not live.any():
            return float("inf")
        stacked = (self.factors[live] / np.sqrt(squares[live])[:, None, None]).reshape(-1, self.k + 1)
        length = np.linalg.norm(stacked, axis=0)
        if not length.all():
            return float("inf")
        singular = singular_values(triangle(stacked / length))
        return float(singular[0] / singular[-1]) if singular[-1] > 0 else float("inf")


@dataclass
class Accumulation:
    """Information of many blocks of samples, the next of which is to come in `form`.

    The first block comes as triangles; the others as products if `may_square` and its condition is below `GRAM_CONDITION`."""

    names: tuple[str, ...]
    n: int
    may_square: bool = True
    form: Form = field(default=Form.TRIANGLE, init=False)

    def __post_init__(self) -> None:
        k = len(self.names) + 1
        self._triangles = Information.empty(self.n, self.names)
        self._products, self._counts = np.zeros((self.n, k, k)), np.zeros(self.n, dtype=np.int64)

    def add(self, factors: Array, counts: Array) -> None:
        """A block (n, k+1, k+1) in the form that was asked for."""
        if self.form == Form.GRAM:
            self._products += factors
            self._counts = self._counts + counts
            return
        self._triangles = self._triangles + Information(factors, counts, self.names)
        if self.may_square and self._triangles.condition <= GRAM_CONDITION:
            self.form = Form.GRAM

    @property
    def information(self) -> Information:
        """Everything so far."""
        if not self._counts.any():
            return self._triangles
        return self._triangles + Information.of_products(self._products, self._counts, self.names)

    @property
    def sound(self) -> bool:
        """Whether products were right for all of it: otherwise take all blocks again without them."""
        found = self.information
        return found.form == Form.TRIANGLE or found.condition <= GRAM_CONDITION


def _root(G: Array) -> Array:
    """Upper triangular R with RᵀR = G, symmetric and positive semidefinite but for round-off."""
    length = np.sqrt(np.maximum(np.diag(G), 0.0))
    safe = np.where(length > 0, length, 1.0)
    values, vectors = np.linalg.eigh(G / np.outer(safe, safe))
    return triangle(np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * length)


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
