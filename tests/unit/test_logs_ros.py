"""JointState messages exported to CSV, with a name array beside the values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ident.errors import DataError
from ident.logs.reading import read_logs
from ident.robots.robot import Robot

ARM = """<robot name="arm"><link name="a"/><link name="b"/><link name="c"/>
<joint name="elbow" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
<joint name="wrist" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/></joint></robot>"""


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_urdf(ARM)


def test_one_column_an_element(tmp_path: Path, robot: Robot) -> None:
    """As `rostopic echo -p` writes it; a gripper publishes on the same topic, and the joints come in another order."""
    lines = ["%time,field.header.stamp,field.name0,field.name1,field.position0,field.position1,field.effort0,field.effort1"]
    start = 1_600_000_000_000_000_000
    for k in range(60):
        lines.append(f"{start + k * 10_000_000 + 777},{start + k * 10_000_000},wrist,elbow,{0.1 * k},{0.2 * k},{1.0},{2.0}")
        if k % 3 == 0:
            lines.append(f"{start + k * 10_000_000 + 999},{start + k * 10_000_000 + 500},finger,thumb,9,9,9,9")
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    log = read_logs(tmp_path / "a.csv", robot)[0]
    np.testing.assert_allclose(log.q, np.arange(60)[:, None] * [0.2, 0.1])
    np.testing.assert_allclose(log.tau["joint"], np.tile([2.0, 1.0], (60, 1)))
    np.testing.assert_allclose(np.diff(log.t), 0.01, atol=1e-6)


def test_lists_in_a_cell(tmp_path: Path, robot: Robot) -> None:
    lines = ["header.stamp.secs,header.stamp.nsecs,name,position,velocity,effort"]
    lines += [f'100,{k * 1_000_000},"[\'elbow\', \'wrist\']","[{0.1 * k}, {0.2 * k}]","(1, 2)","[]"' for k in range(40)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    log = read_logs(tmp_path / "a.csv", robot)[0]
    np.testing.assert_allclose(log.q, np.arange(40)[:, None] * [0.1, 0.2])
    np.testing.assert_allclose(log.dq, np.tile([1.0, 2.0], (40, 1)))
    assert not log.tau
    assert log.t[1] - log.t[0] == pytest.approx(1e-3)


def test_without_a_robot_the_first_message_names_the_joints(tmp_path: Path) -> None:
    lines = ["t,name_0,position_0,effort_0", *(f"{0.01 * k},slider,{k},3" for k in range(30))]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    assert read_logs(tmp_path / "a.csv")[0].n == 1


def test_joints_that_never_occur(tmp_path: Path, robot: Robot) -> None:
    lines = ["t,name_0,name_1,position_0,position_1", *(f"{0.01 * k},left,right,{k},3" for k in range(30))]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(DataError, match="no message names all joints elbow, wrist; the first names left, right"):
        read_logs(tmp_path / "a.csv", robot)
