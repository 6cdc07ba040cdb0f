"""The effect contract, and what a joint, drive, sensor or load can do beside friction; one module a family."""

from __future__ import annotations

from .base import Axis, Effect, Factor, JointEffect, Nature, Need, effect_names, effect_types, make_effect, register
from .motion import Coordinates, Motion

__all__ = [
    "Axis",
    "Coordinates",
    "Effect",
    "Factor",
    "JointEffect",
    "Motion",
    "Nature",
    "Need",
    "effect_names",
    "effect_types",
    "make_effect",
    "register",
]
