"""Fits with a prior whose metric is itself a barrier (entropic, geometric): damped Newton inside the consistent sets.

Both metrics grow beyond all bounds as a body's extent vanishes, so no step leaves the cone of real bodies; bounds and links without
nominal values get a logarithmic barrier whose weight is driven to zero (Boyd and Vandenberghe, Convex Optimization, ch. 11)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .._utils.singular_values import lstsq
from .bounds import Metric
from .conic import SolverError

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Matrices:
    """Symmetric matrices base (a, s, s) + sum of slope (a, p, s, s) over the p unknowns."""

    base: Array
    slope: Array

    def at(self, x: Array) -> Array:
        return self.base + np.einsum("apij,p->aij", self.slope, x)


@dataclass(frozen=True, eq=False)
class InteriorProblem:
    """Minimise the sum over `costed` of (x - target)^2 + `weight` * metric(`nominal`), inside strict inequalities.

    `blocks` positive definite, `rows` x + `constants` > 0, and for every cone (m, p) with offset (m,) first entry > norm of the
    others. `nominal`: pseudo-inertias relative to the nominal ones."""

    target: Array
    costed: Array
    nominal: Matrices
    metric: Metric
    weight: float
    blocks: Matrices
    rows: Array
    constants: Array
    cones: tuple[tuple[Array, Array], ...] = field(default=())

    def is_inside(self, x: Array) -> bool:
        """Whether x (p,) satisfies everything strictly."""
        return bool(np.isfinite(self._value(x, 1.0)))

    def solve(self, x: Array, steps: int = 1000) -> Array:
        """The minimiser, from a strictly feasible `x` (p,), by at most so many Newton `steps` for each weight of the barrier.

        Raises SolverError where Newton's method stalls or does not get there, or the start is not inside."""
        if not self.is_inside(x):
            raise SolverError(
                "the fit with a prior: the start is not strictly inside the bounds; leave room between least and most values."
            )
        if self.metric == Metric.GEOMETRIC:
            # Not convex and flat far from the nominal body: the entropic solution is the place to start from.
            x = replace(self, metric=Metric.ENTROPIC).solve(x, steps)
        barriers = len(self.blocks.base) + len(self.constants) + len(self.cones)
        for mu in (1e-2, 1e-4, 1e-6, 1e-8) if barriers else (0.0,):
            x = self._newton(x, mu, steps)
        return x

    def _newton(self, x: Array, mu: float, steps: int) -> Array:
        for _ in range(steps):
            gradient, hessian = self._slopes(x, mu)
            size = np.sqrt(np.maximum(np.diagonal(hessian), 1e-300))
            scaled = hessian / np.outer(size, size)
            step = -lstsq(scaled + 1e-14 * np.eye(len(x)), gradient / size, rcond=1e-15) / size
            decrement = -float(gradient @ step)
            value = self._value(x, mu)
            if decrement <= 1e-11 * max(abs(value), 1.0):
                return x
            length = 1.0
            while length > 1e-12:
                trial = self._value(x + length * step, mu)
                if trial <= value - 1e-4 * length * decrement:
                    break
                length *= 0.5
            else:
                # No descent left that rounding would not hide.
                if decrement <= 1e-6 * max(abs(value), 1.0):
                    return x
                raise SolverError("the fit with a prior: Newton's method stalled. Check the nominal model, or use the quadratic metric.")
            x = x + length * step
        raise SolverError(f"the fit with a prior: Newton's method did not converge in {steps} steps. Use the quadratic metric.")

    def _value(self, x: Array, mu: float) -> float:
        value = float(np.sum((x - self.target)[self.costed] ** 2))
        lam = np.linalg.eigvalsh(self.nominal.at(x)) if len(self.nominal.base) else np.ones((0, 4))
        if np.any(lam <= 0):
            return np.inf
        value += self.weight * float(np.sum(lam - np.log(lam) - 1.0) if self.metric == Metric.ENTROPIC else 0.5 * np.sum(np.log(lam) ** 2))
        if len(self.blocks.base):
            mine = np.linalg.eigvalsh(self.blocks.at(x))
            if np.any(mine <= 0):
                return np.inf
            value -= mu * float(np.sum(np.log(mine)))
        slack = self.rows @ x + self.constants
        if np.any(slack <= 0):
            return np.inf
        value -= mu * float(np.sum(np.log(slack)))
        for cone, offset in self.cones:
            s = cone @ x + offset
            room = s[0] ** 2 - float(s[1:] @ s[1:])
            if s[0] <= 0 or room <= 0:
                return np.inf
            value -= mu * float(np.log(room))
        return value

    def _slopes(self, x: Array, mu: float) -> tuple[Array, Array]:
        p = len(x)
        gradient, hessian = np.zeros(p), np.zeros((p, p))
        gradient[self.costed] += 2.0 * (x - self.target)[self.costed]
        hessian[self.costed, self.costed] += 2.0
        lam, Q = np.linalg.eigh(self.nominal.at(x)) if len(self.nominal.base) else (np.ones((0, 4)), np.ones((0, 4, 4)))
        for body in range(len(lam)):
            turned = np.einsum("ij,pjl,lm->pim", Q[body].T, self.nominal.slope[body], Q[body])
            spread = _entropic if self.metric == Metric.ENTROPIC else _geometric
            first, factor = spread(lam[body])
            gradient += self.weight * np.einsum("pii,i->p", turned, first)
            flat = (turned * factor).reshape(p, 16)
            hessian += self.weight * flat @ flat.T
        if len(self.blocks.base):
            for inverse, slope in zip(np.linalg.inv(self.blocks.at(x)), self.blocks.slope, strict=True):
                moved = np.einsum("ij,pjl->pil", inverse, slope)
                gradient -= mu * np.trace(moved, axis1=1, axis2=2)
                hessian += mu * np.einsum("pij,rji->pr", moved, moved, optimize=True)
        slack = self.rows @ x + self.constants
        scaled = self.rows / slack[:, None]
        gradient -= mu * scaled.sum(axis=0)
        hessian += mu * scaled.T @ scaled
        for cone, offset in self.cones:
            s = cone @ x + offset
            room = s[0] ** 2 - float(s[1:] @ s[1:])
            signature = np.diag([1.0] + [-1.0] * (len(s) - 1))
            slope = 2.0 * cone.T @ (signature @ s)
            gradient -= mu * slope / room
            hessian += mu * (np.outer(slope, slope) / room**2 - 2.0 * cone.T @ signature @ cone / room)
        return gradient, hessian


def _entropic(lam: Array) -> tuple[Array, Array]:
    """tr A - log det A: slope per eigenvalue, and the root of its curvature between eigenvectors."""
    return 1.0 - 1.0 / lam, 1.0 / np.sqrt(np.outer(lam, lam))


def _geometric(lam: Array) -> tuple[Array, Array]:
    """Half |log A|^2: slope per eigenvalue, and the root of a curvature between eigenvectors that is never negative.

    The curvature is the divided difference of log(x)/x; where that falls below Gauss-Newton's, or is negative (x > e), the latter."""
    logs = np.log(lam)
    gap = lam[:, None] - lam[None, :]
    close = np.abs(gap) < 1e-7 * (lam[:, None] + lam[None, :])
    gap = np.where(close, 1.0, gap)
    mean = 0.5 * (lam[:, None] + lam[None, :])
    gauss = np.where(close, 1.0 / mean, (logs[:, None] - logs[None, :]) / gap) ** 2
    slope = logs / lam
    exact = np.where(close, (1.0 - np.log(mean)) / mean**2, (slope[:, None] - slope[None, :]) / gap)
    return slope, np.sqrt(np.maximum(exact, gauss))
