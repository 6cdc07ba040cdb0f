"""Regressors: rigid-body columns and dynamics, base reduction, closed forms.

>>> import ident
>>> import numpy as np
>>> robot = ident.load_robot("scara")
>>> ident.regressor.regressor(robot.tree, *np.zeros((3, 5, robot.n))).shape
(5, 4, 40)
"""

from __future__ import annotations

from .base_parameters.reduction import BaseReduction
from .base_parameters.structural import StructuralSet, base_set
from .rigid import bias_torque, forward_dynamics, inverse_dynamics, mass_matrix, regressor

__all__ = [
    "BaseReduction",
    "StructuralSet",
    "base_set",
    "bias_torque",
    "forward_dynamics",
    "inverse_dynamics",
    "mass_matrix",
    "regressor",
]
