"""A constant torque: sensor or current offset, or the mean of an asymmetric friction."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from .joint_effect import JointEffect
from .kinds import Axis, Factor
from .motion import Coordinates, Motion
from .registry import register

Array = np.ndarray


@register
@dataclass(frozen=True, kw_only=True)
class Offset(JointEffect):
    """A constant torque on each joint: τ = offset. Confused with the gravity of a vertical axis and asymmetric friction.

    Examples
    --------
    >>> import ident
    >>> effect = ident.effects.Offset(joints=("joint2",))
    >>> [(p.name, p.unit) for p in effect.parameters(ident.load_robot("scara"))]
    [('offset_joint2', 'N m')]
    """

    name: ClassVar[str] = "offset"
    title: ClassVar[str] = "torque offset"
    axis: ClassVar[Axis] = Axis.TIME
    usual: ClassVar[bool] = True
    symbols = (("offset", "{tau}", -np.inf),)
    factors = (Factor.ONE,)

    def basis(self, own: Coordinates, motion: Motion, at: list[int]) -> Iterable[Array]:
        yield np.ones_like(own.q)
