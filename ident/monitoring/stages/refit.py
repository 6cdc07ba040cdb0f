"""A model refitted with a candidate's columns beside its own: values of both, and how well they are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .frame import Frame

Array = np.ndarray
#: Directions of a candidate's parameters that the data show less than this (a share of what they would without the model's) are not
#: known at all, nor is any parameter that has more than such a part in one.
_SHOWN = 1e-9
_TOUCHED = 1e-3
_NOTHING = 1e-250


@dataclass(frozen=True, eq=False)
class Refit:
    """`values` (k,) of a candidate's parameters with `std` (k,), for white noise of unit variance: inf for one that the model's own
    can take up (the ideal part of a counterbalance, which looks like the link's gravity). `model` (b,): coefficients of the frame's
    columns beside them. `covariance` (b+k, b+k) of both. `rank`: directions of the candidate's parameters that are known beside the
    model's."""

    values: Array
    std: Array
    model: Array
    covariance: Array
    rank: int

    @classmethod
    def of(cls, frame: Frame, columns: Array) -> Refit:
        """Of whitened candidate columns (n, M, k) on all rows of a frame."""
        X = frame.columns.reshape(-1, frame.columns.shape[2])
        z = columns.reshape(-1, columns.shape[2])
        cross, gram = X.T @ z, z.T @ z
        along = frame.inverse_gram @ cross
        own, size = gram - cross.T @ along, np.diag(gram)
        scale = np.where(size > _NOTHING, 1.0 / np.sqrt(np.maximum(size, _NOTHING)), 0.0)
        strength, axes = np.linalg.eigh(own * scale[:, None] * scale)
        shown = strength > _SHOWN
        inverse = scale[:, None] * ((axes[:, shown] / strength[shown]) @ axes[:, shown].T) * scale
        values = inverse @ (z.T @ frame.residual.reshape(-1))
        std = np.sqrt(np.maximum(np.diag(inverse), 0.0))
        std[np.any(np.abs(axes[:, ~shown]) > _TOUCHED, axis=1)] = np.inf
        both = -along @ inverse
        covariance = np.block([[frame.inverse_gram - both @ along.T, both], [both.T, inverse]])
        return cls(values, std, frame.coefficients - along @ values, covariance, int(shown.sum()))
