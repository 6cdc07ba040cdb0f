"""From information and weights to values and their covariance: the linear algebra that every estimator shares."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from .._utils.singular_values import singular_values
from ..regressor.base_parameters.reduction import BaseReduction, preference, reduce_columns
from ..robots.parameters import Parameter
from ..signals.rows import Rows
from ..statistics.noise import NoiseModel, noise_gram
from .information import Information

Array = np.ndarray


class MeasuredRows(Protocol):
    """A problem, as far as its rows are concerned: base parameters, blocks of rows, and which rows are used, (M, n) bool."""

    @property
    def base(self) -> BaseReduction: ...

    @property
    def valid(self) -> Array: ...

    def rows(self) -> Iterable[Rows]: ...


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
    """Solve R x = z with scaled columns; columns that the data cannot separate from others are grouped into them.

    Parameters
    ----------
    R : array (b, b)
        Upper triangular, from the information of a problem.
    z : array (b,)
        Right-hand side.
    order : list of int, optional
        Which columns are kept before which; by default as they stand.

    Returns
    -------
    LinearSolution

    Examples
    --------
    >>> import numpy as np
    >>> from ident.estimators import solve_triangle
    >>> solve_triangle(np.array([[2.0, 0.0], [0.0, 4.0]]), np.array([1.0, 1.0])).values.tolist()
    [0.5, 0.25]
    """
    from scipy.linalg import solve_triangular

    scale = np.linalg.norm(R, axis=0)
    safe = np.where(scale > 0, scale, 1.0)
    singular = singular_values(R / safe)
    if len(singular) and scale.min() > 0 and singular[-1] > 1e-10 * singular[0]:
        y = solve_triangular(R / safe, z)
        return LinearSolution(np.arange(len(scale)), np.eye(len(scale)), y / safe, R, float(singular[0] / singular[-1]))
    # Not full rank in these data: the same reduction as for structure, on the data's own factor.

    found = reduce_columns(R, tuple(Parameter(str(i), "", "") for i in range(len(scale))), order or list(range(len(scale))))
    keep = found.independent
    Q, root = np.linalg.qr(R[:, keep])
    scale = np.linalg.norm(root, axis=0)
    singular = singular_values(root / scale) if len(keep) else np.ones(1)
    values = solve_triangular(root / scale, Q.T @ z) / scale if len(keep) else np.zeros(0)
    return LinearSolution(keep, found.regroup, values, root, float(singular[0] / singular[-1]))


def step_size(solution: LinearSolution, values: Array, previous: Array) -> float:
    """Largest change from `previous` (b,) to `values` (b,), in standard deviations of the information (rows of the root).

    Changes within round-off of the predicted torque count as none: a noise-free log has no standard deviation to compare with."""
    step = solution.root @ (values - previous)[solution.columns]
    roundoff = 1e-12 * float(np.linalg.norm(solution.root @ values[solution.columns]))
    return float(np.max(np.where(np.abs(step) > roundoff, np.abs(step), 0.0), initial=0.0))


def full_values(problem: MeasuredRows, solution: LinearSolution) -> Array:
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


#: What each row contributes to the estimating equation Σ score' (τ − Φ p) = 0: (m, n, b) for a block of rows.
Score = Callable[[Rows], Array]


def score_gram(problem: MeasuredRows, noise: NoiseModel, score: Score, residual: Array | None = None) -> Array:
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
    problem: MeasuredRows,
    solution: LinearSolution,
    weights: Array,
    noise: NoiseModel,
    score: Score | None = None,
    residual: Array | None = None,
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
    covariance = (covariance + covariance.T) / 2
    if np.diag(covariance).min(initial=0.0) < 0.0:
        covariance = inflate * _by_root(solution.root, gram)
    return replace(noise, innovation=noise.innovation * inflate, variance=noise.variance * inflate), covariance


def _by_root(root: Array, gram: Array) -> Array:
    """A⁻¹ gram A⁻¹ as a product that rounding cannot make negative: where rows are few, joints fit with errors of very different size."""
    from scipy.linalg import solve_triangular

    size = np.sqrt(np.maximum(np.diag(gram), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    half = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    half = solve_triangular(root, solve_triangular(root, half, trans="T"))
    return np.asarray(half @ half.T)


def order_of(base: BaseReduction) -> list[int]:
    """Order of preference of the base parameters themselves."""
    rank = {p: i for i, p in enumerate(preference(base.parameters))}
    return sorted(range(base.count), key=lambda i: rank[int(base.independent[i])])
