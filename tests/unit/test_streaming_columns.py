"""Columns at the rows, made piece by piece without the full-rate regressor, against the whole regressor filtered and decimated."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from ident.effects.motion import Motion
from ident.effects.registry import make_effect
from ident.model import Model
from ident.problem.columns import RowColumns, can_filter, live_columns
from ident.robots.robot import Robot
from ident.signals.filters import RowFilter

EFFECTS = (
    "rotor_inertia",
    "viscous",
    "coulomb",
    "asymmetric_coulomb",
    "stribeck",
    "offset",
    "linear_spring",
    "offset_drift",
    "external_force",
)


def motion(robot: Robot, samples: int) -> Motion:
    rng = np.random.default_rng(0)
    q, dq, ddq = (rng.standard_normal((samples, robot.n)) for _ in range(3))
    return Motion.of(robot, q, dq, ddq, np.arange(samples) / 100, rate=100.0, torque=rng.standard_normal((samples, robot.n)), start=-1.0)


@pytest.mark.parametrize("name", ["puma560", "palletiser", "scara", "double_pendulum"])
@pytest.mark.parametrize("factor", [1, 7, 40])
def test_columns_are_those_of_the_whole_regressor(name: str, factor: int) -> None:
    robot = ident.load_robot(name)
    row_filter = RowFilter.lowpass(12.0 / factor, 100.0, factor)
    moved = motion(robot, len(row_filter.taps) + 11 * factor)
    links = robot.rigid_body()
    one_joint = make_effect("viscous", joints=[robot.joint_names[-1]], label="x")
    models = {
        "links": links,
        "all": Model(robot, (*links.effects, *(make_effect(e) for e in EFFECTS), one_joint)),
        "in another order": Model(robot, (make_effect("coulomb"), *links.effects, make_effect("viscous"))),
        "no links": Model(robot, (make_effect("viscous"), make_effect("coulomb"))),
    }
    for what, model in models.items():
        assert can_filter(model), what
        keep = model.base.independent
        whole = row_filter.apply(np.ascontiguousarray(model.columns(moved)[:, :, keep]))
        found = RowColumns(model, row_filter)(moved)
        scale = np.abs(whole).max(axis=(0, 1))
        assert found.shape == whole.shape == (row_filter.count(len(moved)), robot.n, len(keep))
        assert np.all(np.abs(found - whole) <= 1e-12 * np.maximum(scale, 1e-12)), what
        assert not whole[:, ~live_columns(model)].any(), what


def test_a_short_stretch_has_no_rows() -> None:
    robot = ident.load_robot("scara")
    model = robot.rigid_body() + make_effect("viscous")
    assert RowColumns(model, RowFilter.lowpass(5.0, 100.0, 4))(motion(robot, 10)).shape == (0, robot.n, model.base.count)
