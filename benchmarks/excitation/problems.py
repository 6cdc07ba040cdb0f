"""Random problems of excitation, by number: an arm, its surroundings, its limits, and what the motion is to be."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ident import Robot, load_robot
from ident.excitation import BSplineFamily, Family, FourierFamily, Limits, Surroundings
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.model import Model
from ident.robots import nominal_values

from .check import Checker, box_mesh

Array = np.ndarray
ARMS = ("ur5", "panda", "iiwa14", "talos_left_arm")
#: Where an arm's base stands: range of the height of the ground in its frame, and half-width of the room about it (m).
_GROUND = {"ur5": (-0.1, 0.0), "panda": (-0.1, 0.0), "iiwa14": (-0.1, 0.0), "talos_left_arm": (-0.8, -0.4)}
_ROOM = {"ur5": (0.8, 1.3), "panda": (0.8, 1.3), "iiwa14": (0.8, 1.3), "talos_left_arm": (0.6, 1.0)}
_JOINTS = {
    "panda": [f"panda_joint{i}" for i in range(1, 8)],
    "talos_left_arm": [f"arm_left_{i}_joint" for i in range(2, 8)],
}


@cache
def robot_of(arm: str) -> Robot:
    if arm == "iiwa14":
        return Robot.from_urdf(Path(__file__).with_name("iiwa14.urdf"))
    return load_robot(arm, joints=_JOINTS.get(arm))


@dataclass(frozen=True, eq=False)
class ExcitationProblem:
    """One problem: what `ident.excite` is asked, and for the checker the friction and rotors that it knows, and a box that stands there."""

    number: int
    arm: str
    model: Model
    values: Array
    drive: Array
    limits: Limits
    room: Surroundings
    box: tuple[Array, Array] | None
    family: Family
    posture: Array | None
    present: Array | None

    @property
    def asked(self) -> dict[str, Any]:
        """Arguments of `ident.excite`."""
        return {"limits": self.limits, "values": self.values, "family": self.family, "posture": self.posture}


def problem(number: int, folder: Path) -> ExcitationProblem:
    """Problem `number`; its obstacle is written to `folder`."""
    arm = ARMS[number % len(ARMS)]
    rng = np.random.default_rng(10_000 + number)
    robot = robot_of(arm)
    n = robot.n
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    effort = np.array([j.effort for j in robot.joints])
    drive = np.stack([rng.uniform(0.0005, 0.002, n), rng.uniform(0.005, 0.02, n), rng.uniform(0.01, 0.04, n)]) * effort
    values = nominal_values(model)
    for row, name in zip(drive, ("rotor_inertia", "viscous", "coulomb"), strict=True):
        (part,) = [s for e, s in zip(model.effects, model.slices, strict=True) if e.name == name]
        values[part] = row
    share = float(rng.uniform(0.5, 0.95))
    speed = np.array([j.velocity for j in robot.joints])
    limits = Limits.of(
        robot,
        share=share,
        acceleration=speed * rng.uniform(2.0, 6.0),
        jerk=speed * rng.uniform(15.0, 60.0) if rng.random() < 0.5 else None,
    )
    duration = float(rng.uniform(5.0, 9.0))
    family: Family = (
        FourierFamily(duration, int(rng.integers(3, 6))) if rng.random() < 0.7 else BSplineFamily(duration, int(rng.integers(8, 15)))
    )
    ground = float(rng.uniform(*_GROUND[arm]))
    bounds = None
    if rng.random() < 0.4:
        x, y = rng.uniform(*_ROOM[arm], (2, 2))
        bounds = ((-x[0], x[1]), (-y[0], y[1]), (ground - 0.01, float(rng.uniform(*_ROOM[arm])) + 0.3))
    box, files = None, []
    if rng.random() < 0.4:
        angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.45, 0.8)
        half = rng.uniform(0.05, 0.2, 3)
        box = np.array([away * np.cos(angle), away * np.sin(angle), ground + half[2]]), half
        files = [box_mesh(folder / f"box{number}.stl", *box)]
    room = Surroundings(ground=ground, box=bounds, clearance=float(rng.uniform(0.005, 0.05)), obstacles=files)
    checker = Checker(arm, robot, room, box)
    postures = [checker.clear_posture(rng, limits) if rng.random() < 0.3 else None for _ in range(2)]
    return ExcitationProblem(number, arm, model, values, drive, limits, room, box, family, *postures)
