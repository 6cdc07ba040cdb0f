"""The report of a fit without torque: measured motion, our replay and MuJoCo's rollout of the exported model beside each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native
from test_actuator_export import as_fitted

import ident
from benchmarks.actuators.commanded import LEG, commanded_log
from ident.drawing.document import Figure, Table, Text
from ident.drives import DriveLaw, DriveLog
from ident.exporting.rollout import mujoco_rollout
from ident.logs.log import LogSet
from ident.reporting.commanded import drive_report

pytestmark = needs_native  # which plays the drives of the logs

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "kp": 25.0, "kd": 0.8, "delay": 0.006}


@pytest.fixture(scope="module")
def robot():
    return ident.Robot.from_urdf(LEG)


@pytest.fixture(scope="module")
def fit(robot):
    law = DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=0.006)
    return as_fitted(robot, law, Ia=0.012, Fv=0.08, Fc=0.15)


@pytest.mark.parametrize("speed_command", [False, True])
def test_mujoco_moves_as_the_joints_did(robot, speed_command):
    """The truth is played by the compiled integrator, which neither of the two uses."""
    pytest.importorskip("mujoco", minversion="3.5")
    sent = "derivative" if speed_command else "logged"
    found = as_fitted(robot, DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=0.006, velocity_command=sent), Ia=0.012, Fv=0.08, Fc=0.15)
    log = commanded_log(robot, TRUTH, seed=4, seconds=3.0, speed_command=speed_command, before=1.0)
    rolled = mujoco_rollout(found, DriveLog.of(log, robot, found.law))
    assert np.sqrt(np.mean((rolled - log.q) ** 2)) < 0.01 * np.std(log.q)


def test_three_lines_stand_in_one_figure(robot, fit):
    pytest.importorskip("mujoco", minversion="3.5")
    log = commanded_log(robot, TRUTH, seed=4, seconds=3.0, before=1.0)
    document = drive_report(fit, LogSet((log,)))
    (figure,) = [s for s in document.sections if isinstance(s, Figure)]
    for panel in figure.panels:
        assert [layer.label.split()[0] for layer in panel.layers] == ["measured", "our", "MuJoCo's"]
        measured, ours, theirs = (np.array(layer.y, float) for layer in panel.layers)
        assert np.std(measured) > 5.0
        assert np.std(ours - measured) < 0.01 * np.std(measured)
        assert 0.0 < np.std(theirs - ours) < 0.01 * np.std(measured)
    (table,) = [s for s in document.sections if isinstance(s, Table)]
    assert float(table.rows[0][4]) < 0.02 * float(table.rows[0][2])


def test_a_log_that_the_file_cannot_be_sent_says_so(robot, fit):
    log = commanded_log(robot, TRUTH, seed=4, seconds=2.0)
    off = {f"torque_enable{j}": np.where(log.t < 1.0, 1.0, 0.0) for j in (1, 2)}
    document = drive_report(fit, LogSet((replace(log, extra={**log.extra, **off}),)))
    (said,) = [s for s in document.sections if isinstance(s, Text) and s.title == "MuJoCo"]
    assert "switched off" in said.lines[0]
    (figure,) = document.figures
    assert all(len(panel.layers) == 2 for panel in figure.panels)
