"""Summaries of estimates as text."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import ident
from ident import load_robot
from ident.estimate.summary import error_table
from ident.statistics.torque_error import TorqueError


def test_error_table_has_a_dash_where_a_joint_has_no_torque() -> None:
    robot = load_robot("puma560")
    tau = np.full((50, robot.n), 4.0)
    residual = np.full((50, robot.n), 0.1)
    residual[:, 2] = np.nan
    tau[:, 4] = 0.0
    estimate = SimpleNamespace(model=SimpleNamespace(robot=robot))
    _, head, cells, rms = error_table(estimate, {"fit": TorqueError.of(residual, tau)}).splitlines()
    assert head.split() == [*robot.joint_names, "all"]
    assert cells.split() == ["fit", "2.50", "2.50", "-", "2.50", "-", "2.50", "2.80"]
    assert rms.split() == ["(0.1)"] * 5
    # Each stands below its joint, the one without rows left free.
    ends = [head.index(name) + len(name) for name in robot.joint_names]
    assert [rms[:end].endswith(")") for end in ends] == [True, True, False, True, True, True]


def test_shape_parameters_are_said_to_be_held() -> None:
    train, _ = ident.demo_logs()
    linear = ident.friction.RotorInertia() + ident.friction.Viscous() + ident.friction.Coulomb()
    law = ident.effects.make_effect("stribeck", joints=("joint3",), v_s=0.2)
    assert "not fitted" not in ident.fit(train, "puma560", model=linear).summary()
    said = " ".join(ident.fit(train, "puma560", model=linear + law).summary().split())
    assert "shape parameters as declared, not fitted: v_s = 0.2" in said
    assert "(stribeck on joint3)" in said
