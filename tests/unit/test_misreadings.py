"""What a log has misread: zeros, units of one torque, the clock; found in the fit's own residual, and not where they are not."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

import ident
from benchmarks.actuators.commanded import PENDULUM
from benchmarks.robustness.mistakes import MISTAKES, World, ended
from ident.estimators import WeightedLeastSquares
from ident.evaluation.against_nominal import factor_doubt, size_doubt, zero_doubt
from ident.evaluation.doubts import doubts
from ident.evaluation.misreadings import misassigned, misreading
from ident.problem.problem import Problem
from ident.signals import ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray
RATE = 200.0


@cache
def recorded(
    name: str, noise: float = 0.01, stribeck: float = 0.0, rotor: float = 0.0, seconds: float = 20.0
) -> tuple[Array, Array, Array]:
    """Times, positions and torques of a built-in robot whose links are the URDF's, with friction; `stribeck`: more of it at low speed;
    `rotor`: inertia of the rotors."""
    robot = ident.load_robot(name)
    n, rng = robot.n, np.random.default_rng(4)
    scale = np.where([j.prismatic for j in robot.joints], 0.1, 0.4)
    order = np.arange(1, 5)[:, None]
    motion = FourierTrajectory(np.full(n, 0.3) * scale, *scale * rng.normal(size=(2, 4, n)) / order, 0.1)
    t = np.arange(round(seconds * RATE)) / RATE
    c = motion.sample(t)
    assert robot.nominal is not None
    model = robot.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
    size = np.sqrt(np.mean(model.inverse_dynamics(c.q, c.dq, c.ddq, np.r_[robot.nominal, np.zeros(2 * n)]) ** 2, axis=0)) + 0.01
    tau = model.inverse_dynamics(c.q, c.dq, c.ddq, np.r_[robot.nominal, 0.1 * size, 0.1 * size])
    tau = tau + rotor * c.ddq + stribeck * size * np.sign(c.dq) * np.exp(-((c.dq / 0.3) ** 2))
    return t, c.q, tau + noise * size * rng.standard_normal(tau.shape)


def fitted(name: str, t: Array, q: Array, tau: Array) -> ident.Estimate:
    robot = ident.load_robot(name)
    model = robot.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
    log = ident.Log("run", t, q=q, tau={robot.transmission.measured.value: tau})
    return WeightedLeastSquares().solve(Problem(model, ZeroPhase(cutoff_hz=10.0)(log, robot)))


@pytest.mark.parametrize("name", ["puma560", "ur5", "scara"])
def test_a_sound_log_raises_none(name: str) -> None:
    estimate = fitted(name, *recorded(name))
    assert misreading(estimate) == ""
    assert doubts(estimate) == ()


@pytest.mark.parametrize(("name", "j", "off"), [("puma560", 1, 0.2), ("puma560", 2, -0.5), ("puma560", 4, 0.5), ("ur5", 4, -0.2)])
def test_a_zero_that_is_off(name: str, j: int, off: float) -> None:
    t, q, tau = recorded(name)
    estimate = fitted(name, t, q + off * np.eye(q.shape[1])[j], tau)
    said = misreading(estimate)
    joint = estimate.model.robot.joint_names[j]
    assert f"the zero of {joint} seems to be off: its position reads about {abs(off):.2g} rad too {'far' if off > 0 else 'little'}" in said
    assert said in doubts(estimate)
    assert not any("time that runs" in one for one in doubts(estimate))


def test_joints_whose_zeros_these_data_do_not_tell_apart_are_both_named() -> None:
    """Axes of the UR5's elbow and first wrist are parallel."""
    t, q, tau = recorded("ur5")
    said = misreading(fitted("ur5", t, q + 0.4 * np.eye(6)[2], tau))
    assert ("wrist_1_joint" in said) == ("cannot distinguish them" in said)


@pytest.mark.parametrize("factor", [10.0, 0.1])
def test_the_torque_of_one_joint_in_another_unit(factor: float) -> None:
    t, q, tau = recorded("puma560")
    scale = np.ones(6)
    scale[1] = factor
    said = misreading(fitted("puma560", t, q, scale * tau))
    assert "the torque of joint2 seems to be about " in said
    told = float(said.split("about ")[1].split()[0])
    assert told == pytest.approx(factor, rel=0.3)


@pytest.mark.parametrize(("name", "late"), [("ur5", 2), ("ur5", -2), ("scara", 4), ("z1", 2)])
def test_torques_that_are_late_together(name: str, late: int) -> None:
    """One joint's encoder was blamed, or nothing."""
    t, q, tau = recorded(name)
    inner = slice(10, -10)
    estimate = fitted(name, t[inner], q[inner], np.roll(tau, late, axis=0)[inner])
    said = misreading(estimate)
    assert said.startswith("the torques of all joints seem to be about ")
    assert float(said.split("about ")[1].split()[0]) == pytest.approx(1e3 * abs(late) / RATE, rel=0.15)
    assert f"too {'late' if late > 0 else 'early'} relative to the positions" in said
    assert said in doubts(estimate)


def test_a_position_that_alone_is_late_is_still_blamed_alone() -> None:
    t, q, tau = recorded("ur5")
    late = q.copy()
    late[:, 2] = np.roll(q[:, 2], 4)
    said = misreading(fitted("ur5", t[10:], late[10:], tau[10:]))
    assert said.startswith("the position of elbow_joint seems to be about 2"), said
    assert "all joints" not in said


@pytest.mark.parametrize("clock", [1.5, 0.5])
def test_another_clock(clock: float) -> None:
    t, q, tau = recorded("puma560")
    said = misreading(fitted("puma560", clock * t, q, tau))
    told = float(said.split("about ")[1].split()[0])
    assert told == pytest.approx(max(clock, 1.0 / clock), rel=0.1)
    assert ("too slowly" in said) == (clock > 1.0)


@pytest.mark.parametrize(("name", "j"), [("puma560", 2), ("z1", 1)])
@pytest.mark.parametrize(
    ("position", "torque", "named"),
    [
        (-1.0, 1.0, "the position of {} seems to count in the opposite direction"),
        (1.0, -1.0, "torque of {} seems to have the opposite sign"),
        (-1.0, -1.0, "position and torque of {} seem to count in the direction opposite to the axis in the URDF"),
    ],
)
def test_a_joint_that_counts_the_other_way_round(name: str, j: int, position: float, torque: float, named: str) -> None:
    """An encoder in the wrong direction was blamed on a torque's sign, or on another joint's zero."""
    t, q, tau = recorded(name)
    turned = np.eye(q.shape[1])[j]
    said = misreading(fitted(name, t, q * (1.0 + (position - 1.0) * turned), tau * (1.0 + (torque - 1.0) * turned)))
    joint = ident.load_robot(name).joint_names[j]
    assert said.startswith(named.format(joint)), said


@pytest.mark.parametrize(
    ("positions", "torques", "named"), [(True, False, "the positions of"), (False, True, "the torques of"), (True, True, "positions and")]
)
def test_columns_of_two_joints_that_were_exchanged(positions: bool, torques: bool, named: str) -> None:
    """They were blamed on the clock."""
    t, q, tau = recorded("ur5")
    order = np.arange(q.shape[1])
    order[[0, 1]] = 1, 0
    estimate = fitted("ur5", t, q[:, order] if positions else q, tau[:, order] if torques else tau)
    said = misreading(estimate)
    assert said.startswith(named), said
    assert "{} and {} seem to be exchanged".format(*estimate.model.robot.joint_names[:2]) in said
    assert misassigned(estimate) == said


@pytest.mark.parametrize("gravity", [(9.81, 0.0, 0.0), (0.0, 0.0, 9.81), (4.0, -5.0, -7.43)])
def test_a_robot_that_hangs_where_it_was_said_to_stand(gravity: tuple[float, float, float]) -> None:
    """A wall-mounted robot was blamed on the unit of its torque."""
    estimate = mounted(gravity)
    said = misreading(estimate)
    direction = np.array(gravity) / np.linalg.norm(gravity)
    told = [float(x) for x in said.split("act along (")[1].split(")")[0].split(",")]
    assert told == pytest.approx(direction, abs=0.05)
    assert "[robot] gravity = [" in said
    assert said in doubts(estimate)


def test_a_torque_without_gravity() -> None:
    assert "the torque seems to hold no gravity" in misreading(mounted((0.0, 0.0, 0.0)))


def mounted(gravity: tuple[float, float, float]) -> ident.Estimate:
    """A fit of a UR5 in some gravity, with what is usually declared."""
    t, q, tau = recorded("ur5")
    robot = ident.load_robot("ur5")
    signals = ZeroPhase(cutoff_hz=10.0)(ident.Log("run", t, q=q, tau={"joint": tau}), robot)
    assert robot.nominal is not None
    change = [
        there.rigid_body().inverse_dynamics(signals.q, signals.dq, signals.ddq, robot.nominal)
        for there in (robot, robot.with_gravity(gravity))
    ]
    # Gravity's torque where the samples are, laid over the recorded one at the times of the log.
    other = np.stack([np.interp(t, signals.t, x) for x in (change[1] - change[0]).T], axis=1)
    return fitted("ur5", t, q, tau + other)


def test_friction_that_the_model_lacks_is_blamed_on_nothing() -> None:
    estimate = fitted("puma560", *recorded("puma560", stribeck=2.0))
    assert estimate.fit_error.relative_all > 0.03
    assert misreading(estimate) == ""


def test_rotors_that_the_model_lacks_are_blamed_on_nothing() -> None:
    estimate = fitted("ur5", *recorded("ur5", noise=0.003, rotor=0.8, seconds=8.0))
    assert estimate.fit_error.relative.max() > 0.02
    assert misreading(estimate) == ""


def test_noise_is_blamed_on_nothing() -> None:
    assert misreading(fitted("ur5", *recorded("ur5", noise=0.2))) == ""


def test_the_zero_of_the_last_joint_shows_in_its_link_alone() -> None:
    t, q, tau = recorded("puma560", noise=0.001)
    estimate = fitted("puma560", t, q + 0.5 * np.eye(6)[5], tau)
    assert misreading(estimate) == ""
    assert factor_doubt(estimate) == ""
    assert "reads 0.5 rad too far" in zero_doubt(estimate)
    assert zero_doubt(fitted("puma560", t, q, tau)) == ""


def test_positions_many_times_too_small_leave_links_that_no_robot_has(tmp_path: Path) -> None:
    """Radians under a name that says degrees: within small angles gravity follows another pattern than the URDF's, and only sizes tell."""
    world, rng = World.of("ur5"), np.random.default_rng([20261127, 166])
    found = ended(world, MISTAKES["radians, said to be degrees"](world.log(rng), world, rng), tmp_path)
    assert any("parameters are many times what the URDF's links have" in said and "kg m^2" in said for said in found.warnings)
    assert size_doubt(fitted("ur5", *recorded("ur5"))) == ""


@pytest.mark.parametrize(("j", "samples"), [(2, 8), (4, -6)])
def test_a_position_that_comes_late(j: int, samples: int) -> None:
    t, q, tau = recorded("ur5")
    rows = np.clip(np.arange(len(t)) - samples, 0, len(t) - 1)
    late = q.copy()
    late[:, j] = q[rows, j]
    inner = slice(10, -10)
    estimate = fitted("ur5", t[inner], late[inner], tau[inner])
    said = misreading(estimate)
    joint = estimate.model.robot.joint_names[j]
    assert f"the position of {joint} seems to be about" in said
    assert f"too {'late' if samples > 0 else 'early'}" in said
    assert float(said.split("about ")[1].split()[0]) == pytest.approx(5 * abs(samples), rel=0.1)


@pytest.mark.parametrize("between", ["", "# paused\n", "time,id,position,effort\n"], ids=["whole", "comment", "header"])
@pytest.mark.parametrize("end", ["", "1.0", "1.00,1,0.3", "1.00,1,0.3,0.0."], ids=["whole", "time", "short", "number"])
def test_names_and_numbers_of_a_long_table_are_of_the_same_rows(tmp_path: Path, between: str, end: str) -> None:
    rows = [f"{k // 2 * 0.02:.2f},{k % 2 + 1},{0.01 * k + k % 2:.3f},{0.2 * k:.4f}\n" for k in range(100)]
    path = tmp_path / "log.csv"
    path.write_text("".join(["time,id,position,effort\n", *rows[:50], between, *rows[50:], end]))
    (log,) = ident.read_logs(path).logs
    assert log.t == pytest.approx(0.02 * np.arange(50), abs=1e-9)
    assert log.q == pytest.approx(0.01 * np.arange(100).reshape(50, 2) + [0.0, 1.0], abs=1e-3)


def test_a_torque_that_contradicts_the_others_is_in_no_unit(data_folder: Path) -> None:
    """A real double pendulum whose first joint swings freely: the second's torque was said to be 5.3e11 times too large."""
    folder = data_folder / "dfki_double_pendulum"
    warnings = ident.fit(folder / "dp_A0_0815_traj12.csv.gz", folder / "dp_designA.urdf").warnings
    assert not any("times what the other joints' torques say" in said for said in warnings), warnings


def test_a_spring_about_an_axis_along_gravity_is_no_other_mounting() -> None:
    """The least tilt with first moments of tons would be that spring: neither a fit nor the diagnosis that finds it speaks of gravity."""
    t, q, tau = recorded("scara")
    springy = tau + np.array([1.0, 0.0, 0.0, 0.0]) * 40.0 * np.sin(q - q.mean(axis=0))
    estimate = fitted("scara", t, q, springy)
    assert "gravity" not in misreading(estimate) + misassigned(estimate)
    on_a_wall = ident.load_robot("scara").with_gravity([9.81, 0.0, 0.0])
    model = on_a_wall.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
    log = ident.Log("run", t, q=q, tau={on_a_wall.transmission.measured.value: tau})
    assert "gravity" in misassigned(WeightedLeastSquares().solve(Problem(model, ZeroPhase(cutoff_hz=10.0)(log, on_a_wall))))


def swung(swing: float, constant: float = 0.0, zero: float = 0.0, late: int = 0) -> ident.Estimate:
    """A fit of a pendulum's friction and link: `constant`, times its usual torque, comes to that; the position reads `zero` too far; the
    torque comes so many samples `late`."""
    robot = ident.Robot.from_urdf(PENDULUM)
    rng = np.random.default_rng(5)
    t = np.arange(0.0, 30.0, 1.0 / RATE)
    c = FourierTrajectory(np.full(1, 0.3), *swing * rng.normal(size=(2, 5, 1)) / np.arange(1, 6)[:, None], 0.1).sample(t)
    model = robot.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
    size = float(np.sqrt(np.mean(model.inverse_dynamics(c.q, c.dq, c.ddq, np.r_[robot.nominal, 0.0, 0.0]) ** 2)))
    tau = model.inverse_dynamics(c.q, c.dq, c.ddq, np.r_[robot.nominal, 0.05 * size, 0.1 * size]) + constant * size
    tau = np.roll(tau + 0.01 * size * rng.standard_normal(tau.shape), late, axis=0)
    inner = slice(20, -20)
    log = ident.Log("run", t[inner], q=c.q[inner] + zero, tau={robot.transmission.measured.value: tau[inner]})
    return ident.fit(log, robot, model=model, held=0)


@pytest.mark.parametrize(("swing", "constant"), [(0.25, 0.5), (0.25, 0.2), (0.6, -0.3)])
def test_a_constant_torque_is_no_zero_that_is_off(swing: float, constant: float) -> None:
    """On a short swing it turns the link as a zero does: a plain fit blamed the zero, and its diagnosis took that back."""
    estimate = swung(swing, constant=constant)
    assert "the zero of that joint is off" in zero_doubt(estimate)
    assert not any("zero" in said for said in estimate.warnings)
    assert [f.name for f in ident.diagnose(estimate).findings] == ["offset"]


@pytest.mark.parametrize(("swing", "zero"), [(0.25, 0.3), (0.6, -0.3), (1.0, 0.1)])
def test_a_zero_that_no_constant_torque_accounts_for_is_still_told(swing: float, zero: float) -> None:
    told = next(said for said in swung(swing, zero=zero).warnings if "the zero of that joint is off" in said)
    assert f"reads {abs(zero):.2g} rad too {'far' if zero > 0 else 'little'}" in told


def test_a_diagnosis_that_explains_a_log_takes_doubts_about_the_fit_without_it_back() -> None:
    """A torque that is late looks like a position that is early, until the delay is found."""
    estimate = swung(1.0, late=6)
    wrong = doubts(estimate)
    assert any("too early" in one for one in wrong)
    assert set(wrong) <= set(estimate.warnings)
    found = ident.diagnose(estimate)
    assert [(f.name, f.joints) for f in found.findings] == [("delay", estimate.model.robot.joint_names)]
    assert not [w for w in found.warnings if any(old in w for old in wrong)]
