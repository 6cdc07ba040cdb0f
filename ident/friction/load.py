"""Friction that grows with the torque a gear transmits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effect import Axis, JointEffect, Nature, Need, register
from ..motion import Coordinates, Motion

if TYPE_CHECKING:
    from ..robot import Robot

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class LoadDependentFriction(JointEffect):
    """Dry friction in proportion to the load: τ = Fl s(ω) |τ_load|, with τ_load = Kᵀ τ of the links, as the model predicts it.

    The part of the torque that accelerates the rotor does not load the gear and is left out. Fl is what the gear loses of the
    torque it transmits. Source: SCIENCE.md 7.1. The measured torque is not used: its noise would bias Fl."""

    name: ClassVar[str] = "load_dependent_friction"
    title: ClassVar[str] = "friction that grows with load"
    axis: ClassVar[Axis] = Axis.LOAD
    nature: ClassVar[Nature] = Nature.FRICTION
    needs: ClassVar[frozenset[Need]] = frozenset({Need.LOAD})
    symbols = (("Fl", "1", 0.0),)

    def columns(self, motion: Motion, robot: Robot) -> Array:
        return super().columns(motion.behind(robot.transmission), robot)

    def torque(self, motion: Motion, robot: Robot, values: Array) -> Array:
        return super().torque(motion.behind(robot.transmission), robot, values)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield own.direction * np.abs(motion.needed_load(f"effect {self.name!r}", self.side)[:, at])
