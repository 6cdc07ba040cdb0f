"""What is known of a declared model from before, where new logs are watched: its parameters with their doubt, and what may change."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..effects.kinds import Nature
from .thresholds import BOUND

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..robots.robot import Robot

Array = np.ndarray
Kind = tuple[str, tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Known:
    """`rows` (k, b) over the declared model's base parameters p, and `told` (k,): told = rows p + noise of unit variance.

    `own`: for each of the model's effects, at each of its places, the effect whose parameters are their change. `before`: by the name of
    a parameter, the value that it adds to, with its standard deviation. `contained`: kinds of which the model's parameters hold
    a part already, so that more or less of it are both possible."""

    rows: Array = field(repr=False)
    told: Array = field(repr=False)
    own: tuple[tuple[Effect, tuple[str, ...]], ...] = ()
    before: Mapping[str, tuple[float, float]] = field(default_factory=dict, repr=False)
    contained: frozenset[Kind] = frozenset()

    def holds(self, effect: Effect) -> bool:
        """Whether an effect is a change of one of the model's own, whose shape is what it was."""
        return any(effect.name == e.name and joints_of(effect) == joints_of(e) for e, _ in self.own)

    def own_parts(self, effect: Effect) -> list[tuple[Effect, tuple[str, ...]]]:
        """The changes of the model's own that an effect is another name of: friction that its friction holds already. None for others."""
        joints = joints_of(effect)
        if effect.nature != Nature.FRICTION or (effect.name, joints) not in self.contained:
            return []
        return [(e, at) for e, at in self.own if e.nature == Nature.FRICTION and at == joints]

    def can_be(self, effect: Effect, robot: Robot, values: Array, std: Array) -> bool | None:
        """Whether values (k,) of an effect can be: of a change, whether what was and the change together can. None: not known better here
        than by the effect's own bounds."""
        if not self.holds(effect):
            kind = (effect.name, joints_of(effect))
            return not effect.implausible(robot, values, std) if kind in self.contained else None
        for p, v, s in zip(effect.parameters(robot), values, std, strict=True):
            if (name := p.name.replace("+", "")) in self.before:
                value, doubt = self.before[name]
                reach = BOUND * float(np.hypot(s, doubt))
                if not p.lower - reach <= value + v <= p.upper + reach:
                    return False
        return True


def joints_of(effect: Effect) -> tuple[str, ...]:
    """Joints that an effect sits on, () for all or for the whole robot."""
    return effect.joints or ()
