"""What an estimate foretells on held-out data, as far as its parameters are known.

Two models are compared by what is left of data that neither was fitted to. How much that differs from block to block of time tells what
the noise of those data does to it. It does not tell what the noise of the fitted data did: the parameters are the same in every block, and
one that the fitted motion hardly shows, and the other motion does, puts its error into all of them. So each model may move its parameters
as far as the fitted data let it, and pays for that: what is compared is the probability that the model, fitted as it was, gives to the
held-out data (posterior predictive; C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, 2.1)."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .whitening import Whitener

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Foretelling:
    """An estimate on the rows of held-out signals."""

    estimate: Estimate
    signals: Signals = field(repr=False)

    @cached_property
    def residual(self) -> Array:
        """Measured minus foretold torque (M, n), NaN in rows that are not used."""
        return self.estimate.residual(self.signals)

    def allowing(self, weight: Array) -> tuple[Array, float]:
        """What is left (M, n) with the parameters where held-out and fitted data together have them, and its price (twice a
        log-likelihood): −2 log of the probability of the rows is Σ w r² of these residuals and the price, up to what is the same for all
        models. `weight` (n,): inverse squares of each joint's noise.

        For parameters off by δ of covariance P: δ = (P⁻¹ + M)⁻¹ g with g = Σ w Φᵀr, M = Σ w ΦᵀΦ; the price is δᵀP⁻¹δ + log det(I + P M)."""
        gradients, grams = self._moments
        gradient, gram = np.einsum("n,nb->b", weight, gradients), np.einsum("n,nbc->bc", weight, grams)
        root = _root(self.estimate.covariance)
        inner = np.eye(len(gram)) + root.T @ gram @ root
        along = np.linalg.solve(inner, root.T @ gradient)
        price = float(along @ along + np.linalg.slogdet(inner)[1])
        return self._at(self.estimate.values + root @ along), price

    def misfit(self, weight: Array) -> float:
        """Σ w r² of the residuals, less what parameters explain that the fitted data leave open: rᵀ(W⁻¹ + ΦPΦᵀ)⁻¹r, on average the number
        of rows with a weight. `weight` (n,) as for `allowing`; of a single joint where the others' are zero."""
        gradients, grams = self._moments
        root = _root(self.estimate.covariance)
        gradient = root.T @ np.einsum("n,nb->b", weight, gradients)
        inner = np.eye(len(gradient)) + root.T @ np.einsum("n,nbc->bc", weight, grams) @ root
        return float(np.nansum(weight * self.residual**2) - gradient @ np.linalg.solve(inner, gradient))

    def surprise(self, white: Whitener) -> float:
        """−2 log of the probability of the rows under noise of a colour, up to what is the same for all models: `allowing` with what is
        left and its price in one. `white`: the whitener of that noise, on any rows."""
        own, rows = self.estimate.model.base.regroup[:, list(self.estimate.base.independent)], self.signals
        there = white.on(rows.valid, rows.row_runs)
        columns = np.zeros((*rows.tau.shape, own.shape[1]))
        for part in self.estimate.problem_on(rows).rows():
            columns[part.place] = np.where(part.valid[:, :, None], part.columns @ own, 0.0)
        used = np.where(rows.valid, np.nan_to_num(self.residual), 0.0)
        left = np.concatenate([there(used[:, j], j) for j in range(rows.robot.n)])
        phi = np.concatenate([there(columns[:, j], j) for j in range(rows.robot.n)])
        root = _root(self.estimate.covariance)
        inner, along = np.eye(root.shape[1]) + root.T @ (phi.T @ phi) @ root, root.T @ (phi.T @ left)
        return float(left @ left - along @ np.linalg.solve(inner, along) + np.linalg.slogdet(inner)[1])

    def _at(self, values: Array) -> Array:
        """Residuals (M, n) at other values of the estimate's parameters."""
        model = self.estimate.model
        return self.estimate.problem_on(self.signals).residual(model.base.base_values(self.estimate.base.expand(values)))

    @cached_property
    def _moments(self) -> tuple[Array, Array]:
        """Σ Φᵀr (n, b) and Σ ΦᵀΦ (n, b, b) of each joint's rows, over the parameters that were estimated."""
        estimate = self.estimate
        own = estimate.model.base.regroup[:, list(estimate.base.independent)]
        used = np.isfinite(self.residual)
        residual = np.where(used, self.residual, 0.0)
        n, count = residual.shape[1], own.shape[1]
        gradients, grams = np.zeros((n, count)), np.zeros((n, count, count))
        for rows in estimate.problem_on(self.signals).rows():
            for j in range(n):
                columns = rows.columns[:, j] @ own * used[rows.place, j][:, None]
                gradients[j] += columns.T @ residual[rows.place, j]
                grams[j] += columns.T @ columns
        return gradients, grams


def _root(covariance: Array) -> Array:
    """A matrix whose product with its transpose is a covariance."""
    size, axes = np.linalg.eigh(covariance)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)))
