"""Long-run covariance of a sum over time: what scores of an estimating equation say of its error, whatever their colour."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..statistics.autoregression import filtered
from ..statistics.noise import fit_noise

if TYPE_CHECKING:
    from ..problem.problem import Problem
    from ..signals.rows import Rows

Array = np.ndarray


def long_run_gram(problem: Problem, score: Callable[[Rows], Array]) -> Array:
    """Covariance (b, b) of Σ score, for score vectors (m, b) per instant that have zero mean but may depend on one another.

    Each score is made white by an autoregression of its own; the covariance of the sum is then that of the innovations, taken
    back at frequency zero (Andrews & Monahan 1992, without a kernel). Runs are apart."""
    parts, runs = [], []
    for rows in problem.rows():
        parts.append(score(rows))
        runs.append(np.full(len(parts[-1]), rows.run))
    scores, run = np.concatenate(parts), np.concatenate(runs)
    slices = [slice(a, b) for a, b in _spans(run)]
    scale = np.maximum(np.sqrt(np.mean(scores**2, axis=0)), 1e-300)
    unit = scores / scale
    noise = fit_noise(unit, slices)
    innovations = np.concatenate([np.stack([filtered(x, a) for x, a in zip(unit[s].T, noise.ar, strict=True)], axis=1) for s in slices])
    whole = np.isfinite(innovations).all(axis=1)
    if not whole.any():
        return scores.T @ scores
    sums = innovations[whole] / np.sum(noise.ar, axis=1) * scale
    return sums.T @ sums * (len(scores) / max(1, int(whole.sum())))


def _spans(run: Array) -> list[tuple[int, int]]:
    edges = np.concatenate([[0], np.flatnonzero(np.diff(run)) + 1, [len(run)]])
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
