"""Feed-forward torque of an identified model as what code in any language needs: tables of the tree, terms of joints and motors.

τ = to_measured_joint (Wᵀ τ_tree + terms of joints) + to_measured_motor (terms of motors)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Effect
from ..effects.kinds import Nature
from ..effects.rigid_body import RigidBody
from ..errors import UnsupportedError
from ..robots.transmission import Side
from .formulas import bound, formulas_of, printed

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .identified import Identified

Array = np.ndarray


@dataclass(frozen=True)
class TorqueTerm:
    """One product of a value and a formula, on joint (or motor) `j` of a side; `link`: whether it is of what loads the gear."""

    side: Side
    j: int
    value: float
    formula: str
    names: dict[str, str]
    link: bool

    def text(self, power: str) -> str:
        """As code. `power`: how x to the y is written."""
        return f"{self.value!r} * {printed(self.formula, self.names, power)}"


@dataclass(frozen=True, eq=False)
class TorqueCode:
    """`inertial` (nb, 10) of the tree's links; `terms` of everything else."""

    robot: Robot
    inertial: Array
    terms: tuple[TorqueTerm, ...]

    @classmethod
    def of(cls, found: Identified) -> TorqueCode:
        """Raises UnsupportedError for effects that declare no formula, and a floating base."""
        robot = found.robot
        if robot.tree.floating:
            raise UnsupportedError("code can be exported for robots on a fixed base only.")
        inertial = np.zeros(10 * robot.tree.nb)
        terms: list[TorqueTerm] = []
        for effect, part in zip(found.model.effects, found.model.slices, strict=True):
            if isinstance(effect, RigidBody):
                inertial = inertial + found.values[part]
            elif effect.nature != Nature.SENSOR or formulas_of(effect):
                terms += _terms(effect, found.values[part], robot)
            else:
                raise _no_formula(effect)
        if found.law is not None:
            back = [(j, float(x)) for j, x in enumerate(found.law.back_emf) if x]
            terms += [TorqueTerm(Side.JOINT, j, x, "dq", {"dq": f"dq[{j}]"}, False) for j, x in back]
        return cls(robot, inertial.reshape(-1, 10), tuple(terms))

    @property
    def name(self) -> str:
        """The robot's name as an identifier."""
        word = re.sub(r"\W", "_", self.robot.name, flags=re.ASCII)
        return f"_{word}" if not word or word[0].isdigit() else word

    @property
    def loads(self) -> bool:
        """Whether a term follows the load of the gears."""
        return any("load" in term.formula for term in self.terms)

    def side(self, side: Side, *, link: bool) -> list[TorqueTerm]:
        return [term for term in self.terms if term.side == side and term.link == link]

    def tables(self, number: Callable[[Array], str]) -> Iterator[tuple[str, str, Array]]:
        """Name, text and values of each table."""
        tree, transmission = self.robot.tree, self.robot.transmission
        measured = transmission.measured
        zero = transmission.K_inverse @ transmission.zero
        arrays = {
            "ROTATION": tree.rotation.reshape(-1, 9),
            "TRANSLATION": tree.translation,
            "AXIS": tree.axis,
            "LINK": self.inertial,
            "GRAVITY": tree.gravity,
            "TREE": self.robot.loop.W,
            "TREE_ZERO": self.robot.loop.offset,
            "MOTOR": transmission.K_inverse,
            "MOTOR_ZERO": zero,
            "LOAD_MOTOR": transmission.torque_map(Side.JOINT, Side.MOTOR),
            "JOINT_MEASURED": transmission.torque_map(Side.JOINT, measured),
            "MOTOR_MEASURED": transmission.torque_map(Side.MOTOR, measured),
        }
        if not self.loads:
            del arrays["LOAD_MOTOR"]
        for name, values in arrays.items():
            yield name, number(np.asarray(values, float)), np.asarray(values, float)


def _terms(effect: Effect, values: Array, robot: Robot) -> list[TorqueTerm]:
    formulas = formulas_of(effect)
    if not formulas:
        raise _no_formula(effect)
    at = effect.at(robot)
    each = np.asarray(values, float).reshape(len(at), len(formulas))
    link = effect.nature == Nature.LINK
    return [
        TorqueTerm(effect.side, j, float(value), formula, bound(effect, j, robot), link)
        for j, row in zip(at, each, strict=True)
        for value, formula in zip(row, formulas, strict=True)
        if value != 0.0
    ]


def _no_formula(effect: Effect) -> UnsupportedError:
    return UnsupportedError(
        f"effect {effect.name!r} declares no formula, so it cannot be written as code: fit a model without it, or give it `formulas`"
        " (docs/extend.md)."
    )
