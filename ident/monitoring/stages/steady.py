"""What a model's parameters are on the rows that follow it: a fit that leaves out where the residual sticks out.

An effect that acts now and then, but hard (a gear with play that knocks), bends a plain fit of the model without it, and what it does is
then foretold from the bent model: at other moments, with another inertia. Rows between the knocks know better."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .frame import Frame

Array = np.ndarray
#: Rows over which a residual's size is taken: what sticks out does so for a while.
_ROWS = 9
#: A row counts for nothing if its residual is so many times the usual one of its joint.
_OUT = 3.0
_STEPS = 20
#: Weights that change less than this have settled.
_SETTLED = 1e-2


def steady_values(frame: Frame, beside: Array | None = None) -> Array:
    """All parameters (k,) by weighted least squares, repeated with the biweight (J. Tukey) of the smoothed residual over its median.
    `beside` (n, M, c): whitened columns that take part in the fit."""
    from scipy.ndimage import uniform_filter1d

    valid = frame.problem.signals.valid.T
    weight = valid.astype(float)
    columns = frame.columns if beside is None else np.concatenate([frame.columns, beside], axis=2)
    for _ in range(_STEPS):
        fit = _weighted(columns, frame.torque, weight)
        # A running sum ends in rounding errors of either sign.
        size = np.sqrt(np.maximum(uniform_filter1d((frame.torque - columns @ fit) ** 2, _ROWS, axis=1), 0.0))
        usual = np.array([np.median(s[v]) if v.any() else 1.0 for s, v in zip(size, valid, strict=True)])
        new = np.clip(1.0 - (size / np.maximum(_OUT * usual, 1e-300)[:, None]) ** 2, 0.0, None) * valid
        change, weight = float(np.abs(new - weight).max(initial=0.0)), new
        if change < _SETTLED:
            break
    fit = _weighted(columns, frame.torque, weight)
    return np.asarray(frame.problem.base.expand(frame.transform @ fit[: frame.columns.shape[2]]))


def _weighted(columns: Array, torque: Array, weight: Array) -> Array:
    """Coefficients (c,) of columns (n, M, c) with rows weighted by `weight` (n, M)."""
    X, y = (weight[:, :, None] * columns).reshape(-1, columns.shape[2]), (weight * torque).reshape(-1)
    return np.asarray(np.linalg.pinv(X.T @ X, hermitian=True) @ (X.T @ y))
