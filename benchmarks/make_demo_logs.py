"""Makes the logs that `ident demo` reads: a PUMA 560 in closed loop, simulated with friction, coupled wrist, encoders and noise.

    python -m benchmarks.make_demo_logs FOLDER

The truth is the built-in robot's nominal (physically consistent) parameters; `unloaded` and `loaded` are of the arm without and
with the 1.6 kg load of its source; the controller is a PD with rigid feedforward at
1 kHz; 5 ms sampling; encoders of 1000 counts a motor turn; torque noise of 2 % of each motor's own torque, white."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

import ident
from ident import Log
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import nominal_values
from ident.simulation.plant import Plant
from ident.simulation.sensors import Sensors
from ident.simulation.simulate import simulate_batch
from ident.simulation.trajectory import FourierTrajectory

RATE = 200.0
SECONDS = 40.0
LOAD_SECONDS = 20.0
PERIODS = 3
HARMONICS = 6


def motion(robot: ident.Robot, seed: int, seconds: float) -> FourierTrajectory:
    """Random Fourier motion over most of the joint ranges (half a turn each way where they are wider)."""
    rng = np.random.default_rng(seed)
    lower = np.array([j.lower for j in robot.joints])
    upper = np.array([j.upper for j in robot.joints])
    middle, half = (lower + upper) / 2, np.minimum((upper - lower) / 2, np.pi)
    sine, cosine = rng.normal(size=(2, HARMONICS, robot.n))
    unit = FourierTrajectory(np.zeros(robot.n), sine, cosine, PERIODS / seconds, PERIODS)
    q = unit.sample(np.arange(0.0, seconds, 0.01)).q
    scale = 0.9 * 2 * half / np.ptp(q, axis=0)
    centre = middle - scale * (q.max(axis=0) + q.min(axis=0)) / 2
    return FourierTrajectory(centre, scale * sine, scale * cosine, PERIODS / seconds, PERIODS)


def simulated(payload: str | None, motions: Mapping[str, int], seeds: tuple[int, ...], seconds: float) -> dict[str, Log]:
    """Logs of the arm with a payload, by name; `motions`: name → seed of its motion, `seeds`: of the noise."""
    robot = ident.load_robot("puma560", payload=payload)
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    values = nominal_values(model)
    desired = [motion(robot, seed, seconds) for seed in motions.values()]
    first = desired[0].sample(np.arange(0.0, seconds, 0.01))
    typical = np.sqrt(np.mean(model.inverse_dynamics(first.q, first.dq, first.ddq, values) ** 2, axis=0))
    sensors = Sensors.typical(counts=1000.0, torque_noise=tuple(0.02 * typical))
    runs = simulate_batch(Plant(model, values), desired=desired, rate=RATE, control_rate=1000.0, sensors=sensors, seeds=seeds)
    return dict(zip(motions, runs, strict=True))


def main(folder: Path) -> None:
    """Simulate and write the logs."""
    logs = simulated(None, {"train": 1, "validate": 2}, (7, 8), SECONDS)
    logs |= simulated("none", {"unloaded": 3}, (9,), LOAD_SECONDS)
    logs |= simulated("1.6kg", {"loaded": 4}, (10,), LOAD_SECONDS)
    folder.mkdir(parents=True, exist_ok=True)
    for name, log in logs.items():
        log.to_csv(folder / f"{name}.csv.gz", force=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
