"""Constrained fits on real logs: consistent, exported and reloaded; as good on held-out data as without, or the reason said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ident.estimators import make_estimator
from ident.export import Identified, export
from ident.physical import Target, binding_constraints, judge, repair_estimate, subject_of
from ident.physical.estimates import triangle_of
from ident.regressor.rigid import inverse_dynamics
from ident.robot import Robot
from ident.session import Session
from ident.study import read_study

pytestmark = pytest.mark.slow
STUDIES = Path(__file__).parents[2] / "benchmarks" / "real"


@pytest.mark.parametrize("name", ["tx40", "panda", "tiago"])
def test_constrained_fit(name: str, data_folder: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("IDENT_DATA", str(data_folder))
    session = Session(read_study(STUDIES / f"{name}.toml"))
    plain = session.estimate
    found = make_estimator("physical").solve(session.problem)
    verdict = judge(found)
    assert verdict.possible.possible
    assert verdict.possible.certified
    assert verdict.consistent is not None
    assert verdict.consistent.consistent
    held = session.held_signals
    before, after = plain.torque_error(held).relative_all, found.torque_error(held).relative_all
    if after > 1.01 * before:
        # The reason: which constraints the data are against, and by how much (squared standard deviations).
        structure = subject_of(plain).structure
        triangle = triangle_of(plain)
        assert triangle is not None
        against = binding_constraints(structure, Target.from_information(*triangle))
        assert against
        assert max(against.values()) > 5
        assert after < 1.15 * before
    fit = repair_estimate(plain, held=held)
    assert fit.errors["held out"]["after"]["relative_all"] == pytest.approx(after, rel=0.02)
    # Out as a URDF, in again, and the same torque.
    exported = export(found, tmp_path / "out.urdf")
    assert exported.bodies
    robot = found.model.robot
    source = robot.source
    again = Robot.from_urdf(
        tmp_path / "out.urdf", gravity=source["gravity"], locked=source["locked"], joints=source["joints"], loop=source["loop"]
    )
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.uniform(-0.3, 0.3, (3, 50, robot.tree.nq))
    own = Identified.of(found).inertial
    wanted = inverse_dynamics(robot.tree, own, q, dq, ddq)
    assert again.nominal is not None
    got = inverse_dynamics(again.tree, again.nominal, q, dq, ddq)
    assert np.abs(got - wanted).max() < 1e-9
