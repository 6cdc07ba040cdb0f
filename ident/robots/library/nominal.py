"""Nominal drive parameters of a built-in robot, and with them the full parameter vector of a model: the truth of simulations."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ...errors import ConfigurationError
from ..parameters import LINK_SYMBOLS
from ..transmission import Side
from .folders import built_in_names, robot_folder

if TYPE_CHECKING:
    from ..parameters import Parameter
    from ..robot import Robot

Array = np.ndarray


class _Part(Protocol):
    """An effect, as far as its values may be known: its kind and its side."""

    @property
    def name(self) -> str: ...

    @property
    def side(self) -> Side: ...


class NamedParameters(Protocol):
    """A model, as far as its parameters' names go."""

    @property
    def robot(self) -> Robot: ...

    @property
    def effects(self) -> Sequence[_Part]: ...

    @property
    def slices(self) -> Sequence[slice]: ...

    @property
    def parameters(self) -> Sequence[Parameter]: ...

    @property
    def names(self) -> Sequence[str]: ...


@dataclass(frozen=True, eq=False)
class DriveParameters:
    """Drive parameters by symbol, each (n,), as the effects name them: `Ia` rotor inertia, `Fv` viscous and `Fc` Coulomb
    friction. They refer to `side`; `joints` are the joints (motors) in order; `units`: symbol → unit."""

    joints: tuple[str, ...]
    side: str
    values: Mapping[str, Array]
    units: Mapping[str, str]
    source: str


def drive_parameters(name: str) -> DriveParameters:
    """Nominal drive parameters of a built-in robot. Raises ConfigurationError where none are known."""
    file = robot_folder(name) / "drive.json"
    if not file.is_file():
        raise ConfigurationError(f"no drive parameters are known for robot {name!r}; give rotor inertia and friction yourself.")
    data = json.loads(file.read_text(encoding="utf-8"))
    values = {symbol: np.array(column, float) for symbol, column in data["values"].items()}
    return DriveParameters(tuple(data["joints"]), data["side"], values, data["units"], data["source"])


def nominal_values(model: NamedParameters, drive: DriveParameters | None = None) -> Array:
    """Values (k,) of all parameters of a model: inertial ones from the robot's URDF, drive ones from `drive` (by default those of the
    built-in robot it was loaded as, else viscous and Coulomb friction of the URDF's <dynamics>), zero for whatever is not known.

    Raises ConfigurationError where the URDF has no inertials, or the drive parameters are of another robot."""
    robot = model.robot
    if robot.nominal is None:
        raise ConfigurationError(f"the URDF of robot {robot.name!r} has no inertials; there are no nominal values.")
    known = {
        f"{symbol}_{joint.name}": value
        for joint, link in zip(robot.tree_joints, robot.nominal.reshape(-1, len(LINK_SYMBOLS)), strict=True)
        for symbol, value in zip(LINK_SYMBOLS, link, strict=True)
    }
    if drive is None and "robot" in robot.source:
        name = str(robot.source["robot"])
        drive = drive_parameters(name) if name in built_in_names() else None
    if drive is not None:
        known |= {
            f"{symbol}_{joint}": value for symbol, column in drive.values.items() for joint, value in zip(drive.joints, column, strict=True)
        }
    else:
        known |= _declared_friction(model)
    return np.array([known.get(name, 0.0) for name in model.names])


def _declared_friction(model: NamedParameters) -> dict[str, float]:
    """Parameter → value of viscous and Coulomb friction from the URDF's <dynamics>, which are of the joint side. Motors that share joints
    have none there: a URDF cannot say how such friction is divided. Where a model has a kind twice on a joint, the first one takes it."""
    robot, found, given = model.robot, dict[str, float](), set[tuple[str, str]]()
    ratio = np.abs(np.diagonal(robot.transmission.K))
    for effect, part in zip(model.effects, model.slices, strict=True):
        if effect.name not in ("viscous", "coulomb") or (effect.side == Side.MOTOR and not robot.transmission.is_diagonal):
            continue
        for parameter in model.parameters[part]:
            j = robot.joint_index(parameter.joint)
            k = ratio[j] if effect.side == Side.MOTOR else 1.0
            value = robot.joints[j].damping * k**2 if effect.name == "viscous" else robot.joints[j].friction * k
            if (effect.name, parameter.joint) not in given:
                found[parameter.name] = float(value)
            given.add((effect.name, parameter.joint))
    return found
