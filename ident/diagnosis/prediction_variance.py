"""How far a fit's own uncertainty lets its prediction be off on other data: what the covariance allows is no contradiction."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import pinv

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray
#: Share of a row's squares along what the fit could not determine, from which on the fit predicts nothing of it.
_OPEN = 1e-6


def prediction_variance(estimate: Estimate, data: Signals) -> Array:
    """Variance (M, n) of the prediction on data by the covariance of the estimate's parameters; infinite in rows along which parameters
    count that the fit could not determine, NaN in rows that are not used."""
    out = np.full(data.tau.shape, np.nan)
    for place, columns, known in _rows(estimate, data):
        out[place] = np.where(known, np.einsum("Nnb,bc,Nnc->Nn", columns, estimate.covariance, columns, optimize=True), np.inf)
    return out


def share_variance(estimate: Estimate, data: Signals, weighted: Array) -> float:
    """Variance, by the covariance of the estimate's parameters, of the sum of its residuals (M, n) times `weighted` (M, n)."""
    slope = np.zeros(len(estimate.values))
    for place, columns, _ in _rows(estimate, data):
        slope += np.einsum("Nn,Nnb->b", weighted[place], columns)
    return float(slope @ estimate.covariance @ slope)


def _rows(estimate: Estimate, data: Signals) -> Iterator[tuple[slice, Array, Array]]:
    """Place of a block of rows, its columns (N, n, b) by the estimated parameters, and whether these are all that counts there (N, n)."""
    # From the model's own base parameters (m) to the estimated ones (b), which the data may have grouped further.
    model, base = estimate.model.base, estimate.base
    grouped = base.regroup @ np.stack([model.expand(x) for x in np.eye(model.count)], axis=1)
    back = pinv(grouped)
    for rows in estimate.problem_on(data).rows():
        columns = rows.columns @ back
        left = np.sum((rows.columns - columns @ grouped) ** 2, axis=2)
        yield rows.place, columns, left <= _OPEN * np.sum(rows.columns**2, axis=2)
