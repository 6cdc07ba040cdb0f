"""Friction that falls (or rises) as the drive warms up: an exponential of the time since the run began."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..effects.base import Axis, JointEffect, Nature, Need, register
from ..effects.motion import Coordinates, Motion
from ..robots.parameters import ShapeParameter

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, kw_only=True)
class _TemperatureDrift(JointEffect):
    """Friction times e^(−t/T): T is the thermal time constant, t the run's own clock."""

    axis: ClassVar[Axis] = Axis.TIME
    nature: ClassVar[Nature] = Nature.FRICTION
    needs: ClassVar[frozenset[Need]] = frozenset({Need.TIME})

    T: float = 100.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (ShapeParameter("T", "s", 0.1, 1e5, 100.0, log=True),)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        """From a fading that a part of the run shows to one that is nearly linear over it."""
        span = float(np.ptp(motion.clock)) if len(motion) else 0.0
        return self.bounded(T=(0.03 * span, 5.0 * span))

    def decay(self, motion: Motion) -> Array:
        """e^(−t/T), (N, 1)."""
        return np.exp(-motion.clock / self.T)[:, None]


@register
@dataclass(frozen=True, kw_only=True)
class TemperatureDriftViscous(_TemperatureDrift):
    """Viscous friction that fades as the lubricant warms: τ = Fvt e^(−t/T) ω.

    Fvt: viscous friction at the start of the run less that of the warm drive."""

    name: ClassVar[str] = "temperature_drift_viscous"
    title: ClassVar[str] = "viscous friction that changes as the drive warms up"
    symbols = (("Fvt", "{tau} s/{q}", -np.inf),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield self.decay(motion) * own.dq


@register
@dataclass(frozen=True, kw_only=True)
class TemperatureDriftCoulomb(_TemperatureDrift):
    """Dry friction that fades as the drive warms: τ = Fct e^(−t/T) s(ω).

    Fct: Coulomb friction at the start of the run less that of the warm drive."""

    name: ClassVar[str] = "temperature_drift_coulomb"
    title: ClassVar[str] = "Coulomb friction that changes as the drive warms up"
    symbols = (("Fct", "{tau}", -np.inf),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield self.decay(motion) * own.direction
