"""Random motions within the ranges and speeds of a robot's joints."""

from __future__ import annotations

import numpy as np

from ident.model import Model
from ident.simulation.trajectory import FourierTrajectory


def fourier(model: Model, seed: int, seconds: float, speed: float, harmonics: int = 5) -> FourierTrajectory:
    """A random motion of one period over most of the joint ranges, at most `speed` times the joints' top speed."""
    robot = model.robot
    rng = np.random.default_rng(seed)
    lower = np.array([max(j.lower, -np.pi) for j in robot.joints])
    upper = np.minimum([j.upper for j in robot.joints], lower + 2 * np.pi)
    sine, cosine = rng.normal(size=(2, harmonics, robot.n))
    unit = FourierTrajectory(np.zeros(robot.n), sine, cosine, 1.0 / seconds).sample(np.linspace(0.0, seconds, 1001))
    top = np.array([j.velocity for j in robot.joints])
    scale = np.minimum(0.9 * (upper - lower) / np.ptp(unit.q, axis=0), speed * top / np.abs(unit.dq).max(axis=0))
    room = upper - lower - scale * np.ptp(unit.q, axis=0)
    centre = lower - scale * unit.q.min(axis=0) + room * rng.uniform(0.05, 0.95, robot.n)
    return FourierTrajectory(centre, scale * sine, scale * cosine, 1.0 / seconds)
