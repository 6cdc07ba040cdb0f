"""Robot: joints by name, locked joints, couplings, gravity, drive; Pinocchio is the oracle."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from test_urdf_reading import chain, joint, urdf

from ident import ConfigurationError, Robot, Transmission
from ident.effects.motion import Motion

THREE = chain(
    '<axis xyz="0 0 1"/>', '<origin xyz="0.3 0 0" rpy="1.5708 0 0"/><axis xyz="0 0 1"/>', '<origin xyz="0.2 0.1 0"/><axis xyz="0 0 1"/>'
)


def torque(robot, q, dq, ddq):
    return robot.rigid_body().torque(Motion.of(robot, q, dq, ddq), robot.nominal)


def samples(n, joints, seed=0):
    return np.random.default_rng(seed).normal(size=(3, n, joints))


def test_whole_robot_agrees_with_rnea():
    robot = Robot.from_urdf(THREE)
    q, dq, ddq = samples(10, 3)
    data = robot.model.createData()
    wanted = [pin.rnea(robot.model, data, *s) for s in zip(q, dq, ddq, strict=True)]
    assert torque(robot, q, dq, ddq) == pytest.approx(np.array(wanted), rel=1e-12, abs=1e-13)


def test_locked_joint_equals_the_whole_robot_at_that_position():
    whole, part = Robot.from_urdf(THREE), Robot.from_urdf(THREE, locked={"j2": 0.7})
    assert part.joint_names == ("j1", "j3")
    q, dq, ddq = samples(10, 3)
    q[:, 1], dq[:, 1], ddq[:, 1] = 0.7, 0, 0
    wanted = torque(whole, q, dq, ddq)[:, [0, 2]]
    keep = [0, 2]
    assert torque(part, q[:, keep], dq[:, keep], ddq[:, keep]) == pytest.approx(wanted, rel=1e-12, abs=1e-12)


def test_kept_joints_lock_the_others():
    assert Robot.from_urdf(THREE, joints=["j3", "j1"], locked={"j2": 0.7}).joint_names == ("j1", "j3")
    q, dq, ddq = samples(5, 1)
    wanted = torque(Robot.from_urdf(THREE, locked={"j1": 0.0, "j2": 0.7}), q, dq, ddq)
    assert torque(Robot.from_urdf(THREE, joints=["j3"], locked={"j2": 0.7}), q, dq, ddq) == pytest.approx(wanted, rel=1e-13)


def test_followers_of_a_locked_joint_are_locked_where_they_follow():
    text = chain("", '<mimic joint="j1" multiplier="2" offset="0.1"/>', "")
    plain = chain("", "", "")
    for robot in (Robot.from_urdf(text, locked={"j1": 0.3}), Robot.from_urdf(text, joints=["j3"], locked={"j1": 0.3})):
        assert robot.joint_names == ("j3",)
        assert robot.loop.is_trivial
        q, dq, ddq = samples(4, 1)
        wanted = torque(Robot.from_urdf(plain, locked={"j1": 0.3, "j2": 0.7}), q, dq, ddq)
        assert torque(robot, q, dq, ddq) == pytest.approx(wanted, rel=1e-12)
    assert Robot.from_urdf(text, locked={"j2": 0.0}).joint_names == ("j1", "j3")


def test_keeping_a_follower_names_its_master():
    text = chain("", '<mimic joint="j1"/>', "")
    with pytest.raises(ConfigurationError, match="'j2' mimics 'j1'; keep that joint"):
        Robot.from_urdf(text, joints=["j2", "j3"])


def test_mimic_is_a_linear_coupling():
    free, coupled = Robot.from_urdf(chain("", "")), Robot.from_urdf(chain("", '<mimic joint="j1" multiplier="-2" offset="0.2"/>'))
    q, dq, ddq = samples(6, 1)
    W = np.array([[1.0], [-2.0]])
    wanted = torque(free, q @ W.T + [0, 0.2], dq @ W.T, ddq @ W.T) @ W
    assert torque(coupled, q, dq, ddq) == pytest.approx(wanted, rel=1e-12)
    assert coupled.tree_joints[1].name == "j2"


def test_declared_loop_replaces_a_joint():
    robot = Robot.from_urdf(THREE, loop={"j3": {"j1": 0.5, "j2": -1, "offset": 0.1}})
    assert robot.joint_names == ("j1", "j2")
    assert robot.tree_position(np.array([1.0, 2.0])) == pytest.approx([1, 2, -1.4])
    assert robot.tree_rate(np.array([1.0, 2.0])) == pytest.approx([1, 2, -1.5])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"locked": {"j9": 0}}, "unknown joint in `locked` 'j9'; did you mean"),
        ({"locked": {"j1": float("nan")}}, "joint 'j1' is locked at nan"),
        ({"joints": ["k1"]}, "unknown joint in `joints` 'k1'"),
        ({"loop": {"j9": {"j1": 1}}}, "unknown joint in .loop. 'j9'"),
        ({"loop": {"j3": {"j9": 1}}}, "depends on 'j9', which is not an independent joint"),
        ({"loop": {"j3": {"j2": 1}, "j2": {"j3": 1}, "j1": {"j2": 1}}}, "leaves no independent joint"),
        ({"loop": {"j3": {"j1": 1}}, "locked": {"j3": 0}}, "both locked and dependent"),
        ({"locked": {"j1": 0, "j2": 0, "j3": 0}}, "no moving joint"),
        ({"gravity": (0, 0)}, "gravity must be three finite numbers"),
        ({"gravity": (0, 0, float("inf"))}, "gravity must be three finite numbers"),
        ({"transmission": [1, 2]}, "describes 2 joints, but robot 'r' has 3: j1, j2, j3"),
        ({"transmission": [1, 0, 2]}, "ratio holds a value that is zero"),
        ({"transmission": np.ones((3, 3))}, "K is singular"),
        ({"measured": "moter"}, "unknown side of the transmission 'moter'; did you mean 'motor'"),
    ],
)
def test_refusals(arguments, message):
    with pytest.raises(ConfigurationError, match=message):
        Robot.from_urdf(THREE, **arguments)


def test_gravity_in_any_direction():
    robot = Robot.from_urdf(THREE, gravity=(1, 2, 3))
    assert robot.tree.gravity == pytest.approx([1, 2, 3])
    turned = Robot.from_urdf(THREE).with_gravity((1, 2, 3))
    q, dq, ddq = samples(4, 3)
    assert torque(turned, q, dq, ddq) == pytest.approx(torque(robot, q, dq, ddq), abs=0)
    assert turned.source["gravity"] == [1, 2, 3]
    with pytest.raises(ConfigurationError, match="gravity"):
        robot.with_gravity((0, float("nan"), 0))


def test_no_inertials_is_said_and_fine():
    robot = Robot.from_urdf(chain("", "").replace(THREE[THREE.index("<inertial>") : THREE.index("</inertial>") + 11], ""))
    assert robot.nominal is None
    (note,) = robot.notes
    assert "no <inertial>" in note
    assert "j1, j2" in note
    assert robot.rigid_body().columns(Motion.of(robot, *samples(3, 2))).shape == (3, 2, 20)


def test_inertia_behind_fixed_joints_counts_as_the_bodys():
    text = urdf(joint("j1", "base", "l1"), joint("tool", "l1", "l2", "fixed", '<origin xyz="1 0 0"/>'))
    robot = Robot.from_urdf(text)
    assert robot.nominal[0] == pytest.approx(2)
    assert robot.nominal[1] == pytest.approx(0.1 + 1.1)
    assert robot.notes == ()


def test_drive_arguments():
    assert Robot.from_urdf(THREE).transmission.K == pytest.approx(np.eye(3), abs=0)
    geared = Robot.from_urdf(THREE, transmission=[10, -20, 4], measured="motor")
    assert np.diag(geared.transmission.K) == pytest.approx([0.1, -0.05, 0.25])
    assert geared.transmission.measured == "motor"
    K = np.array([[0.1, 0, 0], [0, 0.2, 0.1], [0, 0, 0.3]])
    assert Robot.from_urdf(THREE, transmission=K).transmission.K == pytest.approx(K, abs=0)
    assert Robot.from_urdf(THREE, transmission=Transmission(K, np.ones(3))).transmission.zero == pytest.approx(np.ones(3))


def test_names_and_units():
    robot = Robot.from_urdf(chain("", "", kinds=["prismatic", "revolute"]), transmission=[100, 1])
    assert robot.joint_index("j2") == 1
    with pytest.raises(ConfigurationError, match="unknown joint 'j3'; did you mean"):
        robot.joint_index("j3")
    assert [robot.position_unit(0, s) for s in ("joint", "motor")] == ["m", "rad"]
    assert [robot.force_unit(0, s) for s in ("joint", "motor")] == ["N", "N m"]
    assert "j1 (prismatic), j2; geared drive" in str(robot)
    assert len(repr(robot)) < 2000


def test_armature_is_an_effect_and_not_counted_twice():
    text = chain('<dynamics damping="3" friction="2"/>')
    robot = Robot.from_urdf(text)
    assert not robot.model.armature.any()
    assert torque(robot, *np.zeros((2, 1, 1)), np.ones((1, 1))) == pytest.approx(np.array([[0.1]]), abs=1e-12)


def test_branching_tree_keeps_parents_first():
    text = urdf(joint("a", "base", "l1"), joint("b", "l1", "l2"), joint("c", "l1", "l3"), joint("d", "l3", "l4"))
    robot = Robot.from_urdf(text)
    assert robot.joint_names == ("a", "b", "c", "d")
    assert robot.tree.parent.tolist() == [-1, 0, 0, 2]


def test_floating_base_keeps_its_joints():
    robot = Robot.from_urdf(THREE, floating_base=True)
    assert robot.joint_names == ("j1", "j2", "j3")
    assert robot.tree.floating
    assert robot.tree.nv == 9
