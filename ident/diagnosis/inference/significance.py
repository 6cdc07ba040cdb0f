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
#: Of the draws: any other serves as well (`benchmarks.diagnosis.stability`).
SEED = 1
#: Equal parts of a log by which its stretches are drawn.
_PARTS = 20
_EULER = 0.5772156649


def parametric(scores: Scores, level: float = LEVEL) -> float:
    """Quantile (1 − `level`) of the maximum for normal scores of this covariance, each taken as the scores are: without the stretch that
    speaks for it most, if they are. Gumbel's law by moments of the draws.

    Groups of one motor are drawn together, and apart from those of others: their noise is another one. What correlation the model's own
    columns make between them is left out, which can only raise the maximum (Slepian's lemma)."""
    from scipy.linalg.blas import strmm

    rng = np.random.default_rng(SEED)
    largest = np.zeros(_DRAWS)
    for groups in scores.parts:
        ix = np.concatenate([scores.slice_of(k) for k in groups.tolist()])
        degrees = scores.degrees[groups]
        own, waves = scores.gram(ix, ix), scores.constancy
        own = own if waves is None else own + waves.answers[ix] @ waves.answers[ix].T
        L = np.linalg.cholesky((own + own.T) / 2.0 + 1e-5 * np.eye(len(ix))).astype(np.float32)
        normal = rng.normal(size=(len(ix), _PARTS * _DRAWS)).astype(np.float32) / np.float32(np.sqrt(_PARTS))
        parts = strmm(1.0, L.T, normal.T, side=1, overwrite_b=1).T.reshape(len(ix), _PARTS, _DRAWS)
        starts = np.cumsum(np.concatenate([[0], degrees[:-1]]))
        parts = parts if waves is None else waves.tempered(parts, ix)
        squares = least_squares_left(parts, starts, scores.stretch)
        every = np.unique(degrees)
        most = np.stack([squares[degrees == d].max(axis=0) for d in every])
        largest = np.maximum(largest, z_of(most.astype(float), every).max(axis=0))
    return _quantile(largest, level)


def _quantile(largest: Array, level: float) -> float:
    spread = float(largest.std()) * np.sqrt(6.0) / np.pi
    return float(largest.mean() - _EULER * spread - spread * np.log(-np.log1p(-level)))
