"""A fit under a drive law whose error is more than the noise of the readings says so, with the number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, commanded_log
from ident.drives import DriveLaw, DriveLog, fit_drives
from ident.drives.plant import DrivePlant
from ident.drives.residual import above_noise, reading_noise
from ident.drives.search import Fitted

TRUTH = {"Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "kp": 25.0, "kd": 0.8, "delay": 0.006, "limit": 3.0}


def log_of(q: np.ndarray, rate: float = 200.0) -> DriveLog:
    """A log of which the positions count."""
    none = np.zeros_like(q)
    return DriveLog("run", np.arange(len(q)) / rate, q, none, none, none, none + 1.0, None, q[0], none[0])


def swing(count: int, n: int = 1) -> np.ndarray:
    """(N, n) motion of an arm."""
    t = np.arange(count)[:, None] / 200.0
    return 0.4 * np.sin(2.0 * np.pi * np.array([0.7, 1.1, 1.6])[:n] * t) + 0.1 * np.sin(2.0 * np.pi * 4.0 * t)


@pytest.mark.parametrize("noise", [1e-4, 5e-4, 2e-3])
def test_the_noise_of_readings(noise):
    rng = np.random.default_rng(0)
    q = swing(2000) + noise * rng.standard_normal((2000, 1))
    assert reading_noise(log_of(q))[0] == pytest.approx(noise, rel=0.15)


def test_an_encoder_rounds():
    step = 2.0 * np.pi / 4096
    q = step * np.round(swing(2000) / step)
    assert 0.999 * step / np.sqrt(12.0) < reading_noise(log_of(q))[0] < step
    assert np.isnan(reading_noise(log_of(q[:30]))).all()


def leg_fit(excess: np.ndarray, weights: np.ndarray | None = None) -> tuple[DrivePlant, Fitted]:
    """A fit of the leg with residuals of 0.5 mrad of white noise and this excess (N, 2)."""
    robot = ident.Robot.from_urdf(LEG)
    rng = np.random.default_rng(1)
    noise = 5e-4 * rng.standard_normal(excess.shape)
    plant = DrivePlant(robot.rigid_body() + ident.friction.Viscous(), DriveLaw.of(robot, kp=20.0), (log_of(swing(len(excess), 2) + noise),))
    weights = np.ones_like(excess) if weights is None else weights
    return plant, Fitted(np.ones(3), excess - noise, np.zeros((*excess.shape, 3)), weights, True, 1)


def test_the_joint_that_is_above_the_noise_is_named():
    slow = 2e-3 * np.sin(0.02 * np.arange(2000))
    (text,) = above_noise(*leg_fit(np.stack([0.0 * slow, slow], axis=1)))
    assert "hip" not in text
    assert "knee 2.9" in text
    assert "(0.0015 for 0.0005" in text
    assert not above_noise(*leg_fit(np.zeros((2000, 2))))


def test_an_error_without_memory_is_told_by_its_size():
    """Rarely sampled, a model's error is as good as white; what is more than the white noise of the readings is none of theirs."""
    rng = np.random.default_rng(2)
    assert not above_noise(*leg_fit(1e-4 * rng.standard_normal((2000, 2))))
    assert "hip 4" in above_noise(*leg_fit(2e-3 * rng.standard_normal((2000, 2))))[0]


def test_of_few_readings_an_error_has_to_be_larger():
    """The fewer there are, the less is known of their noise."""
    rng = np.random.default_rng(3)
    many, few = (2.5e-4 * rng.standard_normal((count, 2)) for count in (20000, 100))
    assert not above_noise(*leg_fit(few))
    assert above_noise(*leg_fit(4.0 * many))
    assert above_noise(*leg_fit(10.0 * few))


def test_a_residual_within_the_noise_is_no_lack_of_fit():
    """However much it remembers: rounding to the steps of an encoder does, where a joint is slow."""
    plant, fit = leg_fit(np.zeros((2000, 2)))
    slow = 5e-4 * np.sin(0.02 * np.arange(2000))[:, None] * np.ones(2)
    assert not above_noise(plant, replace(fit, residual=slow))
    assert above_noise(plant, replace(fit, residual=2.0 * slow))


def test_a_stretch_that_counts_little_is_not_told_twice():
    jump = np.zeros((2000, 2))
    jump[400:500, 0] = 0.05
    weights = np.ones_like(jump)
    assert above_noise(*leg_fit(jump, weights))
    weights[400:500, 0] = 0.01
    assert not above_noise(*leg_fit(jump, weights))


def test_a_slide_is_told_in_metres():
    plant, fit = leg_fit(2e-3 * np.sin(0.02 * np.arange(2000))[:, None] * np.ones(2))
    robot = ident.Robot.from_urdf(LEG.replace('name="knee" type="revolute"', 'name="knee" type="prismatic"'))
    plant = replace(plant, model=robot.rigid_body() + ident.friction.Viscous(), law=DriveLaw.of(robot, kp=20.0))
    (text,) = above_noise(plant, fit)
    assert " rad), knee" in text
    assert " m). The model" in text


@needs_native
def test_a_limit_that_is_not_declared():
    """The summary says so; with the limit, and in logs that are explained, it says nothing."""
    robot = ident.Robot.from_urdf(PENDULUM)
    model = robot.rigid_body() + ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    logs = ident.LogSet((commanded_log(robot, TRUTH, seed=3, rate=200),))
    without = fit_drives(logs, model, DriveLaw.of(robot, kp=25.0, kd=0.8))
    assert without.fit_rms[0] > 2e-3
    assert "above the noise of the readings: joint1" in " ".join(without.summary().split())
    assert any("above the noise" in text for text in without.to_dict()["warnings"])
    assert fit_drives(logs, model, DriveLaw.of(robot, kp=25.0, kd=0.8, effort_limit=3.0)).warnings == ()
