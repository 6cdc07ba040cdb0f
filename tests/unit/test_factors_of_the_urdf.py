"""Torque and time in units other than they seem, told by factors between a fit and the URDF's inertials."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from ident.effects.motion import Motion
from ident.estimators import WeightedLeastSquares
from ident.evaluation.against_nominal import factor_doubt
from ident.problem.problem import Problem
from ident.signals import ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray


def fitted(clock: float = 1.0, torque: Array | float = 1.0, inertials: Array | float = 1.0) -> ident.Estimate:
    """A fit of a simulated UR5, whose time runs `clock` times too fast and whose torque is in another unit; inertials unlike the URDF's."""
    robot = ident.load_robot("ur5")
    model = robot.rigid_body() + ident.make_effect("viscous") + ident.make_effect("coulomb")
    rng = np.random.default_rng(3)
    motion = FourierTrajectory(np.full(robot.n, 0.3), *0.5 * rng.normal(size=(2, 4, robot.n)) / np.arange(1, 5)[:, None], 0.1)
    t = np.arange(2000) / 200.0
    c = motion.sample(t)
    assert robot.nominal is not None
    values = np.concatenate([robot.nominal * inertials, np.full(6, 2.0), np.full(6, 1.0)])
    tau = model.torque(Motion.of(robot, c.q, c.dq, c.ddq, t, rate=200.0), values)
    tau = tau + 0.01 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    log = ident.Log("run", t / clock, q=c.q, tau={"joint": tau * torque})
    return WeightedLeastSquares().solve(Problem(model, ZeroPhase(cutoff_hz=10.0 * clock)(log, robot)))


def test_a_sound_log_raises_none() -> None:
    assert factor_doubt(fitted()) == ""


@pytest.mark.parametrize("factor", [0.6, 1.7])
def test_links_that_are_lighter_or_heavier_than_the_urdf_says_raise_none(factor: float) -> None:
    assert factor_doubt(fitted(inertials=factor)) == ""


@pytest.mark.parametrize(("clock", "way"), [(2.0, "fast"), (0.4, "slowly")])
def test_another_clock(clock: float, way: str) -> None:
    assert f"too {way}" in factor_doubt(fitted(clock=clock))


def test_milliseconds_for_seconds() -> None:
    assert factor_doubt(fitted(clock=1000.0))


@pytest.mark.parametrize("factor", [0.05, 1000.0])
def test_torque_in_another_unit(factor: float) -> None:
    assert f"torque is about {factor:.2g} times" in factor_doubt(fitted(torque=factor))


def test_torque_of_one_joint_in_another_unit() -> None:
    factors = np.ones(6)
    factors[2] = 10.0
    said = factor_doubt(fitted(torque=factors))
    assert "elbow_joint (" in said
    assert "wrist" not in said
