"""The model's own prediction at given values, for effects that are corrections of it (SCIENCE.md 7.1: T, dτ/dK, dτ/dg, dτ/dt).

Such an effect's columns are derivatives of the prediction, so they hold near the values from which they were taken: refit,
take the prediction anew, and repeat until nothing moves (or apply the finding for good, `Effect.applied`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .transmission import Side

if TYPE_CHECKING:
    from .effect import Effect
    from .model import Model
    from .motion import Coordinates, Motion
    from .robot import Robot

Array = np.ndarray

#: Largest shift of a coordinate (rad, m) in a central difference: the error of the quotient is then about 1e-10 of the torque.
_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class Reference:
    """A model with the values (k,) of all its parameters.

    Effects of the model that are corrections themselves (`Need.REFERENCE`) are left out: a correction is taken of what the
    rest predicts."""

    model: Model
    values: Array

    def torque(self, motion: Motion, side: Side | None = None, robot: Robot | None = None) -> Array:
        """Predicted torque (N, n) on a side (the measured one if None), of the model's robot or of a perturbed one.

        The motor side of `motion` must be that of `robot` (`Motion.moved`)."""
        robot = robot or self.model.robot
        return self._sum(motion, robot, side or robot.transmission.measured, link_only=False)

    def load(self, motion: Motion, robot: Robot | None = None) -> Array:
        """Torque (N, n) that the links ask for, joint side."""
        return self._sum(motion, robot or self.model.robot, Side.JOINT, link_only=True)

    def inertia(self, motion: Motion) -> Array:
        """Inertia (N, n) that each joint moves by itself, joint side, rotor not counted: diagonal of the links' mass matrix."""
        at_rest = replace(motion.joint, dq=np.zeros_like(motion.joint.dq), ddq=np.zeros_like(motion.joint.ddq))
        still = self.load(motion.moved(self.model.robot, at_rest))
        out = np.empty_like(still)
        for j in range(out.shape[1]):
            ddq = np.zeros_like(still)
            ddq[:, j] = 1.0
            out[:, j] = (self.load(motion.moved(self.model.robot, replace(at_rest, ddq=ddq))) - still)[:, j]
        return out

    def along(self, motion: Motion, shift: Coordinates, side: Side | None = None, *, link_only: bool = False) -> Array:
        """Derivative (N, n) of the predicted torque when the joint coordinates move along `shift` (q, dq, ddq on the joint side).

        `link_only`: of the load alone. Central difference; directions of motion are held (`Coordinates.direction`)."""
        robot = self.model.robot
        largest = float(np.abs(shift.q).max(initial=0.0))
        if largest == 0.0:
            largest = max(float(np.abs(shift.dq).max(initial=0.0)), float(np.abs(shift.ddq).max(initial=0.0)))
        if largest == 0.0:
            return np.zeros_like(motion.joint.q)
        h = _STEP / largest
        own = motion.joint
        side = side or robot.transmission.measured
        ends = []
        for step in (h, -h):
            there = replace(own, q=own.q + step * shift.q, dq=own.dq + step * shift.dq, ddq=own.ddq + step * shift.ddq)
            ends.append(self._sum(motion.moved(robot, there), robot, side, link_only))
        return (ends[0] - ends[1]) / (2.0 * h)

    def _sum(self, motion: Motion, robot: Robot, side: Side, link_only: bool) -> Array:
        from .effect import Nature, Need

        chosen: list[tuple[Effect, Array]] = []
        for effect, part in zip(self.model.effects, self.model.slices, strict=True):
            values = self.values[part]
            if Need.REFERENCE not in effect.needs and values.any() and (effect.nature == Nature.LINK or not link_only):
                chosen.append((effect, values))
        if any(Need.LOAD in effect.needs for effect, _ in chosen):
            motion = motion.with_load(self.load(motion, robot))
        out = np.zeros((len(motion), robot.n))
        for effect, values in chosen:
            out += robot.transmission.torque(effect.torque(motion, robot, values), effect.side, side)
        return out
