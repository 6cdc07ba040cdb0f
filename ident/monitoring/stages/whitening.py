"""Whitening: rows of one joint transformed so that its noise becomes white, of unit variance.

The noise of a residual is coloured (differentiated positions, filters, the torque reading). Under an autoregressive model of
order p the transformation is exact: each row less its best prediction from the p rows before it, over the error of that
prediction; at the beginning of a run, from as many as there are. Behind a gap, such as every reversal leaves, the last p rows
in use lie farther back and foretell less, but they do: rows on both sides of a short gap that counted as independent would
say the same thing twice. Then plain least squares is the best there is, and gains in the sum of squares are log-likelihood
ratios (times two)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...statistics.autoregression import autocovariance

if TYPE_CHECKING:
    from scipy.sparse import csr_array

    from ...problem.problem import Problem

Array = np.ndarray
#: Longest memory of the noise, in rows.
_MOST_ORDER = 12
#: A mean square of whitened rows that is this large, and beyond so many standard deviations, is not what the filter promised.
_LARGER = 1.5
_SURELY = 4.0
#: Rows farther back than this, or than where the noise's autocorrelation falls below this for good, tell nothing.
_FARTHEST = 60
_FORGOTTEN = 0.03


@dataclass(frozen=True, eq=False)
class Whitener:
    """`matrices` (one (M, M) sparse matrix a joint): rows that are not used are zero, in and out. `std` (n,): of the noise;
    `predictors`: for each joint its prediction-error filters of order 0, 1, … with the variance of their errors."""

    matrices: tuple[csr_array, ...]
    std: Array
    predictors: tuple[list[tuple[Array, float]], ...]

    def on(self, valid: Array, runs: Iterable[slice]) -> Whitener:
        """The same noise on other rows: `valid` (M, n), the rows of each run."""
        runs = list(runs)
        return Whitener(tuple(_matrix(valid[:, j], runs, p) for j, p in enumerate(self.predictors)), self.std, self.predictors)

    def __call__(self, rows: Array, joint: int) -> Array:
        """Rows (M, …) of one joint, whitened."""
        flat = rows.reshape(len(rows), -1)
        return (self.matrices[joint] @ flat).reshape(rows.shape)

    def back(self, rows: Array, joint: int) -> Array:
        """The transposed transformation (M,) → (M,): gradients with respect to rows before whitening."""
        return self.matrices[joint].T @ rows


def whitener(residual: Array, valid: Array, runs: Iterable[slice], more: Array | None = None) -> Whitener:
    """From residuals (M, n) that hold noise and nothing else, `valid` (M, n) and the rows of each run. `more` (M, n): noise that counts
    beside it, independent of it; `std` does not."""
    runs = list(runs)
    std, predictors = [], []
    for j in range(residual.shape[1]):
        x = np.where(valid[:, j], residual[:, j], np.nan)
        longest = max((r.stop - r.start for r in runs), default=1)
        lags = max(0, min(_MOST_ORDER, longest // 20))
        gamma, count = autocovariance(x, runs, lags)
        if count == 0 or gamma[0] <= 0:
            gamma, lags = np.array([1.0]), 0
        std.append(float(np.sqrt(gamma[0])))
        if more is not None:
            beside, _ = autocovariance(np.where(valid[:, j], more[:, j], np.nan), runs, len(gamma) - 1)
            gamma = gamma + beside
        predictors.append(_borne_out(predictors_of(gamma, count), residual[:, j], valid[:, j], runs))
    return Whitener((), np.array(std), tuple(predictors)).on(valid, runs)


def plain_whitener(problem: Problem, rows: Array) -> Whitener:
    """No colour: each joint's rows (M, n) over their spread."""
    valid = problem.signals.valid
    power = np.sum(np.where(valid, rows, 0.0) ** 2, axis=0) / np.maximum(valid.sum(axis=0), 1)
    std = np.where(power > 0, np.sqrt(power), 1.0)
    return Whitener((), std, tuple([(np.ones(1), float(s) ** 2)] for s in std)).on(valid, problem.signals.row_runs)


def predictors_of(gamma: Array, count: int) -> list[tuple[Array, float]]:
    """Prediction-error filters of order 0, 1, … up to the best order, with the variance of their errors."""
    a, variance = np.ones(1), float(gamma[0])
    found = [(a, variance)]
    best, best_score = 0, count * np.log(variance)
    for p in range(1, len(gamma)):
        reflection = -(a @ gamma[p:0:-1]) / variance
        if not np.isfinite(reflection) or abs(reflection) >= 0.999:
            break
        longer = np.append(a, 0.0)
        a = longer + reflection * longer[::-1]
        variance *= 1.0 - reflection**2
        found.append((a, variance))
        score = count * np.log(variance) + 3.0 * p
        if score < best_score:
            best, best_score = p, score
    return found[: best + 1]


def _borne_out(predictors: list[tuple[Array, float]], residual: Array, valid: Array, runs: list[slice]) -> list[tuple[Array, float]]:
    """Filters up to the highest order of which a residual (M,) does not come out clearly larger than promised.

    Autocovariances over gaps need not be those of any process: a filter that they make may be next to unstable."""
    most = max(_LARGER, 1.0 + _SURELY * np.sqrt(2.0 / max(int(valid.sum()), 1)))
    rows = np.where(valid, residual, 0.0)
    while len(predictors) > 1 and np.sum((_matrix(valid, runs, predictors) @ rows) ** 2) > most * valid.sum():
        predictors = predictors[:-1]
    return predictors


def _matrix(valid: Array, runs: list[slice], predictors: list[tuple[Array, float]]) -> csr_array:
    from scipy.sparse import csr_array

    M, order = len(valid), len(predictors) - 1
    gamma = _autocovariances(predictors)
    at, lags = _past(valid, runs, order, _reach(gamma, order))
    patterns, which = np.unique(lags, axis=0, return_inverse=True)
    filters = np.zeros((len(patterns), order + 1))
    for i, pattern in enumerate(patterns):
        a, variance = _predictor(pattern[pattern > 0], gamma, predictors)
        filters[i, : len(a)] = a / np.sqrt(variance)
    values = filters[which.reshape(-1)]
    columns = at[:, None] - np.concatenate([np.zeros((len(at), 1), int), lags], axis=1)
    live = np.concatenate([np.ones((len(at), 1), bool), lags > 0], axis=1)
    rows = np.broadcast_to(at[:, None], columns.shape)
    return csr_array((values[live], (rows[live], columns[live])), shape=(M, M))


def _past(valid: Array, runs: list[slice], order: int, reach: int) -> tuple[Array, Array]:
    """Rows in use (m,), and how far before each of them lie the `order` last ones in use of the same run, (m, order), ascending; 0 in
    place of those that lie farther back than `reach`."""
    places, found = [np.zeros(0, int)], [np.zeros((0, order), int)]
    for run in runs:
        at = run.start + np.flatnonzero(valid[run])
        lags = np.zeros((len(at), order), int)
        for k in range(1, order + 1):
            lags[k:, k - 1] = at[k:] - at[:-k]
        places.append(at)
        found.append(np.where(lags <= reach, lags, 0))
    return np.concatenate(places), np.concatenate(found)


def _predictor(lags: Array, gamma: Array, predictors: list[tuple[Array, float]]) -> tuple[Array, float]:
    """The best prediction-error filter on rows at lags (k,), ascending: coefficients (k+1,), the row's own first, and its variance."""
    k = len(lags)
    if not k or lags[-1] == k:
        return predictors[k]
    weights = np.linalg.solve(gamma[np.abs(lags[:, None] - lags)], gamma[lags])
    # Nothing foretells better than the whole past does.
    return np.append(1.0, -weights), max(float(gamma[0] - weights @ gamma[lags]), predictors[-1][1])


def _autocovariances(predictors: list[tuple[Array, float]]) -> Array:
    """Autocovariances of the process at lags 0 … `_FARTHEST`: the recursion of its filters backwards, and on."""
    order = len(predictors) - 1
    gamma = np.zeros(_FARTHEST + 1)
    gamma[0] = predictors[0][1]
    for k in range(1, _FARTHEST + 1):
        a, variance = predictors[min(k - 1, order)]
        told = -a[1:] @ gamma[k - 1 : k - len(a) : -1] if len(a) > 1 else 0.0
        gamma[k] = told - (predictors[k][0][-1] * variance if k <= order else 0.0)
    return gamma


def _reach(gamma: Array, order: int) -> int:
    """The farthest lag at which rows are still alike."""
    return max(order, int(np.flatnonzero(np.abs(gamma) >= _FORGOTTEN * gamma[0])[-1]))


def unwhitened_rows(white: Whitener, rows: Array, joint: int, valid: Array) -> Array:
    """Undo whitening: the matrix is lower triangular on the rows in use."""
    from scipy.sparse.linalg import spsolve_triangular

    out = np.zeros(len(rows))
    at = np.flatnonzero(valid)
    if len(at):
        lower = white.matrices[joint].tocsr()[at][:, at]
        out[at] = spsolve_triangular(lower.tocsr(), rows[at], lower=True)
    return out
