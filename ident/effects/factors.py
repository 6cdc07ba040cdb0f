"""Columns that are nothing but a coordinate of a joint's own motion, as effects declare them: what compiled code can do without asking."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .base import Effect
from .joint_effect import JointEffect
from .kinds import Factor

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


def declares(effect: Effect) -> bool:
    """Whether the effect's columns are what its `factors` say."""
    return isinstance(effect, JointEffect) and effect.declares_factors


def coefficients(effect: Effect, values: Array, robot: Robot) -> dict[Factor, Array] | None:
    """Coefficients (n,) of the torque of parameter values (k,) by factor, on the effect's side; None where it does not declare them."""
    if not declares(effect):
        return None
    assert isinstance(effect, JointEffect)
    found = {factor: np.zeros(robot.n) for factor in Factor}
    at = effect.at(robot)
    for factor, each in zip(effect.factors, np.asarray(values, float).reshape(len(at), -1).T, strict=True):
        found[factor][at] += each
    return found
