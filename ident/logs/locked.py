"""Joints that were declared as held still, and whose positions in a log say otherwise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .log import Log
from .names import JointNames, parse_name
from .units import expected_units, unit_of

if TYPE_CHECKING:
    from ..robots.robot import Robot

#: A joint that is so far (rad, m) from where it is locked was moved; less is its zero, or how it gives way.
_APART = 0.05


def locked_notes(log: Log, robot: Robot) -> list[str]:
    """A note for each locked joint whose column has it elsewhere than where it is locked: its links are then fitted in a wrong posture."""
    locked = JointNames.of(robot).locked
    if not locked:
        return []
    whole = JointNames(robot.whole, (False,) * len(robot.whole))
    places = robot.source.get("locked") or {}
    notes = []
    for source, recorded in log.extra.items():
        named = parse_name(source, whole)
        if named is None or named.quantity != "q" or not 0 <= named.joint < len(robot.whole):
            continue
        joint = robot.whole[named.joint]
        unit = unit_of(named.unit) if named.unit else None
        x = recorded[np.isfinite(recorded)] * (1.0 if unit is None else unit.scale)
        known = unit is None or unit.dimension in expected_units("q")
        if joint not in locked or not known or not len(x):
            continue
        place, low, high = float(places.get(joint, 0.0)), float(x.min()), float(x.max())
        if max(abs(low - place), abs(high - place)) <= _APART:
            continue
        moves = high - low > _APART
        how = f"moves from {low:.3g} to {high:.3g}" if moves else f"stands at {0.5 * (low + high):.3g}"
        remedy = "Do not lock a joint that moves." if moves else f"Lock it there (--lock {joint}={0.5 * (low + high):.4g})."
        notes.append(
            f"log {log.name}: {joint} is locked at {place:g}, but {how} in column {source!r}: the links behind it are fitted in a posture"
            f" that they did not have. {remedy}"
        )
    return notes
