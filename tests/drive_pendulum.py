"""The pendulum whose drives are tested: its robot, its declared model, what its link weighs, and lanes of it and of coupled joints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

import ident
from benchmarks.actuators.commanded import PENDULUM
from ident.drives import DriveFit
from ident.drives.links import KnownLinks

Array = np.ndarray
LANES = 4

#: Of the link about its joint (kg m²), and its weight's torque (N m) when it is level.
INERTIA, WEIGHT = 0.002 + 0.6 * 0.2**2, 0.6 * 0.2 * 9.81


def pendulum() -> ident.Robot:
    return ident.Robot.from_urdf(PENDULUM)


def model_of(robot: ident.Robot) -> ident.Model:
    """Rigid body, rotor, and friction."""
    return robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()


def written(folder: Path, logs: dict[str, ident.Log]) -> None:
    """The pendulum's URDF, and its logs as `name`.csv."""
    (folder / "pendulum.urdf").write_text(PENDULUM)
    for name, log in logs.items():
        rows = np.column_stack([log.t, log.q, log.extra["q_cmd1"]])
        np.savetxt(folder / f"{name}.csv", rows, delimiter=",", header="time_s,q1_rad,q_cmd1_rad", comments="")


def astray(fit: DriveFit, truth: Mapping[str, float]) -> list[str]:
    """Names of what a fit does not determine, or determines more than four standard deviations from the truth."""
    at = {name: fit.names.index(name) for name in truth}
    return [name for name, true in truth.items() if not abs(fit.values[at[name]] - true) < 4.0 * _std(fit, at[name])]


def _std(fit: DriveFit, i: int) -> float:
    """NaN where there is none."""
    std = float(fit.determination.std[i])
    return std if np.isfinite(std) else np.nan


class CoupledLinks:
    """Joints under inertia that couples them, and weights."""

    def __init__(self, inertia: Array) -> None:
        self.inertia = inertia

    def terms(self, q: Array, dq: Array) -> tuple[Array, Array]:
        return self.inertia, 0.5 * np.sin(q) + 0.01 * dq


def lanes_of(joints: int, rng: np.random.Generator) -> tuple[KnownLinks | CoupledLinks, Callable[[float], Array]]:
    """Links of one joint, or coupled ones of several; and random values (lanes, joints) about a size."""
    root = 0.3 * rng.normal(size=(LANES, joints, joints))
    inertia = root @ np.swapaxes(root, 1, 2) / joints + 0.05 * np.eye(joints)
    robot = pendulum()
    links = KnownLinks(robot, robot.nominal) if joints == 1 else CoupledLinks(inertia)
    return links, lambda size: size * rng.uniform(0.5, 1.5, (LANES, joints))
