"""MuJoCo: exported files roll out as our replay does, and every row of the table in docs/actuators.md means there what it says."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from test_actuator_export import TRUTH, as_fitted, leg

import ident
from benchmarks.actuators import rollouts
from benchmarks.actuators.commanded import LEG, PENDULUM
from ident.drives import DriveLaw
from ident.exporting import ExportOptions, Identified
from ident.exporting.target import make_target
from ident.regressor.rigid import inverse_dynamics

mujoco = pytest.importorskip("mujoco", minversion="3.5", reason="MuJoCo is not installed: pip install 'ident[mujoco]'")
Array = np.ndarray
INERTIA = 0.6 * 0.2**2 + 0.002


def text_of(source: object, kind: str = "mujoco_actuator") -> str:
    return str(make_target(kind, Path()).written(Identified.of(source), ExportOptions()).content)


def loaded(source: object, kind: str = "mujoco_actuator"):
    model = mujoco.MjModel.from_xml_string(text_of(source, kind))
    return model, mujoco.MjData(model)


def pendulum(*more: str, law: dict[str, object] | None = None, **values: float):
    robot = ident.Robot.from_urdf(PENDULUM)
    given = {"kp": 25.0, "kd": 0.8, "delay_s": 0.0, **(law or {})}
    return as_fitted(robot, DriveLaw.of(robot, str(given.pop("kind", "pd_position")), **given), *more, **values)


@pytest.mark.parametrize("seed", [0, 2, 4, 6, 13])
def test_mujoco_agrees_with_our_replay_to_the_integrators_error(seed):
    """Delay and branches (0, 13), limits with offsets (0, 6), springs (13); motors that share joints (2); a joint that follows (4)."""
    found = rollouts.rolled(seed)
    assert found.agrees, found
    assert found.motion > 100 * found.apart


@pytest.mark.parametrize("lost", ["armature", "damping", "frictionloss", "delay", "forcerange"])
def test_a_file_without_one_of_them_disagrees(lost, monkeypatch):
    """The comparison can fail: a number taken out of the file is noticed."""
    monkeypatch.setattr(rollouts, "FACTOR", 3.0)
    seed = {"forcerange": 6}.get(lost, 0)
    original = rollouts.in_mujoco

    def without(text: str, *rest):
        assert f"{lost}=" in text
        text = re.sub(rf' {lost}="[^"]*"', "", text)
        return original(text, *rest)

    monkeypatch.setattr(rollouts, "in_mujoco", without)
    assert not rollouts.rolled(seed).agrees


def test_armature_adds_to_the_inertia():
    model, data = loaded(pendulum())
    mujoco.mj_forward(model, data)
    full = np.zeros((1, 1))
    mujoco.mj_fullM(model, data, full) if _new_order() else mujoco.mj_fullM(model, full, data.qM)
    assert full[0, 0] == pytest.approx(INERTIA + 0.012)


def _new_order() -> bool:
    return "d: mujoco" in (mujoco.mj_fullM.__doc__ or "")


def test_damping_takes_torque_in_proportion_to_speed():
    model, data = loaded(pendulum())
    data.qvel[0] = 3.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[0] == pytest.approx(-0.08 * 3.0)


def test_back_emf_is_in_damping():
    model, data = loaded(pendulum(law={"back_emf": 0.05}))
    data.qvel[0] = 2.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[0] == pytest.approx(-0.13 * 2.0)


def test_frictionloss_is_a_torque_against_motion_and_creeps_at_rest():
    model, data = loaded(pendulum())
    data.qvel[0] = 2.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_constraint[0] == pytest.approx(-0.15, rel=1e-3)

    def reached(torque: float) -> float:
        model, data = loaded(pendulum(law={"kp": 0.0, "kd": 0.0}))
        model.opt.gravity[:] = 0.0
        data.qfrc_applied[0] = torque
        mujoco.mj_step(model, data, 500)
        return float(data.qpos[0])

    assert reached(0.3) > 0.3
    assert 1e-6 < reached(0.14) < 0.02  # below the level it creeps, where ours stands


def test_springs_are_stiffness_and_rest_position():
    model, data = loaded(pendulum("linear_spring", ks=3.0, ks0=0.6))
    data.qpos[0] = 0.5
    mujoco.mj_forward(model, data)
    assert data.qfrc_passive[0] == pytest.approx(-(3.0 * 0.5 + 0.6))


def test_position_actuators_are_the_law():
    model, data = loaded(pendulum())
    data.qpos[0], data.qvel[0], data.ctrl[0] = 0.2, 1.5, 0.5
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == pytest.approx(25.0 * 0.3 - 0.8 * 1.5)


def test_a_velocity_command_has_an_actuator_of_its_own_and_one_limit():
    model, data = loaded(pendulum(law={"velocity_command": "derivative", "effort_limit": 9.0}))
    data.qpos[0], data.qvel[0], data.ctrl[:] = 0.2, 1.5, (0.5, 2.5)
    mujoco.mj_forward(model, data)
    assert data.actuator_force.sum() == pytest.approx(25.0 * 0.3 + 0.8 * 1.0)
    assert data.qfrc_actuator[0] == pytest.approx(25.0 * 0.3 + 0.8 * 1.0)
    data.ctrl[0] = 2.0
    mujoco.mj_forward(model, data)
    assert data.qfrc_actuator[0] == pytest.approx(9.0)


def test_a_velocity_drive_is_a_velocity_actuator():
    model, data = loaded(pendulum(law={"kind": "pd_velocity", "kp": 0.0, "effort_limit": 1.0}))
    data.qvel[0], data.ctrl[0] = 1.0, 1.5
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == pytest.approx(0.8 * 0.5)
    data.ctrl[0] = 9.0
    mujoco.mj_forward(model, data)
    assert data.actuator_force[0] == pytest.approx(1.0)


def test_forcerange_limits_the_drive_and_not_the_constant_torque():
    model, data = loaded(pendulum("offset", offset=0.4, law={"effort_limit": 5.0}))
    for command, drive in ((0.1, 2.5), (2.0, 5.0), (-2.0, -5.0)):
        data.ctrl[0] = command
        mujoco.mj_forward(model, data)
        assert data.actuator_force[0] == pytest.approx(drive - 0.4)


def test_delay_is_rounded_up_to_whole_steps_and_starts_from_its_buffer():
    model, data = loaded(pendulum(law={"delay_s": 0.0034}))
    model.opt.timestep, model.opt.gravity[:] = 0.001, 0.0
    model.dof_frictionloss[:] = model.dof_damping[:] = 0.0
    force = []
    for _ in range(8):
        data.qpos[0] = data.qvel[0] = 0.0
        data.ctrl[0] = 1.0
        mujoco.mj_step(model, data)
        force.append(round(float(data.actuator_force[0]), 9))
    assert force == [0.0] * 4 + [25.0] * 4  # 3.4 steps are 4; zero before
    mujoco.mj_resetData(model, data)
    mujoco.mj_initCtrlHistory(model, data, 0, None, np.full((int(model.actuator_history[0, 0]), 1), 0.5))
    mujoco.mj_step(model, data)
    assert data.actuator_force[0] == pytest.approx(12.5)


@pytest.mark.parametrize("sent", ["zero", "derivative"])
def test_a_filter_of_commands_is_an_activation(sent):
    """A step of the command, beside the closed form; and the velocity command has a filter of its own."""
    model, data = loaded(pendulum(law={"command_lag_s": 0.05, "velocity_command": sent}))
    assert model.na == model.nu == (1 if sent == "zero" else 2)
    mujoco.mj_step(model, data)
    data.ctrl[0] = 0.4
    for k in range(1, 101):
        mujoco.mj_step(model, data)
        assert data.act[0] == pytest.approx(0.4 * (1.0 - np.exp(-k * model.opt.timestep / 0.05)), rel=1e-9)


def test_motors_that_share_joints_are_tendons():
    K = np.array([[0.02, 0.0], [0.01, 0.01]])
    robot = ident.Robot.from_urdf(LEG).with_transmission(ident.Transmission(K, np.zeros(2), "motor"))
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    motors = np.array([1e-5, 2e-5]), np.array([1e-4, 2e-4]), np.array([1e-3, 2e-3])
    found = Identified(model, np.concatenate([robot.nominal, *motors]))
    with_rotors, without = loaded(found), loaded(Identified(model, np.concatenate([robot.nominal, np.zeros(2), *motors[1:]])))
    back, rate = np.linalg.inv(K), np.array([0.7, -1.1])
    inertia = []
    for own, data in (with_rotors, without):
        data.qvel[:] = rate
        mujoco.mj_forward(own, data)
        full = np.zeros((2, 2))
        mujoco.mj_fullM(own, data, full) if _new_order() else mujoco.mj_fullM(own, full, data.qM)
        inertia.append(full)
    assert inertia[0] - inertia[1] == pytest.approx(back.T @ np.diag(motors[0]) @ back)
    data = with_rotors[1]
    assert data.qfrc_passive == pytest.approx(-back.T @ np.diag(motors[1]) @ back @ rate)
    assert data.qfrc_constraint == pytest.approx(-back.T @ (motors[2] * np.sign(back @ rate)), rel=2e-2)


def test_rotors_between_branches_are_said_to_be_lost():
    """MuJoCo's inertia matrix has no entry for two joints of which none moves the other."""
    urdf = LEG.replace('<parent link="thigh"/>', '<parent link="base"/>')
    K = np.array([[0.02, 0.0], [0.01, 0.01]])
    robot = ident.Robot.from_urdf(urdf).with_transmission(ident.Transmission(K, np.zeros(2), "motor"))
    model = robot.rigid_body() + ident.friction.RotorInertia()
    found = Identified(model, np.concatenate([robot.nominal, [1e-5, 2e-5]]))
    own, data = loaded(found)
    mujoco.mj_forward(own, data)
    full = np.zeros((2, 2))
    mujoco.mj_fullM(own, data, full) if _new_order() else mujoco.mj_fullM(own, full, data.qM)
    back = np.linalg.inv(K)
    true = (back.T @ np.diag([1e-5, 2e-5]) @ back)[0, 1]
    assert abs(true) > 0.05
    assert full[0, 1] == 0.0
    (note,) = [n for n in make_target("mjcf", Path()).written(found, ExportOptions()).notes if "different branches" in n]
    assert float(re.search(r"up to ([\d.]+) kg", note).group(1)) == pytest.approx(abs(true), rel=1e-2)


def test_joints_that_follow_are_equalities():
    rng = np.random.default_rng(3)
    robot = ident.Robot.from_urdf(rollouts.robot_text(rng, 2, follower=True))
    model, data = loaded(Identified(robot.rigid_body(), robot.nominal))
    data.qpos[model.jnt_qposadr[model.joint("joint0").id]] = 0.3
    mujoco.mj_forward(model, data)
    expected = robot.tree_position(np.array([0.3, 0.0]))
    names = [joint.name for joint in robot.tree_joints]
    follower = names.index("joint2")
    residual = data.efc_pos[data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY]
    # The joint stands at zero: what the constraint still asks for is its place.
    assert abs(residual[0]) == pytest.approx(abs(expected[follower]))


def test_a_fit_of_torque_is_driven_by_motors():
    robot = ident.Robot.from_urdf(LEG)
    model, data = loaded(Identified(robot.rigid_body(), robot.nominal))
    data.ctrl[:] = (3.0, 30.0)
    mujoco.mj_forward(model, data)
    assert data.actuator_force == pytest.approx([3.0, 20.0])  # the URDF's effort


def test_gravity_and_inertia_are_the_links():
    """Inverse dynamics of the written bodies is the robot's own."""
    fit = leg(law={"delay_s": 0.0})
    robot = fit.model.robot
    model, data = loaded(fit, "mjcf")
    rng = np.random.default_rng(0)
    for _ in range(5):
        q, dq, ddq = rng.uniform(-1, 1, (3, 2))
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        # Friction is a constraint there, and damping passive: both are in the inverse.
        expected = inverse_dynamics(robot.tree, robot.nominal, q[None], dq[None], ddq[None])[0] + 0.012 * ddq + 0.08 * dq
        assert data.qfrc_inverse + data.qfrc_constraint == pytest.approx(expected, abs=1e-9)
    assert TRUTH["Ia"] == 0.012
