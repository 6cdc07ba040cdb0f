"""From a linear solution to an estimate: noise model, covariance under its colour, torque error, status. Shared by every estimator that
ends in one linear system."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from .._utils.text import counted
from ..errors import ConfigurationError
from ..estimate.estimate import Estimate
from ..estimate.status import Status, StatusCode
from ..problem.advice import advice
from ..problem.linear_solution import LinearSolution, Score, coloured_covariance, full_values
from ..problem.problem import Problem
from ..regressor.base_parameters.reduction import BaseReduction
from ..statistics.noise import NoiseModel, fit_noise
from ..statistics.torque_error import JudgedOn, TorqueError

Array = np.ndarray
#: Relative torque error of a joint that moves, from which its parameters are not to be relied on.
_UNEXPLAINED = 0.3


def finish(
    problem: Problem,
    solution: LinearSolution,
    weights: Array,
    method: str,
    *,
    score: Score | None = None,
    covariance: Array | None = None,
    noise: NoiseModel | None = None,
    warnings: tuple[str, ...] = (),
    code: StatusCode = StatusCode.OK,
    details: tuple[str, ...] = (),
    trace: dict[str, Any] | None = None,
    unexplained: Array | None = None,
) -> Estimate:
    """Build the estimate of a linear solution: noise model from the residual, covariance under its colour, torque error, status.

    Parameters
    ----------
    problem : Problem
        Model and signals.
    solution : LinearSolution
        From `solve_triangle`.
    weights : array (n,)
        Of each measured row.
    method : str
        Name of the estimator.
    score : Score, optional
        Of rows whose solution is not plain weighted least squares (default: weights times columns).
    covariance : array, optional
        Over the solution's columns, where the estimator has its own; likewise `noise`.
    noise : NoiseModel, optional
        See `covariance`.
    warnings, code, details, trace
        Of the estimate and its status.
    unexplained : array (n,), optional
        Relative torque error that judges the fit, where the residual's own also holds noise of the motion.

    Returns
    -------
    Estimate

    Raises
    ------
    ConfigurationError
        Bare values instead of a solution.

    Examples
    --------
    >>> import ident
    >>> from ident.estimators import finish, weighted_solution
    >>> train, _ = ident.demo_logs()
    >>> robot = ident.load_robot("puma560")
    >>> problem = ident.Problem(robot.rigid_body() + ident.friction.Coulomb(), ident.ZeroPhase()(train, robot))
    >>> finish(problem, *weighted_solution(problem), method="mine").method
    'mine'
    """
    _require_solution(solution, method)
    base = problem.base
    full = full_values(problem, solution)
    residual = problem.residual(full)
    noise, covariance = _uncertainty(problem, solution, weights, score, residual, noise, covariance)
    reduced, dropped = _reduced(base, solution)
    error = problem.torque_error(full, residual)
    status = _status(code, details, dropped, solution, covariance, noise, problem, reduced)
    # What was fitted judges the status; what is shown may be judged elsewhere.
    own = error if error.judged == JudgedOn.ROWS else TorqueError.of(residual, problem.tau)
    poor = _explained(problem, own.relative if unexplained is None else unexplained)
    return Estimate(
        method=method,
        model=problem.model,
        base=reduced,
        values=solution.values,
        covariance=covariance,
        status=_both(status, poor),
        fit_error=error,
        noise=noise,
        weights=weights,
        condition=solution.condition,
        samples=int(problem.valid.sum()),
        information=problem.information,
        reference=problem.reference,
        dropped=dropped,
        warnings=(*problem.signals.report.warnings, *base.notes, *warnings),
        trace=trace or {},
    )


def _uncertainty(
    problem: Problem, solution: LinearSolution, weights: Array, score: Score | None, residual: Array, noise: NoiseModel | None,
    covariance: Array | None,
) -> tuple[NoiseModel, Array]:  # fmt: skip
    """Noise model and covariance: those that are given, else of the residual, under its colour."""
    own = fit_noise(residual, problem.row_runs, problem.row_shape) if noise is None else noise
    if covariance is not None:
        return own, covariance
    coloured, covariance = coloured_covariance(problem, solution, weights, own, score, residual)
    return (coloured if noise is None else noise), covariance


def _reduced(base: BaseReduction, solution: LinearSolution) -> tuple[BaseReduction, tuple[str, ...]]:
    """The base parameters that the data determine, and the names of those that were grouped into others."""
    reduced = BaseReduction(
        base.parameters, base.independent[solution.columns], solution.regroup @ base.regroup, base.zero, base.gap, base.notes
    )
    kept = set(solution.columns.tolist())
    return reduced, tuple(base.names[i] for i in range(base.count) if i not in kept)


def _require_solution(solution: object, method: str) -> None:
    """Refuse bare values, which say nothing of what the data determine."""
    if not isinstance(solution, LinearSolution):
        raise ConfigurationError(
            f"method {method!r}: finish() takes a LinearSolution, which solve_triangle(R, z) returns, not {type(solution).__name__};"
            " other values go in by dataclasses.replace(solve_triangle(R, z), values=...)."
        )


def _status(
    code: StatusCode,
    details: tuple[str, ...],
    dropped: tuple[str, ...],
    solution: LinearSolution,
    covariance: Array,
    noise: NoiseModel,
    problem: Problem,
    base: BaseReduction,
) -> Status:
    if code != StatusCode.OK:
        return Status(code, details)
    rows = problem.valid.sum(axis=0)
    # A residual within round-off says nothing about noise.
    exact = noise.variance * rows <= 1e-20 * np.sum(np.where(problem.valid, problem.tau, 0.0) ** 2, axis=0)
    effective = float(np.sum(np.where(exact, rows, rows / noise.correlation_time)))
    if effective < 1.5 * len(solution.values):
        return Status(
            StatusCode.FEW_SAMPLES, (f"About {effective:.0f} independent samples for {counted(len(solution.values), 'parameter')}.",)
        )
    if dropped:
        kept = ", ".join(dropped[:8]) + (" …" if len(dropped) > 8 else "")
        return Status(StatusCode.RANK_DEFICIENT, (f"Not determined alone: {kept}.", *advice(problem.model.robot, base, dropped)))
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    # The torque a parameter causes, against its own uncertainty: a value near zero that is known well is not poorly excited.
    gain = np.linalg.norm(solution.root, axis=0)
    contribution = std * gain / np.sqrt(max(1.0, float(rows.sum())))
    weak = [i for i in range(len(std)) if std[i] > np.abs(solution.values[i]) and contribution[i] > 0.3]
    if weak:
        names = [base.names[i] for i in weak]
        listed = ", ".join(names[:8]) + (" …" if len(names) > 8 else "")
        return Status(StatusCode.POORLY_EXCITED, (f"Poorly excited: {listed}.", *advice(problem.model.robot, base, tuple(names))))
    return Status(StatusCode.OK)


def _both(status: Status, poor: Status) -> Status:
    """The status, with what is said of torque that stays unexplained: that is never left out, whatever else is wrong."""
    if status.code == StatusCode.OK:
        return poor
    # Standard deviations are of the residual: where it is what the model lacks, they do not tell what the motion excites.
    code = poor.code if status.code == StatusCode.POORLY_EXCITED and poor.details else status.code
    return replace(status, code=code, details=(*poor.details, *status.details))


def _explained(problem: Problem, relative: Array) -> Status:
    """OK, or which joints' torque the model leaves unexplained although they move."""
    names = problem.model.robot.joint_names
    q = problem.signals.q
    # A few samples tell, and signals on disk are read by slices only.
    moving = np.ptp(np.concatenate([q[i : i + 1] for i in np.linspace(0, len(q) - 1, 64).astype(int).tolist()]), axis=0) > 0
    poor = [f"{name} {share:.0%}" for name, share, moves in zip(names, relative, moving, strict=True) if moves and share > _UNEXPLAINED]
    if not poor:
        return Status(StatusCode.OK)
    return Status(StatusCode.POOR_FIT, (f"Relative torque error above {_UNEXPLAINED:.0%}: {', '.join(poor)}.",))
