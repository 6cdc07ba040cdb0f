"""Gravity that acts along another direction than declared, or not at all: a robot on a wall or a ceiling, a torque that a controller has
freed of gravity.

Torque is linear in gravity for given parameters, and in the parameters for given gravity. Along the axes of the base, and from the best of
them by Gauss-Newton steps, gravity is fitted beside all parameters."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.gravity import tilt_axes
from ..effects.kinds import Need
from ..effects.rigid_body import RigidBody
from ..model import Model
from ..problem.information import Information
from ..problem.reweighting import reweighted
from ..robots.robot import STANDARD_GRAVITY

if TYPE_CHECKING:
    from ..problem.problem import Problem
    from ..signals.signals import Block

Array = np.ndarray
#: Passes of weighting, Gauss-Newton steps and the change of direction (rad) at which they end.
_PASSES, _STEPS, _SETTLED = 5, 8, 1e-3


@dataclass(frozen=True)
class Mounting:
    """Gravity (3,) in m/s² of the base's frame, and the relative error (n,) of each joint with it."""

    gravity: Array
    errors: Array
    declared: Array

    @property
    def told(self) -> str:
        """A clause: what seems to be wrong."""
        if not self.gravity.any():
            return "the torque seems to hold no gravity (a controller may have subtracted it)"
        if not self.declared.any():
            return f"gravity seems to act along {_direction(self.gravity)} of the base's frame; none is declared"
        return f"gravity seems to act along {_direction(self.gravity)} of the base's frame, not along {_direction(self.declared)}"

    @property
    def remedy(self) -> str:
        """A sentence: what to look at."""
        what = "Log the whole torque, or declare" if not self.gravity.any() else "Check how the robot is mounted, and declare it:"
        parts = [f"{x:g}" for x in np.round(self.gravity, 2) + 0.0]
        return f"{what} --gravity {' '.join(parts)}, or [robot] gravity = [{', '.join(parts)}] in a study file."


def mounting(problem: Problem, blocks: Sequence[Block]) -> Mounting | None:
    """The direction of gravity that fits some rows of a problem best, or no gravity; None where the model does not tell."""
    model = problem.model
    if model.needs & {Need.LOAD, Need.REFERENCE} or not any(isinstance(effect, RigidBody) for effect in model.effects):
        return None
    declared = np.array(model.robot.model.gravity.linear, float)
    size = float(np.linalg.norm(declared if declared.any() else STANDARD_GRAVITY))
    rows = _Rows.of(problem, blocks)
    axes = [sign * size * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
    tried = [(rows.errors(g), g) for g in (*axes, np.zeros(3), declared)]
    errors, best = min(tried, key=lambda one: float(np.sum(np.log(one[0]))))
    if best.any():
        errors, best = rows.refined(errors, best)
    return Mounting(best, errors, declared)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Columns (4, m, n, k) of all parameters without gravity, and what gravity of 1 m/s² along x, y, z adds; torque, and rows used."""

    columns: Array
    tau: Array
    used: Array
    names: tuple[str, ...]

    @classmethod
    def of(cls, problem: Problem, blocks: Iterable[Block]) -> _Rows:
        models = [Model(problem.model.robot.with_gravity(field.tolist()), problem.model.effects) for field in (np.zeros(3), *np.eye(3))]
        columns, tau, used = [], [], []
        for block in blocks:
            motion = problem.motion(block.samples)
            valid = problem.valid[block.rows]
            own = np.stack([block.reduce(model.columns(motion)) for model in models])
            columns.append(np.where(valid[:, :, None], own, 0.0))
            tau.append(np.where(valid, problem.tau[block.rows], 0.0))
            used.append(valid)
        made = np.concatenate(columns, axis=1)
        made[1:] -= made[0]
        return cls(made, np.concatenate(tau), np.concatenate(used), tuple(p.name for p in problem.model.parameters))

    def errors(self, gravity: Array) -> Array:
        """Relative error (n,) of each joint with some gravity (3,)."""
        return self._fitted(gravity)[1]

    def _fitted(self, gravity: Array) -> tuple[Array, Array]:
        information = Information.empty(self.tau.shape[1], self.names).with_rows(self._with(gravity), self.tau, self.used)
        solution, _ = reweighted(information, list(range(information.k)), iterations=_PASSES)
        values = np.zeros(information.k)
        values[solution.columns] = solution.values
        return values, information.relative_errors(values)

    def _with(self, gravity: Array) -> Array:
        return np.asarray(self.columns[0] + np.einsum("a,amnk->mnk", gravity, self.columns[1:]))

    def refined(self, errors: Array, gravity: Array) -> tuple[Array, Array]:
        """Errors and gravity where no turn of it makes them smaller."""
        size = float(np.linalg.norm(gravity))
        for _ in range(_STEPS):
            values, _ = self._fitted(gravity)
            slopes = np.einsum("amnk,k->mna", self.columns[1:], values)
            # Two directions square to gravity: its size is not told beside the masses.
            across = np.stack(tilt_axes(gravity))
            names = (*self.names, "across_1", "across_2")
            rows = np.concatenate([self._with(gravity), slopes @ across.T], axis=2)
            information = Information.empty(self.tau.shape[1], names).with_rows(rows, self.tau, self.used)
            order = [len(names) - 2, len(names) - 1, *range(len(names) - 2)]
            solution, _ = reweighted(information, order, iterations=_PASSES)
            turn = np.array([solution.values[solution.columns == len(self.names) + i].sum() for i in (0, 1)])
            after = gravity + across.T @ turn
            after *= size / np.linalg.norm(after)
            found = self.errors(after)
            if np.sum(np.log(found)) >= np.sum(np.log(errors)):
                break
            settled = float(np.linalg.norm(after - gravity)) < _SETTLED * size
            errors, gravity = found, after
            if settled:
                break
        return errors, gravity


def _direction(gravity: Array) -> str:
    """A direction in two digits: (0, 0, -1)."""
    unit = np.round(gravity / np.linalg.norm(gravity), 2) + 0.0
    return f"({', '.join(f'{x:g}' for x in unit)})"
