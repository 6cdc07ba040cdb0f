"""A body of known mass that a link carries in one log: what gives unknown gains their scale."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
_KEYS = ("joint", "mass", "com", "inertia")


@dataclass(frozen=True)
class Load:
    """A body that the link of `joint` carries: `mass` (kg), `com` (m, in the joint's frame), `inertia` about it (kg m², along that frame:
    Ixx, Ixy, Iyy, Ixz, Iyz, Izz), of a body without extent where it is not given."""

    joint: str
    mass: float
    com: tuple[float, float, float]
    inertia: tuple[float, ...] = (0.0,) * 6

    @classmethod
    def read(cls, where: str, table: Any, robot: Robot) -> Load:
        """From a study file's table. Raises ConfigurationError."""
        if not isinstance(table, Mapping) or set(table) - set(_KEYS) or not {"joint", "mass", "com"} <= set(table):
            raise ConfigurationError(
                f"{where}: give a table with joint, mass (kg) and com (m, three numbers), and inertia where it is known."
            )
        robot.joint_index(table["joint"])
        mass, com = _finite(table["mass"], 1, f"{where} mass"), _finite(table["com"], 3, f"{where} com")
        inertia = _finite(table.get("inertia", (0.0,) * 6), 6, f"{where} inertia")
        if not mass[0] > 0.0:
            raise ConfigurationError(f"{where} mass is {mass[0]:g} kg: give the mass that was added, above zero.")
        return cls(str(table["joint"]), mass[0], (com[0], com[1], com[2]), inertia)

    def parameters(self, robot: Robot) -> Array:
        """What it adds to the inertial parameters (10 nb,) of the robot's links, in Pinocchio's order."""
        c = np.array(self.com)
        xx, xy, yy, xz, yz, zz = self.inertia
        about = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) + self.mass * (c @ c * np.eye(3) - np.outer(c, c))
        own = [self.mass, *(self.mass * c), about[0, 0], about[0, 1], about[1, 1], about[0, 2], about[1, 2], about[2, 2]]
        out = np.zeros(10 * robot.tree.nb)
        at = 10 * [joint.name for joint in robot.tree_joints].index(self.joint)
        out[at : at + 10] = own
        return out

    def to_dict(self) -> dict[str, Any]:
        """As `[drive.by_log]` has it."""
        return {"joint": self.joint, "mass": self.mass, "com": list(self.com), "inertia": list(self.inertia)}


def _finite(value: Any, count: int, where: str) -> tuple[float, ...]:
    try:
        found = np.atleast_1d(np.array(value, float))
    except (TypeError, ValueError):
        found = np.zeros(0)
    if found.shape != (count,) or not np.isfinite(found).all():
        raise ConfigurationError(f"{where}: give {'a number' if count == 1 else f'{count} numbers'}.")
    return tuple(float(x) for x in found)
