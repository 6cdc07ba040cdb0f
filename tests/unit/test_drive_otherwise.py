"""Where no candidate explains a log without torque: links, velocities that were sent, what happens between two commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators import commanded
from benchmarks.actuators.commanded import PENDULUM, commanded_log
from benchmarks.actuators.coverage import EFFECTS, LEG
from ident.diagnosis.drives import diagnose_drives
from ident.drives import DriveLaw
from ident.drives.links import FreeLinks, KnownLinks
from ident.logs.log import LogSet

TRUTH = {"kp": 25.0, "kd": 0.8, "Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "offset": 0.05, "delay": 0.006}


def diagnosed(log, robot, **declared):
    model = robot.rigid_body()
    for name in EFFECTS:
        model = model + ident.make_effect(name)
    return diagnose_drives(LogSet((log,)), model, DriveLaw.of(robot, kp=25.0, kd=0.8, **declared))


def the_only_finding(found):
    assert found.verdict == "explained"
    (finding,) = found.findings
    assert np.sqrt(np.mean(found.after.fit_rms**2)) == pytest.approx(5e-4, rel=0.1)
    return finding


@needs_native
def test_a_load_that_nobody_declared_is_one_of_the_links():
    true = ident.Robot.from_urdf(PENDULUM.replace('mass value="0.6"', 'mass value="1.5"'))
    log = commanded_log(true, TRUTH, seed=7101, seconds=5.0, rate=200, noise=5e-4, before=1.0)
    finding = the_only_finding(diagnosed(log, ident.Robot.from_urdf(PENDULUM)))
    assert (finding.effect, finding.joints) == ("links", ("joint1",))
    ((name, value, std, unit),) = finding.values
    assert (name, unit) == ("mz_joint1", "kg m")
    # 1.5 kg, 0.2 m below the axis.
    assert abs(value + 0.3) < 3.0 * std < 0.05
    assert finding.declared == pytest.approx((-0.12,))


@needs_native
@pytest.mark.parametrize("seed", [7102, 7103])
def test_velocities_that_were_sent_and_not_logged(seed):
    robot = ident.Robot.from_urdf(PENDULUM)
    log = commanded_log(robot, TRUTH, seed=seed, seconds=5.0, rate=200, noise=5e-4, before=1.0, speed_command=True)
    log = replace(log, extra={key: x for key, x in log.extra.items() if not key.startswith("dq")})
    finding = the_only_finding(diagnosed(log, robot))
    assert finding.effect == "velocity_command"
    assert 'velocity_command = "derivative"' in finding.text()


@needs_native
@pytest.mark.parametrize(("declared", "named"), [("staircase", "command_ramp"), ("ramp", "command_staircase")])
def test_what_happens_between_two_commands(monkeypatch, declared, named):
    robot, rate, plain = ident.Robot.from_urdf(PENDULUM), 25, commanded.command
    finer = 1000 // rate

    def between(seed, seconds, fine, n, rest=0.5):
        slow = plain(seed, seconds, rate, n, rest)
        if named == "command_staircase":
            return np.repeat(slow, finer, axis=0)
        at = np.arange(round(seconds * fine)) / fine
        return np.stack([np.interp(at, np.arange(len(slow)) / rate, column) for column in slow.T], axis=1)

    monkeypatch.setattr(commanded, "command", between)
    log = commanded_log(robot, TRUTH, seed=7104, seconds=10.0, rate=1000, noise=5e-4, before=1.0)
    log = ident.Log("run", t=log.t[::finer], q=log.q[::finer], extra={key: x[::finer] for key, x in log.extra.items()})
    assert the_only_finding(diagnosed(log, robot, command=declared)).effect == named


def test_links_with_parameters_of_their_own_in_each_lane():
    robot = ident.Robot.from_urdf(LEG)
    rng = np.random.default_rng(7105)
    sets = np.stack([robot.nominal, 1.2 * robot.nominal, robot.nominal])
    q, dq = rng.uniform(-1.0, 1.0, (2, 3, robot.n))
    H, c = FreeLinks(robot, sets).terms(q, dq)
    for lane, parameters in enumerate(sets):
        own_H, own_c = KnownLinks(robot, parameters).terms(q[[lane]], dq[[lane]])
        np.testing.assert_allclose(H[lane], own_H[0], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(c[lane], own_c[0], rtol=1e-12, atol=1e-14)
