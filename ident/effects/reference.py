"""The model's own prediction at given values, for effects that are corrections of it: T, dτ/dK, dτ/dg, dτ/dt.

Such an effect's columns are derivatives of the prediction, so they hold near the values from which they were taken: refit,
take the prediction anew, and repeat until nothing moves (or apply the finding for good, `Effect.applied`)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..robots.transmission import Side
from .kinds import Nature, Need

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .base import Effect
    from .composed import ComposedModel
    from .motion import Motion

Array = np.ndarray

#: Shifts (SI) in central differences. Of position: fine enough for a ripple of hundreds of cycles a motor turn. The links' torque is
#: quadratic in velocities and linear in accelerations, where longer steps are exact and quieter.
_STEPS = {"q": 1e-6, "dq": 1e-5, "ddq": 1e-3}


@dataclass(frozen=True, eq=False)
class Reference:
    """A model with the values (k,) of all its parameters.

    Effects of the model that are corrections themselves (`Need.REFERENCE`) are left out: a correction is taken of what the
    rest predicts."""

    model: ComposedModel
    values: Array

    def values_of(self, effect: Effect, robot: Robot) -> Array:
        """Values (k,) that the parameters of a correction have here; zero where the model does not hold it. A correction that is not
        linear in its size takes its columns there."""
        names = self.model.names
        found = [names.index(p.name) if p.name in names else -1 for p in effect.parameters(robot)]
        return np.array([self.values[i] if i >= 0 else 0.0 for i in found])

    def of_robot(self, robot: Robot) -> Reference:
        """The same values for another robot."""
        return replace(self, model=self.model.of_robot(robot))

    def torque(self, motion: Motion, side: Side | None = None) -> Array:
        """Predicted torque (N, n) on a side (the measured one if None)."""
        return self.part(motion, side)

    def load(self, motion: Motion, robot: Robot | None = None) -> Array:
        """Torque (N, n) that the links ask for, joint side, of the model's robot or of a perturbed one."""
        return self.part(motion, Side.JOINT, robot, link_only=True)

    def gravity(self, motion: Motion, gravity: Array) -> Array:
        """Torque (N, n) of the links, joint side, in a field of `gravity` (3,) alone; linear in it."""
        robot = self.model.robot
        still = np.zeros_like(motion.joint.q)
        at_rest = motion.moved(robot, replace(motion.joint, dq=still, ddq=still))
        there, nowhere = robot.with_gravity(gravity.tolist()), robot.with_gravity((0.0, 0.0, 0.0))
        return self.load(at_rest, there) - self.load(at_rest, nowhere)

    def inertia(self, motion: Motion, direction: Array) -> Array:
        """Inertia (N,) of the links, rotors not counted, against moving all joints along `direction` (n,): dᵀ M d."""

        def compute() -> Array:
            robot = self.model.robot
            still = np.zeros_like(motion.joint.q)
            rates = [still, np.broadcast_to(direction, still.shape)]
            torque = [self.load(motion.moved(robot, replace(motion.joint, dq=still, ddq=ddq))) for ddq in rates]
            return (torque[1] - torque[0]) @ direction

        return motion.remembered(("inertia", self, direction.tobytes()), compute)

    def sensitivity(self, motion: Motion, direction: Array, *, link_only: bool = False, acting: Side | None = None) -> Array:
        """Derivatives of the predicted torque (measured side), of the load alone (joint side), or of what acts on one side alone (on that
        side), when the joints' positions, velocities, accelerations move along `direction` (n,): (3, N, n).

        Central differences; directions of motion are held (`Coordinates.direction`)."""

        def compute() -> Array:
            robot, own = self.model.robot, motion.joint
            side = acting or (Side.JOINT if link_only else robot.transmission.measured)
            slopes = []
            for name, h in _STEPS.items():
                ends = []
                for step in (h, -h):
                    there = replace(own, **{name: getattr(own, name) + step * direction})
                    ends.append(self.part(motion.moved(robot, there), side, link_only=link_only, acting=acting))
                slopes.append((ends[0] - ends[1]) / (2.0 * h))
            return np.stack(slopes)

        return motion.remembered(("sensitivity", self, direction.tobytes(), link_only, acting), compute)

    def along(
        self,
        motion: Motion,
        direction: Array,
        shift: tuple[Array, Array, Array],
        *,
        link_only: bool = False,
        acting: Side | None = None,
    ) -> Array:
        """First-order change (N, n) of what `sensitivity` differentiates when the joints move away along `direction` (n,) by `shift`:
        a distance and its two time derivatives, (N,) each."""
        slopes = self.sensitivity(motion, direction, link_only=link_only, acting=acting)
        return np.einsum("snj,sn->nj", slopes, np.stack(shift))

    def part(
        self, motion: Motion, side: Side | None = None, robot: Robot | None = None, *, link_only: bool = False, acting: Side | None = None
    ) -> Array:
        """Predicted torque (N, n) on `side` (the measured one if None) of some of the effects, of the model's robot or of a perturbed one.

        `link_only`: those of the links; `acting`: those that act on that side. The motor side of `motion` must be that of
        `robot` (`Motion.moved`)."""
        robot = robot or self.model.robot
        side = side or robot.transmission.measured
        chosen: list[tuple[Effect, Array]] = []
        for effect, columns in zip(self.model.effects, self.model.slices, strict=True):
            values = self.values[columns]
            if Need.REFERENCE in effect.needs or not values.any():
                continue
            if (effect.nature == Nature.LINK or not link_only) and acting in (None, effect.side):
                chosen.append((effect, values))
        if motion.load is None and any(Need.LOAD in effect.needs for effect, _ in chosen):
            motion = motion.with_load(self.load(motion, robot))
        out = np.zeros((len(motion), robot.n))
        for effect, values in chosen:
            out += robot.transmission.torque(effect.torque(motion, robot, values), effect.side, side)
        return out
