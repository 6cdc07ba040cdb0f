"""Total least squares: the regressor is noisy too, and by how much is known from the noise of the motion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from .._utils.singular_values import svd
from ..effects.kinds import Need
from ..errors import ConfigurationError, UnsupportedError
from ..estimate.status import StatusCode
from ..problem.information import Information, triangle
from ..problem.linear_solution import LinearSolution, full_values, sandwich
from .base import Capability, Estimator, per_joint, register
from .finish import finish
from .least_squares import weighted_solution
from .long_run import long_run_gram
from .motion_noise import column_noise

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem
    from ..signals.rows import Rows

Array = np.ndarray
#: Share of a column's energy below which its noise counts as none.
_EXACT = 1e-13


@register
@dataclass(frozen=True, kw_only=True)
class TotalLeastSquares(Estimator):
    """Least squares with errors in the regressor (Van Huffel & Vandewalle 1991: mixed and generalised).

    `position_std`, `velocity_std`, `acceleration_std`: noise of the prepared joint-side motion, per joint (or one number for all) in rad,
    rad/s, rad/s² (m …); what is left out is free of noise. Columns without noise stay exact. Rows weigh by their residual; the noise of the
    torque is what the residual holds beyond that of the regressor. Only as good as the noise levels given: where they are not
    known, instrumental variables ("iv") need none.

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> method = ident.estimators.TotalLeastSquares(acceleration_std=0.01)
    >>> ident.fit(train, "puma560", method=method, held=0).status.code.value
    'ok'
    """

    name: ClassVar[str] = "tls"
    title: ClassVar[str] = "total least squares"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING, Capability.WEIGHTS, Capability.NOISY_REGRESSOR})

    position_std: tuple[float, ...] | float | None = None
    velocity_std: tuple[float, ...] | float | None = None
    acceleration_std: tuple[float, ...] | float | None = None
    iterations: int = 30

    def check(self, problem: Problem) -> None:
        given = {f: getattr(self, f) for f in ("position_std", "velocity_std", "acceleration_std")}
        if all(value is None for value in given.values()):
            raise ConfigurationError(
                "method 'tls' needs the noise of the motion: acceleration_std (rad/s² or m/s², one number for all joints or a list),"
                ' velocity_std, position_std; in a study file: [estimator] method = "tls", acceleration_std = 0.2. Where it is not known,'
                " use method 'iv'."
            )
        n = problem.model.robot.n
        for name, value in given.items():
            if value is not None:
                per_joint(value, n, f"method 'tls': {name}", positive=False)
        memory = problem.model.needs & {Need.HISTORY, Need.NEIGHBOURS}
        if memory:
            raise UnsupportedError(
                "method 'tls' knows how noise of one instant reaches the columns, but an effect of this model depends on other instants"
                f" ({', '.join(sorted(memory))}); use 'iv', or 'wls' on well-filtered signals."
            )

    def _solve(self, problem: Problem) -> Estimate:
        n = problem.model.robot.n
        given = (self.position_std, self.velocity_std, self.acceleration_std)
        q, dq, ddq = (per_joint(0.0 if x is None else x, n, "noise", positive=False) for x in given)
        first, weights = weighted_solution(problem)
        roots = column_noise(problem, q, dq, ddq)[:, :, first.columns]
        information = problem.information.selected(first.columns)
        solution, eigenvalue, done = first, 1.0, False
        for _ in range(self.iterations):
            noise = _row_noise(information, roots, solution.values)
            weights = np.where(information.counts > 0, 1.0 / noise.total, 0.0)
            values, root, eigenvalue = _mixed(information, weights, roots, noise.torque)
            change = np.linalg.norm(solution.root @ (values - solution.values))
            size = np.linalg.norm(solution.root @ values)
            solution = LinearSolution(first.columns, first.regroup, values, root, solution.condition)
            if not np.all(np.isfinite(values)):
                break
            if change <= 1e-9 * size:
                done = True
                break
        return self._finish(problem, solution, weights, roots, eigenvalue, done)

    def _finish(self, problem: Problem, solution: LinearSolution, weights: Array, roots: Array, eigenvalue: float, done: bool) -> Estimate:
        if not np.all(np.isfinite(solution.values)):
            raise ConfigurationError(
                "method 'tls': with this much noise in the motion the log fits any parameters (no generic solution);"
                " check the units of the noise levels, filter harder, or use 'iv'."
            )
        counts = problem.information.counts
        pull = np.einsum("jra,jrb,b->ja", roots, roots, solution.values)  # C_j p
        values = full_values(problem, solution)
        spread = np.einsum("ja,a->j", pull, solution.values)
        share = np.where(counts > 0, 1.0, 0.0) * weights

        def score(rows: Rows) -> Array:
            e = np.where(rows.valid, rows.tau - rows.columns @ values, 0.0)
            columns = rows.columns[:, :, solution.columns]
            # Without the second term the noise that residual and regressor share would count as signal.
            correction = eigenvalue * np.where(rows.valid, 1.0, 0.0) @ (share[:, None] * pull)
            return np.einsum("mj,mjb->mb", e * share, columns) + correction

        gram = long_run_gram(problem, score)
        covariance = sandwich(solution.root, gram)
        trace = {"regressor_noise": spread.tolist(), "eigenvalue": eigenvalue}
        code = StatusCode.OK if done else StatusCode.NOT_CONVERGED
        return finish(problem, solution, weights, self.name, covariance=covariance, code=code, trace=trace)


@dataclass(frozen=True, eq=False)
class _Noise:
    """Per row (n,): variance of the residual, and of the torque's part in it."""

    total: Array
    torque: Array


def _row_noise(information: Information, roots: Array, values: Array) -> _Noise:
    counts = np.maximum(information.counts, 1)
    total = information.residual_squares(values) / np.maximum(counts - len(values) / max(1, information.n), 1)
    floor = 1e-24 * np.maximum(information.torque_squares(), 1e-300) / counts
    total = np.maximum(total, floor)
    regressor = np.sum((roots @ values) ** 2, axis=1)
    return _Noise(total, np.maximum(total - regressor, 1e-3 * total))


def _mixed(information: Information, weights: Array, roots: Array, torque_noise: Array) -> tuple[Array, Array, float]:
    """Smallest generalised eigenvector of ([Φ τ]ᵀW[Φ τ], noise): values (b,), root of the noise-free information, eigenvalue.

    Directions of [Φ τ] without noise are eliminated exactly; the rest is whitened by its noise and solved by singular values."""
    from scipy.linalg import solve_triangular

    k = information.k
    R = triangle((np.sqrt(weights)[:, None, None] * information.factors).reshape(-1, k + 1))
    scale = np.maximum(np.linalg.norm(R, axis=0), 1e-300)
    mass = np.sqrt(weights * information.counts)
    noise = np.zeros((roots.shape[0] * roots.shape[1] + len(mass), k + 1))
    noise[: -len(mass), :-1] = (mass[:, None, None] * roots).reshape(-1, k)
    noise[-len(mass) :, -1] = mass * np.sqrt(torque_noise)
    _, level, V = svd(triangle(noise / scale) if len(noise) > k else noise / scale)
    level = np.append(level, np.zeros(k + 1 - len(level))) if len(level) < k + 1 else level
    noisy = level > np.sqrt(_EXACT)
    exact, rough = V[~noisy].T, V[noisy].T / level[noisy]
    T = np.linalg.qr((R / scale) @ np.concatenate([exact, rough], axis=1))[1]
    e = exact.shape[1]
    _, singular, right = svd(T[e:, e:])
    b = right[-1]
    a = -solve_triangular(T[:e, :e], T[:e, e:] @ b) if e else np.zeros(0)
    x = (exact @ a + rough @ b) / scale
    if abs(x[-1]) * scale[-1] < 1e-10 * np.linalg.norm(x * scale):
        return np.full(k, np.nan), R[:-1, :-1], float(singular[-1] ** 2)
    values = -x[:-1] / x[-1]
    # Information without the part that is noise; where noise dominates it, the raw one bounds the step.
    columns = noise[:, :-1]
    gram = R[:-1, :-1].T @ R[:-1, :-1] - float(singular[-1] ** 2) * columns.T @ columns
    unit = np.maximum(scale[:-1], 1e-300)
    lower = gram / np.outer(unit, unit)
    smallest = float(np.linalg.eigvalsh(lower)[0])
    root = np.linalg.cholesky(lower).T * unit if smallest > 1e-14 else R[:-1, :-1]
    return values, root, float(singular[-1] ** 2)
