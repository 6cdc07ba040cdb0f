"""Rows of a step-by-step test: windowed means of both sides of the equation, combined as the kind of test asks.

Everything is a linear combination of rows in integrated form (`ident.problem.integrated`): no acceleration enters, and what a
combination cancels (friction in the mean of both directions, gravity in half their difference) cancels in the columns as well."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError, DataError
from ..planning.trials import MotionKind
from ..problem.formulations import model_parts
from ..problem.integrated import smooth_window
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..planning.sequence import Plan
    from ..planning.trials import PlannedTest
    from ..problem.problem import Problem
    from ..robots.robot import Robot

Array = np.ndarray
#: Length of a window in accelerated motion, s, and rows a window. A window holds at least so many samples: from there on its
#: sums are integrals to 1e-10 (`integrated.smooth_window`).
_WINDOW_S, _ROWS_PER_WINDOW, _WINDOW_SAMPLES = 0.3, 3, 40
#: Fewest samples of a stretch that is used.
_LEAST = 20


@dataclass(frozen=True, eq=False)
class StepRows:
    """What one test gives: `columns` (m, b) and `torque` (m,) of the row that it reads, called `row`.

    `sensors` (n,): how much of each measured torque is in it; `gain` (m,): standard deviation that white noise of unit
    variance has in a row; `overlap`: by how much windows that overlap raise the variance of a mean."""

    name: str
    kind: str
    row: str
    columns: Array
    torque: Array
    sensors: Array
    gain: Array
    overlap: float = 1.0

    @property
    def white(self) -> Array:
        """Columns and torque (m, b+1), each row in units of white noise."""
        return np.column_stack([self.columns, self.torque]) / self.gain[:, None]


def planned_rows(problem: Problem, plan: Plan) -> Iterator[StepRows]:
    """Rows of every test of a plan, in its order. Raises DataError for a test whose log is missing or too short."""
    for test in plan.tests:
        yield _test_rows(problem, plan, test)


def unplanned_rows(problem: Problem) -> Iterator[StepRows]:
    """Without a plan every run is a test, and every torque is read."""
    robot, signals = problem.model.robot, problem.signals
    for run, name in zip(signals.runs, signals.run_names, strict=True):
        columns, torque, gain, overlap = _sliding(problem, run)
        for j, joint in enumerate(robot.joint_names):
            known = np.isfinite(torque[:, j])
            if known.any():
                label = f"{joint} ({robot.transmission.measured.value})"
                own = np.eye(robot.n)[j]
                yield StepRows(f"{name}, {joint}", "run", label, columns[known, j], torque[known, j], own, gain[known], overlap)


def _test_rows(problem: Problem, plan: Plan, test: PlannedTest) -> StepRows:
    robot = problem.model.robot
    run = _run_of(problem, test)
    t = problem.signals.t
    segments = plan.trajectory(test)[1]
    row = robot.joint_index(test.row)
    measured = robot.transmission.measured
    to_side = robot.transmission.torque_map(measured, Side(test.side))[row]
    found: list[tuple[Array, Array, Array]] = []
    overlap = 1.0
    means: dict[tuple[int, float], dict[int, tuple[Array, Array, float]]] = {}
    for segment in segments:
        start, stop = (run.start + int(i) for i in np.searchsorted(t[run], (segment.begin, segment.end)))
        if stop - start < _LEAST:
            continue
        if test.kind == MotionKind.ACCELERATED:
            columns, torque, gain, overlap = _sliding(problem, slice(start, stop))
            found.append((np.einsum("j,mjb->mb", to_side, columns), _combined(to_side, torque), gain))
        else:
            columns, torque, spread = _mean(problem, slice(start, stop))
            mean = to_side @ columns, _combined(to_side, torque[None]), spread
            means.setdefault((segment.posture, segment.speed), {})[segment.direction] = mean
    # Static: the mean of both directions holds the posture. Constant velocity: half their difference is friction.
    sign = 1.0 if test.kind == MotionKind.STATIC else -1.0
    for pair in means.values():
        if len(pair) == 2:
            (forward, ahead, one), (backward, behind, two) = pair[1], pair[-1]
            found.append((0.5 * (forward + sign * backward)[None], 0.5 * (ahead + sign * behind), np.array([0.5 * np.hypot(one, two)])))
    columns, torque, gain = (np.concatenate(part) for part in zip(*found, strict=True)) if found else (np.zeros(0),) * 3
    known = np.isfinite(torque)
    if not known.any():
        raise DataError(f"test {test.name}: no stretch of its log ({test.log}) can be used; record it as the plan says.")
    row_name = f"{test.row} ({Side(test.side).value})"
    return StepRows(test.name, test.kind.value, row_name, columns[known], torque[known], to_side, gain[known], overlap)


def _combined(weights: Array, torque: Array) -> Array:
    """weights @ torque for (m, n) torque; NaN only where a torque that counts is missing."""
    counts = weights != 0
    return torque[:, counts] @ weights[counts]


def _run_of(problem: Problem, test: PlannedTest) -> slice:
    wanted = log_name(test.log)
    for name, run in zip(problem.signals.run_names, problem.signals.runs, strict=True):
        if log_name(name) == wanted:
            return run
    raise DataError(f"test {test.name}: no log is named {wanted!r}; the logs are {', '.join(map(str, problem.signals.run_names))}.")


def log_name(file: str) -> str:
    """A log's name: its file's name without folder and suffixes."""
    name = file.replace("\\", "/").rsplit("/", 1)[-1]
    for suffix in (".gz", ".csv", ".parquet", ".mat"):
        name = name.removesuffix(suffix)
    return name


def _mean(problem: Problem, samples: slice) -> tuple[Array, Array, float]:
    """Columns (n, b) and torque (n,) of one window over the samples, measured side, and its noise gain."""
    w, slope = smooth_window(samples.stop - samples.start, problem.signals.rate)
    parts = model_parts(problem.model, problem.motion(samples))
    keep = problem.base.independent
    columns = np.tensordot(w, parts.force[:, :, keep], 1) + np.tensordot(slope, parts.momentum[:, :, keep], 1)
    return columns, w @ problem.signals.torque[samples], float(np.sqrt(np.sum(w**2)))


def _sliding(problem: Problem, samples: slice) -> tuple[Array, Array, Array, float]:
    """Columns (m, n, b), torque (m, n), noise gain (m,) of overlapping windows, and the variance factor of the overlap."""
    rate = problem.signals.rate
    size = samples.stop - samples.start
    length = min(max(_WINDOW_SAMPLES, round(_WINDOW_S * rate)), size)
    hop = max(1, length // _ROWS_PER_WINDOW)
    w, slope = smooth_window(length, rate)
    parts = model_parts(problem.model, problem.motion(samples))
    keep = problem.base.independent
    force, momentum = parts.force[:, :, keep], parts.momentum[:, :, keep]
    torque = problem.signals.torque[samples]
    at = range(0, size - length + 1, hop)
    columns = np.stack([np.tensordot(w, force[i : i + length], 1) + np.tensordot(slope, momentum[i : i + length], 1) for i in at])
    means = np.stack([w @ torque[i : i + length] for i in at])
    own = np.correlate(w, w, mode="full")[length - 1 :: hop]
    return columns, means, np.full(len(means), np.sqrt(own[0])), float((own[0] + 2 * own[1:].sum()) / own[0])


def check_joints(robot: Robot, plan: Plan) -> None:
    """Refuse a plan that was made for other joints."""
    if tuple(plan.joints) != tuple(robot.joint_names):
        raise ConfigurationError(
            f"the plan is for joints {', '.join(plan.joints)} (robot {plan.robot!r}), but robot {robot.name!r} has"
            f" {', '.join(robot.joint_names)}."
        )


def check_plan(problem: Problem, plan: Plan) -> None:
    """Refuse a plan that was made for other joints, or signals that lack the logs of its tests."""
    check_joints(problem.model.robot, plan)
    there = {log_name(name) for name in problem.signals.run_names}
    missing = [test.name for test in plan.tests if log_name(test.log) not in there]
    if missing:
        some = ", ".join(missing[:6]) + (" …" if len(missing) > 6 else "")
        raise DataError(f"no log of test {some} is among the signals; record what the plan asks for.")
