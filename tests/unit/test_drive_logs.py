"""Logs of commands: which columns are what, what is seen in them, and real ones where they are here."""

from __future__ import annotations

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.cli import main
from ident.drives import DriveLaw, DriveLog, fit_drives
from ident.drives.commands import commanded
from ident.drives.folds import HeldOut, best
from ident.drives.plant import DrivePlant
from ident.drives.seen import seen_in
from ident.drives.unknowns import unknowns


@pytest.fixture(scope="module")
def robot():
    return ident.Robot.from_urdf(LEG)


def test_units_of_commands_are_converted(robot):
    extra = {"q_cmd1_deg": np.array([180.0, 90.0]), "q_cmd2_rad": np.array([1.0, 2.0]), "supply1_V": np.array([7.0, 7.0]), "x": np.zeros(2)}
    found = commanded(extra, robot)
    assert set(found) == {"q_cmd", "supply"}
    assert found["q_cmd"] == pytest.approx(np.array([[np.pi, 1.0], [np.pi / 2, 2.0]]))
    assert np.isnan(found["supply"][:, 1]).all()


def test_a_log_that_numbers_all_joints_of_a_robot_with_locked_ones():
    knee = ident.Robot.from_urdf(LEG, joints=["knee"])
    found = commanded({"q_cmd1": np.zeros(3), "q_cmd2": np.ones(3)}, knee)
    assert np.array_equal(found["q_cmd"], np.ones((3, 1)))


def test_a_missing_command_names_file_column_and_joint(robot):
    log = ident.Log("bench", t=np.arange(4) * 0.01, q=np.zeros((4, 2)), extra={"q_cmd1": np.zeros(4)})
    with pytest.raises(ident.DataError, match=r"log bench: column q_cmd2 \(joint knee\)"):
        DriveLog.of(log, robot, DriveLaw.of(robot, kp=1.0))


def test_what_differs_by_log_is_looked_up_by_its_name(robot):
    law = DriveLaw.of(robot, kp=20.0, by_log={"*march*": {"kp": [10.0, 15.0], "command": "ramp"}})
    assert list(law.for_log("go2_march_traj0").constants["kp"]) == [10.0, 15.0]
    assert law.for_log("go2_march_traj0").command == "ramp"
    assert list(law.for_log("go2_april").constants["kp"]) == [20.0, 20.0]


def test_what_is_seen_in_a_log(robot):
    t = np.arange(400) * 0.005
    wanted = np.repeat(np.sin(2 * np.pi * t[::4]), 4)
    extra = {"q_cmd1": wanted, "q_cmd2": wanted, "torque_enable1": (t < 1.0).astype(float), "torque_enable2": (t < 1.0).astype(float)}
    log = ident.Log("run", t=t, q=0.9 * np.stack([wanted, wanted], axis=1), extra=extra)
    law = DriveLaw.of(robot, kp=20.0, effort_limit=1.0)
    seen = seen_in(DriveLog.of(log, robot, law), law)
    assert seen.rate_hz == pytest.approx(200.0)
    assert seen.command_unchanged == pytest.approx(0.75, abs=0.02)
    assert seen.torque_off == pytest.approx(0.5, abs=0.01)
    assert seen.saturated == pytest.approx(np.mean(np.abs(2.0 * wanted) > 1.0))
    assert "staircase" in seen.text()


def test_a_study_says_the_law(tmp_path):
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    file = tmp_path / "study.toml"

    def study(drive: str) -> ident.Study:
        file.write_text(f'[robot]\nurdf = "pendulum.urdf"\n[drive]\n{drive}\n')
        return ident.read_study(file)

    law = study('law = "pd_position"\nkp = { joint1 = 20 }\nkd = "fit"\neffort_limit = 3').drive_law()
    assert law is not None
    assert law.constants["kp"][0] == 20.0
    assert law.unknown("kd")
    assert law.unknown("delay_s")
    assert study('law = "torque"').drive_law() is None
    with pytest.raises(ident.ConfigurationError, match="kp must be a number"):
        study('law = "pd_position"\nkp = "stiff"')
    with pytest.raises(ident.ConfigurationError, match="unknown key of"):
        study('law = "pd_position"\nkp = 1\n[drive.by_log.run1]\nkpp = 2')
    written = study('law = "pd_position"\nkp = 20\n[drive.by_log."a*"]\nkp = 10').to_toml(tmp_path)
    file.write_text(written)
    again = ident.read_study(file).drive_law()
    assert again is not None
    assert again.for_log("abc").constants["kp"][0] == 10.0


@pytest.mark.parametrize("key", ["effort_limit", "joint_stiffness", "no_load_speed"])
@pytest.mark.parametrize(
    ("given", "expected"),
    [('"none"', [np.inf] * 2), ('["none", 3]', [np.inf, 3.0]), ('{ hip = "none", knee = "identify" }', [np.inf, np.nan])],
)
def test_a_joint_without_a_limit(tmp_path, robot, key, given, expected):
    """In a study, in one that is written again, and in the law's own words, of all logs and of one."""
    (tmp_path / "leg.urdf").write_text(LEG)
    file = tmp_path / "study.toml"
    limit = "" if key != "no_load_speed" else "effort_limit = 2\n"
    file.write_text(
        f'[robot]\nurdf = "leg.urdf"\n[drive]\nlaw = "pd_position"\nkp = 20\n{limit}{key} = {given}\n[drive.by_log.a]\n{key} = {given}\n'
    )
    file.write_text(ident.read_study(file).to_toml(tmp_path))
    law = ident.read_study(file).drive_law()
    assert law is not None
    again = law.to_dict()
    again = DriveLaw.of(robot, again.pop("law"), **again)
    for one in (law, law.for_log("a"), again, again.for_log("a")):
        np.testing.assert_array_equal(one.constants[key], expected)
    model = robot.rigid_body() + ident.friction.Viscous()
    of_logs = DriveLaw.of(robot, kp=20.0, by_log={"a": {key: ["none", 3.0]}}, **({"effort_limit": 2.0} if limit else {}))
    assert key not in {unknown.place for unknown in unknowns(model, of_logs)}


def test_what_a_constant_may_be(tmp_path, robot):
    with pytest.raises(ident.ConfigurationError, match=r"effort_limit: joint 'hip' .* \"identify\", or \"none\""):
        DriveLaw.of(robot, kp=20.0, effort_limit={"knee": 2.0})
    with pytest.raises(ident.ConfigurationError, match=r"kp: joint 'hip' .* a number or \"identify\""):
        DriveLaw.of(robot, kp={"knee": 2.0})
    with pytest.raises(ident.ConfigurationError, match=r"kd of joint 'knee' is 'none'"):
        DriveLaw.of(robot, kp=20.0, kd=[1.0, "none"])
    (tmp_path / "leg.urdf").write_text(LEG)
    file = tmp_path / "study.toml"
    file.write_text('[robot]\nurdf = "leg.urdf"\n[drive]\nlaw = "pd_position"\nkp = { hip = "none", knee = 2 }\n')
    with pytest.raises(ident.ConfigurationError, match=r"kp must be .* only effort_limit, joint_stiffness and no_load_speed may be"):
        ident.read_study(file)


@needs_native
def test_the_limit_of_one_joint_is_identified_beside_one_without(robot):
    truth = {"Ia": 0.012, "Fv": 0.1, "Fc": 0.2, "kp": [25.0, 20.0], "kd": 0.8, "delay": 0.006, "limit": [np.inf, 1.5]}
    logs = ident.LogSet((commanded_log(robot, truth, seed=1, rate=200, before=1.0),))
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    law = DriveLaw.of(robot, kp=[25.0, 20.0], kd=0.8, effort_limit={"hip": "none", "knee": "identify"})
    fit = fit_drives(logs, model, law)
    assert fit.value("effort_limit_knee") == pytest.approx(1.5, rel=0.01)
    assert "effort_limit_hip" not in fit.names
    assert np.isinf(fit.constants()["effort_limit"][0])


@pytest.mark.slow
def test_a_real_actuator_is_simulated_as_well_as_published(data_folder):
    """K-Bot's hip pitch: published baseline 0.0050 rad from chirp to step, load free."""
    from benchmarks.actuators.run import cases, fitted

    (case,) = [c for c in cases(short=True) if "hip_pitch" in c.name]
    assert fitted(case)[0].heldout_rms[0] < 0.0050


def test_diagnose_by_regression_says_in_one_line_why_there_is_no_torque(tmp_path, capsys):
    """A delay that is to be identified leaves no torque to explain."""
    t = np.arange(2000) * 0.005
    rows = np.column_stack([t, np.sin(t), np.sin(t)])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time_s,q1_rad,q_cmd1_rad", comments="")
    (tmp_path / "robot.urdf").write_text(PENDULUM)
    drive = '[drive]\nlaw = "pd_position"\nkp = 20.0\nkd = 1.0\ndelay_s = "identify"\neffects = ["viscous"]\n'
    (tmp_path / "study.toml").write_text(f'[robot]\nurdf = "robot.urdf"\n{drive}[logs]\nfit = ["log.csv"]\n')
    assert main(["diagnose", str(tmp_path / "study.toml"), "--method", "wls"]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    assert "delay_s is to be identified" in said
    assert "ident fit" in said


def test_the_choice_between_models_counts_each_log_by_its_own_error():
    """A loud log does not outvote quiet ones: what halves a small error is more likely than what takes a tenth off a large one."""
    logs = np.repeat([0, 1, 2], 100)
    size = np.where(logs == 0, 0.5, 0.01)[:, None]
    plain = HeldOut(size**2, logs)
    quiet = HeldOut(np.where(logs[:, None] == 0, 1.05 * size, 0.5 * size) ** 2, logs)
    loud = HeldOut(np.where(logs[:, None] == 0, 0.9 * size, size) ** 2, logs)
    assert best([plain, quiet, loud]) == 1
    assert best([plain, HeldOut(0.99 * size**2, logs)]) == 0


def test_links_without_mass_are_not_possible():
    """Where the links are free, a set of parameters that leaves a joint no inertia is never simulated as if it had some."""
    robot = ident.Robot.from_urdf(PENDULUM)
    model = robot.rigid_body() + ident.make_effect("rotor_inertia")
    t = np.arange(100) * 0.01
    log = ident.Log("run", t=t, q=np.zeros((100, 1)), extra={"q_cmd1": np.zeros(100)})
    law = DriveLaw.of(robot, kp=20.0, delay_s=0.0, links="identify")
    plant = DrivePlant(model, law, (DriveLog.of(log, robot, law),))
    sets = np.zeros((2, len(plant.unknowns)))
    (inertia,) = [i for i, u in enumerate(plant.unknowns) if u.name.startswith("Iyy")]
    sets[:, inertia] = 0.01, -1e-6
    assert list(plant.possible(sets)) == [True, False]
