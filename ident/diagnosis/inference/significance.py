"""Critical values of the largest score over the whole catalogue."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..thresholds import LEVEL
from .scores import least_squares_left, z_of

if TYPE_CHECKING:
    from .scores import Scores

Array = np.ndarray
_DRAWS = 300
#: Equal parts of a log by which its stretches are drawn.
_PARTS = 20
_EULER = 0.5772156649


def parametric(scores: Scores) -> float:
    """Quantile of the maximum for normal scores of this covariance, each taken as the scores are: without the stretch that speaks for it
    most. Gumbel's law by moments of the draws."""
    c = len(scores.gram)
    L = np.linalg.cholesky((scores.gram + scores.gram.T) / 2.0 + 1e-5 * np.eye(c))
    normal = np.random.default_rng(1).normal(size=(c, _PARTS * _DRAWS)) / np.sqrt(_PARTS)
    parts = (L @ normal).reshape(c, _PARTS, _DRAWS)
    return _quantile(z_of(least_squares_left(parts, scores.starts), scores.degrees).max(axis=0))


def by_blocks(scores: Scores, residual_blocks: Array | None = None) -> float:
    """The same by random signs of the blocks' own scores: colour and what is not stationary are in it."""
    blocks = scores.blocks if residual_blocks is None else residual_blocks
    signs = np.random.default_rng(2).choice([-1.0, 1.0], size=(blocks.shape[1], _DRAWS))
    return _quantile(z_of(np.add.reduceat((blocks @ signs) ** 2, scores.starts, axis=0), scores.degrees).max(axis=0))


def _quantile(largest: Array) -> float:
    spread = float(largest.std()) * np.sqrt(6.0) / np.pi
    return float(largest.mean() - _EULER * spread - spread * np.log(-np.log(1.0 - LEVEL)))
