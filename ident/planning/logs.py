"""Simulated logs of a plan: every test as a run, all runs at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..effects.motion import Coordinates, Motion
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from ..simulation.controller import PDFeedforward
from ..simulation.result import Simulation
from ..simulation.sensors import Sensors
from ..simulation.simulate import simulate_batch
from .manifest import write_manifest

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from ..simulation.controller import Controller
    from ..simulation.plant import Plant
    from ..simulation.trajectory import Chained
    from .sequence import Plan
    from .trials import PlannedTest

_DEFAULTS: dict[str, Any] = {"rate": 250.0, "control_rate": 1000.0, "step": 1e-3}


class TrackingMode(StrEnum):
    """How a simulated test follows its planned motion.

    CONTROLLER: a discrete controller tracks it, as on a test bench; joints stick for moments where they reverse.
    EXACT: the motion is the planned one, and the torque that of inverse dynamics; dry friction of what stands still is zero."""

    CONTROLLER = "controller"
    EXACT = "exact"


def simulate_logs(
    plan: Plan,
    plant: Plant,
    folder: Path,
    names: Sequence[str] | None,
    tracking: str,
    seed: int,
    force: bool,
    settings: Mapping[str, Any],
) -> Path:
    """Simulate, write logs and manifest; the manifest's path."""
    if plant.robot.joint_names != plan.joints:
        raise ConfigurationError(
            f"the plan is for joints {', '.join(plan.joints)}, but the robot has {', '.join(plant.robot.joint_names)}."
        )
    if tracking not in list(TrackingMode):
        raise unknown_name("way to track a plan", tracking, [t.value for t in TrackingMode])
    tests = plan.tests if names is None else tuple(plan.test(name) for name in names)
    if not tests:
        raise ConfigurationError("the plan holds no test.")
    for test in tests:
        require_reachable(test, plant.robot, f"plan for {plan.robot}")
    folder.mkdir(parents=True, exist_ok=True)
    taken = [folder / name for name in ("plan.toml", *(t.log for t in tests)) if (folder / name).exists()]
    if taken and not force:
        raise ConfigurationError(f"{taken[0]} exists; nothing was written. Choose another folder, or allow overwriting (--force).")
    ways = [plan.trajectory(test)[0] for test in tests]
    seeds = [seed + plan.tests.index(test) for test in tests]
    runs = _RUNS[TrackingMode(tracking)](plant, ways, seeds, {**_DEFAULTS, **settings})
    for test, way, run in zip(tests, ways, runs, strict=True):
        run.until(way.duration).to_csv(folder / test.log, force=force)
    return write_manifest(plan, folder / "plan.toml", force=force)


def _tracked(plant: Plant, ways: list[Chained], seeds: list[int], settings: dict[str, Any]) -> Sequence[Simulation]:
    settings.setdefault("controller", servo(plant))
    return simulate_batch(plant, desired=ways, seeds=seeds, **settings)


def servo(plant: Plant) -> Controller | None:
    """A controller that feeds the whole model forward, friction included: without it a weak loop sticks at creeping speed.

    None, for the simulation's own, where the model depends on more than the instant."""
    if plant.model.needs:
        return None
    return PDFeedforward.tuned(plant.model, plant.schedule.values[0])


def _exact(plant: Plant, ways: list[Chained], seeds: list[int], settings: dict[str, Any]) -> Sequence[Simulation]:
    if plant.extra or plant.flexible is not None or len(plant.schedule.values) > 1:
        raise UnsupportedError("exact tracking knows a model with constant values alone; use tracking = 'controller' for this plant.")
    settings = {k: v for k, v in settings.items() if k not in ("control_rate", "step")}
    rate, sensors, progress = settings.pop("rate"), settings.pop("sensors", None) or Sensors(), settings.pop("progress", None)
    if settings:
        raise ConfigurationError(f"exact tracking has no controller: {min(settings)!r} means nothing to it.")
    found = []
    for done, (way, seed) in enumerate(zip(ways, seeds, strict=True), start=1):
        found.append(_followed(plant, way, rate, sensors, seed))
        if progress is not None:
            progress(done / len(ways))
    return found


def _followed(plant: Plant, way: Chained, rate: float, sensors: Any, seed: int) -> Simulation:
    """One run along its motion, read at `rate` Hz."""
    robot, model, values = plant.robot, plant.model, plant.schedule.values[0]
    t = np.arange(int(way.duration * rate + 1e-9) + 1) / rate
    link = way.sample(t)
    K = robot.transmission
    motor = Coordinates(K.motor_position(link.q), K.motor_rate(link.dq), K.motor_rate(link.ddq))
    tau = model.torque(Motion.of(robot, link.q, link.dq, link.ddq, t, rate=rate), values)
    still = np.zeros(tau.shape)
    states = np.zeros((len(t), 0))
    return Simulation.of(robot, t, link, motor, tau, tau, still, still.astype(bool), states, 1, True, sensors, seed)


_RUNS: dict[TrackingMode, Callable[[Plant, list[Chained], list[int], dict[str, Any]], Sequence[Simulation]]] = {
    TrackingMode.CONTROLLER: _tracked,
    TrackingMode.EXACT: _exact,
}


def require_reachable(test: PlannedTest, robot: Robot, where: str) -> None:
    """Raise ConfigurationError for a posture outside the joints' ranges (a joint without one turns within one turn of zero): of another
    robot, or a damaged file."""
    for k, posture in enumerate(test.postures.tolist()):
        for q, joint in zip(posture, robot.joints, strict=True):
            turn = np.inf if joint.prismatic else 2.0 * np.pi
            low, high = max(joint.lower, -turn), min(joint.upper, turn)
            if not low - 1e-6 <= q <= high + 1e-6:
                raise ConfigurationError(
                    f"{where}: test {test.name!r}: posture {k + 1} puts {joint.name} at {q:.4g}, outside {low:.4g} … {high:.4g}."
                    " Make the plan for this robot (ident plan)."
                )
