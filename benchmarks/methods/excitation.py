"""Designed trajectories against chance, their limits, and whether the accuracy they promise is what simulated experiments give."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ident.effects.motion import Motion
from ident.excitation import DOptimality, Excitation, FourierFamily, excite, random_excitation
from ident.planning import default_model
from ident.problem.problem import Problem
from ident.robots import load_robot, nominal_values
from ident.robots.transmission import Side
from ident.simulation.plant import Plant
from ident.simulation.sensors import Sensors, TorqueWindow
from ident.simulation.simulate import simulate

from .data import recorded

Array = np.ndarray
#: Robots by name, and the joints that move (None: all).
ROBOTS: dict[str, tuple[str, ...] | None] = {"puma560": None, "panda": tuple(f"panda_joint{i}" for i in range(1, 8)), "ur5": None}
#: Limits are checked at so many instants.
_FINE = 20_001
TOLERANCE = 1e-9


@dataclass(frozen=True)
class Design:
    """A designed trajectory against the best of random ones. `volume`: −log det of the information over the number of parameters;
    `excess`: largest transgression of a limit (negative: room left), in the limit's unit; `ratio_*`: scatter of simulated experiments over
    the predicted standard deviation."""

    robot: str
    parameters: int
    random: int
    volume: float
    best_volume: float
    condition: float
    best_condition: float
    excess: float
    seconds: float
    seeds: int
    ratio_mean: float
    ratio_least: float
    ratio_largest: float

    @property
    def beats(self) -> bool:
        """Better than every random one in both measures, within the limits."""
        return self.volume < self.best_volume and self.condition < self.best_condition and self.excess <= TOLERANCE

    @property
    def holds(self) -> bool:
        """Whether the predicted deviations hold: the scatter of so few seeds itself deviates by 1/√(2 S), 4.5 times of which is allowed."""
        room = 4.5 / np.sqrt(2 * (self.seeds - 1))
        return abs(self.ratio_least - 1) < room and abs(self.ratio_largest - 1) < room


def design(name: str, *, random: int = 100, starts: int = 3, iterations: int = 60, seeds: int = 400, seconds: float = 10.0) -> Design:
    """Design a trajectory for a robot, compare it, and simulate experiments along it."""
    joints = ROBOTS[name]
    model = default_model(load_robot(name, joints=joints))
    family = FourierFamily(seconds)
    chance = [random_excitation(model, family=family, seed=s) for s in range(random)]
    begin = time.process_time()
    found = excite(model, family=family, starts=starts, iterations=iterations)
    spent = time.process_time() - begin
    volume = DOptimality()
    ratios = scatter(found, seeds)
    return Design(
        name, model.base.count, random, volume.exact(found.information, found.names),
        min(volume.exact(c.information, c.names) for c in chance), found.condition, min(c.condition for c in chance),
        transgression(found), spent, seeds, float(ratios.mean()), float(ratios.min()), float(ratios.max()),
    )  # fmt: skip


def transgression(found: Excitation) -> float:
    """Largest amount by which a limit is exceeded on a fine grid; negative where all are kept."""
    limits, model = found.limits, found.model
    motion = found.trajectory.sample(np.linspace(0.0, found.trajectory.duration, _FINE))
    over = [motion.q - limits.upper, limits.lower - motion.q, np.abs(motion.dq) - limits.velocity, np.abs(motion.ddq) - limits.acceleration]
    if np.isfinite(limits.torque).any() and model.robot.nominal is not None:
        robot = model.robot
        torque = model.torque(Motion.of(robot, motion.q, motion.dq, motion.ddq), nominal_values(model))
        over.append(np.abs(robot.transmission.torque(torque, robot.transmission.measured, Side.JOINT)) - limits.torque)
    return float(max(part.max() for part in over))


def scatter(found: Excitation, seeds: int) -> Array:
    """Scatter (b,) of weighted least squares over simulated experiments, over the predicted standard deviation.

    The robot is simulated once along the trajectory under a controller, and its torque disturbed `seeds` times by the noise that the
    prediction counts with."""
    model = found.model
    values = nominal_values(model)
    sensors = Sensors((TorqueWindow(1.0 / found.rate),), Side.MOTOR, columns=("q", "dq", "ddq", "tau"))
    run = simulate(
        Plant(model, values),
        desired=found.trajectory,
        rate=found.rate,
        control_rate=10 * found.rate,
        step=0.1 / found.rate,
        sensors=sensors,
    )
    problem = Problem(model, recorded()([run.log("run0")], model.robot))
    parts = [(rows.columns / found.noise[:, None])[rows.valid] for rows in problem.rows()]
    flat = np.concatenate(parts)
    scale = np.linalg.norm(flat, axis=0)
    noise = np.random.default_rng(0).normal(size=(len(flat), seeds))
    errors = np.linalg.lstsq(flat / scale, noise, rcond=None)[0] / scale[:, None]
    return errors.std(axis=1, ddof=1) / found.expected_std()


HEAD = [
    "robot", "parameters", "volume", "best of random", "condition", "best of random", "limits exceeded by", "better", "scatter / predicted",
    "holds", "s",
]  # fmt: skip


def row(d: Design) -> list[str]:
    """For a table."""
    ratio = f"{d.ratio_mean:.3f} ({d.ratio_least:.2f} … {d.ratio_largest:.2f})"
    excess = "none" if d.excess <= 0 else f"{d.excess:.1e}"
    return [
        d.robot, f"{d.parameters}", f"{d.volume:.2f}", f"{d.best_volume:.2f}", f"{d.condition:.2f}", f"{d.best_condition:.2f}", excess,
        "yes" if d.beats else "NO", ratio, "yes" if d.holds else "NO", f"{d.seconds:.1f}",
    ]  # fmt: skip
