"""Positions and velocities of which no unit is told: radians or degrees, as one tells of the other; and what is said where nothing does."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from .channel_group import ChannelGroup
from .rates import velocity_ratio

Array = np.ndarray
_DEG = np.pi / 180
#: Velocities that are so near (logarithm) to the positions' change, or to it in degrees, are that: gears have ratios about 57, too.
_NEAR = 0.03


@dataclass(frozen=True)
class Angles:
    """Factors to SI of positions and velocities; what is said behind the positions' columns, and what is noted."""

    scale: float
    rate: float
    said: str = ""
    notes: tuple[str, ...] = ()


def agreed(
    q: ChannelGroup, dq: ChannelGroup | None, scales: tuple[float, float], known: bool, t: Array | None, table: Mapping[str, Array]
) -> Angles:
    """Positions (and velocities) in the units in which one is the other's change.

    `scales`: factors as units tell them, or the positions' reach; `known`: positions are counts, or of a recorder whose units are known;
    `t`: times (N,) in s, None where they are not known."""
    told = known or bool(q.unit)
    ratio = None if dq is None or t is None or (told and dq.unit) else _times(t, table, q, dq, scales)
    scale, rate = scales
    if ratio is not None and dq is not None:
        if abs(np.log(ratio) + np.log(_DEG)) < _NEAR:  # the positions change 57 times as fast as the velocities say
            if not told and scale == 1.0:
                return Angles(_DEG, rate, " (in degrees, inferred from the velocities)")
            if not dq.unit and _same(rate, _DEG):
                return Angles(scale, 1.0, "" if told else _in_degrees(scale), (f"{dq} are in rad/s, as the change of {q} tells.",))
        if abs(np.log(ratio) - np.log(_DEG)) < _NEAR:
            if not told and dq.unit and _same(scale, _DEG):
                return Angles(1.0, rate, " (in radians, inferred from the velocities)")
            if not dq.unit and rate == 1.0:
                return Angles(
                    scale,
                    _DEG,
                    "" if told else " (in radians, inferred from the velocities)",
                    (f"{dq} are in deg/s, as the change of {q} tells.",),
                )
        if dq.unit and abs(np.log(ratio)) < _NEAR:
            return Angles(scale, rate, _in_degrees(scale))
    return Angles(scale, rate, _in_degrees(scale) if told else _untold(scale))


def _times(t: Array, table: Mapping[str, Array], q: ChannelGroup, dq: ChannelGroup, scales: tuple[float, float]) -> float | None:
    """How many times as fast as the velocities say the positions change; None where they have nothing to do with each other."""
    values = [scale * np.column_stack([np.asarray(table[c], float) for c in g.columns]) for g, scale in zip((q, dq), scales, strict=True)]
    with np.errstate(all="ignore"):
        ratio = velocity_ratio(t, *values)
    return 1.0 / ratio if np.isfinite(ratio) and ratio > 0.0 else None


def _same(a: float, b: float) -> bool:
    return abs(a - b) < 1e-12


def _in_degrees(scale: float) -> str:
    return " (in degrees)" if _same(scale, _DEG) else ""


def _untold(scale: float) -> str:
    """What is said of positions that only their reach tells a unit of, or nothing."""
    return _in_degrees(scale) or " (no unit given: taken as rad, m)"
