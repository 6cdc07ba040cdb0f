"""The noise floor: what is left when everything that any candidate can take up is taken up.

The declared model's residual holds what it lacks, and would make that look like noise. So the model is first saturated,
greedily, with whatever candidates and generic shapes gain most; colour and level of what is then left are the noise's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .frame import Frame, Motions, raw_columns
from .search import Bank
from .whitening import Whitener, whitener

if TYPE_CHECKING:
    from ..problem import Problem
    from .candidates import Candidate

Array = np.ndarray
#: Columns are added while the best one gains more than this (a χ² that chance over the whole catalogue seldom reaches).
_LEAST = 20.0
_MOST = 60


def noise_floor(problem: Problem, motions: Motions, candidates: tuple[Candidate, ...], bank: Bank, generic: list[Array]) -> Whitener:
    """Whitener of the noise of a problem's rows. `generic`: further columns (M, n, k) that saturate the model."""
    signals = problem.signals
    raw = raw_columns(problem)
    plain = Frame.build(problem, _unit(problem), raw)
    residual = _unwhitened(plain)
    white = whitener(residual, signals.valid, signals.row_runs)
    bank.prepare(motions, candidates)
    blocks = [columns for c in candidates for columns in bank.columns(motions, c.variants)] + generic
    for _ in range(2):
        frame = Frame.build(problem, white, raw)
        white = whitener(saturated_residual(frame, blocks), signals.valid, signals.row_runs)
    return white


def saturated_residual(frame: Frame, blocks: list[Array]) -> Array:
    """Residual (M, n), not whitened, of the frame's model with the blocks (M, n, k) that gain most added one after the other."""
    n, M, b = frame.columns.shape
    valid = frame.problem.signals.valid
    Q, _ = np.linalg.qr(frame.columns.reshape(-1, b))
    whitened = [_orthogonal(frame.whitened(block).reshape(n * M, -1), Q) for block in blocks]
    r = frame.residual.reshape(-1).copy()
    kept: list[Array] = []
    for _ in range(_MOST):
        gains = [float(np.sum((q.T @ r) ** 2)) - 2.0 * q.shape[1] if q.shape[1] else 0.0 for q in whitened]
        i = int(np.argmax(gains))
        if gains[i] < _LEAST:
            break
        q = whitened[i]
        for other in kept:
            q = q - other @ (other.T @ q)
        q = _orthogonal(q, np.zeros((len(q), 0)))
        if not q.shape[1]:
            whitened[i] = q
            continue
        r = r - q @ (q.T @ r)
        kept.append(q)
        whitened[i] = np.zeros((len(r), 0))
    colours = r.reshape(n, M)
    return np.where(valid, np.stack([_solve_white(frame.white, colours[j], j, valid[:, j]) for j in range(n)], axis=1), 0.0)


def _orthogonal(Z: Array, Q: Array) -> Array:
    """Orthonormal basis of what is left of columns (rows, k) beside an orthonormal Q."""
    size = np.linalg.norm(Z, axis=0)
    live = size > 0
    if not live.any():
        return np.zeros((len(Z), 0))
    Z = Z[:, live] / size[live]
    Z = Z - Q @ (Q.T @ Z)
    values, vectors = np.linalg.eigh(Z.T @ Z)
    keep = values > 1e-6
    return (Z @ vectors[:, keep]) / np.sqrt(values[keep])


def _unit(problem: Problem) -> Whitener:
    """No colour: each joint's rows over the spread of its torque."""
    from scipy.sparse import diags_array

    valid, tau = problem.signals.valid, problem.signals.tau
    found = []
    std = np.empty(tau.shape[1])
    for j in range(tau.shape[1]):
        use = valid[:, j]
        std[j] = float(np.std(tau[use, j])) if use.sum() > 1 else 1.0
        std[j] = std[j] if std[j] > 0 else 1.0
        found.append(diags_array(np.where(use, 1.0 / std[j], 0.0)).tocsr())
    return Whitener(tuple(found), std)


def _unwhitened(frame: Frame) -> Array:
    valid = frame.problem.signals.valid
    return np.stack([_solve_white(frame.white, frame.residual[j], j, valid[:, j]) for j in range(len(frame.residual))], axis=1)


def _solve_white(white: Whitener, rows: Array, joint: int, valid: Array) -> Array:
    """Undo whitening: the matrix is lower triangular on the rows in use."""
    from scipy.sparse.linalg import spsolve_triangular

    out = np.zeros(len(rows))
    at = np.flatnonzero(valid)
    if len(at):
        lower = white.matrices[joint].tocsr()[at][:, at]
        out[at] = spsolve_triangular(lower.tocsr(), rows[at], lower=True)
    return out
