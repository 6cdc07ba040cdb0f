"""Torque offsets that change during a run: a slow drift, a sudden step."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..robots.parameters import ShapeParameter
from .joint_effect import JointEffect
from .kinds import Axis, Need
from .motion import Coordinates, Motion
from .registry import register

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class OffsetDrift(JointEffect):
    """A torque offset that grows with time: τ = rate × t, t the run's own clock.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.OffsetDrift(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('drift_joint2', 'N m/s')]
    """

    name: ClassVar[str] = "offset_drift"
    title: ClassVar[str] = "torque offset that drifts"
    axis: ClassVar[Axis] = Axis.TIME
    needs: ClassVar[frozenset[Need]] = frozenset({Need.TIME})
    symbols = (("drift", "{tau}/s", -np.inf),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield np.broadcast_to(motion.clock[:, None], own.q.shape)


@register
@dataclass(frozen=True, kw_only=True)
class OffsetStep(JointEffect):
    """A torque offset that appears at a moment: τ = step for t ≥ t_0, t the run's own clock.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.OffsetStep(joints=("joint2",), t_0=10.0)
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('step_joint2', 'N m')]
    """

    name: ClassVar[str] = "offset_step"
    title: ClassVar[str] = "torque offset that appears during the run"
    axis: ClassVar[Axis] = Axis.TIME
    needs: ClassVar[frozenset[Need]] = frozenset({Need.TIME})
    symbols = (("step", "{tau}", -np.inf),)

    t_0: float = 10.0

    def shape(self) -> tuple[ShapeParameter, ...]:
        return (step_time(),)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield np.broadcast_to(after(motion, self.t_0)[:, None], own.q.shape)

    def search_range(self, motion: Motion, robot: Robot) -> dict[str, tuple[float, float]]:
        return self.bounded(t_0=inside(motion))


def step_time() -> ShapeParameter:
    """The moment t_0 of a step."""
    return ShapeParameter("t_0", "s", 0.0, 1e6, 10.0)


def after(motion: Motion, t_0: float) -> Array:
    """1 from t_0 on, 0 before, (N,); in between for the sample whose period (half of it either side) holds t_0."""
    if motion.rate <= 0.0:
        return (motion.clock >= t_0).astype(float)
    return np.clip((motion.clock - t_0) * motion.rate + 0.5, 0.0, 1.0)


def inside(motion: Motion) -> tuple[float, float]:
    """Moments of a step that leave something of the run on both sides (5 %)."""
    if not len(motion):
        return 0.0, 0.0
    first, last = float(motion.clock.min()), float(motion.clock.max())
    return first + 0.05 * (last - first), last - 0.05 * (last - first)
