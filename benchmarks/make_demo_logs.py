"""Makes the logs that `ident demo` reads: a PUMA 560 in closed loop, simulated with friction, coupled wrist, encoders and noise.

    python -m benchmarks.make_demo_logs FOLDER

The truth is the built-in robot's nominal (physically consistent) parameters; the controller is a PD with rigid feedforward at
1 kHz; 5 ms sampling; encoders of 1000 counts a motor turn; torque noise of 2 % of each motor's own torque, white."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import ident
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import nominal_values
from ident.simulation.simulate import Plant, Sensors, simulate_batch
from ident.simulation.trajectory import FourierTrajectory

RATE = 200.0
SECONDS = 40.0
PERIODS = 3
HARMONICS = 6


def motion(robot: ident.Robot, seed: int) -> FourierTrajectory:
    """Random Fourier motion over most of the joint ranges (half a turn each way where they are wider)."""
    rng = np.random.default_rng(seed)
    lower = np.array([j.lower for j in robot.joints])
    upper = np.array([j.upper for j in robot.joints])
    middle, half = (lower + upper) / 2, np.minimum((upper - lower) / 2, np.pi)
    sine, cosine = rng.normal(size=(2, HARMONICS, robot.n))
    unit = FourierTrajectory(np.zeros(robot.n), sine, cosine, PERIODS / SECONDS, PERIODS)
    q = unit.sample(np.arange(0.0, SECONDS, 0.01)).q
    scale = 0.9 * 2 * half / np.ptp(q, axis=0)
    centre = middle - scale * (q.max(axis=0) + q.min(axis=0)) / 2
    return FourierTrajectory(centre, scale * sine, scale * cosine, PERIODS / SECONDS, PERIODS)


def main(folder: Path) -> None:
    """Simulate and write both logs."""
    robot = ident.load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    values = nominal_values(model)
    desired = [motion(robot, seed) for seed in (1, 2)]
    first = desired[0].sample(np.arange(0.0, SECONDS, 0.01))
    typical = np.sqrt(np.mean(model.inverse_dynamics(first.q, first.dq, first.ddq, values) ** 2, axis=0))
    sensors = Sensors.typical(counts=1000.0, torque_noise=tuple(0.02 * typical))
    runs = simulate_batch(Plant(model, values), desired=desired, rate=RATE, control_rate=1000.0, sensors=sensors, seeds=(7, 8))
    folder.mkdir(parents=True, exist_ok=True)
    for name, run in zip(("train", "validate"), runs, strict=True):
        run.to_csv(folder / f"{name}.csv.gz", force=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
