"""Trajectories: exact derivatives, rest at the ends."""

from __future__ import annotations

import numpy as np
import pytest

from ident.errors import ConfigurationError
from ident.simulation.trajectory import BSplineTrajectory, Chained, Dwell, FourierTrajectory, PointToPoint, Trajectory, Trapezoid


def _all() -> list[Trajectory]:
    rng = np.random.default_rng(0)
    a, b = np.array([0.1, -0.4]), np.array([0.9, 0.3])
    return [
        FourierTrajectory(a, rng.normal(size=(4, 2)), rng.normal(size=(4, 2)), 0.2),
        FourierTrajectory(a, rng.normal(size=(3, 2)), rng.normal(size=(3, 2)), 0.5, 3),
        BSplineTrajectory(rng.normal(size=(9, 2)), 4.0),
        BSplineTrajectory(rng.normal(size=(2, 2)), 1.0),
        PointToPoint(a, b, 1.5),
        Trapezoid(a, b, 2.0, 0.4),
        Dwell(a, 0.5),
        Chained([Dwell(a, 0.3), PointToPoint(a, b, 1.0), Trapezoid(b, a, 1.0, 0.2)]),
    ]


@pytest.mark.parametrize("index", range(8))
def test_derivatives_are_those_of_the_position_and_both_ends_rest(index: int) -> None:
    trajectory = _all()[index]
    T = trajectory.duration
    ends = trajectory.sample(np.array([0.0, T]))
    np.testing.assert_allclose(ends.dq, 0.0, atol=1e-10)
    if not isinstance(trajectory, (Trapezoid, Chained)):
        np.testing.assert_allclose(ends.ddq, 0.0, atol=1e-9)
    t = np.random.default_rng(1).uniform(0.01, T - 0.01, 60)
    h = 1e-5
    before, here, after = (trajectory.sample(t + d) for d in (-h, 0.0, h))
    np.testing.assert_allclose((after.q - before.q) / (2 * h), here.dq, atol=2e-7 * (1 + np.abs(here.dq).max()))
    smooth = np.all(np.abs(after.ddq - before.ddq) < 0.1 * (1 + np.abs(here.ddq).max()), axis=1)
    np.testing.assert_allclose(((after.dq - before.dq) / (2 * h))[smooth], here.ddq[smooth], atol=1e-4 * (1 + np.abs(here.ddq).max()))
    assert smooth.sum() > 50


@pytest.mark.parametrize("index", range(8))
def test_outside_its_time_a_trajectory_stands_still(index: int) -> None:
    trajectory = _all()[index]
    outside = trajectory.sample(np.array([-1.0, trajectory.duration + 1.0]))
    ends = trajectory.sample(np.array([0.0, trajectory.duration]))
    np.testing.assert_allclose(outside.q, ends.q)
    assert np.all(outside.dq == 0)
    assert np.all(outside.ddq == 0)


def test_periods_repeat() -> None:
    wave = _all()[1]
    t = np.linspace(0, 1.999, 50)
    np.testing.assert_allclose(wave.sample(t).q, wave.sample(t + 2.0).q, atol=1e-12)


def test_trapezoid_moves_at_constant_speed_in_its_middle() -> None:
    way = Trapezoid(np.array([0.0, 1.0]), np.array([1.0, -1.0]), 2.0, 0.5)
    begin, end = way.steady
    motion = way.sample(np.linspace(begin, end, 20))
    np.testing.assert_allclose(motion.dq, np.tile([1.0 / 1.5, -2.0 / 1.5], (20, 1)))
    np.testing.assert_allclose(motion.ddq, 0.0, atol=1e-12)
    np.testing.assert_allclose(way.sample(np.array([2.0])).q[0], [1.0, -1.0])


def test_wrong_shapes_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="sine and cosine"):
        FourierTrajectory(np.zeros(2), np.zeros((3, 2)), np.zeros((2, 2)), 0.1)
    with pytest.raises(ConfigurationError, match="base frequency"):
        FourierTrajectory(np.zeros(2), np.zeros((3, 2)), np.zeros((3, 2)), 0.0)
    with pytest.raises(ConfigurationError, match="control points"):
        BSplineTrajectory(np.zeros(4), 1.0)
    with pytest.raises(ConfigurationError, match="ramp"):
        Trapezoid(np.zeros(1), np.ones(1), 1.0, 0.7)
    with pytest.raises(ConfigurationError, match="same number of joints"):
        Chained([Dwell(np.zeros(1), 1.0), Dwell(np.zeros(2), 1.0)])
