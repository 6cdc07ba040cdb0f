"""One run in files of one joint each: put together by their names, on one clock, and never with what is a run of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ident

Array = np.ndarray
JOINTS = ("shoulder", "elbow", "wrist")
N, n, RATE = 400, 3, 200.0
T = np.arange(N) / RATE


def robot(names: tuple[str, ...] = JOINTS) -> ident.Robot:
    """A chain that swings in gravity."""
    parts = ['<robot name="arm"><link name="base"/>']
    for k, joint in enumerate(names):
        parent = "base" if k == 0 else names[k - 1]
        body = (
            '<inertial><origin xyz="0.2 0 0.05"/><mass value="2"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
        )
        parts.append(f'<link name="{joint}">{body}</link><joint name="{joint}_joint" type="revolute"><parent link="{parent}"/>')
        parts.append(f'<child link="{joint}"/><origin xyz="0.3 0 0"/><axis xyz="0 1 0"/>')
        parts.append('<limit lower="-6" upper="6" effort="90" velocity="9"/></joint>')
    return ident.Robot.from_urdf("".join(parts) + "</robot>")


def motion() -> tuple[Array, Array, Array]:
    """Positions, velocities, and the torques of the robot with friction."""
    w = 3.0 + 1.7 * np.arange(n)
    q = 0.6 * np.sin(np.outer(T, w) + np.arange(n))
    dq, ddq = 0.6 * w * np.cos(np.outer(T, w) + np.arange(n)), -0.6 * w**2 * np.sin(np.outer(T, w) + np.arange(n))
    model = robot().rigid_body() + ident.make_effect("viscous")
    values = np.concatenate([robot().nominal, [1.0, 0.8, 0.5]])  # type: ignore[list-item]
    return q, dq, model.inverse_dynamics(q, dq, ddq, values)


Q, DQ, TAU = motion()


def write(path: Path, j: int, names: str = "time,q,dq,tau", t: Array = T, scale: float = 1.0) -> Path:
    table = np.column_stack([t, scale * Q[:, j], scale * DQ[:, j], TAU[:, j]])
    np.savetxt(path, table, delimiter=",", header=names, comments="", fmt="%.12g")
    return path


def is_the_run(log: ident.Log) -> None:
    assert log.q is not None
    assert log.dq is not None
    np.testing.assert_allclose(log.q, Q, atol=1e-9)
    np.testing.assert_allclose(log.dq, DQ, atol=1e-9)
    np.testing.assert_allclose(log.tau["joint"], TAU, atol=1e-8)


@pytest.mark.parametrize("name", ["joint{}.csv", "axis_{}_run3.csv", "2024-05-01 J{}.csv", "log.motor{}.csv"])
@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize("given", ["folder", "list", "list turned round"])
@pytest.mark.parametrize("known", [False, True], ids=["no robot", "robot"])
def test_numbered_files(tmp_path: Path, name: str, first: int, given: str, known: bool) -> None:
    paths = [write(tmp_path / name.format(first + j), j) for j in range(n)]
    which = {"folder": tmp_path, "list": paths, "list turned round": paths[::-1]}[given]
    (log,) = ident.read_logs(which, robot() if known else None)
    is_the_run(log)
    assert any("each hold one joint of the same run, in this order" in note for note in log.notes)


def test_degrees_and_names_of_joints(tmp_path: Path) -> None:
    """By names the files go to the robot's joints, whatever their order."""
    for j in (2, 0, 1):
        write(tmp_path / f"run1_{JOINTS[j]}.csv", j, "time [s],angle [deg],speed [deg/s],torque [Nm]", scale=180 / np.pi)
    (log,) = ident.read_logs(tmp_path, robot())
    is_the_run(log)
    assert log.joint_names == robot().joint_names


def test_columns_that_number_one_joint_each(tmp_path: Path) -> None:
    for j in range(n):
        write(tmp_path / f"log_{j + 1}.csv", j, f"time,q{j + 1},dq{j + 1},tau{j + 1}")
    (log,) = ident.read_logs(tmp_path)
    is_the_run(log)


def test_two_runs_in_a_folder(tmp_path: Path) -> None:
    for run in (1, 2):
        for j in range(n):
            write(tmp_path / f"run{run}_joint{j + 1}.csv", j)
    logs = ident.read_logs(tmp_path, robot())
    assert len(logs) == 2
    for log in logs:
        is_the_run(log)


def test_clocks_that_differ_are_brought_together(tmp_path: Path) -> None:
    late = T + 0.0031
    paths = [write(tmp_path / f"joint{j + 1}.csv", j, t=late if j == 1 else T) for j in range(n)]
    (log,) = ident.read_logs(paths, robot())
    assert log.q is not None
    assert log.t[0] == pytest.approx(T[1])
    np.testing.assert_allclose(log.q[:, 0], Q[1:, 0], atol=1e-9)
    np.testing.assert_allclose(log.q[:, 1], np.interp(T[1:], late, Q[:, 1]), atol=1e-9)
    assert any("interpolated to those of the first" in note for note in log.notes)


def test_times_that_do_not_overlap_are_refused(tmp_path: Path) -> None:
    for j in range(n):
        write(tmp_path / f"joint{j + 1}.csv", j, t=T + 10.0 * j)
    with pytest.raises(ident.DataError, match=r"joint1\.csv … joint3\.csv.*their times do not overlap"):
        ident.read_logs(tmp_path, robot())


def test_whole_logs_that_are_named_by_the_joint_that_was_moved_stay_apart(tmp_path: Path) -> None:
    names = ["time", *(f"{x}{j + 1}" for x in ("q", "dq", "tau") for j in range(n))]
    for j in range(n):
        np.savetxt(tmp_path / f"joint{j + 1}.csv", np.column_stack([T, Q, DQ, TAU]), delimiter=",", header=",".join(names), comments="")
    logs = ident.read_logs(tmp_path, robot())
    assert len(logs) == n
    for log in logs:
        is_the_run(log)


def test_runs_of_one_joint_stay_apart(tmp_path: Path) -> None:
    for j in range(n):
        write(tmp_path / f"run{j + 1}.csv", j)
    assert [log.n for log in ident.read_logs(tmp_path)] == [1, 1, 1]


def test_a_fit_of_files_by_joint_is_that_of_one_table(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    for j in range(n):
        write(tmp_path / "run" / f"joint{j + 1}.csv", j)
    names = ["time", *(f"{x}{j + 1}" for x in ("q", "dq", "tau") for j in range(n))]
    table = np.column_stack([T, Q, DQ, TAU])
    np.savetxt(tmp_path / "whole.csv", table, delimiter=",", header=",".join(names), comments="", fmt="%.12g")
    fits = [ident.fit(path, robot(), model=ident.make_effect("viscous"), held=0) for path in (tmp_path / "run", tmp_path / "whole.csv")]
    np.testing.assert_allclose(fits[0].values, fits[1].values, rtol=1e-9)
    found = dict(zip(fits[0].names, fits[0].values, strict=True))
    np.testing.assert_allclose([found[f"Fv_{name}_joint"] for name in JOINTS], [1.0, 0.8, 0.5], atol=0.03)
