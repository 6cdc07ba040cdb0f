"""Long-run covariance of a sum over time, from the scatter of batch means: no model of the noise, only that it forgets."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..noise import fit_noise

if TYPE_CHECKING:
    from ..problem import Problem, Rows

Array = np.ndarray


def batch_gram(problem: Problem, score: Callable[[Rows], Array], least: int = 8) -> Array:
    """Covariance (b, b) of Σ score, for score vectors (m, b) per instant that have zero mean but may depend on one another.

    Sums over batches of consecutive instants are taken as independent; a batch is several correlation times of the scores
    long. Each run has its own batches."""
    parts, runs = [], []
    for rows in problem.rows():
        parts.append(score(rows))
        runs.append(np.full(len(parts[-1]), rows.run))
    scores, run = np.concatenate(parts), np.concatenate(runs)
    slices = [slice(int(a), int(b)) for a, b in _spans(run)]
    scale = np.maximum(np.sqrt(np.mean(scores**2, axis=0)), 1e-300)
    times = fit_noise(scores / scale, slices).correlation_time
    length = int(max(1, np.ceil(4 * float(np.quantile(times, 0.9)))))
    length = max(1, min(length, len(scores) // max(least, 1)))
    sums = [np.add.reduceat(scores[s], np.arange(0, s.stop - s.start, length), axis=0) for s in slices]
    batches = np.concatenate(sums)
    return batches.T @ batches


def _spans(run: Array) -> list[tuple[int, int]]:
    edges = np.concatenate([[0], np.flatnonzero(np.diff(run)) + 1, [len(run)]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
