"""Friction that falls (or rises) as the drive warms up: an exponential of the time since the run began."""

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


#: Thermal time constants of drives, s: from the winding of a small motor to the housing of a large gear.
_FASTEST, _SLOWEST = 5.0, 3600.0


def _span(motion: Motion) -> float:
    """Seconds of a run."""
    return float(np.ptp(motion.clock)) if len(motion) else 0.0


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
        """Drives warm up in seconds to an hour; what takes more than twice the run is a drift in it."""
        return self.bounded(T=(_FASTEST, min(_SLOWEST, max(2.0 * _span(motion), 1.5 * _FASTEST))))

    def could_show(self, motion: Motion, robot: Robot) -> bool:
        return 2.0 * _span(motion) > _FASTEST

    def decay(self, motion: Motion) -> Array:
        """e^(−t/T), (N, 1)."""
        return np.exp(-motion.clock / self.T)[:, None]


@register
@dataclass(frozen=True, kw_only=True)
class TemperatureDriftViscous(_TemperatureDrift):
    """Viscous friction that fades as the lubricant warms: τ = Fvt e^(−t/T) ω.

    Fvt: viscous friction at the start of the run less that of the warm drive.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.TemperatureDriftViscous(joints=("joint2",), T=100.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fvt_joint2', 'N m s/rad')]
    """

    name: ClassVar[str] = "temperature_drift_viscous"
    title: ClassVar[str] = "viscous friction that changes as the drive warms up"
    symbols = (("Fvt", "{tau} s/{q}", 0.0),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield self.decay(motion) * own.dq


@register
@dataclass(frozen=True, kw_only=True)
class TemperatureDriftCoulomb(_TemperatureDrift):
    """Dry friction that fades as the drive warms: τ = Fct e^(−t/T) s(ω).

    Fct: Coulomb friction at the start of the run less that of the warm drive.

    Examples
    --------
    >>> import ident
    >>> effect = ident.friction.TemperatureDriftCoulomb(joints=("joint2",), T=100.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('Fct_joint2', 'N m')]
    """

    name: ClassVar[str] = "temperature_drift_coulomb"
    title: ClassVar[str] = "Coulomb friction that changes as the drive warms up"
    symbols = (("Fct", "{tau}", 0.0),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield self.decay(motion) * own.direction
