"""The frame of monitoring: new rows beside what is known of the parameters from an earlier fit.

What is known enters like rows of its own: the earlier estimate with its covariance, so that its doubt counts in full. Changes are
then scored as a diagnosis scores effects: by the exact refit of everything with them, also on blocks that the refit did not see."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..errors import DataError
from .stages.frame import Frame, Products, Score, raw_columns
from .stages.whitening import Whitener, predictors_of

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem
    from ..signals.signals import Signals

Array = np.ndarray
#: Directions of which neither the earlier fit nor the new rows tell anything are left out below this (relative).
_RANK = 1e-10
#: Fold of what is known before: in every training set, in no test set.
_KNOWN = -1
#: Rows over which the noise's own response is followed; lags of its autocovariance; share of white noise in it.
_MEMORY, _LAGS, _TRACE = 4000, 12, 1e-3


@dataclass(frozen=True, eq=False)
class KnownFrame(Frame):
    """A frame whose last block is what is known before. `known` (b+1, b+1): its cross-products with coefficients and their target.

    `own`: how many of the columns are the model's; accepted changes follow."""

    known: Array
    own: int

    @classmethod
    def of(cls, problem: Problem, white: Whitener, estimate: Estimate, raw: Array | None = None) -> KnownFrame:
        """New rows of a problem beside an estimate of the same model. Raises DataError where there are too few rows."""
        raw = raw_columns(problem) if raw is None else raw
        target, rows = knowledge(problem, estimate)
        # The blocks and folds are those of any frame.
        plain = Frame.build(problem, white, raw) if problem.signals.valid.sum() >= 4 * raw.shape[2] else None
        if plain is None:
            used = int(problem.signals.valid.sum())
            raise DataError(
                f"only {used} usable rows for {raw.shape[2]} parameters: too few to tell a change from chance; give a longer log."
            )
        n = raw.shape[1]
        columns = np.stack([white(raw[:, j], j) for j in range(n)])
        stacked = np.concatenate([columns.reshape(-1, raw.shape[2]), rows])
        scale = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
        _, s, Vt = np.linalg.svd(np.linalg.qr(stacked / scale, mode="r"))
        live = s > _RANK * s[0]
        transform = (Vt[live].T / s[live]) / scale[:, None]
        wide = np.concatenate([rows @ transform, target[:, None]], axis=1)
        block_rows = (*plain.block_rows, slice(raw.shape[0], raw.shape[0]))
        folds = np.append(plain.folds, _KNOWN)
        return cls(problem, white, columns @ transform, plain.torque, transform, block_rows, folds, wide.T @ wide, int(live.sum()))

    def beside(self, Z: Array) -> KnownFrame:
        """The same with whitened columns (n, M, k) of an accepted change, of which nothing is known before."""
        b, k = self.columns.shape[2], Z.shape[2]
        known = np.zeros((b + k + 1, b + k + 1))
        at = np.r_[:b, b + k]
        known[np.ix_(at, at)] = self.known
        transform = np.concatenate([self.transform, np.zeros((len(self.transform), k))], axis=1)
        return replace(self, columns=np.concatenate([self.columns, Z], axis=2), transform=transform, known=known)

    @cached_property
    def gram(self) -> Array:
        """Cross-products per block, the last one of what is known before."""
        width = self.columns.shape[2] + 1
        out = np.empty((len(self.folds), width, width))
        for i, rows in enumerate(self.block_rows):
            part = np.concatenate([self.columns[:, rows], self.torque[:, rows, None]], axis=2).reshape(-1, width)
            out[i] = part.T @ part
        out[-1] = self.known
        return out

    @cached_property
    def loss(self) -> float:
        """Sum of squares of the whitened residual and of the distance from what is known before."""
        theta = np.append(-self.coefficients, 1.0)
        return float(theta @ self.gram.sum(axis=0) @ theta)

    def score_products(self, p: Products) -> Score:
        """As of any frame; what is known before is never held out."""
        score = super().score_products(p)
        return replace(score, gain=np.where(self.folds == _KNOWN, 0.0, score.gain))

    @cached_property
    def covariance(self) -> Array:
        """Covariance (b, b) of all coefficients, accepted changes included."""
        return self.inverse_gram

    def changes(self) -> tuple[Array, Array]:
        """Coefficients of the accepted changes and their covariance."""
        return self.coefficients[self.own :], self.covariance[self.own :, self.own :]

    def freedom(self, joints: Array) -> int:
        """Degrees of freedom that the noise of some joints' rows (n,) bool is known with: half of what the parameters leave, for its
        colour is fitted too."""
        rows = self.problem.signals.valid.sum(axis=0)
        left = 1.0 - self.columns.shape[2] / max(int(rows.sum()), 1)
        return max(4, int(0.5 * left * rows[joints].sum()))

    def freed(self) -> tuple[float, Array]:
        """What is gained when nothing is known before and all parameters are free: the fall of the loss, and the gain on each of
        the blocks (blocks,) when they are held out."""
        free, _ = self._free(np.ones(self.n_blocks, bool))
        gain = np.zeros(self.n_blocks)
        for fold in range(self.n_folds):
            test = self.folds == fold
            losses = self._free(~test)[1]
            gain[test] = (self._fold_losses[fold] - losses)[test]
        return self.loss - float(free), gain

    def _free(self, use: Array) -> tuple[Array, Array]:
        """Total loss on the new rows and loss of each block, all parameters fitted to the blocks in `use` alone."""
        G, b = self.gram[:-1][use[:-1]].sum(axis=0), self.columns.shape[2]
        theta = np.append(-np.linalg.pinv(G[:b, :b], rcond=1e-10, hermitian=True) @ G[:b, b], 1.0)
        losses = np.einsum("i,bij,j->b", theta, self.gram, theta)
        return losses[:-1].sum(), losses


def knowledge(problem: Problem, estimate: Estimate) -> tuple[Array, Array]:
    """What an estimate tells of a problem's base parameters p, as rows of unit variance: `(y, A)` with y = A p + noise.

    The estimate's own base parameters may be groups of the structure's, where its logs could not tell them apart: the rest is
    not known."""
    groups = estimate.base.regroup[:, problem.base.independent]
    values, vectors = np.linalg.eigh(_scaled(estimate.covariance, estimate.std))
    std = np.where(estimate.std > 0, estimate.std, 1e-12)
    # A variance that rounding has made zero or negative must not turn into certainty.
    half = (vectors / np.sqrt(np.maximum(values, 1e-9))).T / std
    return half @ estimate.values, half @ groups


def _scaled(covariance: Array, std: Array) -> Array:
    safe = np.where(std > 0, std, 1.0)
    return covariance / safe[:, None] / safe


def noise_of(estimate: Estimate, signals: Signals) -> Whitener:
    """Whitener of new rows (prepared like the fit's) by the noise that the fit left: its level and its colour.

    The fit had many rows and no change in them; the new rows' own residual would count a change as noise, or, all parameters
    freed, take noise for parameters."""
    from scipy.signal import lfilter

    noise = estimate.noise
    impulse = np.zeros(_MEMORY)
    impulse[0] = 1.0
    predictors, std = [], []
    for j, variance in enumerate(noise.variance):
        response = lfilter([1.0], noise.ar[j], impulse)
        shape = np.array([response[: len(response) - lag] @ response[lag:] for lag in range(_LAGS + 1)])
        level = float(variance) if variance > 0 else 1.0
        # A trace of white noise: rows behind a filter are never predicted as exactly as the model of their colour has it.
        gamma = level * shape / shape[0] * np.r_[1.0 + _TRACE, np.ones(_LAGS)]
        predictors.append(predictors_of(gamma, estimate.samples))
        std.append(np.sqrt(level))
    return Whitener((), np.array(std), tuple(predictors)).on(signals.valid, signals.row_runs)
