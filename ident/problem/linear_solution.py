"""From information and weights to an estimate: shared by every estimator that ends in one linear system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..estimate.status import Status, StatusCode
from ..regressor.base_parameters.reduction import BaseReduction, preference, reduce_columns
from ..statistics.noise import NoiseModel, fit_noise, noise_gram
from .information import Information
from .problem import Rows

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from .problem import Problem

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class LinearSolution:
    """Least-squares solution of R p = z.

    `columns` (b',): which of the information's columns could be told apart; `regroup` (b', b); `values` (b',);
    `root` (b', b'): upper triangular, rootᵀ root = ΦᵀWΦ over those columns; `condition` of the scaled columns."""

    columns: Array
    regroup: Array
    values: Array
    root: Array
    condition: float


def solve_triangle(R: Array, z: Array, order: list[int] | None = None) -> LinearSolution:
    """Solve with columns scaled; columns that the data cannot tell from others are grouped into them (see regressor.base).

    `order`: which column may stay before which; by default as they stand."""
    from scipy.linalg import solve_triangular

    scale = np.linalg.norm(R, axis=0)
    safe = np.where(scale > 0, scale, 1.0)
    singular = np.linalg.svd(R / safe, compute_uv=False)
    if len(singular) and scale.min() > 0 and singular[-1] > 1e-10 * singular[0]:
        y = solve_triangular(R / safe, z)
        return LinearSolution(np.arange(len(scale)), np.eye(len(scale)), y / safe, R, float(singular[0] / singular[-1]))
    # Not full rank in these data: the same reduction as for structure, on the data's own factor.
    from ..robots.parameters import Parameter

    found = reduce_columns(R, tuple(Parameter(str(i), "", "") for i in range(len(scale))), order or list(range(len(scale))))
    keep = found.independent
    Q, root = np.linalg.qr(R[:, keep])
    scale = np.linalg.norm(root, axis=0)
    singular = np.linalg.svd(root / scale, compute_uv=False) if len(keep) else np.ones(1)
    values = solve_triangular(root / scale, Q.T @ z) / scale if len(keep) else np.zeros(0)
    return LinearSolution(keep, found.regroup, values, root, float(singular[0] / singular[-1]))


def step_size(solution: LinearSolution, values: Array, previous: Array) -> float:
    """Largest change from `previous` (b,) to `values` (b,), in standard deviations of the information (rows of the root).

    Changes within round-off of the predicted torque count as none: a noise-free log has no standard deviation to compare with."""
    step = solution.root @ (values - previous)[solution.columns]
    roundoff = 1e-12 * float(np.linalg.norm(solution.root @ values[solution.columns]))
    return float(np.max(np.where(np.abs(step) > roundoff, np.abs(step), 0.0), initial=0.0))


def full_values(problem: Problem, solution: LinearSolution) -> Array:
    """Values (b,) over all base parameters of the problem; those that were grouped away are zero."""
    out = np.zeros(problem.base.count)
    out[solution.columns] = solution.values
    return out


def row_variances(information: Information, values: Array, root: Array | None = None, weights: Array | None = None) -> Array:
    """Residual variance of each measured row, (n,), freed of the parameters it helped to fit (trace of its hat matrix)."""
    squares = information.residual_squares(values)
    used = np.zeros(information.n)
    if root is not None and weights is not None and root.size:
        from scipy.linalg import solve_triangular

        for j in range(information.n):
            leverage = solve_triangular(root, information.factors[j][:-1, :-1].T, trans="T", lower=False)
            used[j] = weights[j] * np.sum(leverage**2)
    return squares / np.maximum(information.counts - used, 1.0)


#: Relative torque error of a joint that moves, from which its parameters are not to be relied on.
_UNEXPLAINED = 0.3

#: What each row contributes to the estimating equation Σ score' (τ − Φ p) = 0: (m, n, b) for a block of rows.
Score = Callable[[Rows], Array]


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
    """Build the estimate: noise model from the residual, covariance under its colour, torque error, status.

    `score`: of rows whose solution is not plain weighted least squares (default weights times columns). `covariance` over
    the solution's columns, and `noise`, where the estimator has its own. `unexplained` (n,): relative torque error that judges
    the fit, where the residual's own also holds noise of the motion."""
    from ..estimate.estimate import Estimate

    base = problem.base
    full = full_values(problem, solution)
    residual = problem.residual(full)
    if noise is None:
        noise = fit_noise(residual, problem.row_runs, problem.row_shape)
        if covariance is None:
            noise, covariance = coloured_covariance(problem, solution, weights, noise, score, residual)
    elif covariance is None:
        covariance = coloured_covariance(problem, solution, weights, noise, score, residual)[1]
    reduced = BaseReduction(
        base.parameters, base.independent[solution.columns], solution.regroup @ base.regroup, base.zero, base.gap, base.notes
    )
    names = base.names
    kept = set(solution.columns.tolist())
    dropped = tuple(names[i] for i in range(base.count) if i not in kept)
    error = problem.torque_error(full, residual)
    status = _status(code, details, dropped, solution, covariance, noise, problem, reduced)
    poor = _explained(problem, error.relative if unexplained is None else unexplained)
    # Whatever else is wrong: that next to nothing is explained is never left unsaid.
    status = poor if status.code == StatusCode.OK else replace(status, details=(*status.details, *poor.details))
    return Estimate(
        method=method,
        model=problem.model,
        base=reduced,
        values=solution.values,
        covariance=covariance,
        status=status,
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


def score_gram(problem: Problem, noise: NoiseModel, score: Score, residual: Array | None = None) -> Array:
    """Covariance (b, b) of Σ scoreᵀ noise over all rows, under the noise's colour; rows left out count nothing.

    `residual` (M, n): its innovations then stand for their own variance (`noise_gram`)."""
    blocks = (Rows(score(rows), rows.tau, rows.valid, rows.place, rows.run) for rows in problem.rows())
    return noise_gram(noise, blocks, np.ones(problem.valid.shape[1]), residual)


def sandwich(root: Array, gram: Array) -> Array:
    """A⁻¹ gram A⁻¹ with A = rootᵀ root, by triangular solves."""
    from scipy.linalg import solve_triangular

    half = solve_triangular(root, solve_triangular(root, gram, trans="T"))
    both = solve_triangular(root, solve_triangular(root, half.T, trans="T"))
    return (both + both.T) / 2


def coloured_covariance(
    problem: Problem, solution: LinearSolution, weights: Array, noise: NoiseModel, score: Score | None = None, residual: Array | None = None
) -> tuple[NoiseModel, Array]:
    """Covariance A⁻¹ (Ψᵀ Γ Ψ) A⁻¹ of the solution (Ψ = WΦ by default), and the noise model freed of what the fit absorbed.

    The residual lacks the part of the noise that the fit took up: its expected sum of squares is tr Γ − tr(A⁻¹ ΦᵀWΓWΦ)/w,
    so each row's level is raised by that share."""
    from scipy.linalg import solve_triangular

    if score is None:
        gram = noise_gram(noise, problem.rows(), weights, residual)
    else:
        gram = score_gram(problem, noise, score, residual)
    gram = gram[np.ix_(solution.columns, solution.columns)]
    half = solve_triangular(solution.root, gram, trans="T")
    inner = solve_triangular(solution.root, half.T, trans="T")  # root⁻ᵀ gram root⁻¹
    rows = problem.valid.sum(axis=0)
    energy = float(np.sum(weights * noise.variance * rows))
    absorbed = min(0.9, float(np.trace(inner)) / energy) if energy > 0 else 0.0
    inflate = 1.0 / (1.0 - absorbed)
    back = solve_triangular(solution.root, inner)
    covariance = solve_triangular(solution.root, back.T).T * inflate
    return replace(noise, innovation=noise.innovation * inflate, variance=noise.variance * inflate), (covariance + covariance.T) / 2


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
        return Status(StatusCode.FEW_SAMPLES, (f"About {effective:.0f} independent samples for {len(solution.values)} parameters.",))
    from .advice import advice

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


def order_of(base: BaseReduction) -> list[int]:
    """Order of preference of the base parameters themselves."""
    rank = {p: i for i, p in enumerate(preference(base.parameters))}
    return sorted(range(base.count), key=lambda i: rank[int(base.independent[i])])
