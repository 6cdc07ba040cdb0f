"""Positions between which joints are looked at, where a URDF may bound both ends, one, or none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .joints import Joint

Array = np.ndarray


def reach(joints: Sequence[Joint], turn: float = np.pi, stroke: float = 1.0) -> tuple[Array, Array]:
    """Lower and upper (n,), finite and in order: the limits; where an end has none, `turn` rad (`stroke` m) on that side of zero, or
    twice that from the other end where zero lies beyond it."""
    lower, upper = np.empty(len(joints)), np.empty(len(joints))
    for i, joint in enumerate(joints):
        half = stroke if joint.prismatic else turn
        low, high = joint.lower, joint.upper
        if not np.isfinite(low):
            low = -half if not np.isfinite(high) or high > -half else high - 2.0 * half
        if not np.isfinite(high):
            high = half if low < half else low + 2.0 * half
        lower[i], upper[i] = low, high
    return lower, upper
