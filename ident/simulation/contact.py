"""Dry friction at rest: which contacts hold and which break loose, as a box-constrained linear complementarity problem."""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def resolve(W: Array, b: Array) -> tuple[Array, Array]:
    """Friction levels s (p,) in [-1, 1] with z = b - W s, z_i > 0 only where s_i = 1 and z_i < 0 only where s_i = -1; and which
    contacts break loose (p,), as 1 or -1, 0 for those that hold.

    `z` are the accelerations of p contacts at rest, `W` (p, p) what one unit of friction level takes from them. Block
    principal pivoting with Murty's least-index rule where blocks cycle (Júdice & Pires, 1994): finite for P-matrices, which
    a positive definite inertia with friction along the contacts' own directions gives."""
    driving = np.diag(W) <= 0
    if driving.any():
        # Friction that feeds power in (parameters that are not physical) holds nothing: such a contact goes where it is pulled.
        s, side = np.where(b < 0, -1.0, 1.0), np.where(b < 0, -1, 1)
        rest = np.flatnonzero(~driving)
        s[rest], side[rest] = _pivot(W[np.ix_(rest, rest)], b[rest] - W[np.ix_(rest, np.flatnonzero(driving))] @ s[driving])
        return s, side
    return _pivot(W, b)


def _pivot(W: Array, b: Array) -> tuple[Array, Array]:
    p = len(b)
    W = W + 1e-13 * np.abs(W).max(initial=1e-300) * np.eye(p)  # parallel contacts share their load
    tolerance = 1e-12 * max(float(np.abs(b).max(initial=0.0)), 1e-300)
    side = np.zeros(p, dtype=int)  # 0: held, ±1: sliding
    best, patience = p + 1, 10
    for _ in range(60 + 20 * p):
        s = side.astype(float)
        held = side == 0
        if held.any():
            s[held] = np.linalg.solve(W[np.ix_(held, held)], b[held] - W[np.ix_(held, ~held)] @ s[~held])
        z = b - W @ s
        wrong = (held & (np.abs(s) > 1 + 1e-12)) | (~held & (side * z < -tolerance))
        count = int(wrong.sum())
        if count == 0:
            return np.clip(s, -1.0, 1.0), side
        if count < best:
            best, patience = count, 10
        else:
            patience -= 1
        change = wrong if patience > 0 else np.arange(p) == np.flatnonzero(wrong)[0]
        side = np.where(change, np.where(held, np.sign(s), 0), side).astype(int)
    # Not a P-matrix (an impossible inertia): the nearest admissible answer by projected Gauss-Seidel.
    s = np.zeros(p)
    diagonal = np.where(np.diag(W) > 0, np.diag(W), np.inf)
    for _ in range(200):
        for i in range(p):
            s[i] = np.clip(s[i] + (b[i] - W[i] @ s) / diagonal[i], -1.0, 1.0)
    return s, np.where(np.abs(s) == 1.0, s, 0.0).astype(int)
