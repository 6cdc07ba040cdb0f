"""The frame of a diagnosis: a model's whitened rows, reduced block by block, so that any candidate is refitted in full at once.

Every candidate is judged by the exact least-squares refit of the whole model with its columns added, and by the error that
this refit makes on blocks of time that it did not see (cross-validation). Only cross-products with the candidate's columns
are needed for that: the model's own are kept per block. Losses are sums of squares of whitened residuals, so that noise of
any colour counts for what it is worth."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...errors import DataError
from .whitening import Whitener

if TYPE_CHECKING:
    from ...problem.problem import Problem

Array = np.ndarray
#: Blocks of time: enough for a standard error, long enough to hold several correlation times.
_BLOCKS = 40
_FOLDS = 8
#: Directions of the model that the data show less than this (relative) are left out of every refit.
_RANK = 1e-8
_NOTHING = 1e-250


@dataclass(frozen=True, eq=False)
class Frame:
    """A model's rows, whitened and orthonormalised.

    `problem`; `white`: the noise's whitener; `columns` (n, M, b) and `torque` (n, M): whitened, zero in rows that are not
    used; `transform` (k_base, b): base parameters = transform @ coefficients of `columns`; `block_rows`: the rows of each block;
    `folds` (blocks,): the fold of each block."""

    problem: Problem
    white: Whitener
    columns: Array
    torque: Array
    transform: Array
    block_rows: tuple[slice, ...]
    folds: Array

    @classmethod
    def build(cls, problem: Problem, white: Whitener, raw: Array | None = None) -> Frame:
        """Gather all rows of a problem; `raw` (M, n, k_base), if they are at hand. Raises DataError where there are too few."""
        signals = problem.signals
        raw = raw_columns(problem) if raw is None else raw
        used = int(signals.valid.sum())
        if used < 4 * raw.shape[2]:
            raise DataError(f"only {used} usable rows for {raw.shape[2]} parameters: too few to hold any out for a diagnosis.")
        n = raw.shape[1]
        columns = np.stack([white(raw[:, j], j) for j in range(n)])
        tau = np.where(signals.valid, signals.tau, 0.0)
        torque = np.stack([white(tau[:, j], j) for j in range(n)])
        R = np.linalg.qr(columns.reshape(-1, columns.shape[2]), mode="r")
        # A column of nothing (a step after the end of a log) has no part in anything.
        scale = np.linalg.norm(R, axis=0)
        scale = np.where(scale > 1e-12 * scale.max(initial=0.0), scale, np.inf)
        _, s, Vt = np.linalg.svd(R / scale)
        live = s > _RANK * s[0]
        transform = (Vt[live].T / s[live]) / scale[:, None]
        block_rows, folds = _blocks(signals.row_runs)
        return cls(problem, white, columns @ transform, torque, transform, block_rows, folds)

    @property
    def n_blocks(self) -> int:
        return len(self.folds)

    @cached_property
    def _wide(self) -> Array:
        """[columns torque], (n, M, b+1)."""
        return np.concatenate([self.columns, self.torque[:, :, None]], axis=2)

    @cached_property
    def gram(self) -> Array:
        """[columns torque]ᵀ [columns torque] per block, (blocks, b+1, b+1)."""
        out = np.empty((self.n_blocks, self._wide.shape[2], self._wide.shape[2]))
        for i, rows in enumerate(self.block_rows):
            part = self._wide[:, rows].reshape(-1, out.shape[2])
            out[i] = part.T @ part
        return out

    @cached_property
    def coefficients(self) -> Array:
        """Least-squares coefficients (b,) of the columns."""
        G, b = self.gram.sum(axis=0), self.columns.shape[2]
        return _solve(G[:b, :b], G[:b, b])

    @cached_property
    def residual(self) -> Array:
        """Whitened residual (n, M) of the model alone."""
        return self.torque - self.columns @ self.coefficients

    @property
    def base_values(self) -> Array:
        """Base parameters (k_base,) of the fit."""
        return self.transform @ self.coefficients

    @cached_property
    def loss(self) -> float:
        """Sum of squares of the whitened residual."""
        return float(np.sum(self.residual**2))

    def whitened(self, columns: Array) -> Array:
        """Columns (M, n, k) on the measured side → (n, M, k); rows that are not used come out as zero."""
        valid = self.problem.signals.valid
        out = np.zeros((columns.shape[1], columns.shape[0], columns.shape[2]))
        for j in acting_on(columns):
            out[j] = self.white(np.where(valid[:, j, None], columns[:, j], 0.0), j)
        return out

    def products(self, Z: Array) -> Products:
        """Cross-products of whitened candidate columns (n, M, k) with the model's and their own, per block."""
        joints = live_joints(Z)
        k, width = Z.shape[2], self._wide.shape[2]
        cross, own = np.zeros((self.n_blocks, k, width)), np.zeros((self.n_blocks, k, k))
        for j in joints:
            z, x = Z[j], self._wide[j]
            for i, rows in enumerate(self.block_rows):
                part = z[rows].T
                cross[i] += part @ x[rows]
                own[i] += part @ z[rows]
        return Products(cross, own)

    def score(self, Z: Array) -> Score:
        """Refit the whole model with whitened candidate columns (n, M, k), in full and with each fold held out."""
        return self.score_products(self.products(Z))

    def score_products(self, p: Products) -> Score:
        """`score` from the cross-products."""
        b = self.columns.shape[2]
        gain = np.empty(self.n_blocks)
        for fold in range(self.n_folds):
            test = self.folds == fold
            theta, z = self._refit(~test, p)
            gain[test] = self._fold_losses[fold][test] - _losses(self.gram[test], p.cross[test], p.own[test], theta, z)
        theta, z = self._refit(np.ones(self.n_blocks, bool), p)
        total = float(_losses(self.gram, p.cross, p.own, theta, z).sum())
        return Score(gain, self.loss - total, z, -theta[:b])

    def fit_gain(self, Z: Array, values: Array | None = None) -> float:
        """Fall of the loss when candidate columns (n, M, k) are added, nothing held out: cheap, for searching shapes. `values` (k,): what
        their parameters are held at, the model's being refitted beside them."""
        return float(self.fit_gains(Z, Z.shape[2], [values])[0][0])

    def fit_gains(self, Z: Array, k: int, values: Sequence[Array | None]) -> tuple[Array, Array]:
        """`fit_gain` of c candidates of k columns each, side by side in Z (n, M, c k), with each one's `values`; and what they would gain
        with free parameters; (c,) each."""
        count = len(values)
        joints = live_joints(Z)
        if not len(joints):
            return np.zeros(count), np.zeros(count)
        X, z = self.columns[joints].reshape(-1, self.columns.shape[2]), Z[joints].reshape(-1, Z.shape[2])
        cross = X.T @ z
        along = self.inverse_gram @ cross
        right = z.T @ self.residual[joints].reshape(-1)
        gains, free = np.empty(count), np.empty(count)
        for i, at in enumerate(values):
            part = slice(i * k, (i + 1) * k)
            own = z[:, part].T @ z[:, part]
            size, own = np.diag(own), own - cross[:, part].T @ along[:, part]
            free[i] = right[part] @ _solve(own, right[part], size)
            gains[i] = free[i] if at is None else 2.0 * right[part] @ at - at @ own @ at
        return gains, free

    @cached_property
    def inverse_gram(self) -> Array:
        """Inverse of the columns' own cross-products (b, b): the covariance of their coefficients in units of the whitened noise."""
        G, b = self.gram.sum(axis=0), self.columns.shape[2]
        return np.linalg.pinv(G[:b, :b], hermitian=True)

    @property
    def n_folds(self) -> int:
        return int(self.folds.max()) + 1

    @cached_property
    def _fold_losses(self) -> Array:
        """Loss of the model on every block, fitted with one fold held out, (folds, blocks)."""
        return np.stack([self._block_losses(self.folds != fold) for fold in range(self.n_folds)])

    @cached_property
    def heldout_loss(self) -> Array:
        """Cross-validated loss of the model per block, (blocks,)."""
        return self._fold_losses[self.folds, np.arange(self.n_blocks)]

    def _block_losses(self, use: Array) -> Array:
        b = self.columns.shape[2]
        G = self.gram[use].sum(axis=0)
        theta = np.append(-_solve(G[:b, :b], G[:b, b]), 1.0)
        return np.einsum("i,bij,j->b", theta, self.gram, theta)

    def _refit(self, use: Array, p: Products) -> tuple[Array, Array]:
        b, k = self.columns.shape[2], p.own.shape[1]
        G, C, D = self.gram[use].sum(axis=0), p.cross[use].sum(axis=0), p.own[use].sum(axis=0)
        A = np.empty((b + k, b + k))
        A[:b, :b], A[b:, :b], A[:b, b:], A[b:, b:] = G[:b, :b], C[:, :b], C[:, :b].T, D
        found = _solve(A, np.append(G[:b, b], C[:, b]))
        return np.append(-found[:b], 1.0), found[b:]


@dataclass(frozen=True, eq=False)
class Products:
    """Candidate columns' cross-products per block: `cross` (blocks, k, b+1) with the model's columns and torque, `own` (blocks, k, k)."""

    cross: Array
    own: Array


@dataclass(frozen=True, eq=False)
class Score:
    """`gain` (blocks,): fall of the held-out loss per block; `fit_gain`: fall of the loss when nothing is held out;
    `values` (k,): the candidate's parameters; `model` (b,): coefficients of the frame's columns beside it."""

    gain: Array
    fit_gain: float
    values: Array
    model: Array

    @property
    def heldout(self) -> float:
        """Total held-out gain (twice a log-likelihood)."""
        return float(self.gain.sum())

    @property
    def standard_error(self) -> float:
        """Standard error of `heldout` over the blocks."""
        return float(np.sqrt(len(self.gain)) * self.gain.std(ddof=1)) if len(self.gain) > 1 else float("inf")


def live_joints(Z: Array) -> Array:
    """Joints on whose rows whitened columns (n, M, k) are anything."""
    return np.flatnonzero([bool((z != 0.0).any()) for z in Z])


def acting_on(columns: Array) -> list[int]:
    """Joints on whose rows columns (rows, n, k) are anything."""
    return np.flatnonzero((columns != 0.0).any(axis=0).any(axis=1)).tolist()


def raw_columns(problem: Problem) -> Array:
    """Base columns (M, n, k_base) of a problem, zero in rows that are not used."""
    signals = problem.signals
    out = np.zeros((*signals.tau.shape, problem.base.count))
    for rows in problem.rows():
        out[rows.place] = np.where(rows.valid[:, :, None], rows.columns, 0.0)
    return out


def _losses(gram: Array, cross: Array, own: Array, theta: Array, z: Array) -> Array:
    model = np.einsum("i,bij,j->b", theta, gram, theta)
    return model - 2.0 * np.einsum("k,bki,i->b", z, cross, theta) + np.einsum("k,bkl,l->b", z, own, z)


def _solve(A: Array, y: Array, size: Array | None = None) -> Array:
    """Solve a scaled symmetric positive semidefinite system; directions below 1e-9 of `size` (default: the diagonal) are left at zero."""
    size = np.diag(A) if size is None else size
    scale = np.where(size > _NOTHING, 1.0 / np.sqrt(np.maximum(size, _NOTHING)), 0.0)
    A = A * scale[:, None] * scale
    try:
        L = np.linalg.cholesky(A)
        if float(np.diag(L).min(initial=1.0)) > 1e-4:
            return scale * np.linalg.solve(L.T, np.linalg.solve(L, scale * y))
    except np.linalg.LinAlgError:
        pass
    values, vectors = np.linalg.eigh(A)
    inverse = np.where(values > 1e-9, 1.0 / np.maximum(values, 1e-300), 0.0)
    return scale * (vectors @ (inverse * (vectors.T @ (scale * y))))


def _blocks(runs: Sequence[slice]) -> tuple[tuple[slice, ...], Array]:
    """Cut the runs into about `_BLOCKS` contiguous blocks of rows, dealt to the folds in turn."""
    rows = sum(r.stop - r.start for r in runs)
    length = max(8, -(-rows // _BLOCKS))
    found: list[slice] = []
    for run in runs:
        pieces = max(1, round((run.stop - run.start) / length))
        edges = np.linspace(run.start, run.stop, pieces + 1).astype(int).tolist()
        found += [slice(a, b) for a, b in itertools.pairwise(edges)]
    return tuple(found), np.arange(len(found)) % min(_FOLDS, len(found))
