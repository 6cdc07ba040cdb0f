"""A preparation made anew from what a report tells of."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from effect_robots import ROBOTS

from ident.logs.log import Log, LogSet
from ident.signals import make_preparation
from ident.signals.likewise import like
from ident.simulation.trajectory import FourierTrajectory


@pytest.mark.parametrize("asked", [{}, {"cutoff_hz": 7.3}, {"row_cutoff_hz": 1.7}, {"decimate": 5}, {"method": "savitzky_golay"}])
def test_other_data_are_prepared_as_the_first_were(asked: dict[str, Any]) -> None:
    """To the last tap: rows of held-out data are those of the same filter, so many samples apart."""
    robot, rng = ROBOTS["scara"](), np.random.default_rng(5)
    robot_motion = FourierTrajectory(np.zeros(robot.n), *(0.1 * rng.normal(size=(2, 12, robot.n))), 0.1)
    t = np.arange(6000) / 200.0
    c = robot_motion.sample(t)
    logs = LogSet((Log("a", t, c.q + 1e-5 * rng.normal(size=c.q.shape), tau={"joint": rng.normal(size=c.q.shape)}),), robot=robot)
    first = make_preparation(**asked)(logs, robot)
    again = like(first.report.to_dict())(logs, robot)
    np.testing.assert_array_equal(again.tau, first.tau)
    np.testing.assert_array_equal(again.ddq, first.ddq)
    assert again.report.cutoff_hz == first.report.cutoff_hz
