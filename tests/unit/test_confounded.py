"""What a log cannot tell apart is never printed as a number: each kind on logs of a known truth, and what would tell it apart."""

from __future__ import annotations

import json

import numpy as np
import pytest
from rigid_models import needs_native
from scipy.integrate import solve_ivp

import ident
from benchmarks.actuators import commanded
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.drives import DriveFit, DriveLaw, DriveLog, fit_drives
from ident.drives.space import foreign_commands
from ident.logs.log import LogSet

pytestmark = needs_native  # which plays the drives of the logs

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "offset": 0.1, "kp": 25.0, "kd": 0.8, "delay": 0.006}


@pytest.fixture(scope="module")
def robot():
    return ident.Robot.from_urdf(PENDULUM)


def fitted(robot, log, effects=("rotor_inertia", "viscous", "coulomb", "offset"), **law) -> DriveFit:
    model = robot.rigid_body()
    for name in effects:
        model = model + ident.make_effect(name)
    return fit_drives(LogSet((log,)), model, DriveLaw.of(robot, **law))


def numbers(fit: DriveFit) -> set[str]:
    """Names that have a value in the result, after checking that the summary has one line of value for each and no more."""
    entries = json.loads(json.dumps(fit.to_dict()))["parameters"]
    valued = {p["name"] for p in entries if "value" in p}
    lines = [line.split()[0] for line in fit.summary().splitlines() if " ± " in line and line.startswith("  ")]
    said = {p["expression"] for p in entries if "value" in p and not p["name"].startswith("delay")} | {
        c.expression for c in fit.determination.combinations
    }
    assert {text.split()[0] for text in said} == set(lines)
    return valued


def sums(fit: DriveFit) -> dict[str, tuple[float, float]]:
    return {c.expression: (c.value, c.std) for c in fit.determination.combinations}


def test_kd_with_viscous_friction_while_no_velocity_is_commanded(robot):
    log = commanded_log(robot, TRUTH, seed=12)
    fit = fitted(robot, log, kp=25.0, kd="identify")
    assert not numbers(fit) & {"kd_joint1", "Fv_joint1"}
    value, std = sums(fit)["Fv_joint1 + kd_joint1"]
    assert abs(value - 0.88) < 4.0 * std
    assert {"kd_joint1", "Fv_joint1"} <= numbers(
        fitted(robot, commanded_log(robot, TRUTH, seed=12, speed_command=True), kp=25.0, kd="identify")
    )


def test_the_gain_with_everything_without_a_known_load(robot):
    log = commanded_log(robot, TRUTH, seed=13)
    fit = fitted(robot, log, kp="identify", kd=0.0, links="identify")
    assert numbers(fit) <= {"delay"}
    assert all("kp_joint1" in text for text in sums(fit))
    assert sums(fit)["Fc_joint1 / kp_joint1"][0] == pytest.approx(0.15 / 25.0, rel=0.05)
    assert "kp_joint1" in numbers(fitted(robot, log, kp="identify", kd=0.0))


def test_the_delay_with_inertia_and_damping_in_one_slow_sine(robot, monkeypatch):
    def sine(seed, seconds, rate, n, rest=0.5):
        t = np.arange(round(seconds * rate)) / rate - rest
        return np.repeat((0.5 * np.sin(2.0 * np.pi * 0.3 * t) * np.clip(t / 2.0, 0.0, 1.0) ** 2)[:, None], n, axis=1)

    monkeypatch.setattr(commanded, "command", sine)
    log = commanded_log(robot, {**TRUTH, "Fc": 0.0}, seconds=10.0, noise=3e-3)
    slow = fitted(robot, log, kp=25.0, kd=0.8, effects=("rotor_inertia", "viscous", "offset"))
    assert not numbers(slow) & {"Fv_joint1"}
    value, low, high = slow.delay_interval()["delay"]
    assert low <= 0.006 <= high
    assert high - low > 0.004
    # No viscous friction is negative: what the log says of Fv + kp delay bounds the delay, which a standard deviation does not know.
    steep = 25.0 + 0.6 * 9.81 * 0.2
    assert high < (0.08 + steep * 0.006 + 0.05) / steep
    assert high < value + 1.96 * np.sqrt(slow.covariance[-1, -1])
    assert any(text.startswith("Fv_joint1 + 2") and text.endswith("delay") for text in sums(slow))
    given = fitted(robot, log, kp=25.0, kd=0.8, delay_s=0.006, effects=("rotor_inertia", "viscous", "offset"))
    assert "Fv_joint1" in numbers(given)
    monkeypatch.undo()
    wide = fitted(robot, commanded_log(robot, TRUTH, seconds=10.0, noise=1e-3), kp=25.0, kd=0.8)
    assert {"Fv_joint1", "Ia_joint1", "delay"} <= numbers(wide)


def test_the_offset_with_gravity_at_one_posture(robot, monkeypatch):
    wide = commanded.command
    monkeypatch.setattr(commanded, "command", lambda *at: 0.02 * wide(*at))
    log = commanded_log(robot, TRUTH, seed=14, noise=1e-4)
    fit = fitted(robot, log, kp=25.0, kd=0.8, links="identify")
    assert not numbers(fit) & {"mx_joint1", "offset_joint1"}
    ((text, (value, std)),) = [pair for pair in sums(fit).items() if "offset_joint1" in pair[0]]
    assert text == "mx_joint1 - 0.102 offset_joint1"
    assert abs(value + 0.1 / 9.81) < 4.0 * std + 1e-5
    monkeypatch.undo()
    moved = fitted(robot, commanded_log(robot, TRUTH, seed=14), kp=25.0, kd=0.8, links="identify")
    assert "offset_joint1" in numbers(moved)
    assert moved.value("offset_joint1") == pytest.approx(0.1, rel=0.2)


def swinging(wanted: np.ndarray) -> ident.Log:
    """A pendulum that swings with the torque switched off, while commands go on; integrated here."""

    def rates(t, state):
        torque = 0.6 * 9.81 * 0.2 * np.sin(state[0]) + 0.08 * state[1] + 0.02 * np.tanh(state[1] / 0.003)
        return state[1], -torque / (0.6 * 0.2**2 + 0.002 + 0.012)

    t = np.arange(500) / 100
    state = solve_ivp(rates, (0.0, 5.0), (1.0, 0.0), t_eval=t, max_step=1e-3, rtol=1e-9).y
    noise = 5e-4 * np.random.default_rng(3).standard_normal(len(t))
    extra = {"q_cmd1": wanted, "torque_enable1": np.zeros(len(t))}
    return ident.Log("off", t=t, q=(state[0] + noise)[:, None], dq=state[1][:, None], extra=extra)


def test_wanted_commands_while_the_torque_is_off(robot):
    log = swinging(commanded.command(5, 5.0, 100, 1)[:, 0])
    fit = fitted(robot, log, kp="identify", kd="identify")
    assert numbers(fit) == {"Ia_joint1", "Fv_joint1", "Fc_joint1"}
    assert fit.value("Ia_joint1") == pytest.approx(0.012, rel=0.05)
    assert fit.value("Fv_joint1") == pytest.approx(0.08, rel=0.05)
    assert not [c for c in sums(fit) if "k" in c]
    assert "not determined by these logs" in fit.summary()
    assert all("below" not in p for p in fit.to_dict()["parameters"] if p["name"] in ("kp_joint1", "kd_joint1"))
    other = fitted(robot, swinging(np.zeros(500)), kp="identify", kd="identify")
    assert other.value("Ia_joint1") == pytest.approx(fit.value("Ia_joint1"), rel=1e-6)


def linked(log: ident.Log) -> ident.Log:
    """Commands as two motors of a linkage have them: of both joints, with a transmission between."""
    hip, knee = (log.extra[f"q_cmd{j}"] for j in (1, 2))
    return ident.Log(log.name, t=log.t, q=log.q, extra={"q_cmd1": 0.1 * (hip + 0.4 * knee), "q_cmd2": 0.4 * hip - knee})


def test_commands_in_another_space_than_the_joints():
    leg = ident.Robot.from_urdf(LEG)
    log = commanded_log(leg, TRUTH, seed=4)
    law = DriveLaw.of(leg, kp=25.0, kd=0.8)
    assert foreign_commands(DriveLog.of(log, leg, law), leg) == ()
    assert foreign_commands(DriveLog.of(linked(log), leg, law), leg) == (0,)
    with pytest.raises(ident.DataError, match="joint hip do not match its position") as caught:
        fitted(leg, linked(log), kp=25.0, kd=0.8)
    assert "linkage" in str(caught.value)


def test_real_commands_behind_linkages_are_refused(data_folder):
    """The IGRIS-C's ankles and waist stand on four-bar pairs; its hips and knees do not."""
    folder = data_folder / "actuators/igris_c"
    robot = ident.Robot.from_urdf(folder / "igris_c_legs.urdf")
    (log,) = ident.read_logs([str(folder / "igris_c_chirp.csv.gz")], robot)
    seen = DriveLog.of(log, robot, DriveLaw.of(robot, kp=100.0))
    names = {robot.joint_names[j] for j in foreign_commands(seen, robot)}
    assert names == {"waist_roll", "waist_pitch", "l_ankle_pitch", "l_ankle_roll", "r_ankle_pitch", "r_ankle_roll"}
