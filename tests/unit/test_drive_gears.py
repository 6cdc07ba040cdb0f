"""Gears beside a drive law: positions, commands and gains of the joints, rotors and friction of the motors."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.exporting import ExportOptions, Identified
from ident.exporting.target import make_target

pytestmark = needs_native

RATIOS = np.array([50.0, -9.0])
#: Of the joints; offsets have a sign.
JOINTS = {"Ia": [0.012, 0.01], "Fv": [0.1, 0.08], "Fc": [0.15, 0.1], "offset": [0.05, -0.04]}
GAINS = {"kp": [25.0, 20.0], "kd": [0.8, 0.6]}


def geared(ratios: np.ndarray) -> ident.Robot:
    robot = ident.Robot.from_urdf(LEG)
    return robot.with_transmission(ident.Transmission.from_ratio(ratios))


def motors() -> dict[str, np.ndarray]:
    """The same actuators before the gears."""
    size = np.abs(RATIOS)
    powers = {"Ia": size**2, "Fv": size**2, "Fc": size, "offset": RATIOS}
    return {key: np.array(JOINTS[key]) / powers[key] for key in JOINTS}


def declared(robot: ident.Robot, side: str = "motor") -> ident.Model:
    model = robot.rigid_body()
    for name in ("rotor_inertia", "viscous", "coulomb", "offset"):
        model = model + ident.make_effect(name, **({} if name == "rotor_inertia" else {"side": side}))
    return model


@pytest.fixture(scope="module")
def log():
    """Simulated with the gears, by the integrator that no fit uses."""
    return commanded_log(geared(RATIOS), {**motors(), **GAINS, "delay": 0.006}, seed=4230, seconds=3.0, rate=100, before=1.0)


@pytest.fixture(scope="module")
def fits(log):
    """With the gears, and of the same actuators without them."""
    logs = ident.LogSet((log,))
    return [fit_drives(logs, declared(robot), DriveLaw.of(robot, **GAINS)) for robot in (geared(RATIOS), geared(np.ones(2)))]


def test_parameters_are_the_motors(fits):
    fit = fits[0]
    decided = fit.determination
    for key, values in motors().items():
        for joint, true in zip(("hip", "knee"), values, strict=True):
            i = fit.names.index(f"{key}_{joint}")
            assert abs(fit.values[i] - true) < 4.0 * decided.std[i], (key, joint)
            assert decided.std[i] < 0.1 * abs(true)
    assert fit.fit_rms.max() < 6e-4


def test_gears_change_nothing_but_the_side(fits):
    """The same motion, delay and intervals; a file for a simulator is of the joints."""
    fit, plain = fits
    factors = np.array([u.factor for u in fit.unknowns])
    np.testing.assert_allclose(fit.values * factors, plain.values, rtol=1e-4)
    np.testing.assert_allclose(fit.determination.std * np.abs(factors), plain.determination.std, rtol=1e-2)
    for key, values in fit.drive().items():
        np.testing.assert_allclose(values, plain.drive()[key], rtol=1e-4, err_msg=key)
    texts = [str(make_target("mujoco_actuator", Path()).written(Identified.of(one), ExportOptions()).content) for one in fits]
    numbers = [np.array([float(x) for x in _numbers(text)]) for text in texts]
    np.testing.assert_allclose(numbers[0], numbers[1], rtol=1e-4, atol=1e-6)


def _numbers(text: str) -> list[str]:
    return re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e-?\d+)?(?![\w.])", text)


def test_friction_may_be_declared_at_the_joint(log, fits):
    robot = geared(RATIOS)
    fit = fit_drives(ident.LogSet((log,)), declared(robot, "joint"), DriveLaw.of(robot, **GAINS))
    for key, values in fit.drive().items():
        np.testing.assert_allclose(values, fits[1].drive()[key], rtol=1e-3, err_msg=key)


def test_a_fit_is_saved_and_read(fits, tmp_path):
    fits[0].save(tmp_path / "fit.json")
    back = DriveFit.load(tmp_path / "fit.json")
    np.testing.assert_allclose(back.model.robot.transmission.K, np.diag(1.0 / RATIOS))
    for key, values in back.drive().items():
        np.testing.assert_array_equal(values, fits[0].drive()[key])


def test_positions_of_the_motors_are_carried_to_the_joints(log):
    robot = geared(RATIOS)
    of_motors = ident.Log("run", t=log.t, q_motor=robot.transmission.motor_position(log.q), extra=log.extra)
    simulated = []
    for one in (log, of_motors):
        fit = fit_drives(ident.LogSet((one,)), declared(robot), DriveLaw.of(robot, **GAINS, delay_s=0.006))
        simulated.append(fit.values)
    np.testing.assert_allclose(simulated[0], simulated[1], rtol=1e-3)


def test_unknown_gains_and_viscous_friction_stand_together_by_the_ratio():
    robot = ident.Robot.from_urdf(PENDULUM).with_transmission(ident.Transmission.from_ratio(np.array([50.0])))
    truth = {"kp": 25.0, "kd": 0.8, "Ia": 0.012 / 2500.0, "Fv": 0.08 / 2500.0, "Fc": 0.15 / 50.0, "delay": 0.006}
    log = commanded_log(robot, truth, seed=4231, rate=200, before=1.0)
    fit = fit_drives(ident.LogSet((log,)), declared(robot), DriveLaw.of(robot, kp="identify", kd="identify"))
    (together,) = fit.determination.combinations
    assert together.expression == "Fv_joint1 + 0.0004 kd_joint1"
    assert together.value == pytest.approx(0.08 / 2500.0 + 0.0004 * 0.8, rel=0.01)


def test_what_is_refused(log):
    coupled = ident.Robot.from_urdf(LEG).with_transmission(ident.Transmission(np.array([[0.02, 0.0], [0.02, 0.1]]), np.zeros(2)))
    with pytest.raises(ident.UnsupportedError, match="K couples joints"):
        DriveLaw.of(coupled, **GAINS)
    robot = geared(RATIOS)
    sent = {f"q_cmd{j + 1}": RATIOS[j] * log.extra[f"q_cmd{j + 1}"] for j in range(2)}
    before = ident.Log("run", t=log.t, q=log.q, extra=sent)
    with pytest.raises(ident.DataError, match="before their gears"):
        fit_drives(ident.LogSet((before,)), declared(robot), DriveLaw.of(robot, **GAINS))
    spring = robot.rigid_body() + ident.make_effect("linear_spring", side="motor")
    with pytest.raises(ident.UnsupportedError, match='side = "joint"'):
        fit_drives(ident.LogSet((log,)), spring, DriveLaw.of(robot, **GAINS))


def test_a_study_with_a_ratio(log, tmp_path, ident):
    (tmp_path / "leg.urdf").write_text(LEG)
    rows = np.column_stack([log.t, log.q, log.extra["q_cmd1"], log.extra["q_cmd2"]])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="time_s,q1_rad,q2_rad,q_cmd1_rad,q_cmd2_rad", comments="")
    head = '[robot]\nurdf = "leg.urdf"\n[drive]\nratio = [50.0, -9.0]\neffects = ["rotor_inertia", "viscous", "coulomb", "offset"]\n'
    tail = 'kp = [25.0, 20.0]\nkd = [0.8, 0.6]\n[logs]\nfit = ["log.csv"]\n'
    (tmp_path / "study.toml").write_text(f'{head}law = "pd_position"\n{tail}')
    ran = ident("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    found = DriveFit.load(tmp_path / "out/fit.json")
    np.testing.assert_allclose(found.drive()["armature"], JOINTS["Ia"], rtol=0.05)
    for law in ("", 'law = "torque"\n'):
        (tmp_path / "other.toml").write_text(f"{head}{law}{tail}")
        ran = ident("fit", tmp_path / "other.toml")
        assert ran.code == 2
        assert "[drive] kp, kd: constants of a drive law, but" in " ".join(ran.err.split())
