"""Covariance of a fit by simulation: its residual is the model's error more than noise, and remembers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._utils.singular_values import lstsq
from .search import Fitted

Array = np.ndarray
#: Directions whose information is below this share of the largest are beyond the numbers' own precision; standard deviations by its root.
_NONE = 1e-8
RESOLUTION = 1e-4
#: Share of a log that its residual may remember at most.
_MEMORY = 0.1


@dataclass(frozen=True, eq=False)
class Precision:
    """Information (p, p) and score covariance (p, p) of unknowns in units of `scale` (p,)."""

    information: Array
    scores: Array
    scale: Array

    @classmethod
    def of(cls, fit: Fitted, scale: Array) -> Precision:
        """From a fit's derivatives and residual; the residual's memory is counted (Newey and West, 1987)."""
        J = fit.slopes * fit.weights[..., None] * scale
        r = fit.residual * fit.weights
        flat = J.reshape(-1, J.shape[2])
        score = np.einsum("tj,tjp->tp", r, J)
        count = int(np.count_nonzero(fit.weights))
        lags = memory(r)
        S = score.T @ score
        for lag in range(1, lags + 1):
            product = score[lag:].T @ score[:-lag]
            S += (1.0 - lag / (lags + 1)) * (product + product.T)
        return cls(flat.T @ flat, S * count / max(count - J.shape[2], 1), scale)

    @cached_property
    def strengths(self) -> Array:
        """Length (p,) of each unknown's derivative."""
        return np.sqrt(np.diag(self.information))

    def covariance(self, free: Array) -> Array:
        """Covariance (f, f) of the `free` unknowns (indices) in units of their scale, the others known."""
        F, S = self.information[np.ix_(free, free)], self.scores[np.ix_(free, free)]
        size = np.sqrt(np.maximum(np.diag(F), 1e-300))
        values, vectors = np.linalg.eigh(F / np.outer(size, size))
        # A direction without information has no variance that could be computed: it is as good as infinite.
        none = values < _NONE
        inverse = np.where(none, 0.0, 1.0 / np.where(none, 1.0, values))
        spread = vectors.T @ (S / np.outer(size, size)) @ vectors * np.outer(inverse, inverse)
        # No direction is better known than it were if the residual were white noise.
        white = np.maximum(np.where(none, 1e12, inverse) - np.diag(spread), 0.0)
        found = vectors @ (spread + np.diag(white)) @ vectors.T
        with np.errstate(over="ignore"):
            return np.asarray(found / np.outer(size, size))

    def regrouped(self, free: Array, held: Array) -> Array:
        """(f, h): how much of each `held` unknown one of `free` takes over, in units of their scales."""
        F = self.information
        return lstsq(F[np.ix_(free, free)], F[np.ix_(free, held)], rcond=_NONE)


def memory(residual: Array) -> int:
    """Samples over which the residual (N, n) of some joint remembers: twice the first lag at which it does not differ from noise."""
    count = len(residual)
    most = max(1, int(_MEMORY * count))
    longest = 0
    for r in residual.T:
        r = r - r.mean()
        power = np.abs(np.fft.rfft(r, 2 * count)) ** 2
        correlation = np.fft.irfft(power)[: most + 1]
        correlation = correlation / max(correlation[0], 1e-300)
        below = np.flatnonzero(correlation < 2.0 / np.sqrt(count))
        longest = max(longest, 2 * (int(below[0]) - 1) if len(below) else most)
    return min(longest, most)
