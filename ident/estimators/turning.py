"""Rows that a reversal reaches: kept where they fit like the others, left out where the joint sticks.

A joint that sticks at a reversal has any friction up to its breakaway for some milliseconds; no velocity tells it, and the rows
around it carry errors of many times the noise (measured on simulated stiction: Coulomb friction off by 6 std). Where friction
merely changes sign, the same rows tell low-speed friction and should stay. The residual decides, joint by joint."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..problem.linear_solution import order_of, solve_triangle
from ..problem.problem import Problem as Plain

if TYPE_CHECKING:
    from ..problem.problem import Problem

#: Variance of the residual in rows that a reversal reaches, over that of the others, beyond which the joint sticks there.
_STICKS = 9.0
_FEWEST = 10


def without_sticking(problem: Problem) -> tuple[Problem, tuple[str, ...]]:
    """The problem without the rows in which a joint sticks, and these joints."""
    turning = problem.signals.turning
    if type(problem) is not Plain or turning is None or not (turning & problem.valid).any():
        return problem, ()
    information = problem.information
    weights = np.where(information.counts > 0, information.counts / np.maximum(information.torque_squares(), 1e-300), 0.0)
    solution = solve_triangle(*information.combined(weights)[:2], order_of(problem.base))
    values = np.zeros(problem.base.count)
    values[solution.columns] = solution.values
    squares = problem.residual(values) ** 2
    joints = []
    for j, name in enumerate(problem.model.robot.joint_names):
        near, far = problem.valid[:, j] & turning[:, j], problem.valid[:, j] & ~turning[:, j]
        if near.sum() < _FEWEST or far.sum() < max(_FEWEST, 0.3 * problem.valid[:, j].sum()):
            continue
        if squares[near, j].mean() > _STICKS * squares[far, j].mean():
            joints.append(name)
    if not joints:
        return problem, ()
    return replace(problem, signals=problem.signals.without_turning(joints)), tuple(joints)
