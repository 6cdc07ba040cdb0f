"""What a log without torque does not say of the scale of torque, and of a joint that does not move."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import PENDULUM, commanded_log
from ident.diagnosis.drives import diagnose_drives
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.drives.determined import Standing
from ident.logs.log import LogSet

pytestmark = needs_native  # which plays the drives of the logs

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "kp": 25.0, "kd": 0.8, "delay": 0.006}


@pytest.fixture(scope="module")
def turntable() -> ident.Robot:
    """The pendulum about an axis along gravity, which no weight holds against the drive."""
    upright = PENDULUM.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 0 1"/>')
    assert upright != PENDULUM
    return ident.Robot.from_urdf(upright)


def model_of(robot: ident.Robot) -> ident.Model:
    return robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()


def fitted(robot: ident.Robot, **law: float | str) -> DriveFit:
    log = commanded_log(robot, TRUTH, seed=0)
    return fit_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, kp="identify", kd="identify", **law))


def test_without_weight_known_links_are_no_scale_beside_an_unknown_rotor(turntable: ident.Robot) -> None:
    """Gains, friction, and the sum of rotor and link may all be larger by one factor: the same motion."""
    fit = fitted(turntable)
    standing = dict(zip(fit.names, fit.determination.verdicts, strict=True))
    assert not [name for name in ("kp_joint1", "kd_joint1", "Ia_joint1", "Fv_joint1", "Fc_joint1") if standing[name] == Standing.DETERMINED]
    told = fit.determination.combinations
    assert len(told) == 3
    true = {f"{name}_joint1": TRUTH[name] for name in ("kp", "kd", "Ia", "Fv", "Fc")} | {"delay": TRUTH["delay"]}
    for one in told:
        worth = float(eval(re.sub(r"(\d[\d.e+-]*) ([A-Za-z])", r"\1*\2", one.expression), {}, true))
        assert abs(one.value - worth) < 3.0 * one.std + 1e-3 * abs(worth), one.expression


def test_a_weight_is_a_scale() -> None:
    fit = fitted(ident.Robot.from_urdf(PENDULUM))
    standing = dict(zip(fit.names, fit.determination.verdicts, strict=True))
    assert standing["kp_joint1"] == Standing.DETERMINED
    i = fit.names.index("kp_joint1")
    assert abs(fit.values[i] - TRUTH["kp"]) < 3.5 * np.sqrt(fit.covariance[i, i])


def test_a_log_in_which_nothing_moves_is_refused(turntable: ident.Robot) -> None:
    rng = np.random.default_rng(0)
    t = np.arange(600) / 200.0
    rest = ident.Log("rest", t=t, q=0.3 + 2e-4 * rng.normal(size=(600, 1)), extra={"q_cmd1": np.full(600, 0.31)})
    law = DriveLaw.of(turntable, kp=25.0, kd=0.8)
    for way in (fit_drives, diagnose_drives):
        with pytest.raises(ident.DataError, match="moves"):
            way(LogSet((rest,)), model_of(turntable), law)


def test_the_rounding_of_an_encoder_is_nothing_that_is_left() -> None:
    """The error of ticks goes with the motion, and so is foretold by its own past; by its size it is the readings' own."""
    robot = ident.Robot.from_urdf(PENDULUM)
    log = commanded_log(robot, TRUTH | {"offset": 0.0}, seed=3)
    tick = 2.0 * np.pi / 1024
    ticks = replace(log, q=tick * np.round(log.q / tick))
    found = diagnose_drives(LogSet((ticks,)), model_of(robot), DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=0.006))
    assert (found.verdict, found.findings) == ("clean", ())


VELOCITY = {"Ia": 0.02, "Fv": 0.1, "Fc": 0.2, "kp": 0.0, "kd": 2.0, "delay": 0.006}


def velocity_fit(robot: ident.Robot) -> DriveFit:
    """A drive that is sent speeds, its gain unknown."""
    log = commanded_log(robot, VELOCITY, seed=0, seconds=6.0, rate=200, before=1.0, speed_command=True)
    return fit_drives(LogSet((log,)), model_of(robot), DriveLaw.of(robot, "pd_velocity", kd="identify"))


def test_the_gain_of_a_drive_that_is_sent_speeds() -> None:
    fit = velocity_fit(ident.Robot.from_urdf(PENDULUM))
    for symbol, share in (("kd", 0.002), ("Ia", 0.01), ("Fv", 0.01), ("Fc", 0.02)):
        assert fit.value(f"{symbol}_joint1") == pytest.approx(VELOCITY[symbol], rel=share)
    assert fit.value("delay") == pytest.approx(0.006, abs=1e-4)
    assert set(fit.determination.verdicts) == {Standing.DETERMINED}


def test_without_weight_it_is_the_scale(turntable: ident.Robot) -> None:
    """Friction over kd, and rotor less what stands beside it, with the log that would tell kd."""
    fit = velocity_fit(turntable)
    assert not [u.name for u, v in zip(fit.unknowns, fit.determination.verdicts, strict=True) if v == Standing.DETERMINED and u.joint >= 0]
    told = {one.expression: one for one in fit.determination.combinations}
    assert told["Fv_joint1 / kd_joint1"].value == pytest.approx(0.05, rel=0.01)
    assert told["Fc_joint1 / kd_joint1"].value == pytest.approx(0.1, rel=0.02)
    assert all("kd from the drive's settings, a log with a known mass" in one.separated_by for one in told.values())
    assert any("known gain" in text for text in fit.warnings)
