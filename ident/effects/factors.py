"""Columns that are nothing but a coordinate of a joint's own motion, as effects declare them: what compiled code can do without asking."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .base import Effect, Factor, JointEffect

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


def declares(effect: Effect) -> bool:
    """Whether the effect's columns are what its `factors` say.

    A subclass with columns of its own does not inherit what its base declared."""
    if not isinstance(effect, JointEffect) or type(effect).torque is not JointEffect.torque or effect.needs:
        return False
    if type(effect).columns is not JointEffect.columns:
        return False
    says, does = (next(kind for kind in type(effect).__mro__ if name in vars(kind)) for name in ("factors", "basis"))
    return bool(effect.factors) and says is does


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
