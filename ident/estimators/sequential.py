"""Step by step: one test after another, from the tip to the base, each with what those before it have found (Yoshida 1995)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from .._utils.singular_values import condition, svd
from ..errors import ConfigurationError, DataError, UnsupportedError, unknown_name
from ..planning.plan import read_plan
from ..problem.information import triangle
from ..problem.linear_solution import LinearSolution, order_of, solve_triangle
from ..problem.problem import Problem as Plain
from .base import Capability, Estimator, register
from .finish import finish
from .step_report import steps_text, told
from .step_rows import StepRows, check_joints, check_plan, planned_rows, unplanned_rows

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..planning.sequence import Plan
    from ..problem.problem import Problem
    from ..robots.robot import Robot

Array = np.ndarray
_CARRY = ("update", "hold")
#: Singular values below this share of a test's largest are round-off.
_RANK = 1e-9


@register
@dataclass(frozen=True, kw_only=True)
class StepByStep(Estimator):
    """Sequential identification from static, constant-velocity and accelerated tests of one or two joints.

    `plan`: the plan that the logs follow, or the path of its manifest (`ident plan`); the signals' runs carry the names of
    its logs. Without one, every run is a test and all torques are read. All tests are used in integrated form, without
    acceleration. `carry`: "update": every test brings all its information, and later tests refine earlier values; "hold":
    values once found stand, with their covariance, as in the original method. `defer`: with "hold", a direction whose singular
    value is below this share of the test's largest waits for a later test instead of being fixed by a weak one.

    Examples
    --------
    >>> import ident
    >>> method = ident.estimators.StepByStep(carry="hold")
    >>> sorted(capability.value for capability in method.capabilities)
    ['weights']
    """

    name: ClassVar[str] = "sequential"
    title: ClassVar[str] = "step by step"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.WEIGHTS})
    files: ClassVar[frozenset[str]] = frozenset({"plan"})
    whole_logs: ClassVar[bool] = True

    plan: Plan | str | None = None
    carry: str = "update"
    defer: float = 0.01

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.carry not in _CARRY:
            raise unknown_name("way to carry values in method 'sequential'", self.carry, _CARRY)
        if not 0 <= self.defer < 1:
            raise ConfigurationError(f"method 'sequential': defer is a share of the largest singular value, in [0, 1), not {self.defer}.")

    def _read(self) -> Plan | None:
        if isinstance(self.plan, str):
            return read_plan(self.plan)
        return self.plan

    def own_logs(self) -> tuple[Path, ...]:
        """The logs that the manifest names, in its folder. Raises DataError for tests whose log is not there."""
        plan = self._read()
        if plan is None or not isinstance(self.plan, str):
            return ()
        files = {test.name: Path(self.plan).parent / test.log for test in plan.tests}
        missing = [f"{name} ({path.name})" for name, path in files.items() if not path.is_file()]
        if missing:
            some = ", ".join(missing[:6]) + (" …" if len(missing) > 6 else "")
            raise DataError(
                f"plan {self.plan}: no log of test {some} in {Path(self.plan).parent}; record it under that name, or name the logs (--log)."
            )
        return tuple(files.values())

    def check_robot(self, robot: Robot) -> None:
        plan = self._read()
        if plan is not None:
            check_joints(robot, plan)

    def check(self, problem: Problem) -> None:
        if type(problem) is not Plain:
            raise UnsupportedError(
                f"method 'sequential' makes windowed rows itself, not from those of {type(problem).__name__}; give it the torque form"
                " (Problem), or use 'wls'."
            )
        plan = self._read()
        if plan is not None:
            check_plan(problem, plan)

    def _solve(self, problem: Problem) -> Estimate:
        plan = self._read()
        steps = list(unplanned_rows(problem) if plan is None else planned_rows(problem, plan))
        advance = self._update if self.carry == "update" else self._hold
        information = problem.information
        variance = information.torque_squares() / np.maximum(information.counts, 1)
        solution, report = advance(problem, steps, variance)
        for _ in range(4):
            variance = _sensor_noise(steps, solution, variance)
            solution, report = advance(problem, steps, variance)
        weights = 1.0 / variance
        found = solution.linear
        trace: dict[str, Any] = {"carry": self.carry, "steps": report, "noise_std": np.sqrt(variance).tolist()}
        trace["text"] = steps_text(report, {p.name: p.unit for p in problem.base.parameters})
        return finish(problem, found, weights, self.name, covariance=solution.covariance, trace=trace)

    def _update(self, problem: Problem, steps: list[StepRows], variance: Array) -> tuple[_Solution, list[dict[str, Any]]]:
        R = np.zeros((problem.base.count + 1,) * 2)
        factors = []
        for step in steps:
            R = triangle(np.concatenate([R, _weighted(step, variance)]))
            factors.append(R)
        solution = solve_triangle(R[:-1, :-1], R[:-1, -1], order_of(problem.base))
        found = _Solution(solution, _covariance(solution), _spread(solution, problem.base.count))
        return found, _growth(steps, factors, found, problem.base.names)

    def _hold(self, problem: Problem, steps: list[StepRows], variance: Array) -> tuple[_Solution, list[dict[str, Any]]]:
        names, b = problem.base.names, problem.base.count
        rows = np.concatenate([_weighted(step, variance) for step in steps])
        scale = np.linalg.norm(rows[:, :-1], axis=0)
        if np.any(scale == 0):
            lost = ", ".join(names[i] for i in np.flatnonzero(scale == 0)[:8])
            raise DataError(f"no test excites what {lost} depend on; add the tests that the plan asks for, or use carry = 'update'.")
        held = _Held(b, scale)
        report = []
        for i, step in enumerate(steps):
            before = held.determined()
            held.learn(_weighted(step, variance), self.defer)
            values, std = held.parameters()
            report.append(told(step, names, np.flatnonzero(held.determined() & ~before), values, std, held.rank))
            if i == len(steps) - 1 and held.rank < b:
                # What was deferred to the end is found from all tests together.
                held.learn(rows, 0.0)
        if held.rank < b:
            lost = ", ".join(np.array(names)[~held.determined()][:8])
            raise DataError(f"the tests leave {lost} undetermined; add the tests that the plan asks for, or use carry = 'update'.")
        values, _ = held.parameters()
        whole = triangle(rows)
        linear = LinearSolution(np.arange(b), np.eye(b), values, whole[:-1, :-1], condition(whole[:-1, :-1] / scale))
        return _Solution(linear, held.covariance(), values), report


@dataclass(frozen=True, eq=False)
class _Solution:
    """The solution with its covariance, and values (b,) of all base parameters (those grouped away zero)."""

    linear: LinearSolution
    covariance: Array
    everywhere: Array


class _Held:
    """Directions that are known, their values and covariance, in scaled parameters x·scale."""

    def __init__(self, b: int, scale: Array) -> None:
        self.scale = scale
        self.basis, self.values, self.spread = np.zeros((b, 0)), np.zeros(0), np.zeros((0, 0))

    @property
    def rank(self) -> int:
        return self.basis.shape[1]

    def learn(self, rows: Array, defer: float) -> None:
        """Rows (m, b+1) of unit variance: fix the directions that they show well enough, given those held."""
        A, y = rows[:, :-1] / self.scale, rows[:, -1]
        known = A @ self.basis
        fresh = A - known @ self.basis.T
        left, s, right = svd(fresh, full_matrices=False)
        size = float(np.linalg.norm(A))
        take = (s > _RANK * size) & (s >= defer * s.max(initial=0.0))
        if not take.any():
            return
        back = left[:, take] / s[take]
        gain = back.T @ known
        new = back.T @ y - gain @ self.values
        corner = back.T @ back + gain @ self.spread @ gain.T
        cross = -gain @ self.spread
        self.spread = np.block([[self.spread, cross.T], [cross, corner]])
        self.values = np.append(self.values, new)
        self.basis = np.concatenate([self.basis, right[take].T], axis=1)

    def determined(self) -> Array:
        """Which parameters (b,) are known alone."""
        return 1.0 - np.sum(self.basis**2, axis=1) < 1e-9

    def parameters(self) -> tuple[Array, Array]:
        """Values and standard deviations (b,), NaN where not known alone."""
        alone = self.determined()
        values = np.where(alone, self.basis @ self.values / self.scale, np.nan)
        return values, np.where(alone, np.sqrt(np.maximum(np.diag(self.covariance()), 0.0)), np.nan)

    def covariance(self) -> Array:
        """Covariance (b, b) of the parameters."""
        part = self.basis / self.scale[:, None]
        return part @ self.spread @ part.T


def _growth(steps: list[StepRows], factors: list[Array], found: _Solution, names: tuple[str, ...]) -> list[dict[str, Any]]:
    """What each step added on the way to the solution: `factors` (b+1, b+1) hold all rows up to each step.

    Rank means nothing here, for what a pair of sweeps should cancel leaves a trace. In coordinates in which the whole has the
    information matrix 1, a combination is known from a hundredth of its final precision on; a parameter is found once its
    standard deviation is near the final one, or below half its value."""
    from scipy.linalg import solve_triangular

    linear = found.linear
    columns = linear.columns
    alone = np.count_nonzero(linear.regroup, axis=1) == 1
    final = np.sqrt(np.diag(found.covariance))
    before = np.zeros(len(columns), bool)
    report = []
    for step, R in zip(steps, factors, strict=True):
        share, axes = np.linalg.eigh(_gram_of(solve_triangular(linear.root, R[:-1, columns].T, trans="T")))
        # What no step has told yet stays where the whole leaves it, 10,000 times less certain.
        precision = np.maximum(share, 0.0) + 1e-8
        shape = solve_triangular(linear.root, axes)
        std = np.sqrt(np.sum(shape**2 / precision, axis=1))
        miss = R[:-1, -1] - R[:-1, columns] @ linear.values
        pull = axes.T @ solve_triangular(linear.root, R[:-1, columns].T @ miss, trans="T")
        values = linear.values + shape @ (pull / precision)
        now = alone & ((std <= 3 * final) | ((std <= 0.5 * np.abs(linear.values)) & (std <= 1e3 * final)))
        everywhere, spread = np.full((2, len(names)), np.nan)
        everywhere[columns], spread[columns] = values, std
        report.append(told(step, names, columns[now & ~before], everywhere, spread, int(np.sum(share > 1e-4))))
        before |= now
    return report


def _gram_of(A: Array) -> Array:
    return A @ A.T


def _weighted(step: StepRows, variance: Array) -> Array:
    """Rows (m, b+1) of unit variance, for noise `variance` (n,) of the measured torques."""
    return step.white / np.sqrt(step.sensors**2 @ variance * step.overlap)


def _sensor_noise(steps: list[StepRows], solution: _Solution, variance: Array) -> Array:
    """Noise variance (n,) of single samples of the measured torques: what explains the residual of every kind of row best.

    A row on the joint side mixes several measured torques, and a test of few rows tells nothing of its own noise; together
    they do. Non-negative least squares on the rows' variances, each as certain as its degrees of freedom."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    linear = solution.linear
    seen, said, sure, floor = [], [], [], []
    for row in {step.row: None for step in steps}:
        mine = [step for step in steps if step.row == row]
        white = np.concatenate([step.white for step in mine])
        reduced = np.concatenate([_weighted(step, variance)[:, :-1] for step in mine])[:, linear.columns]
        # Overlapping windows share their samples: leverage counts by what they are worth.
        leverage = float(np.sum(solve_triangular(linear.root, reduced.T, trans="T") ** 2)) * mine[0].overlap
        free = len(white) - min(leverage, len(white))
        if free > 0.2:
            seen.append(mine[0].sensors ** 2)
            said.append(float(np.sum((white @ np.append(-solution.everywhere, 1.0)) ** 2)) / free)
            sure.append(np.sqrt(free))
            floor.append(1e-24 * float(np.mean(white[:, -1] ** 2)))
    if not seen:
        return variance
    A, v = np.array(seen), np.maximum(np.array(said), floor)
    predicted = A @ variance
    found = variance
    for _ in range(3):
        scale = np.array(sure) / np.maximum(predicted, 1e-300)
        size = np.maximum(A.max(axis=0), 1e-300)
        found = nnls(A / size * scale[:, None] / np.sqrt(scale @ scale), v * scale / np.sqrt(scale @ scale))[0] / size
        predicted = np.maximum(A @ found, 1e-3 * v)
    typical = np.median(found[found > 0] / variance[found > 0]) if np.any(found > 0) else 1.0
    return np.maximum(found, 1e-3 * typical * variance)


def _covariance(solution: LinearSolution) -> Array:
    from scipy.linalg import solve_triangular

    inverse = solve_triangular(solution.root, np.eye(len(solution.values)))
    return inverse @ inverse.T


def _spread(solution: LinearSolution, count: int) -> Array:
    out = np.zeros(count)
    out[solution.columns] = solution.values
    return out
