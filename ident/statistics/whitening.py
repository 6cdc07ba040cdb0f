"""Whitening of rows with gaps: each by the predictor of the order that the rows since the last gap allow."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..regressor.kernel_choice import kernel
from .autoregression import lower_orders

Array = np.ndarray
#: Numbers that a row has a multiple of: what the compiled filter takes at once.
_LANES = 8


def padded(width: int) -> int:
    """The least width of whitened rows that holds so many numbers."""
    return -(-width // _LANES) * _LANES


class RowWhitener:
    """Rows, block by block, through the predictors of an autoregression with this `polynomial` and variance of the `innovation`: Γ⁻¹ = LᵀL
    with Γ the covariance of each stretch without a gap, and what comes out is L times the rows.

    Rows come in parts, columns of arrays (m, …), which stand side by side with zeros behind them, and beside which a column of an array of
    bool says which of them are there; what is not may hold anything, and comes out as zero."""

    def __init__(self, polynomial: Array, innovation: float) -> None:
        last = int(np.flatnonzero(polynomial)[-1])
        self._predictors = np.zeros((last + 1, last + 7))
        for order, (a, variance) in enumerate(lower_orders(polynomial[: last + 1], innovation)):
            self._predictors[order, 3 : order + 4] = a / np.sqrt(variance)
        self.reset(0)

    @property
    def order(self) -> int:
        """Rows that a row is predicted from at most."""
        return len(self._predictors) - 1

    def reset(self, width: int) -> None:
        """Begin a run of rows of this width, which is as `padded` has it."""
        self._past, self._age = np.zeros((self.order, width)), 0

    def rows(self, parts: Sequence[tuple[Array, slice]], valid: tuple[Array, int]) -> Array:
        """Whitened rows (m, w) that follow the last ones."""
        out = np.empty((len(valid[0]), self._past.shape[1]))
        self._age = kernel().series.whiten(self._predictors, self._past, self._age, parts, valid, out)
        return out

    def add_products(self, parts: Sequence[tuple[Array, slice]], valid: tuple[Array, int], into: Array, rows: int) -> None:
        """Add to `into` (w, w) the products of the first `rows` columns of whitened rows that follow the last ones with each column from
        there on; `rows` is as `padded` has it. The whitened rows are never in memory at once."""
        self._age = kernel().series.whiten(self._predictors, self._past, self._age, parts, valid, None, into, rows)
