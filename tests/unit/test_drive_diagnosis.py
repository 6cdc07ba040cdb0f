"""What a diagnosis names in logs without torque: servos of a simulation written beside the product, with something injected."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from benchmarks.actuators.servos import URDF, recorded, servo
from ident.cli import main
from ident.diagnosis.drives import diagnose_drives
from ident.diagnosis.drives.candidates import DriveCandidate, same_motion
from ident.diagnosis.drives.result import DriveFinding
from ident.diagnosis.drives.revision import Accepted, needed
from ident.diagnosis.drives.screening import Screened
from ident.diagnosis.drives.trials import Stage, settled, with_candidate
from ident.drives import DriveLaw
from ident.drives.plant import DrivePlant
from ident.drives.search import fitted
from ident.drives.space import drive_logs
from ident.drives.starts import moved_inertia, starts
from ident.logs.log import LogSet
from ident.regressor.kernel_choice import kernel

EFFECTS = ("rotor_inertia", "viscous", "coulomb", "offset")
CASES = ("clean", "clean", "joint_elasticity", "load_dependent_friction", "kp", "delay", "deadband")


@pytest.fixture(scope="module")
def logs():
    """One log of each case, with its servo."""
    seeds = [0, 1, 2, 2, 2, 2, 2]
    servos = [servo(fault, seed) for fault, seed in zip(CASES, seeds, strict=True)]
    t, q, sent = recorded(servos, seeds)
    return [(one, t, q[:, [k]], sent[:, k]) for k, one in enumerate(servos)]


def diagnosed(case, **declared):
    one, t, q, sent = case
    robot = ident.Robot.from_urdf(URDF)
    model = robot.rigid_body()
    for name in EFFECTS:
        model = model + ident.make_effect(name)
    log = ident.Log("run", t=t, q=q, extra={"q_cmd1": sent})
    return diagnose_drives(LogSet((log,)), model, DriveLaw.of(robot, **{**one.declared, **declared}))


@pytest.mark.parametrize("k", [0, 1])
def test_nothing_is_found_where_nothing_is_missing(logs, k):
    found = diagnosed(logs[k])
    assert found.verdict == "clean"
    assert not found.findings


@pytest.mark.parametrize("k", range(2, len(CASES)), ids=CASES[2:])
def test_what_was_injected_is_named_with_its_size(logs, k):
    one = logs[k][0]
    found = diagnosed(logs[k])
    assert [f.effect for f in found.findings] == [CASES[k]]
    name, value, std, _ = found.findings[0].values[-2 if CASES[k] == "joint_elasticity" else -1]
    sizes = {"joint_elasticity": one.stiffness, "load_dependent_friction": one.load, "deadband": one.deadband}
    true = (sizes | {"kp": one.kp, "delay": one.delay})[CASES[k]]
    assert value == pytest.approx(true, rel=0.05), name
    assert std < 0.1 * true
    assert found.after.fit_rms[0] == pytest.approx(5e-4, rel=0.1)
    assert found.before.fit_rms[0] > 1.1 * found.after.fit_rms[0]


def test_a_gain_that_is_to_be_identified_is_not_doubted(logs):
    found = diagnosed(logs[4], kp="identify")
    assert not found.findings
    assert found.before.value("kp_joint1") == pytest.approx(logs[4][0].kp, rel=0.03)


def test_a_study_is_diagnosed_by_simulation(logs, tmp_path, capsys):
    one, t, q, sent = logs[5]
    rows = np.column_stack([t, q, sent])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time_s,q1_rad,q_cmd1_rad", comments="", fmt="%.17g")
    (tmp_path / "robot.urdf").write_text(URDF)
    drive = f'[drive]\nlaw = "pd_position"\nkp = {one.kp}\nkd = {one.kd}\ndelay_s = {one.declared["delay_s"]}\n'
    effects = f"effects = {json.dumps(EFFECTS)}\n"
    (tmp_path / "study.toml").write_text(f'[robot]\nurdf = "robot.urdf"\n{drive}{effects}[logs]\nfit = ["log.csv"]\n')
    assert main(["diagnose", str(tmp_path / "study.toml"), "--json", "--strict", "--out", str(tmp_path / "out")]) == 1
    said = json.loads(capsys.readouterr().out)
    assert said["findings"][0]["effect"] == "delay"
    assert said["findings"][0]["declared"] == pytest.approx(one.declared["delay_s"])
    assert said["after"]["replay"]["heldout"]["rms"][0] < said["before"]["replay"]["heldout"]["rms"][0]
    assert (tmp_path / "out" / "after.fit.json").exists()


@pytest.fixture(scope="module")
def wrong_knee():
    """Two joints that move each other, of which the knee has another kp than declared: logs, model and declared law."""
    if not kernel().compiled:
        pytest.skip("the log is simulated by compiled code")
    robot = ident.Robot.from_urdf(LEG)
    truth = {"Ia": [0.012, 0.01], "Fv": 0.1, "Fc": 0.15, "offset": 0.1, "kp": [25.0, 20.0], "kd": 0.8, "delay": 0.006}
    log = commanded_log(robot, truth, seed=4, seconds=3.0, before=1.0)
    model = robot.rigid_body()
    for name in EFFECTS:
        model = model + ident.make_effect(name)
    return LogSet((log,)), model, DriveLaw.of(robot, kp=[25.0, 26.0], kd=0.8, delay_s=0.006)


def test_a_finding_keeps_the_joints_on_which_it_counts_in_the_end(wrong_knee):
    """Large steps of time may have put it on both: the fit to the end names the one."""
    logs, model, law = wrong_knee
    plant = DrivePlant(model, law, drive_logs(logs, model.robot, law))
    at, sizes = starts(plant)
    stage, inertia = Stage(plant, fitted(plant, at, sizes), sizes), moved_inertia(plant)
    one = Screened(DriveCandidate("kp", "kp"), (0, 1), np.zeros(2), 0.5)
    kept, after = settled(stage, one, with_candidate(stage, one, inertia), plant.step, inertia)
    assert kept.joints == (1,)
    assert [u.name for u in after.plant.unknowns if u.place == "kp"] == ["kp_knee"]


def test_a_gain_is_doubted_on_the_joint_that_has_another_one(wrong_knee):
    """That the one is wrong does not make the other so."""
    found = diagnose_drives(*wrong_knee)
    (finding,) = found.findings
    assert (finding.effect, finding.joints) == ("kp", ("knee",))
    ((name, value, std, _),) = finding.values
    assert name == "kp_knee"
    assert abs(value - 20.0) < min(3.0 * std, 0.2)
    assert finding.gain > 0.5
    assert finding.declared == (26.0,)
    assert any("inertial parameters of the URDF's links" in text for text in found.warnings)


def test_numbers_that_differ_by_joint_are_all_told(wrong_knee):
    found = diagnose_drives(*wrong_knee)
    finding = replace(found.findings[0], joints=("hip", "knee"), declared=(25.0, 26.0))
    assert "(declared: 25, 26)" in finding.text()
    assert replace(found, findings=(finding,)).to_dict()["findings"][0]["declared"] == [25.0, 26.0]
    assert found.to_dict()["findings"][0]["declared"] == 26.0


def test_an_interval_keeps_to_what_is_possible(wrong_knee):
    found = diagnose_drives(*wrong_knee)
    doubtful = replace(found.findings[0], values=(("kp_knee", 20.0, 30.0, "N m/rad"),))
    assert "kp_knee not determined (0 to 79 N m/rad)" in doubtful.text()
    (told,) = replace(found, findings=(doubtful,)).to_dict()["findings"][0]["parameters"]
    assert told["interval"] == [0.0, pytest.approx(78.8)]


@pytest.fixture(scope="module")
def moving_command():
    """A drive that is sent the derivative of its position command, too, and has another kd than declared."""
    if not kernel().compiled:
        pytest.skip("the log is simulated by compiled code")
    robot = ident.Robot.from_urdf(PENDULUM)
    truth = {"Ia": 0.012, "Fv": 0.5, "Fc": 0.15, "offset": 0.1, "kp": 25.0, "kd": 0.8, "delay": 0.006}
    log = commanded_log(robot, truth, seed=6, seconds=4.0, before=1.0, speed_command=True)
    model = robot.rigid_body()
    for name in EFFECTS:
        model = model + ident.make_effect(name)
    return LogSet((log,)), model


@pytest.mark.parametrize(("sent", "others"), [("logged", []), ("derivative", ["velocity_command"])])
def test_a_kd_beside_a_velocity_command_that_nobody_logged(moving_command, sent, others):
    """Twice the kd and twice the velocity command are the same, where viscous friction makes up for the rest."""
    logs, model = moving_command
    found = diagnose_drives(logs, model, DriveLaw.of(model.robot, kp=25.0, kd=0.5, delay_s=0.006, velocity_command=sent))
    (finding,) = found.findings
    assert finding.effect == "kd"
    assert finding.values[0][1] == pytest.approx(0.8, abs=0.05)
    assert [rival.effect for rival in finding.rivals] == others
    assert finding.confidence + sum(rival.confidence for rival in finding.rivals) == pytest.approx(1.0, abs=0.01)
    assert found.verdict == ("ambiguous" if others else "explained")


@pytest.mark.parametrize(("scale", "kd", "others"), [("identify", 0.0, ("effort_limit",)), (0.5, 0.0, ()), ("identify", 0.1, ())])
def test_a_gain_of_duty_beside_its_limit(scale, kd, others):
    """Where the torque of full duty is unknown, half the gain is twice the limit: the bracket's size is nobody's to say."""
    robot = ident.Robot.from_urdf(PENDULUM)
    law = DriveLaw.of(robot, "pwm", kp=1.2, kd=kd, torque_scale=scale, back_emf=0.0, delay_s=0.0)
    one, t = DriveCandidate("kp", "kp"), np.arange(0.0, 1.0, 0.01)
    still = np.zeros((len(t), 1))
    log = ident.Log("run", t=t, q=still, extra={"q_cmd1": still[:, 0], "supply1_V": still[:, 0] + 7.0})
    wider = one.added_to(DrivePlant(robot.rigid_body(), law, drive_logs(LogSet((log,)), robot, law)), [0])
    assert same_motion(one, (0,), law, wider, np.ones(len(wider.unknowns))) == others


def leg_diagnosed(truth, seed, ticks=0, **declared):
    """A leg of two joints, whose log may be in ticks of an encoder (a turn)."""
    robot = ident.Robot.from_urdf(LEG)
    log = commanded_log(robot, {**SOFT, **truth}, seed=seed, seconds=4.0, before=1.0, noise=1e-4 if ticks else 5e-4)
    if ticks:
        log = replace(log, q=2 * np.pi / ticks * np.round(log.q * ticks / (2 * np.pi)))
    model = robot.rigid_body()
    for name in EFFECTS:
        model = model + ident.make_effect(name)
    law = DriveLaw.of(robot, **{"kp": [25.0, 20.0], "kd": 0.8, "delay_s": 0.01, **declared})
    return LogSet((log,)), model, law


SOFT = {"Ia": [0.012, 0.01], "Fv": 0.1, "Fc": [0.3, 0.2], "offset": 0.05, "kp": [25.0, 20.0], "kd": 0.8, "delay": 0.01}


@needs_native
@pytest.mark.parametrize("seed", [0, 1])
def test_a_delay_is_that_of_all_joints(seed):
    """Twice the declared one, in ticks: nothing stands beside it, and what is left are ticks."""
    found = diagnose_drives(*leg_diagnosed({"delay": 0.02}, seed, ticks=4096))
    (finding,) = found.findings
    assert (finding.effect, finding.joints, str(found.verdict)) == ("delay", ("hip", "knee"), "explained")
    assert finding.values[0][1] == pytest.approx(0.02, abs=2e-4)
    assert np.all(found.after.fit_rms < 6e-4)


@needs_native
@pytest.mark.parametrize("seed", [0, 1])
def test_a_limit_that_nobody_declared(seed):
    """Its size, and only where it is reached."""
    found = diagnose_drives(*leg_diagnosed({"limit": [4.0, 50.0]}, seed))
    (finding,) = found.findings
    assert (finding.effect, finding.joints, str(found.verdict)) == ("effort_limit", ("hip",), "explained")
    assert finding.values[0][1] == pytest.approx(4.0, rel=0.005)
    assert finding.declared is None


@needs_native
def test_a_limit_that_is_another_than_declared():
    found = diagnose_drives(*leg_diagnosed({"limit": [4.0, 3.0]}, 0, effort_limit=[6.0, 3.0]))
    (finding,) = found.findings
    assert (finding.effect, finding.joints) == ("effort_limit", ("hip",))
    assert finding.values[0][1] == pytest.approx(4.0, rel=0.005)


@needs_native
def test_what_stood_in_for_a_later_finding_goes():
    """Friction that follows the load, found first, is none once the delay is there."""
    logs, model, law = leg_diagnosed({"delay": 0.02}, 0)
    declared = DrivePlant(model, law, drive_logs(logs, model.robot, law))
    loss, late = DriveCandidate("gear_loss", "gear_loss"), DriveCandidate("delay", "delay_s")
    plant = late.added_to(loss.added_to(declared, [0, 1]), [0, 1])
    at, sizes = starts(plant)
    now = Stage(plant, fitted(plant, at, sizes), sizes)
    told = [DriveFinding(one.name, (), (), None, 0.5, 1.0, ()) for one in (loss, late)]
    accepted = [Accepted(Screened(one, (0, 1), np.zeros(2), 0.5), text) for one, text in zip((loss, late), told, strict=True)]
    kept, after = needed(declared, now, accepted)
    assert [one.one.candidate.name for one in kept] == ["delay"]
    assert "Fm_hip" not in {u.name for u in after.plant.unknowns}
    assert after.fit.cost == pytest.approx(now.fit.cost, rel=0.05)
    # What is there stays.
    logs, model, law = leg_diagnosed({"delay": 0.02, "limit": 4.0}, 0)
    declared = DrivePlant(model, law, drive_logs(logs, model.robot, law))
    found = diagnose_drives(logs, model, law)
    assert {finding.effect for finding in found.findings} == {"delay", "effort_limit"}


@needs_native
@pytest.mark.parametrize("seed", [2, 3])
def test_gain_and_limit_together(seed):
    """Each with its value, and neither is what the other might have been."""
    found = diagnose_drives(*leg_diagnosed({"limit": [4.0, 50.0]}, seed, kp=[25.0, 16.0]))
    told = {(f.effect, f.joints): f.values[0][1] for f in found.findings}
    assert set(told) == {("effort_limit", ("hip",)), ("kp", ("knee",))}
    assert told["effort_limit", ("hip",)] == pytest.approx(4.0, rel=0.005)
    assert told["kp", ("knee",)] == pytest.approx(20.0, rel=0.01)
    assert str(found.verdict) == "explained"
    assert np.all(found.after.fit_rms < 5.5e-4)
    assert not any("unexplained by the model" in text for text in found.warnings)


@needs_native
def test_what_data_held_out_contradict_is_not_explained():
    """A limit below what the held-out part reaches, say."""
    logs, model, law = leg_diagnosed({"limit": [4.0, 50.0]}, 0)
    free, *_ = leg_diagnosed({}, 5)
    found = diagnose_drives(logs, model, law, held=free)
    assert found.after.heldout_rms[0] > found.before.heldout_rms[0]
    assert str(found.verdict) == "unexplained"
    assert any("held-out data is larger" in text for text in found.warnings)
