"""Friction that grows with the torque a gear transmits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.joint_effect import JointEffect
from ..effects.kinds import Axis, Nature, Need
from ..effects.motion import Coordinates, Motion
from ..effects.registry import register
from ..robots.parameters import ShapeParameter

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: A gear that loses more than this share of the torque it transmits next to locks itself; what a diagnosis finds so is something else
#: that grows with load (a drive that lets small torque fall under the table).
_LOCKS = 0.5


@register
@dataclass(frozen=True, kw_only=True)
class LoadDependentFriction(JointEffect):
    """Dry friction in proportion to the load: τ = Fl s(ω) |τ_load − rotor dω/dt|, τ_load = Kᵀ τ of the links as predicted.

    Fl is what the gear loses of the torque it transmits. The torque that accelerates the rotor does not load the gear; where
    base parameters have joined rotor and link inertia (a first joint), the prediction holds it too, and `rotor` (inertia on
    `side`) takes it out again. The measured torque is not used: its noise would bias Fl.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.LoadDependentFriction(joints=("joint2",), rotor=0.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fl_joint2', '1')]
    """

    name: ClassVar[str] = "load_dependent_friction"
    title: ClassVar[str] = "friction that grows with load"
    axis: ClassVar[Axis] = Axis.LOAD
    nature: ClassVar[Nature] = Nature.FRICTION
    needs: ClassVar[frozenset[Need]] = frozenset({Need.LOAD})
    symbols = (("Fl", "1", 0.0),)
    formulas = ("sgn(dq) * abs(load - rotor * ddq)",)

    rotor: float = 0.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("rotor", "kg m^2 (kg)", 0.0, 1e4, 0.0),)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """From none to what the accelerations and the load leave room for."""
        if motion.load is None:
            return self.bounded()
        at = self.at(robot)
        load = motion.behind(robot.transmission).needed_load(f"effect {self.name!r}", self.side)[:, at]
        ddq = motion.on(self.side).ddq[:, at]
        moved = np.sum(ddq**2, axis=0)
        room = np.divide(np.abs(np.sum(load * ddq, axis=0)), moved, out=np.zeros_like(moved), where=moved > 0)
        return self.bounded(rotor=(0.0, float(room.max(initial=0.0))))

    def implausible(self, robot: Robot, values: Array, std: Array) -> str:
        """Why it cannot be: friction next to as large as the load itself."""
        off = np.flatnonzero(np.asarray(values) > _LOCKS + 3.0 * np.asarray(std))
        return f"a gear that loses {float(np.asarray(values)[off[0]]):.3g} of its load next to locks" if len(off) else ""

    def columns(self, motion: Motion, robot: Robot) -> Array:
        return super().columns(motion.behind(robot.transmission), robot)

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        return super().torque(motion.behind(robot.transmission), robot, values)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        load = motion.needed_load(f"effect {self.name!r}", self.side)[:, at]
        yield own.direction * np.abs(load - self.rotor * own.ddq)
