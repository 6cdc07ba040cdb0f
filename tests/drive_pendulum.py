"""The pendulum whose drives are tested: its robot, its declared model, and what its link weighs."""

from __future__ import annotations

import ident
from benchmarks.actuators.commanded import PENDULUM

#: Of the link about its joint (kg m²), and its weight's torque (N m) when it is level.
INERTIA, WEIGHT = 0.002 + 0.6 * 0.2**2, 0.6 * 0.2 * 9.81


def pendulum() -> ident.Robot:
    return ident.Robot.from_urdf(PENDULUM)


def model_of(robot: ident.Robot) -> ident.Model:
    """Rigid body, rotor, and friction."""
    return robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
