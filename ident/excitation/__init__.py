"""Exciting trajectories: motion within limits that reveals a model's parameters best (Swevers et al., 1997)."""

from __future__ import annotations

from .approach import NoWay
from .clearance import Clearance
from .design import excite, random_excitation, tell_apart
from .families import BSplineFamily, Family, FourierFamily
from .limits import Limits
from .noise import sample_noise
from .objective import Both, ConditionNumber, DOptimality, Measure, condition_number
from .result import Excitation
from .surroundings import Safety, Surroundings

__all__ = [
    "BSplineFamily",
    "Both",
    "Clearance",
    "ConditionNumber",
    "DOptimality",
    "Excitation",
    "Family",
    "FourierFamily",
    "Limits",
    "Measure",
    "NoWay",
    "Safety",
    "Surroundings",
    "condition_number",
    "excite",
    "random_excitation",
    "sample_noise",
    "tell_apart",
]
