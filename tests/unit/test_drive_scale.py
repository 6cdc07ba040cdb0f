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
