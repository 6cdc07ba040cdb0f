"""The frame of a diagnosis: the declared model's rows, reduced block by block so that any candidate is refitted in full at once.

Every candidate is judged by the exact least-squares refit of the whole model with its columns added, on part of the blocks, and
by the error that this refit makes on the other blocks (cross-validation). Only cross-products with the candidate's columns are
needed for that: the model's own are kept per block of time. Losses are in units of the noise variance per *effective* sample
(the residual's correlation time), so that coloured noise does not pass as evidence."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..effect import Effect
from ..errors import DataError

if TYPE_CHECKING:
    from ..problem import Problem

Array = np.ndarray
#: Blocks of time; enough for a standard error, long enough to hold several correlation times.
_BLOCKS = 40
_FOLDS = 5


@dataclass(frozen=True, eq=False)
class Frame:
    """A model's weighted, orthonormalised rows.

    `problem`; `columns` (M, n, b): orthonormalised base columns, zero in rows that are not used; `torque` (M, n), zero there
    too; `transform` (b, b): base parameters = transform @ coefficients of `columns`; `weights` (n,): 1 / (noise variance ×
    correlation time in rows); `block` (M,): the block of each row; `folds` (blocks,): the fold of each block."""

    problem: Problem
    columns: Array
    torque: Array
    transform: Array
    weights: Array
    block: Array
    folds: Array

    @classmethod
    def build(cls, problem: Problem, variance: Array, correlation_time: Array) -> Frame:
        """Gather all rows of a problem. `variance` and `correlation_time` (n,) are those of the residual's noise floor.

        Raises DataError where too few rows are left to hold any out."""
        signals = problem.signals
        M, n = signals.tau.shape
        columns = np.zeros((M, n, problem.base.count))
        for rows in problem.rows():
            columns[rows.place] = np.where(rows.valid[:, :, None], rows.columns, 0.0)
        torque = np.where(signals.valid, signals.tau, 0.0)
        used = signals.valid.sum(axis=0)
        if used.sum() < 4 * problem.base.count:
            raise DataError(f"only {int(used.sum())} usable rows for {problem.base.count} parameters: too few to hold any out for a diagnosis.")
        weights = np.where(used > 0, 1.0 / np.maximum(variance * correlation_time, 1e-300), 0.0)
        R = np.linalg.qr((columns * np.sqrt(weights)[:, None]).reshape(-1, columns.shape[2]), mode="r")
        # Directions that the data do not show are left out: they would make every refit arbitrary.
        U, s, Vt = np.linalg.svd(R / np.maximum(np.linalg.norm(R, axis=0), 1e-300))
        live = s > 1e-9 * s[0]
        scale = np.maximum(np.linalg.norm(R, axis=0), 1e-300)
        transform = (Vt[live].T / s[live]) / scale[:, None]
        block, folds = _blocks(signals.row_runs, M)
        return cls(problem, columns @ transform, torque, transform, weights, block, folds)

    @property
    def n_blocks(self) -> int:
        return len(self.folds)

    @cached_property
    def gram(self) -> Array:
        """[columns torque]ᵀ W [columns torque] per block, (blocks, b+1, b+1)."""
        full = np.concatenate([self.columns, self.torque[:, :, None]], axis=2)
        out = np.empty((self.n_blocks, full.shape[2], full.shape[2]))
        for i, rows in enumerate(self.block_rows):
            part = (full[rows] * np.sqrt(self.weights)[:, None]).reshape(-1, full.shape[2])
            out[i] = part.T @ part
        return out

    @cached_property
    def block_rows(self) -> tuple[slice, ...]:
        """Rows of each block (contiguous)."""
        edges = np.flatnonzero(np.diff(self.block, prepend=-1, append=self.n_blocks))
        return tuple(slice(int(a), int(b)) for a, b in zip(edges[:-1], edges[1:], strict=True))

    def effect_columns(self, effect: Effect) -> Array:
        """Columns (M, n, k) of an effect on the measured side, filtered like the torque, zero in rows that are not used."""
        problem, robot = self.problem, self.problem.model.robot
        measured = robot.transmission.measured
        parts = []
        for block in problem.signals.blocks(None):
            values = effect.columns(problem.motion(block.samples, effect.needs), robot)
            if effect.side != measured:
                values = np.matmul(robot.transmission.torque_map(effect.side, measured), values)
            parts.append(block.reduce(values))
        return np.where(problem.signals.valid[:, :, None], np.concatenate(parts), 0.0)

    def score(self, candidate: Array) -> Score:
        """Refit the whole model with a candidate's columns (M, n, k), in full and with each fold held out."""
        Z = candidate * self.weights[:, None]
        k = candidate.shape[2]
        joints = np.flatnonzero(np.any(candidate, axis=(0, 2)))
        full = np.concatenate([self.columns, self.torque[:, :, None]], axis=2)
        cross = np.empty((self.n_blocks, k, full.shape[2]))
        own = np.empty((self.n_blocks, k, k))
        for i, rows in enumerate(self.block_rows):
            z, x = Z[rows][:, joints].reshape(-1, k), full[rows][:, joints].reshape(-1, full.shape[2])
            cross[i] = z.T @ x
            own[i] = z.T @ candidate[rows][:, joints].reshape(-1, k)
        return self._score(cross, own)

    def _score(self, cross: Array, own: Array) -> Score:
        b = self.columns.shape[2]
        gain = np.empty(self.n_blocks)
        for fold in range(int(self.folds.max()) + 1):
            test = self.folds == fold
            coefficients = self._refit(~test, cross, own)
            for i in np.flatnonzero(test):
                gain[i] = self.loss_without(fold)[i] - _loss(self.gram[i], cross[i], own[i], coefficients, b)
        every = np.ones(self.n_blocks, bool)
        coefficients = self._refit(every, cross, own)
        total = sum(_loss(self.gram[i], cross[i], own[i], coefficients, b) for i in range(self.n_blocks))
        without = float(np.sum(self._losses(every)))
        return Score(gain, without - float(total), coefficients[b:], coefficients[:b])

    def loss_without(self, fold: int) -> Array:
        """Loss of the model without any candidate on every block, fitted with one fold held out, (blocks,)."""
        return self._fold_losses[fold]

    @cached_property
    def _fold_losses(self) -> Array:
        return np.stack([self._losses(self.folds != fold) for fold in range(int(self.folds.max()) + 1)])

    @cached_property
    def heldout_loss(self) -> Array:
        """Cross-validated loss of the model without any candidate per block, (blocks,)."""
        return self._fold_losses[self.folds, np.arange(self.n_blocks)]

    def _losses(self, use: Array) -> Array:
        b = self.columns.shape[2]
        G = self.gram[use].sum(axis=0)
        theta = np.append(-_solve(G[:b, :b], G[:b, b]), 1.0)
        return np.einsum("i,bij,j->b", theta, self.gram, theta)

    def _refit(self, use: Array, cross: Array, own: Array) -> Array:
        b = self.columns.shape[2]
        k = own.shape[1]
        G, C, D = self.gram[use].sum(axis=0), cross[use].sum(axis=0), own[use].sum(axis=0)
        A = np.empty((b + k, b + k))
        A[:b, :b], A[b:, :b], A[:b, b:], A[b:, b:] = G[:b, :b], C[:, :b], C[:, :b].T, D
        return _solve(A, np.append(G[:b, b], C[:, b]))


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
        """Total held-out gain, in noise variances per effective sample."""
        return float(self.gain.sum())

    @property
    def standard_error(self) -> float:
        """Standard error of `heldout` over the blocks."""
        return float(np.sqrt(len(self.gain)) * self.gain.std(ddof=1)) if len(self.gain) > 1 else float("inf")


def _loss(gram: Array, cross: Array, own: Array, coefficients: Array, b: int) -> float:
    p, z = coefficients[:b], coefficients[b:]
    theta = np.append(-p, 1.0)
    return float(theta @ gram @ theta - 2 * z @ (cross @ theta) + z @ own @ z)


def _solve(A: Array, y: Array) -> Array:
    """Solve a scaled symmetric positive semidefinite system; directions below 1e-11 are left at zero."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
    values, vectors = np.linalg.eigh(A * scale[:, None] * scale)
    inverse = np.where(values > 1e-11 * values[-1], 1.0 / np.maximum(values, 1e-300), 0.0)
    return scale * (vectors @ (inverse * (vectors.T @ (scale * y))))


def _blocks(runs: tuple[slice, ...], rows: int) -> tuple[Array, Array]:
    """Cut the runs into about `_BLOCKS` contiguous blocks, dealt to the folds in turn."""
    length = max(8, -(-rows // _BLOCKS))
    block = np.empty(rows, int)
    count = 0
    for run in runs:
        pieces = max(1, round((run.stop - run.start) / length))
        edges = np.linspace(run.start, run.stop, pieces + 1).astype(int)
        for a, b in zip(edges[:-1], edges[1:], strict=True):
            block[a:b] = count
            count += 1
    return block, np.arange(count) % min(_FOLDS, count)
