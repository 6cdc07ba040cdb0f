"""What rows of the regression equation a test gives: the columns it reads, for deciding ranks."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import singular_values, svd
from ..effects.kinds import Need
from ..effects.motion import Coordinates, Motion
from ..errors import UnsupportedError
from ..robots.transmission import Side
from .trials import MotionKind

if TYPE_CHECKING:
    from ..model import Model

Array = np.ndarray
#: Singular values below this share of the largest are rounding.
_RANK = 1e-9


class RowSampler:
    """Rows of a model's base parameters (b), each column scaled by its size in motion of all joints."""

    def __init__(self, model: Model, reference: Coordinates) -> None:
        for effect in model.effects:
            if effect.needs & {Need.LOAD, Need.REFERENCE, Need.HISTORY, Need.NEIGHBOURS, Need.TORQUE}:
                raise UnsupportedError(
                    f"plan: effect {effect.name!r} depends on more than the motion at an instant; plan with the rigid body and its drives,"
                    " and diagnose further effects afterwards."
                )
        self.model, self.base = model, model.base
        rows = self.columns(reference, Side.JOINT).reshape(-1, self.base.count)
        self.scale = np.linalg.norm(rows, axis=0) / np.sqrt(len(rows))
        values = singular_values(rows / self.scale / np.sqrt(len(rows)))
        #: Smallest singular value of motion of all joints.
        self.whole = float(values[-1])

    def columns(self, motion: Coordinates, side: Side) -> Array:
        """Columns (N, n, b) on a side, not scaled."""
        robot = self.model.robot
        columns = self.model.columns(Motion.of(robot, motion.q, motion.dq, motion.ddq))[:, :, self.base.independent]
        measured = robot.transmission.measured
        return columns if side == measured else np.matmul(robot.transmission.torque_map(measured, side), columns)

    def read(self, kind: MotionKind, motion: Coordinates, row: int, side: Side) -> Array:
        """Scaled rows (N, b) that a test of some kind gives at a motion; of sweeps, `motion` is the one forward."""
        forward = self.columns(motion, side)[:, row]
        if kind == MotionKind.ACCELERATED:
            return forward / self.scale
        backward = self.columns(Coordinates(motion.q, -motion.dq, motion.ddq), side)[:, row]
        sign = 1.0 if kind == MotionKind.STATIC else -1.0
        return 0.5 * (forward + sign * backward) / self.scale


class Knowledge:
    """What the rows so far determine."""

    def __init__(self, b: int) -> None:
        self.basis = np.zeros((b, 0))

    @property
    def rank(self) -> int:
        return self.basis.shape[1]

    def news(self, rows: Array) -> tuple[Array, Array]:
        """Directions (b, g) that rows (m, b) add, and their singular values (g,) per root of a row."""
        fresh = rows - (rows @ self.basis) @ self.basis.T
        fresh = fresh - (fresh @ self.basis) @ self.basis.T
        _, s, Vt = svd(fresh / np.sqrt(len(rows)), full_matrices=False)
        size = max(float(np.linalg.norm(rows, axis=1).max(initial=0.0)), 1e-300)
        keep = s > _RANK * max(size, 1.0)
        return Vt[keep].T, s[keep]

    def learn(self, directions: Array) -> None:
        """Add directions (b, g), which are orthogonal to those known."""
        if directions.shape[1]:
            self.basis = np.linalg.qr(np.concatenate([self.basis, directions], axis=1))[0]

    def determined(self) -> Array:
        """Which parameters (b,) bool are determined alone, not only in combination with others."""
        rest = 1.0 - np.sum(self.basis**2, axis=1)
        return rest < 1e-10
