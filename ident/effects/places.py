"""Where an effect sits, in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .base import Effect


def place_of(effect: Effect, joints: Sequence[str] | None = None) -> str:
    """ "joint3", "joint6 (motor of joint5)"; "" for the whole robot. `joints`: instead of the effect's own."""
    return place_of_joints((effect.joints or ()) if joints is None else joints, motors_of(effect))


def place_of_joints(joints: Sequence[str], motors: Sequence[str]) -> str:
    """`place_of` from the names of joints, and of those whose motors a coupling ties in."""
    others = ", ".join(m for m in motors if m not in joints or len(motors) > 1)
    return ", ".join(joints) + (f" (motor of {others})" if others else "")


def motors_of(effect: Effect) -> tuple[str, ...]:
    """Joints whose motors an effect ties to the joints that it sits on (a coupling of gears); () for any other effect."""
    return tuple(getattr(effect, "motors", None) or ())


def on(place: str) -> str:
    """ " on joint3"; "" for the whole robot."""
    return f" on {place}" if place else ""
