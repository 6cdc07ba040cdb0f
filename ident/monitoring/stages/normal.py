"""Normal equations of a linearised stage: its columns' coefficients beside steps of the shapes of its effects, some of them bound.

Where an effect's parameters must have certain values (`Effect.response`: the lag of a filter is its time constant), parameter and shape
are one: with both free, a shape that is a little off finds a parameter that makes up for it, and neither is known well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect

if TYPE_CHECKING:
    from ...robots.robot import Robot
    from .stage import Stage

Array = np.ndarray
_NOTHING = 1e-250
#: Relative step of a difference quotient over a shape.
_DIFFERENCE = 1e-4


@dataclass(frozen=True, eq=False)
class Slopes:
    """Derivatives of the whitened torque over shapes: `columns` (n, M, s); `place` (s,): index of the effect and name of the shape."""

    columns: Array
    place: tuple[tuple[int, str], ...]


@dataclass(frozen=True, eq=False)
class Normal:
    """`matrix` (b+s, b+s) and `right` (b+s,) of b coefficients and s steps of shapes, and what must hold of them: `bonds` (m, b+s) times
    them is `bound` (m,)."""

    matrix: Array
    right: Array
    bonds: Array
    bound: Array
    coefficients: int

    @classmethod
    def of(cls, stage: Stage, effects: Sequence[Effect], slopes: Slopes) -> Normal:
        """Of a stage, its effects and slopes."""
        frame = stage.frame
        b = frame.columns.shape[2]
        X = frame.columns.reshape(-1, b)
        S = slopes.columns.reshape(len(X), slopes.columns.shape[2])
        G, cross, torque = frame.gram.sum(axis=0), X.T @ S, frame.torque.reshape(-1)
        matrix = np.block([[G[:b, :b], cross], [cross.T, S.T @ S]])
        bonds, bound = _bonds(stage, effects, slopes)
        return cls(matrix, np.append(G[:b, b], S.T @ torque), bonds, bound, b)

    def fixed(self) -> Normal:
        """The same with all shapes as they are."""
        b = self.coefficients
        return Normal(self.matrix[:b, :b], self.right[:b], self.bonds[:, :b], self.bound, b)

    def solved(self) -> tuple[Array, Array]:
        """What fits best (b+s,), and the inverse of the normal matrix within the bonds."""
        size = np.diag(self.matrix)
        scale = np.where(size > _NOTHING, 1.0 / np.sqrt(np.maximum(size, _NOTHING)), 0.0)
        matrix = self.matrix * scale[:, None] * scale
        if not len(self.bound):
            inverse = _inverse(matrix)
            return scale * (inverse @ (scale * self.right)), inverse * scale[:, None] * scale
        bonds = self.bonds * scale
        _, values, axes = np.linalg.svd(bonds)
        free = axes[int(np.sum(values > 1e-9 * values.max(initial=0.0))) :].T
        at = np.linalg.pinv(bonds, rcond=1e-9) @ self.bound
        inverse = free @ _inverse(free.T @ matrix @ free) @ free.T
        found = at + inverse @ (scale * self.right - matrix @ at)
        return scale * found, inverse * scale[:, None] * scale

    def gain(self, x: Array) -> float:
        """Fall of the loss from nothing at all to x (b+s,)."""
        return float(2.0 * self.right @ x - x @ self.matrix @ x)


def _inverse(A: Array) -> Array:
    """Of a symmetric positive semidefinite scaled matrix; directions below 1e-10 are left at zero."""
    return np.asarray(np.linalg.pinv(A, rcond=1e-10, hermitian=True)) if len(A) else A


def _bonds(stage: Stage, effects: Sequence[Effect], slopes: Slopes) -> tuple[Array, Array]:
    """What must hold between parameters and shapes, to first order in the latter."""
    robot, frame, base = stage.problem.model.robot, stage.frame, list(stage.problem.base.names)
    b, rows, bound = frame.columns.shape[2], list[Array](), list[float]()
    for i, effect in enumerate(effects):
        response = effect.response(robot)
        names = [p.name for p in effect.parameters(robot)]
        if response is None or any(name not in base for name in names):
            continue
        for k, name in enumerate(names):
            row = np.zeros(b + len(slopes.place))
            row[:b] = frame.transform[base.index(name)]
            for s, (own, shape) in enumerate(slopes.place):
                if own == i:
                    row[b + s] = -_change(effect, shape, robot)[k]
            rows.append(row)
            bound.append(float(response[k]))
    return np.reshape(rows, (len(rows), b + len(slopes.place))), np.array(bound)


def _change(effect: Effect, name: str, robot: Robot) -> Array:
    """Derivative (k,) of the values that parameters must have, over a shape (its logarithm where that is natural)."""
    p = next(p for p in effect.shape() if p.name == name)
    at, ends, width = float(getattr(effect, name)), [], []
    for step in (_DIFFERENCE, -_DIFFERENCE):
        x = float(np.clip(at * np.exp(step) if p.log else at + step * (abs(at) + 1e-6), p.lower, p.upper))
        there = effect.with_shape(**{name: x}).response(robot)
        ends.append(np.zeros(1) if there is None else there)
        width.append(np.log(x) if p.log else x)
    return np.asarray((ends[0] - ends[1]) / (width[0] - width[1])) if width[0] != width[1] else 0.0 * ends[0]
