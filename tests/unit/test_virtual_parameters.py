"""Virtual parameters: the recursive pass with them gives Pinocchio's torques at fewer operations."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from effect_robots import chain
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ident import friction
from ident.errors import ConfigurationError
from ident.regressor.newton_euler import aligned, write_pass
from ident.regressor.scalar_graph import Program, ScalarGraph
from ident.regressor.virtual_parameters import virtual_parameters
from ident.robots import load_robot
from ident.robots.robot import Robot


def states(n: int, seed: int = 0, count: int = 20) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return tuple(rng.uniform(-2, 2, (count, n)) for _ in range(3))  # type: ignore[return-value]


def link(rng: np.random.Generator) -> np.ndarray:
    """Parameters of a link that can be: a negative number's sign may cost an operation, so that masses below zero are counted worse."""
    root = rng.normal(scale=0.1, size=(3, 3))
    inertia = pin.Inertia(rng.uniform(0.5, 3.0), rng.normal(scale=0.1, size=3), np.trace(root @ root.T) * np.eye(3) - root @ root.T)
    return np.asarray(inertia.toDynamicParameters())


def by_pinocchio(robot: Robot, parameters: np.ndarray, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
    """Torques by regressor times all parameters: Pinocchio's own, joint by joint."""
    tree = robot.tree
    model = pin.Model()
    for i in range(tree.nb):
        kind = (pin.JointModelPrismaticUnaligned if tree.prismatic[i] else pin.JointModelRevoluteUnaligned)(tree.axis[i])
        model.addJoint(int(tree.parent[i]) + 1, kind, pin.SE3(tree.rotation[i], tree.translation[i]), f"j{i}")
    model.gravity.linear = tree.gravity
    data = model.createData()
    rows = [np.atleast_2d(pin.computeJointTorqueRegressor(model, data, *state)) for state in zip(q, dq, ddq, strict=True)]
    return np.array(rows) @ parameters


def found_for(robot: Robot, parameters: np.ndarray):
    base = robot.rigid_body().base
    return virtual_parameters(robot, base, base.base_values(parameters))


@pytest.mark.parametrize("name", ["puma560", "scara"])
def test_torques_are_pinocchios(name: str) -> None:
    robot = load_robot(name)
    parameters = np.random.default_rng(1).normal(size=10 * robot.tree.nb)
    found = found_for(robot, parameters)
    q, dq, ddq = states(robot.n)
    assert found.torque(q, dq, ddq) == pytest.approx(by_pinocchio(robot, parameters, q, dq, ddq), rel=1e-9, abs=1e-8)
    full = np.einsum("iab,ib->ia", aligned(robot.tree).moments, parameters.reshape(-1, 10))
    own = write_pass(aligned(robot.tree).tree, full)
    assert own.torque(q, dq, ddq) == pytest.approx(by_pinocchio(robot, parameters, q, dq, ddq), rel=1e-9, abs=1e-8)


def test_the_puma_saves_a_sixth() -> None:
    robot = load_robot("puma560")
    found = found_for(robot, np.random.default_rng(0).uniform(0.1, 0.9, 60))
    assert len(found.names) == robot.rigid_body().base.count == 36
    assert not any(name.startswith(("m_", "mz_", "Szz_")) for name in found.names)
    assert (found.full.multiplications, found.full.additions) == (294, 291)
    assert (found.virtual.multiplications, found.virtual.additions) == (249, 246)
    assert found.saving > 0.15
    assert str(found.virtual.multiplications) in str(found)
    assert found.to_dict()["saving"] == found.saving


@settings(max_examples=8, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 10_000), st.integers(1, 5))
def test_any_open_chain(seed: int, n: int) -> None:
    """Prismatic joints, oblique axes and twists, gravity or none."""
    rng = np.random.default_rng(seed)
    joints = []
    for _ in range(n):
        axis = str(rng.choice(["0 0 1", "0 1 0", "1 0 0", "0 -1 0", "0.6 0 0.8"]))
        twist = str(rng.choice(["0 0 0", "1.5707963267948966 0 0", "-1.5707963267948966 0 0", "0.3 0.2 -0.7"]))
        joints.append(
            ("prismatic" if rng.random() < 0.25 else "revolute", " ".join(f"{x:.2f}" for x in rng.uniform(-0.4, 0.4, 3)), twist, axis)
        )
    robot = Robot.from_urdf(chain("any", joints), gravity=[0, 0, -9.81] if rng.random() < 0.7 else [0, 0, 0])
    parameters = np.concatenate([link(rng) for _ in range(n)])
    found = found_for(robot, parameters)
    q, dq, ddq = states(n, seed)
    assert found.torque(q, dq, ddq) == pytest.approx(by_pinocchio(robot, parameters, q, dq, ddq), rel=1e-8, abs=1e-7)
    assert found.virtual.operations <= found.full.operations
    assert len(found.names) <= robot.rigid_body().base.count


def test_a_parallelogram_goes_through_its_closure() -> None:
    robot = load_robot("palletiser")
    parameters = np.random.default_rng(2).normal(size=10 * robot.tree.nb)
    found = found_for(robot, parameters)
    q, dq, ddq = states(robot.n)
    own = (robot.tree_position(q), robot.tree_rate(dq), robot.tree_rate(ddq))
    assert found.torque(q, dq, ddq) == pytest.approx(by_pinocchio(robot, parameters, *own) @ robot.loop.W, rel=1e-9, abs=1e-8)
    assert found.saving > 0.25


def test_operations_are_counted_once_and_only_if_needed() -> None:
    graph = ScalarGraph()
    x, y = graph.input("x"), graph.input("y")
    shared = x * y
    out = shared + shared * 1.0 + 0.0 * x - (-y) * x + 2.0 * (3.0 * y)
    unused = x * x
    program = Program.of(graph, [out])
    # x y once; 6 y; three sums.
    assert (program.multiplications, program.additions) == (2, 3)
    assert Program.of(graph, [out, unused]).multiplications == 3
    (value,) = program.run({"x": np.array([2.0]), "y": np.array([5.0])})
    assert value == pytest.approx([3 * 10 + 30])
    assert (x - x).value == 0.0
    negative = -x
    assert (-negative).number == x.number


def test_the_command_counts_them(ident) -> None:
    ran = ident("base", "--robot", "puma560", "--operations", "--json", "--quiet")
    assert ran.code == 0, ran.err
    counted = ran.json["operations"]
    assert counted["full"] == {"multiplications": 294, "additions": 291}
    assert counted["virtual"] == {"multiplications": 249, "additions": 246}
    assert len(counted["nonzero"]) == ran.json["count"]
    assert "% saved" in ran.err


def test_wrong_number_of_values() -> None:
    robot = load_robot("scara")
    with pytest.raises(ConfigurationError, match="links alone"):
        virtual_parameters(robot, robot.rigid_body().base, np.zeros(3))
    model = robot.rigid_body() + friction.Viscous()
    with pytest.raises(ConfigurationError, match="links alone"):
        virtual_parameters(robot, model.base, np.zeros(model.base.count))
