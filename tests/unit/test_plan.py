"""Step-by-step plans: the verified PUMA plan, any chain, manifests, simulated logs."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import chain, pendulum, seven
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ident.effects.motion import Motion
from ident.errors import ConfigurationError, UnsupportedError
from ident.friction import LoadDependentFriction
from ident.logs.reading import read_logs
from ident.planning import MotionKind, Plan, Separation, default_model, make_plan, read_plan, simulate_plan, write_plan
from ident.robots import load_robot, nominal_values
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission
from ident.simulation.plant import Plant
from ident.simulation.sensors import Sensors


@pytest.fixture(scope="module")
def puma() -> Plan:
    return make_plan(load_robot("puma560"))


def test_the_puma_needs_the_thirteen_verified_tests(puma: Plan) -> None:
    """SCIENCE.md 4: which joints move and which row is read, in order."""
    assert (puma.rank, len(puma.base)) == (52, 52)
    static = [t.row for t in puma.of_kind(MotionKind.STATIC)]
    assert static == [f"joint{i}" for i in (6, 5, 4, 3, 2)]
    assert all(set(t.reveals) == {f"mx_{t.row}", f"my_{t.row}"} for t in puma.of_kind(MotionKind.STATIC))
    steady = puma.of_kind(MotionKind.CONSTANT_VELOCITY)
    assert [set(t.reveals) for t in steady] == [{f"Fv_joint{i}", f"Fc_joint{i}"} for i in range(1, 7)]
    swings = [("".join(j[-1] for j in t.moving), t.row[-1]) for t in puma.of_kind(MotionKind.ACCELERATED)]
    assert swings == [
        ("6", "6"), ("56", "6"), ("5", "5"), ("45", "5"), ("4", "4"), ("34", "4"), ("14", "4"),
        ("3", "3"), ("23", "3"), ("13", "3"), ("2", "2"), ("12", "2"), ("1", "1"),
    ]  # fmt: skip
    revealed = [name for t in puma.tests for name in t.reveals]
    assert sorted(revealed) == sorted(puma.base)


def test_uncoupled_motors_need_fifteen(puma: Plan) -> None:
    robot = load_robot("puma560")
    diagonal = robot.with_transmission(Transmission(np.diag(np.diag(robot.transmission.K)), robot.transmission.zero, Side.MOTOR))
    plan = make_plan(diagonal)
    assert (plan.rank, len(plan.of_kind(MotionKind.ACCELERATED))) == (52, 15)
    safe = make_plan(robot, separation=Separation.SAFE)
    assert (safe.rank, len(safe.of_kind(MotionKind.ACCELERATED))) == (52, 15)
    weakest = min(t.strength for t in puma.of_kind(MotionKind.ACCELERATED))
    assert min(t.strength for t in safe.of_kind(MotionKind.ACCELERATED)) > 3 * weakest


def test_the_published_plan_has_the_tests_of_the_source_in_its_order() -> None:
    plan = make_plan(load_robot("puma560"), published="yoshida1995")
    assert (plan.rank, len(plan.base)) == (52, 52)
    swings = [("".join(j[-1] for j in t.moving), t.row[-1]) for t in plan.of_kind(MotionKind.ACCELERATED)]
    assert swings == [
        ("6", "6"), ("5", "5"), ("56", "6"), ("4", "4"), ("45", "5"), ("3", "3"), ("34", "4"), ("23", "3"), ("2", "2"), ("13", "3"),
        ("12", "2"), ("14", "4"), ("1", "1"),
    ]  # fmt: skip
    with pytest.raises(ConfigurationError, match="published plan"):
        make_plan(load_robot("scara"), published="yoshida1995")


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 1000), st.integers(2, 5))
def test_any_chain_is_determined(seed: int, n: int) -> None:
    """Random chains, prismatic joints among them, a random coupled transmission, gravity or none."""
    rng = np.random.default_rng(seed)
    twists = ["0 0 0", "1.5707963267948966 0 0", "-1.5707963267948966 0 0", "0 1.5707963267948966 0"]
    joints = []
    for _ in range(n):
        kind = "prismatic" if rng.random() < 0.25 else "revolute"
        joints.append((kind, " ".join(f"{x:.2f}" for x in rng.uniform(-0.4, 0.4, 3)), str(rng.choice(twists)), "0 0 1"))
    K = np.diag(rng.uniform(0.01, 0.05, n))
    if rng.random() < 0.5 and n > 1:
        K[n - 1, n - 2] = 0.004
    gravity = [0, 0, -9.81] if rng.random() < 0.7 else [0, 0, 0]
    robot = Robot.from_urdf(chain("any", joints), transmission=K, measured=Side.MOTOR, gravity=gravity)
    plan = make_plan(robot)
    assert plan.rank == len(plan.base) == default_model(robot).base.count
    assert not plan.notes


def test_a_parallelogram_is_planned_too() -> None:
    urdf = chain("bars", [("revolute", "0.3 0 0" if i else "0 0 0", "0 0 0", "0 1 0") for i in range(3)])
    robot = Robot.from_urdf(urdf, loop={"j3": {"j1": -1.0, "j2": 1.0}}, transmission=np.array([50.0, 60.0]))
    plan = make_plan(robot)
    assert plan.rank == len(plan.base)


def test_motion_stays_within_limits_and_only_named_joints_move(puma: Plan) -> None:
    from ident.excitation import Limits

    robot = load_robot("puma560")
    limits = Limits.of(robot)
    for test in puma.tests:
        way, segments = puma.trajectory(test)
        motion = way.sample(np.linspace(0, way.duration, 4001))
        assert np.all(motion.q <= limits.upper + 1e-9)
        assert np.all(motion.q >= limits.lower - 1e-9)
        assert np.all(np.abs(motion.dq) <= limits.velocity * (1 + 1e-9))
        assert np.all(np.abs(motion.ddq) <= limits.acceleration * (1 + 1e-9))
        assert len(segments) >= len(test.postures)
        for s in segments:
            part = way.sample(np.linspace(s.begin, s.end, 50)[1:-1])
            speed = part.dq if test.side == Side.JOINT else robot.transmission.motor_rate(part.dq)
            moving = np.isin(robot.joint_names, test.moving)
            assert np.all(np.abs(speed[:, ~moving]) < 1e-9)
            assert np.all(np.abs(speed[:, moving]).max(axis=0) > 0)
            if test.kind != MotionKind.ACCELERATED:
                np.testing.assert_allclose(np.abs(speed[:, moving]), s.speed, rtol=1e-9)
                assert np.all(np.sign(speed[:, moving]) == s.direction)
                np.testing.assert_allclose(part.ddq, 0.0, atol=1e-9)


def test_manifest_comes_back_as_it_was(puma: Plan, tmp_path) -> None:
    path = write_plan(puma, tmp_path / "plan.toml")
    back = read_plan(path)
    assert back.to_dict() == puma.to_dict()
    assert str(back) == str(puma)
    a, b = puma.trajectory(puma.tests[-1])[0], back.trajectory(back.test(puma.tests[-1].name))[0]
    np.testing.assert_array_equal(a.sample(np.linspace(0, 5, 9)).q, b.sample(np.linspace(0, 5, 9)).q)
    with pytest.raises(ConfigurationError, match="exists"):
        write_plan(puma, path)
    with pytest.raises(ConfigurationError, match="static_joint6"):
        puma.test("static_joint66")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('schema = "ident.plan/1"', 'schema = "x"', "not a manifest"),
        ("rank = ", "rank = inf #", "'rank' must be a whole number"),
        ("rank = ", "rank = [] #", "'rank' must be a whole number"),
        ("speeds = ", "speeds = [nan] #", "'speeds' must be finite numbers"),
        ("gain = ", 'gain = "1" #', "'gain' must be a whole number"),
        ('kind = "static"', 'kind = "statik"', "static"),
        ('row = "joint6"', 'row = "joint9"', "joint9"),
        ("gain = 2", "gian = 2", "gian"),
        ("speeds = [", "speeds = [1.0, ", "same number"),
        ("base_hz = 0.5", "", "base_hz"),
        ("[plan]", "[plan", "not valid TOML"),
    ],
)
def test_a_broken_manifest_is_explained(puma: Plan, tmp_path, old: str, new: str, message: str) -> None:
    path = write_plan(puma, tmp_path / "plan.toml")
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigurationError, match=message):
        read_plan(path)


def _rows(plan: Plan, robot: Robot, folder) -> tuple[np.ndarray, np.ndarray]:
    """The rows that the manifest names, from the logs: only the stretches and the one torque that each test is for."""
    model = default_model(robot)
    columns, torque = [], []
    for test in plan.tests:
        log = read_logs(folder / test.log, robot=robot)[0]
        assert log.q is not None
        assert log.dq is not None
        assert log.ddq is not None
        K = robot.transmission
        T = K.torque_map(K.measured, test.side)
        row = robot.joint_index(test.row)
        phi = np.matmul(T, model.columns(Motion.of(robot, log.q, log.dq, log.ddq))[:, :, model.base.independent])[:, row]
        tau = (log.tau[K.measured.value] @ T.T)[:, row]
        # Where a motor that takes part in the row stands, its dry friction is unknown.
        part = np.abs(T[row]) > 0
        turning = np.all(np.abs(K.motor_rate(log.dq))[:, part] > 1e-9, axis=1)
        for s in plan.trajectory(test)[1]:
            use = (log.t > s.begin) & (log.t < s.end) & turning
            columns.append(phi[use])
            torque.append(tau[use])
    return np.concatenate(columns), np.concatenate(torque)


def _recovered(plan: Plan, robot: Robot, values: np.ndarray, folder) -> float:
    A, b = _rows(plan, robot, folder)
    scale = np.linalg.norm(A, axis=0)
    found = np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale
    truth = default_model(robot).base.base_values(values)
    return float(np.abs((found - truth) * scale).max() / np.abs(truth * scale).max())


def test_simulated_logs_hold_what_the_plan_promises(tmp_path) -> None:
    urdf = chain("two", [("revolute", "0 0 0.3", "1.5707963267948966 0 0", "0 0 1"), ("revolute", "0.4 0 0", "1.2 0 0", "0 0 1")])
    K = np.array([[0.02, 0.0], [0.004, 0.03]])
    robot = Robot.from_urdf(urdf, transmission=K, measured=Side.MOTOR)
    model = default_model(robot)
    values = np.concatenate([robot.nominal, [2e-4, 1e-4], [1e-3, 1e-3], [0.05, 0.03]])
    plan = make_plan(robot, postures=2)
    manifest = simulate_plan(plan, Plant(model, values), tmp_path / "logs", rate=50.0, control_rate=250.0, step=4e-3)
    assert manifest.name == "plan.toml"
    assert {f.name for f in (tmp_path / "logs").iterdir()} == {"plan.toml", *(t.log for t in plan.tests)}
    assert _recovered(read_plan(manifest), robot, values, tmp_path / "logs") < 1e-9
    with pytest.raises(ConfigurationError, match="nothing was written"):
        simulate_plan(plan, Plant(model, values), tmp_path / "logs")
    quick = {"sensors": Sensors.typical(), "rate": 50.0, "control_rate": 250.0}
    some = simulate_plan(plan, Plant(model, values), tmp_path / "some", tests=[plan.tests[1].name], **quick)
    assert len(list(some.parent.iterdir())) == 2
    with pytest.raises(ConfigurationError, match="joints"):
        simulate_plan(plan, Plant(pendulum().rigid_body(), pendulum().nominal), tmp_path / "other")


@pytest.mark.slow
def test_the_puma_plan_gives_back_all_fifty_two(puma: Plan, tmp_path) -> None:
    robot = load_robot("puma560")
    values = nominal_values(default_model(robot))
    simulate_plan(puma, Plant(default_model(robot), values), tmp_path, rate=50.0, control_rate=250.0, step=4e-3)
    assert _recovered(puma, robot, values, tmp_path) < 1e-8


def test_what_a_plan_cannot_hold_is_said() -> None:
    robot = seven()
    with pytest.raises(UnsupportedError, match="load_dependent_friction"):
        make_plan(default_model(robot) + LoadDependentFriction())
    with pytest.raises(ConfigurationError, match="postures"):
        make_plan(robot, postures=1)
