"""MuJoCo actuators: the file says what the fit says, and MuJoCo rolls it out as our replay does."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.drives import DriveFit, DriveLaw, DriveLog, fit_drives
from ident.drives.plant import DrivePlant
from ident.exporting.actuators import actuator_text, export_actuators
from ident.logs.log import LogSet

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "kp": 25.0, "kd": 0.8, "delay": 0.0}


def as_fitted(robot: ident.Robot, law: DriveLaw, values: dict[str, float], offset: bool = False) -> DriveFit:
    """A fit with these values, as if found."""
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    if offset:
        model = model + ident.make_effect("offset")
    unknowns = DrivePlant(model, law, ()).unknowns
    found = np.array([values[u.name.split("_")[0]] for u in unknowns])
    n = robot.n
    return DriveFit(model, law, unknowns, found, np.eye(len(found)), None, np.zeros(n), 0.01, 1, True)


@pytest.mark.parametrize(
    ("urdf", "offset", "limit"), [(PENDULUM, 0.0, np.inf), (PENDULUM, 0.1, np.inf), (LEG, 0.0, np.inf), (LEG, 0.0, 2.5)]
)
def test_mujoco_rolls_the_file_out_as_our_replay_does(urdf, offset, limit):
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'ident[mujoco]'")
    robot = ident.Robot.from_urdf(urdf)
    law = DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=0.0, effort_limit=limit)
    fit = as_fitted(robot, law, {**TRUTH, "offset": offset}, offset != 0.0)
    log = commanded_log(robot, TRUTH, seconds=4.0, noise=0.0)
    ours = fit.replay(LogSet((log,)))[log.name] + log.q
    text, _ = actuator_text(fit)
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep, model.opt.integrator = 2.5e-4, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # Dry friction is a soft constraint there: as hard as it can be.
    model.dof_solref[:], model.dof_solimp[:, :2] = (5e-4, 1.0), (0.9999, 0.9999)
    data = mujoco.MjData(model)
    data.qpos[:], theirs = log.q[0], []
    for row in np.stack([log.extra[f"q_cmd{j + 1}"] for j in range(robot.n)], axis=1):
        theirs.append(data.qpos.copy())
        data.ctrl[:] = row
        for _ in range(40):
            mujoco.mj_step(model, data)
    assert np.abs(ours - np.array(theirs)).max() < 4e-3
    assert np.sqrt(np.mean((ours - np.array(theirs)) ** 2)) < 1e-3


def test_what_the_file_says(tmp_path):
    from lxml import etree

    robot = ident.Robot.from_urdf(LEG)
    law = DriveLaw.of(robot, kp=[25.0, 30.0], kd=0.8, effort_limit=5.0)
    fit = as_fitted(robot, law, {**TRUTH, "delay": 0.004})
    written = export_actuators(fit, tmp_path / "leg.xml")
    root = etree.parse(str(tmp_path / "leg.xml")).getroot()
    hip = root.find(".//joint[@name='hip']")
    assert [float(hip.get(key)) for key in ("armature", "damping", "frictionloss")] == [0.012, 0.08, 0.15]
    drives = root.findall("actuator/position")
    assert [(d.get("joint"), float(d.get("kp")), float(d.get("kv"))) for d in drives] == [("hip", 25.0, 0.8), ("knee", 30.0, 0.8)]
    assert drives[0].get("forcerange") == "-5.0 5.0"
    assert any("delay from command to torque (4.00 to 4.00 ms)" in note for note in written.notes)
    with pytest.raises(ident.ConfigurationError, match="exists; nothing was written"):
        export_actuators(fit, tmp_path / "leg.xml")


def test_links_that_are_no_bodies_are_refused():
    robot = ident.Robot.from_urdf(PENDULUM)
    logs = LogSet((commanded_log(robot, TRUTH, seconds=3.0),))
    model = robot.rigid_body() + ident.friction.Coulomb()
    fit = fit_drives(logs, model, DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=0.0, links="identify"))
    assert DriveLog.of(logs[0], robot, fit.law).q_cmd.shape == logs[0].q.shape
    with pytest.raises(ident.UnsupportedError, match="no bodies"):
        actuator_text(fit)
