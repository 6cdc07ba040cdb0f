"""The benchmark of excitation: its check sees what is wrong, and a problem of it passes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.excitation.check import Checker
from benchmarks.excitation.problems import problem, robot_of
from benchmarks.excitation.run import CONSISTENT, EXACT, lines, outside, solve, worst
from ident.excitation import Limits, Surroundings, random_excitation


def test_a_problem_of_the_benchmark(tmp_path: Path) -> None:
    row = solve(problem(6, tmp_path))
    assert row["arm"] == "iiwa14"
    assert row["touching"] == 0
    assert not outside(row)
    assert worst(row) <= EXACT
    assert row["still"] <= 1e-8
    assert row["consistent"] <= CONSISTENT
    assert any("iiwa14" in line for line in lines([row]))


def test_its_check_sees_contacts_depths_and_excess(tmp_path: Path) -> None:
    robot = robot_of("iiwa14")
    model = robot.rigid_body()
    checker = Checker("iiwa14", robot, Surroundings(ground=0.4), (np.array([0.4, 0.0, 0.3]), np.full(3, 0.1)))
    found = random_excitation(model, limits=Limits.of(robot), rate=1000.0, seed=1)
    own = Limits.of(robot, share=0.3, acceleration=0.5, torque=1.0, jerk=1.0)
    seen = checker.verdict(found.to_frame(), own, np.zeros((3, 7)))
    assert seen["touching"] > 0
    assert seen["room"] < 0
    for kind in ("position", "velocity", "acceleration", "jerk", "torque"):
        assert seen[f"over_{kind}"] > 0, kind
    frame = found.to_frame()
    frame["dq1"] *= 1.5
    assert checker.verdict(frame, own, np.zeros((3, 7)))["consistent"] > CONSISTENT > seen["consistent"]
