"""Stamps that jitter about equal steps, and samples that were taken at unequal ones."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, commanded_log
from ident.diagnosis.drives import diagnose_drives
from ident.drives import DriveLaw, DriveLog, fit_drives
from ident.drives.clock import equal_steps
from ident.drives.fit import notes_of
from ident.drives.plant import DrivePlant
from ident.logs.log import LogSet

TRUTH = {"Ia": [0.012, 0.01], "Fv": 0.1, "Fc": [0.3, 0.2], "kp": [25.0, 20.0], "kd": 0.8, "delay": 0.006}

pytestmark = needs_native


def model(robot: ident.Robot) -> ident.Model:
    return robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()


@pytest.fixture(scope="module")
def robot() -> ident.Robot:
    return ident.Robot.from_urdf(LEG)


def jittered(log: ident.Log, seconds: float, seed: int = 0) -> ident.Log:
    return replace(log, t=log.t + seconds * np.random.default_rng(seed).standard_normal(len(log.t)))


@pytest.mark.parametrize("seed", [0, 1])
def test_stamps_that_jitter_are_no_times(robot, seed):
    """The fit ends at the noise, and says what it took for times."""
    law = DriveLaw.of(robot, kp=[25.0, 20.0], kd=0.8)
    plain = commanded_log(robot, TRUTH, seed=seed, before=1.0)
    log = jittered(plain, 8e-4, seed)
    np.testing.assert_allclose(np.diff(equal_steps(log.t, log.q)), np.diff(plain.t), rtol=1e-3)
    fit = fit_drives(LogSet((log,)), model(robot), law)
    assert fit.fit_rms == pytest.approx(5e-4, rel=0.1)
    assert fit.value("delay") == pytest.approx(0.006, abs=3e-4)
    (said,) = [text for text in fit.warnings if "equal steps" in text]
    assert float(re.search(r"by ([\d.]+) ms", said)[1]) == pytest.approx(0.8, rel=0.12)
    found = diagnose_drives(LogSet((log,)), model(robot), replace(law, constants={**law.constants, "delay_s": np.full(2, 0.006)}))
    assert str(found.verdict) == "clean"


@pytest.mark.parametrize("seed", [0, 1])
def test_samples_at_unequal_steps_keep_their_times(robot, seed):
    fine = commanded_log(robot, TRUTH, seed=seed, rate=1000, noise=0.0, before=1.0)
    rng = np.random.default_rng(seed)
    rows = np.arange(0, len(fine.t) - 10, 10)
    rows = np.maximum.accumulate(np.maximum(rows + np.rint(0.8 * rng.standard_normal(len(rows))).astype(int), 0))
    q = fine.q[rows] + 5e-4 * rng.standard_normal((len(rows), 2))
    np.testing.assert_array_equal(equal_steps(fine.t[rows], q), fine.t[rows])


def test_steps_that_are_equal_or_wander_stay(robot):
    log = commanded_log(robot, TRUTH, seed=0, before=1.0)
    assert equal_steps(log.t, log.q) is log.t
    drifting = log.t + 0.02 * np.sin(log.t)
    assert equal_steps(drifting, log.q) is drifting
    short = log.rows(slice(0, 30))
    assert equal_steps(short.t, short.q) is short.t
    law = DriveLaw.of(robot, kp=20.0)
    assert notes_of(DrivePlant(model(robot), law, (DriveLog.of(log, robot, law),))) == ()
