"""Base parameters as a linear map of all parameters: the one result type of the closed forms and of the structural set."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..._utils.singular_values import pinv
from .expressions import expression, link_parameter_names

if TYPE_CHECKING:
    from ...robots.robot import Robot

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class BaseForm:
    """b base parameters: values = matrix @ inertia + rotor_matrix @ rotor.

    `matrix` (b, 10 nb): coefficients of the link parameters, in Pinocchio's order per moving body, in the frames of the URDF;
    nb counts the bodies of the tree, so dependent joints of a loop are included, and a free-flyer is body 0.
    `rotor_matrix` (b, n): coefficients of the motors' reflected inertias (kg m^2, motor side), zero where they were not asked for.
    `names` (b,): short names; `expressions` (b,): readable combinations. `count_formula`: how b comes about.
    `parameters` (10 nb,), `rotors` (n,): names of the columns. `robot`, `method`: whose set it is, and what found it. `notes`: what to
    know about it."""

    robot: Robot
    method: str
    matrix: Array
    rotor_matrix: Array
    names: tuple[str, ...]
    count_formula: str
    parameters: tuple[str, ...]
    rotors: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of base parameters."""
        return len(self.matrix)

    @property
    def full(self) -> Array:
        """(b, 10 nb + n): link and rotor columns side by side."""
        return np.hstack([self.matrix, self.rotor_matrix])

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns of `full`."""
        return self.parameters + self.rotors

    def values(self, inertia: Array, rotor: Array | None = None) -> Array:
        """Base values (b,) from link parameters (10 nb,) and reflected rotor inertias (n,), zero if not given."""
        linked = self.matrix @ np.asarray(inertia, float)
        return linked if rotor is None else linked + self.rotor_matrix @ np.asarray(rotor, float)

    @cached_property
    def expressions(self) -> tuple[str, ...]:
        """Each base parameter as a combination of link parameters (and rotor inertias), in words of `.expressions`."""
        columns = self.columns
        return tuple(expression(row, columns) for row in self.full)

    @cached_property
    def lift(self) -> Array:
        """(10 nb + n, b), the smallest right inverse of `full`: lift @ values are parameters of the same dynamics, not physical ones."""
        full = self.full
        scale = 1.0 / np.maximum(np.linalg.norm(full, axis=1), 1e-300)
        inverse: Array = pinv(full * scale[:, None], rcond=1e-14) * scale
        return inverse


def body_names(robot: Robot) -> tuple[str, ...]:
    """Names of the moving bodies: that of the joint that moves each; a free-flyer's body is "base"."""
    return (("base",) if robot.floating_base else ()) + tuple(j.name for j in robot.tree_joints)


def rotor_names(robot: Robot) -> tuple[str, ...]:
    """Names of the reflected rotor inertias, one a motor."""
    return tuple(f"Ia_{name}" for name in robot.joint_names)


def make_form(
    robot: Robot, method: str, names: tuple[str, ...], matrix: Array, count_formula: str, notes: tuple[str, ...] = ()
) -> BaseForm:
    """A form without rotor inertia."""
    parameters = link_parameter_names(body_names(robot))
    rotor = np.zeros((len(matrix), robot.n))
    return BaseForm(robot, method, matrix, rotor, names, count_formula, parameters, rotor_names(robot), notes)
