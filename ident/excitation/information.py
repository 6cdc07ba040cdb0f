"""The information that a motion gives on a model's base parameters, and how it changes with the motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..effects.kinds import Need
from ..effects.motion import Coordinates, Motion
from ..effects.reference import Reference
from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..model import Model

Array = np.ndarray


class MotionInformation:
    """Columns of a model's base parameters along a sampled motion, weighted by the noise of the measured rows.

    `values` (k,): parameter values for effects that need the model's prediction, and for torque; None where there are none.
    `noise` (n,): std of the torque on the measured side, per sample."""

    def __init__(self, model: Model, values: Array | None, noise: Array) -> None:
        self.model, self.values = model, values
        self.weight = 1.0 / noise**2
        self.base = model.base
        self.keep = self.base.independent
        robot = model.robot
        self._to_joint = robot.transmission.torque_map(robot.transmission.measured, Side.JOINT)
        needs = model.needs & {Need.LOAD, Need.REFERENCE}
        self._reference = Reference(model, np.zeros(len(model.parameters)) if values is None else values) if needs else None

    def motion(self, t: Array, joint: Coordinates) -> Motion:
        """The motion with all that the effects ask for; t uniform."""
        rate = 1.0 / float(t[1] - t[0]) if len(t) > 1 else 0.0
        return self._complete(Motion.of(self.model.robot, joint.q, joint.dq, joint.ddq, t, rate=rate))

    def _complete(self, motion: Motion) -> Motion:
        return motion if self._reference is None else motion.with_reference(self._reference)

    def columns(self, motion: Motion) -> Array:
        """Columns (N, n, k) of all parameters, measured side."""
        return self.model.columns(motion)

    def matrix(self, columns: Array) -> Array:
        """Information (b, b) on the base parameters."""
        flat = (np.sqrt(self.weight)[:, None] * columns[:, :, self.keep]).reshape(-1, len(self.keep))
        return flat.T @ flat

    def joint_torque(self, columns: Array) -> Array:
        """Torque (N, n) on the joint side that the values predict."""
        assert self.values is not None
        return (columns @ self.values) @ self._to_joint.T

    def torque(self, t: Array, joint: Coordinates) -> Array:
        """Torque (N, n) on the joint side that the values predict along a motion sampled at uniform times t (N,)."""
        assert self.values is not None
        return self.model.torque(self.motion(t, joint), self.values) @ self._to_joint.T

    def torque_at_reversals(self, t: Array, joint: Coordinates) -> Array:
        """The same (K, n) beside the velocity reversals between samples, with friction in either direction: there it jumps."""
        assert self.values is not None
        sign = np.sign(joint.dq)
        before = np.flatnonzero((sign[1:] != sign[:-1]).any(axis=1))
        rows, other = np.concatenate([before, before + 1]), np.concatenate([before + 1, before])
        if not len(rows):
            return np.zeros((0, self.model.robot.n))
        there = Coordinates(joint.q[rows], joint.dq[rows], joint.ddq[rows])
        turned = self.motion(t[: len(rows)], Coordinates(joint.q[rows], joint.dq[other], joint.ddq[rows]))
        return self.model.torque(self._complete(turned.moved(self.model.robot, there)), self.values) @ self._to_joint.T

    def pull(self, motion: Motion, columns: Array, dA: Array, d_torque: Array | None) -> Coordinates:
        """Derivatives (N, n) with respect to q, dq, ddq of a scalar whose derivatives are dA (b, b) with respect to the
        information and `d_torque` (N, n) with respect to the joint-side torque.

        Columns are linear in ddq and, but for friction, quadratic in dq: those differences are exact. Signs of velocities are
        held, and so is what an effect remembers of the motion before."""
        G = np.zeros_like(columns)
        G[:, :, self.keep] = 2.0 * self.weight[:, None] * (columns[:, :, self.keep] @ dA)
        if d_torque is not None:
            assert self.values is not None
            G += (d_torque @ self._to_joint)[:, :, None] * self.values

        def scalar(joint: Coordinates) -> Array:
            moved = self._complete(motion.moved(self.model.robot, joint))
            return np.einsum("njk,njk->n", G, self.columns(moved))

        joint, n = motion.joint, self.model.robot.n
        q, dq, ddq = joint.q, joint.dq, joint.ddq
        here = np.einsum("njk,njk->n", G, columns)
        out = [np.empty_like(q) for _ in range(3)]
        for j in range(n):
            e = np.zeros(n)
            e[j] = 1.0
            h = 1e-5
            out[0][:, j] = (scalar(Coordinates(q + h * e, dq, ddq)) - scalar(Coordinates(q - h * e, dq, ddq))) / (2 * h)
            h = 1e-3
            out[1][:, j] = (scalar(Coordinates(q, dq + h * e, ddq)) - scalar(Coordinates(q, dq - h * e, ddq))) / (2 * h)
            out[2][:, j] = scalar(Coordinates(q, dq, ddq + e)) - here
        return Coordinates(out[0], out[1], out[2])
