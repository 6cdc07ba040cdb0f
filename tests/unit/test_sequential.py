"""Step-by-step estimation: every parameter from its plan without noise, what it carries, what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import chain

from ident import MomentumProblem, Problem
from ident.errors import ConfigurationError, DataError, UnsupportedError
from ident.estimators import make_estimator
from ident.logs.reading import read_logs
from ident.planning import default_model, make_plan, simulate_plan
from ident.robots import load_robot, nominal_values
from ident.robots.robot import Robot
from ident.robots.transmission import Side
from ident.signals import Recorded
from ident.simulation.plant import Plant
from ident.simulation.sensors import Sensors, TorqueNoise


def planned_logs(robot: Robot, folder, values=None, noise: float = 0.0, seed: int = 0):
    """Problem of a plan's logs tracked exactly, its manifest, and the truth."""
    model = default_model(robot)
    values = nominal_values(model) if values is None else values
    sensors = Sensors((TorqueNoise(noise),) if noise else ())
    manifest = simulate_plan(make_plan(robot), Plant(model, values), folder, tracking="exact", sensors=sensors, seed=seed)
    signals = Recorded()(read_logs(str(folder / "*.csv.gz"), robot))
    return Problem(model, signals), str(manifest), model.base.base_values(values)


def worst(found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.abs((found - truth) / np.maximum(np.abs(truth), 1e-3 * np.abs(truth).max())).max())


def two_joints() -> tuple[Robot, np.ndarray]:
    urdf = chain("two", [("revolute", "0 0 0.3", "1.5707963267948966 0 0", "0 0 1"), ("revolute", "0.4 0 0", "1.2 0 0", "0 0 1")])
    robot = Robot.from_urdf(urdf, transmission=np.array([[0.02, 0.0], [0.004, 0.03]]), measured=Side.MOTOR)
    return robot, np.concatenate([robot.nominal, [2e-4, 1e-4], [1e-3, 1e-3], [0.05, 0.03]])


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    robot, values = two_joints()
    return planned_logs(robot, tmp_path_factory.mktemp("two"), values)


@pytest.mark.parametrize("carry", ["update", "hold"])
def test_two_joints_without_noise(two, carry: str) -> None:
    problem, plan, truth = two
    found = make_estimator("sequential", plan=plan, carry=carry).solve(problem)
    assert found.names == problem.base.names
    assert worst(found.values, truth) < 1e-8


@pytest.mark.parametrize("carry", ["update", "hold"])
def test_a_sliding_joint_without_noise(tmp_path, carry: str) -> None:
    problem, plan, truth = planned_logs(load_robot("scara"), tmp_path)
    assert any(joint.prismatic for joint in problem.model.robot.joints)
    found = make_estimator("sequential", plan=plan, carry=carry).solve(problem)
    assert worst(found.values, truth) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "count"), [("puma560", 52), ("ur5", 52)])
def test_six_joints_without_noise(tmp_path, robot: str, count: int) -> None:
    problem, plan, truth = planned_logs(load_robot(robot), tmp_path)
    for carry in ("update", "hold"):
        found = make_estimator("sequential", plan=plan, carry=carry).solve(problem)
        assert len(found.values) == count
        assert worst(found.values, truth) < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_random_chains_without_noise(tmp_path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 5))
    twists = ["0 0 0", "1.5707963267948966 0 0", "-1.5707963267948966 0 0", "0 1.5707963267948966 0"]
    joints = []
    for _ in range(n):
        kind = "prismatic" if rng.random() < 0.25 else "revolute"
        joints.append((kind, " ".join(f"{x:.2f}" for x in rng.uniform(-0.4, 0.4, 3)), str(rng.choice(twists)), "0 0 1"))
    robot = Robot.from_urdf(chain("any", joints), transmission=np.diag(rng.uniform(0.01, 0.05, n)), measured=Side.MOTOR)
    problem, plan, truth = planned_logs(robot, tmp_path)
    found = make_estimator("sequential", plan=plan).solve(problem)
    assert worst(found.values, truth) < 1e-7


def test_steps_are_told(two) -> None:
    problem, plan, _ = two
    found = make_estimator("sequential", plan=plan).solve(problem)
    steps = found.trace["steps"]
    assert [s["known"] for s in steps] == sorted(s["known"] for s in steps)
    assert steps[-1]["known"] == problem.base.count
    told = [name for step in steps for name in step["revealed"]]
    assert sorted(told) == sorted(problem.base.names)
    summary = found.summary()
    assert all(step["test"] in summary for step in steps)


def test_intervals_hold_with_noise(tmp_path) -> None:
    robot, values = two_joints()
    model = default_model(robot)
    plan = make_plan(robot)
    simulate_plan(plan, Plant(model, values), tmp_path / "exact", tracking="exact")
    clean = read_logs(str(tmp_path / "exact" / "*.csv.gz"), robot)
    truth = model.base.base_values(values)
    estimator = make_estimator("sequential", plan=str(tmp_path / "exact" / "plan.toml"))
    from dataclasses import replace

    z = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        noisy = [replace(log, tau={"motor": log.tau["motor"] + 0.01 * rng.normal(size=log.tau["motor"].shape)}) for log in clean]
        found = estimator.solve(Problem(model, Recorded()(replace(clean, logs=tuple(noisy)))))
        z.append((found.values - truth) / found.std)
    assert np.mean(np.abs(z) < 1.96) > 0.87
    assert np.sqrt(np.mean(np.square(z))) < 1.3


def test_refusals(two) -> None:
    problem, plan, _ = two
    with pytest.raises(ConfigurationError, match="is for joints"):
        make_estimator("sequential", plan=plan).check_robot(load_robot("scara"))
    with pytest.raises(UnsupportedError, match="wls"):
        make_estimator("sequential", plan=plan).solve(MomentumProblem(problem.model, problem.signals))
    some = problem.signals.source
    from ident.logs.log import LogSet

    with pytest.raises(DataError, match="record what the plan asks for"):
        make_estimator("sequential", plan=plan).solve(Problem(problem.model, Recorded()(LogSet(some.logs[1:], some.robot))))
    with pytest.raises(ConfigurationError, match="update"):
        make_estimator("sequential", carry="updat")
    with pytest.raises(ConfigurationError, match="defer"):
        make_estimator("sequential", defer=1.5)
