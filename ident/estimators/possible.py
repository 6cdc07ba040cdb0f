"""The nearest parameters whose inertia is positive along a log: instruments must come from a model that can exist.

A model whose inertia matrix is indefinite at a few postures accelerates without bound there, and spoils every instrument
. Positive definiteness at one posture and direction is linear in the parameters, so the nearest set in the
metric of the estimate follows by cutting planes, each step a least-distance problem (Lawson & Hanson, ch. 23)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.kinds import Nature, Need
from ..effects.motion import Motion
from ..errors import DataError
from ..model import Model
from ..robots.transmission import Side
from .bounded import base_bounds

if TYPE_CHECKING:
    from ..problem.problem import Problem
    from ..regressor.base_parameters.reduction import BaseReduction

Array = np.ndarray
#: Least eigenvalue of the inertia matrix, in units of each joint's typical inertia.
MARGIN = 0.02
_POSTURES = 250
_CUTS = 60


@dataclass(frozen=True, eq=False)
class NearestPossible:
    """`values` (b,) after the repair; `scale` (n,): square root of each joint's typical inertia; `moved`: the change in
    standard deviations of the information, 0 where nothing was wrong; `worst`: least eigenvalue before (relative to `scale`)."""

    values: Array
    scale: Array
    moved: float
    worst: float


def possible_along(problem: Problem, values: Array, root: Array, margin: float = MARGIN) -> NearestPossible:
    """Nearest base values (b,) to `values` with positive inertia at the log's postures and friction that takes power.

    `root` (b, b): upper triangular, rootᵀ root the information that measures nearness. Raises DataError where there is none."""
    base = problem.base
    inertia = base_inertia(problem.model, base, _postures(problem))
    typical = np.median(np.abs(np.einsum("sjjb,b->sj", inertia, values)), axis=0)
    # A joint whose estimated inertia happens to vanish takes the size that its own columns would have.
    scale = np.sqrt(np.maximum(typical, 1e-3 * typical.max(initial=1e-12)))
    shaped = inertia / np.outer(scale, scale)[None, :, :, None]
    rows, bounds = _signs(problem.model, base)
    violated = bool(np.any(rows @ values < bounds))
    least, vectors = np.linalg.eigh(shaped @ values)
    worst = float(least[:, 0].min())
    if worst >= margin and not violated:
        return NearestPossible(values, scale, 0.0, worst)
    for _ in range(_CUTS):
        bad = np.flatnonzero(least[:, 0] < margin * (1 - 1e-6))
        chosen = bad[np.argsort(least[bad, 0])][:20]
        cut = np.einsum("si,sijb,sj->sb", vectors[chosen, :, 0], shaped[chosen], vectors[chosen, :, 0])
        rows, bounds = np.concatenate([rows, cut]), np.append(bounds, np.full(len(cut), margin * 1.05))
        found = nearest(values, root, rows, bounds)
        least, vectors = np.linalg.eigh(shaped @ found)
        if least[:, 0].min() >= margin * (1 - 1e-6):
            return NearestPossible(found, scale, float(np.linalg.norm(root @ (found - values))), worst)
    raise DataError("the first estimate is too far from any possible robot to make instruments from it; start from the momentum form.")


def nearest(values: Array, root: Array, rows: Array, bounds: Array) -> Array:
    """The p that minimises ‖root (p − values)‖ with rows @ p ≥ bounds, through non-negative least squares."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    scale = np.linalg.norm(root, axis=0)
    unit = root / scale
    A = solve_triangular(unit, (rows / scale).T, trans="T").T
    size = np.linalg.norm(A, axis=1)
    A, f = A / size[:, None], (bounds - rows @ values) / size
    step = max(float(np.abs(f).max()), 1e-300)
    E = np.vstack([A.T, f / step])
    target = np.zeros(len(E))
    target[-1] = 1.0
    u, _ = nnls(E, target, maxiter=30 * E.shape[1])
    r = E @ u - target
    if abs(r[-1]) < 1e-12:
        raise DataError("no possible robot is near the first estimate: its constraints contradict each other.")
    return values + solve_triangular(unit, -r[:-1] / r[-1] * step) / scale


def base_inertia(model: Model, base: BaseReduction, q: Array) -> Array:
    """Inertia matrix on the joint side per unit base parameter, (S, n, n, b), drives included, at postures q (S, n)."""
    robot, (S, n) = model.robot, q.shape
    out = np.zeros((S, n, n, base.count))
    still = np.zeros((S, n))
    instant = [e for e in model.effects if not e.needs & {Need.HISTORY, Need.NEIGHBOURS, Need.REFERENCE, Need.LOAD, Need.TORQUE}]
    part = Model(robot, tuple(instant))
    place = {name: i for i, name in enumerate(part.names)}
    kept = [(i, place[name]) for i, name in enumerate(base.names) if name in place]
    mine, theirs = (np.array(x, int) for x in zip(*kept, strict=True))
    to_joint = robot.transmission.torque_map(robot.transmission.measured, Side.JOINT)
    at_rest = part.columns(Motion.of(robot, q, still, still))[:, :, theirs]
    for j in range(n):
        ddq = still.copy()
        ddq[:, j] = 1.0
        columns = part.columns(Motion.of(robot, q, still, ddq))[:, :, theirs] - at_rest
        out[:, :, j][:, :, mine] = np.matmul(to_joint, columns)
    return (out + out.swapaxes(1, 2)) / 2


def _postures(problem: Problem) -> Array:
    q = problem.signals.q
    return q[np.unique(np.linspace(0, len(q) - 1, _POSTURES).astype(int))]


def _signs(model: Model, base: BaseReduction) -> tuple[Array, Array]:
    """Rows and bounds: friction parameters that stand alone are not negative (a negative one feeds the motion)."""
    lower, _ = base_bounds(base)
    friction = {e.name for e in model.effects if e.nature == Nature.FRICTION}
    at = [i for i in range(base.count) if base.parameters[base.independent[i]].effect in friction and np.isfinite(lower[i])]
    return np.eye(base.count)[at], lower[at]
