"""Logs of the test robots, simulated with noise."""

from __future__ import annotations

import numpy as np

from ident.effects.motion import Motion
from ident.effects.reference import Reference
from ident.logs.log import Log
from ident.model import Model
from ident.robots.robot import Robot
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray
RATE = 200.0
NOISE = 0.05


def recorded(robot: Robot, model: Model, values: Array, seed: int, seconds: float = 38.0, noise: float = NOISE) -> Log:
    """A log of an arm along sines, with white torque noise."""
    rng = np.random.default_rng(seed)
    order = np.arange(1, 25)
    weight = (1.0 / (4.0 + order))[:, None] * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    motion = FourierTrajectory(np.zeros(robot.n), rng.normal(size=(24, robot.n)) * weight, rng.normal(size=(24, robot.n)) * weight, 0.025)
    t = np.arange(round(seconds * RATE)) / RATE
    c = motion.sample(t)
    still = Motion.of(robot, c.q, c.dq, c.ddq, t, rate=RATE)
    tau = model.torque(still.with_reference(Reference(model, values)), values)
    tau = tau + noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    return Log("run", t, q=c.q, tau={robot.transmission.measured.value: tau})
