"""Torques of any form, with states of their own: what simulation takes beside a model's effects, and what effects with memory bring."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Protocol, runtime_checkable

import numpy as np

from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .motion import Motion

Array = np.ndarray


class ForceModel(ABC):
    """A torque that loads the drive, like an effect's, but of any form and with states of its own if it needs them.

    Subclass it (a frozen dataclass is best) and pass instances to `Plant(extra=...)`. All arrays have one row per parallel
    run (B). The torque has the sign of an effect's: what the drive must supply for it. It may jump where a speed on its side
    changes sign (dry friction); simulation finds this and treats standstill properly. States integrate with the motion
    through `rate`, or, where they follow the path and not the clock (a bristle, a memory), through `carried`."""

    #: The side on which the torque acts.
    side: Side = Side.MOTOR

    @abstractmethod
    def torque(self, motion: Motion, state: Array, robot: Robot) -> Array:
        """Torque (B, n) on `side` at the motion (B rows) and the own states (B, s)."""

    def start(self, motion: Motion, robot: Robot) -> Array:
        """Own states (B, s) at the start; none by default."""
        return np.zeros((len(motion), 0))

    def rate(self, motion: Motion, state: Array, robot: Robot) -> Array:
        """Time derivative (B, s) of the own states."""
        return np.zeros_like(state)

    def carried(self, before: Motion, state: Array, now: Motion, robot: Robot) -> Array | None:
        """Own states (B, s) after the path from `before`, where they were `state`, to `now`; None where `rate` says it.

        Called for every stage of an integration step, always from the step's start."""
        return None


@runtime_checkable
class Simulated(Protocol):
    """An effect with memory: it brings its own forward model, for the values (k,) of its linear parameters."""

    def force_model(self, robot: Robot, values: Array) -> ForceModel:
        """The force that these values of the effect's parameters make."""
