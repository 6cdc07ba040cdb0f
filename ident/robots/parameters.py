"""Parameters: their names, units and bounds. A name is unique within a model."""

from __future__ import annotations

import math
from dataclasses import dataclass

#: Pinocchio's order of a link's ten inertial parameters, about the origin of the joint frame.
LINK_SYMBOLS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
LINK_UNITS = ("kg", "kg m", "kg m", "kg m", "kg m^2", "kg m^2", "kg m^2", "kg m^2", "kg m^2", "kg m^2")


@dataclass(frozen=True)
class Parameter:
    """One linear parameter of a model.

    `name` is unique in the model (`Fv_joint1`); `joint` is the joint (or motor) it belongs to, or "" for the whole
    robot; `effect` is the name of the effect that brings it; `lower` and `upper` bound it physically (inclusive)."""

    name: str
    unit: str
    effect: str
    joint: str = ""
    lower: float = -math.inf
    upper: float = math.inf


@dataclass(frozen=True)
class ShapeParameter:
    """One nonlinear parameter of an effect: the name of the effect's field that holds it, with bounds and prior.

    `typical` is where a search starts; `log` says that the natural scale is logarithmic; `points`: of a first grid over the search
    range (0: as many as the search sees fit). `idealised`: share of itself by which the value found may be off because the law is an ideal
    one, however well it fits: part of its standard deviation."""

    name: str
    unit: str
    lower: float
    upper: float
    typical: float
    log: bool = False
    points: int = 0
    idealised: float = 0.0
