"""What a consistent fit is to be near to: an information triangle or a covariance, as base values = offset + root @ w."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .._utils.singular_values import lstsq, svd
from ..errors import ConfigurationError

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Target:
    """What is to be fitted: base values = offset + root @ w at the cost sum over `costed` of (w - target)^2."""

    offset: Array
    root: Array
    target: Array
    costed: Array

    @classmethod
    def from_information(cls, R: Array, z: Array) -> Target:
        """Least squares |R p - z|^2, R (m, b) of any rank; directions it does not see are free."""
        R, z = np.atleast_2d(np.asarray(R, float)), np.asarray(z, float)
        size = np.linalg.norm(R, axis=0)
        D = 1.0 / np.where(size > 0, size, 1.0)
        U, S, Vt = svd(R * D, full_matrices=False)
        # Economic form has min(m, b) directions; the rest are unseen.
        full = svd(Vt, full_matrices=True)[2] if len(Vt) < R.shape[1] else Vt
        seen = S > 1e-12 * max(float(S.max(initial=0.0)), 1e-300)
        root = np.concatenate([(D[:, None] * Vt[seen].T) / S[seen], D[:, None] * np.concatenate([Vt[~seen], full[len(Vt) :]]).T], axis=1)
        # Counted from the unconstrained solution, so that the cost is what the constraints add.
        offset = root[:, : seen.sum()] @ (U[:, seen].T @ z)
        return cls(offset, root, np.zeros(root.shape[1]), np.arange(root.shape[1]) < seen.sum())

    @classmethod
    def from_covariance(cls, values: Array, covariance: Array, unseen: Array | None = None) -> Target:
        """Mahalanobis distance from `values`; directions without variance stay fixed, but for the `unseen` ones (b, u), which are free."""
        root = covariance_root(covariance)
        free = np.zeros((len(root), 0)) if unseen is None else np.asarray(unseen, float)
        both = np.concatenate([root, free], axis=1)
        return cls(np.asarray(values, float), both, np.zeros(both.shape[1]), np.arange(both.shape[1]) < root.shape[1])

    @classmethod
    def fixed(cls, values: Array) -> Target:
        """Exactly these base values."""
        values = np.asarray(values, float)
        return cls(values, np.zeros((len(values), 0)), np.zeros(0), np.zeros(0, bool))


def covariance_root(covariance: Array) -> Array:
    """Root L (b, r) with L L' = covariance, scaled before the rank is decided. Raises ConfigurationError if it is no covariance."""
    C = np.asarray(covariance, float)
    C = 0.5 * (C + C.T)
    if not np.all(np.isfinite(C)) or np.any(np.diagonal(C) < 0):
        raise ConfigurationError("the covariance holds a negative variance or a value that is not finite, so it gives no metric.")
    std = np.sqrt(np.diagonal(C))
    D = np.where(std > 0, std, 1.0)
    eigenvalues, vectors = np.linalg.eigh(C / np.outer(D, D))
    if len(eigenvalues) and eigenvalues[0] < -1e-6 * max(eigenvalues[-1], 1e-300):
        raise ConfigurationError("the covariance is not positive semidefinite, so it gives no metric.")
    keep = eigenvalues > 1e-14 * max(float(eigenvalues.max(initial=0.0)), 1e-300)
    return (D[:, None] * vectors[:, keep]) * np.sqrt(eigenvalues[keep])


def mahalanobis(root: Array, change: Array, unseen: Array | None = None) -> float:
    """Length of a change of base values in the metric of a covariance root (b, r); infinite where it leaves its range.

    Changes along `unseen` directions (b, u) cost nothing."""
    free = np.zeros((len(root), 0)) if unseen is None else unseen
    both = np.concatenate([root, free], axis=1)
    size = np.linalg.norm(both, axis=1)
    D = 1.0 / np.where(size > 0, size, 1.0)
    # Without what is free first, so that it does not count.
    Q, _ = np.linalg.qr(D[:, None] * free)
    A, y = D[:, None] * root, D * change
    A, y = A - Q @ (Q.T @ A), y - Q @ (Q.T @ y)
    x = lstsq(A, y, rcond=1e-13)
    left = A @ x - y
    return float(np.linalg.norm(x)) if np.linalg.norm(left) <= 1e-6 * max(float(np.linalg.norm(y)), 1e-300) else np.inf
