"""Correlated samples within bounds: a normal distribution cut off where parameters cannot be."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
_SWEEPS = 40


def bounded_normal(mean: Array, covariance: Array, lower: Array, upper: Array, count: int, rng: np.random.Generator) -> Array:
    """Samples (count, p) of the normal distribution of mean (p,) and covariance (p, p), given that lower ≤ sample ≤ upper.

    Gibbs sampling along the axes of the covariance: without active bounds the first sweep is an exact, independent draw; where a direction
    is hardly determined and bounded, the samples fill what the bounds leave of it. The mean has to lie within the bounds."""
    from scipy.special import ndtr, ndtri

    scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(scale > 0, scale, 1.0)
    size, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    kept = size > 1e-14 * max(float(size.max(initial=0.0)), 1e-300)
    root = scale[:, None] * axes[:, kept] * np.sqrt(size[kept])
    at = np.isfinite(lower) | np.isfinite(upper)
    x = np.tile(mean, (count, 1))
    z = np.zeros((count, root.shape[1]))
    for _ in range(_SWEEPS if at.any() else 1):
        for k, along in enumerate(root.T):
            rest = x - z[:, k, None] * along
            moves = at & (along != 0.0)
            first, second = ((edge[moves] - rest[:, moves]) / along[moves] for edge in (lower, upper))
            low = np.minimum(first, second).max(axis=1, initial=-np.inf)
            high = np.maximum(first, second).min(axis=1, initial=np.inf)
            # In the lower tail, where the distribution function keeps its digits.
            flip = np.where(low > 0, -1.0, 1.0)
            a, b = np.where(flip > 0, low, -high), np.where(flip > 0, high, -low)
            share = ndtr(a) + rng.uniform(size=count) * (ndtr(b) - ndtr(a))
            z[:, k] = flip * np.clip(ndtri(np.clip(share, 1e-300, 1.0)), a, b)
            x = rest + z[:, k, None] * along
    return np.clip(x, lower, upper)


def total_covariance(values: Array, within: Array) -> tuple[Array, Array]:
    """Mean (p,) and covariance (p, p) of one more unit, from the values (u, p) of u units and the mean covariance of their estimates.

    In directions in which the units differ by more than their estimates are uncertain it is their spread, with that of the mean; elsewhere
    the uncertainty of one estimate."""
    count, mean = len(values), values.mean(axis=0)
    scale = np.sqrt(np.maximum(np.diag(within), 0.0))
    scale = np.where(scale > 0, scale, np.maximum(np.std(values, axis=0), 1e-12))
    W = within / np.outer(scale, scale) + 1e-12 * np.eye(len(scale))
    spread = (values - mean) / scale
    between = spread.T @ spread / (count - 1) * (1.0 + 1.0 / count)
    root = np.linalg.cholesky(W)
    back = np.linalg.inv(root)
    size, axes = np.linalg.eigh(back @ between @ back.T)
    half = root @ axes * np.sqrt(np.maximum(size, 1.0))
    return mean, np.outer(scale, scale) * (half @ half.T)
