"""A joint that is declared as held still, and moves in the log."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import ident
from ident.robots import Robot

T = np.arange(400) / 100.0


def logged(robot: Robot, last: np.ndarray, name: str = "q6") -> ident.LogSet:
    """A log of all six joints of a UR5, whose last one goes as given."""
    columns = {f"q{j + 1}": 0.3 * np.sin(T + j) for j in range(5)} | {name: last} | {f"tau{j + 1}": np.cos(T + j) for j in range(6)}
    return ident.read_logs(pd.DataFrame({"t": T} | columns), robot)


def locked(position: float) -> Robot:
    return Robot.from_urdf(UR5, locked={"wrist_3_joint": position})


UR5 = ident.load_robot("ur5").source["urdf"]


@pytest.mark.parametrize(("name", "unit"), [("q6", 1.0), ("q6_deg", np.pi / 180)])
def test_a_locked_joint_that_moves_is_said(name: str, unit: float) -> None:
    """Its column was left out, and the others were fitted as if it had been still."""
    (note,) = [n for n in logged(locked(0.0), np.sin(2.0 * T) / unit, name)[0].notes if "is locked" in n]
    assert "wrist_3_joint is locked at 0, but moves from -1 to 1" in note
    assert "Do not lock a joint that moves" in note


def test_a_joint_that_is_locked_elsewhere_is_said() -> None:
    still = np.full_like(T, 0.4)
    (note,) = [n for n in logged(locked(0.0), still)[0].notes if "is locked" in n]
    assert "but stands at 0.4" in note
    assert "--lock wrist_3_joint=0.4" in note
    assert not any("is locked" in n for n in logged(locked(0.4), still)[0].notes)


def test_a_robot_without_locked_joints_has_no_such_note() -> None:
    assert not any("is locked" in n for n in logged(ident.load_robot("ur5"), np.sin(T))[0].notes)
