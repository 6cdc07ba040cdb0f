"""Rows near velocity reversals: kept where they are consistent with the others, left out where they are not.

Near a reversal friction takes any value up to its breakaway, and the direction of a speed is wrong by its own error in time; no velocity
tells it, and the rows around it carry errors of several times the noise, which bias friction and inertia alike
(`benchmarks/diagnosis/intervals.py` counts how often intervals cover the truth). Where friction merely changes sign, the same rows tell
low-speed friction and stay. The residual decides, joint by joint: whether it scatters more there than chance lets it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..estimate.record import ReversalsLeftOut
from ..problem.linear_solution import order_of, solve_triangle
from ..problem.problem import Problem as Plain

if TYPE_CHECKING:
    from ..problem.problem import Problem

Array = np.ndarray

#: Probability with which rows that fit like the others scatter as much more than they.
_LEVEL = 0.01
#: Share of a joint's rows, and rows at least, that must be left.
_LEFT, _FEWEST = 0.3, 10
#: Rows within which a residual may depend on itself.
_LAGS = 30


def without_inconsistent_reversals(problem: Problem) -> tuple[Problem, tuple[ReversalsLeftOut, ...]]:
    """The problem without the rows near reversals of joints where they are not consistent with the others, and what is left out."""
    near_reversal = problem.signals.near_reversal
    if type(problem) is not Plain or near_reversal is None or not (near_reversal & problem.valid).any():
        return problem, ()
    information = problem.information
    weights = np.where(information.counts > 0, information.counts / np.maximum(information.torque_squares(), 1e-300), 0.0)
    solution = solve_triangle(*information.combined(weights)[:2], order_of(problem.base))
    values = np.zeros(problem.base.count)
    values[solution.columns] = solution.values
    residual = problem.residual(values)
    squares = residual**2
    left_out = []
    for j, name in enumerate(problem.model.robot.joint_names):
        near, far = problem.valid[:, j] & near_reversal[:, j], problem.valid[:, j] & ~near_reversal[:, j]
        if not near.any() or far.sum() < max(_FEWEST, _LEFT * problem.valid[:, j].sum()):
            continue
        if squares[near, j].mean() > _by_chance(residual[far, j], int(near.sum())) * squares[far, j].mean():
            left_out.append(ReversalsLeftOut(name, int(near.sum()), int(problem.valid[:, j].sum())))
    if not left_out:
        return problem, ()
    return replace(problem, signals=problem.signals.without_reversals(r.joint for r in left_out)), tuple(left_out)


def _by_chance(residual: Array, rows: int) -> float:
    """Variance of so many rows over that of others with this `residual` (M,), which chance seldom exceeds: an F quantile, each side counted
    as the independent rows that it is worth (Bartlett's sum of squared autocorrelations)."""
    from scipy.special import fdtri

    x = residual - residual.mean()
    power = float(x @ x)
    lags = range(1, min(_LAGS, len(x) - 1))
    correlated = 1.0 + 2.0 * sum((float(x[k:] @ x[:-k]) / power) ** 2 for k in lags) if power > 0 else 1.0
    return float(fdtri(max(rows / correlated, 1.0), max(len(x) / correlated, 1.0), 1.0 - _LEVEL))
