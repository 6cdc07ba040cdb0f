"""Orders of what repeats with an angle: which are worth searching."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..robots.transmission import Side

if TYPE_CHECKING:
    from ..robots.robot import Robot

#: A little less than once a turn: what is found there is once a turn, known no better.
_ONCE = 0.9


def slowest_order(robot: Robot, joints: Sequence[int], side: Side) -> float:
    """Lowest order (cycles per unit of the position on `side`) of what repeats with a drive: nothing in it turns more slowly than the joint
    that it moves, and a sine of which the log holds a small part is any smooth law. 0 where one of the joints is a slide."""
    if any(robot.joints[j].prismatic for j in joints):
        return 0.0
    return min((_ONCE * (1.0 if side == Side.JOINT else abs(float(robot.transmission.K[j, j]))) for j in joints), default=0.0)
