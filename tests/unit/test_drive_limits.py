"""Limits of torque that are identified: one that is reached has a value, one that is not has none and cuts nothing."""

from __future__ import annotations

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, commanded_log
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.drives.determined import Standing
from ident.logs.log import LogSet

TRUTH = {"Ia": [0.012, 0.01], "Fv": 0.1, "Fc": [0.3, 0.2], "kp": [25.0, 20.0], "kd": 0.8, "delay": 0.006}

pytestmark = needs_native


def fitted(seed: int, **more: object) -> DriveFit:
    robot = ident.Robot.from_urdf(LEG)
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    log = commanded_log(robot, {**TRUTH, **more}, seed=seed, seconds=6.0, before=1.0)
    logs, held = LogSet((log,)).split(by="fraction", held=0.3)
    return fit_drives(logs, model, DriveLaw.of(robot, kp=[25.0, 20.0], kd=0.8, effort_limit="identify"), held=held)


@pytest.mark.parametrize("seed", range(2))
def test_a_limit_that_is_never_reached_has_no_value(seed):
    """Nor does it act on data held out, however much these ask for."""
    fit = fitted(seed)
    standing = dict(zip(fit.names, fit.determination.verdicts, strict=True))
    assert {standing["effort_limit_hip"], standing["effort_limit_knee"]} == {Standing.UNSEEN}
    assert not np.isfinite(fit.determination.below[[fit.names.index(f"effort_limit_{joint}") for joint in ("hip", "knee")]]).any()
    assert fit.heldout_rms == pytest.approx(5e-4, rel=0.25)
    assert "no bound in these logs" in fit.summary()


@pytest.mark.parametrize("seed", [1, 2])
def test_a_limit_that_is_reached_has_one(seed):
    fit = fitted(seed, limit=[4.0, 50.0])
    standing = dict(zip(fit.names, fit.determination.verdicts, strict=True))
    assert standing["effort_limit_hip"] == Standing.DETERMINED
    assert standing["effort_limit_knee"] == Standing.UNSEEN
    i = fit.names.index("effort_limit_hip")
    assert abs(fit.values[i] - 4.0) < 3.5 * fit.determination.std[i]
    assert fit.determination.std[i] < 0.02
    assert fit.heldout_rms == pytest.approx(5e-4, rel=0.25)
