"""Columns that look like what a log lacks: asked about, and by the right joint."""

from __future__ import annotations

from pathlib import Path

import pytest

from ident.auditing import audit
from ident.errors import DataError
from ident.logs.columns import resolve_columns
from ident.logs.hints import lookalikes
from ident.logs.log import LogSet
from ident.logs.names import JointNames
from ident.logs.reading import read_logs
from ident.logs.torque import measured
from ident.robots.robot import Robot
from ident.streaming.ingest import Reading, store_logs

ARM = ("slide", "shoulder", "elbow", "wrist")
PLAIN = ("joint1", "joint2", "joint3")
UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
PANDA = tuple(f"panda_joint{j + 1}" for j in range(7))
FROM_ZERO = tuple(f"arm_{j}" for j in range(4))


@pytest.mark.parametrize(
    ("column", "quantity", "names", "joint"),
    [
        ("torque_3", "tau_joint", PLAIN, 2),
        ("torque_3", "tau_joint", (), 2),
        ("torque3_Nm", "tau_motor", UR, 2),
        ("effort_joint3", "tau_joint", PLAIN, 2),
        ("jointTorque3", "tau_joint", PANDA, 2),
        ("TAU_J3", "tau_joint", PANDA, 2),
        ("tau_shoulder", "tau_joint", ARM, 1),
        ("shoulder.trq", "tau_motor", ARM, 1),
        ("wrist_1_torque", "tau_joint", UR, 3),
        ("tau_elbow_joint_Nm", "tau_joint", UR, 2),
        ("torque_2", "tau_joint", FROM_ZERO, 2),
        ("motor_current_2", "tau_current", (), 1),
        ("effort2_A", "tau_current", PANDA, 1),
        ("pos_3", "q", PLAIN, 2),
        ("elbow_angle_deg", "q", UR, 2),
        ("elbow_deg", "q", UR, 2),  # its unit says what it is
        ("elbow pos [deg]", "q", UR, 2),
        ("shoulder torque (N m)", "tau_joint", ARM, 1),
    ],
)
def test_a_column_is_taken_for_its_joint(column: str, quantity: str, names: tuple[str, ...], joint: int) -> None:
    every = range(max(len(names), 4))
    assert lookalikes(["stamp", column, "temperature"], quantity, every, names) == {joint: column}
    others = [j for j in every if j != joint]
    assert not lookalikes([column], quantity, others, names), "a joint that lacks nothing is not asked about"


@pytest.mark.parametrize(
    ("column", "quantity"),
    [
        ("temperature_3", "tau_joint"),
        ("torque_limit_3", "tau_joint"),
        ("torque_3_deg", "tau_joint"),
        ("effort3_A", "tau_joint"),
        ("torque_9", "tau_joint"),
        ("tau_shoulder", "tau_joint"),
        ("gripper_torque", "tau_joint"),
        ("current_3", "tau_motor"),
        ("statement_3", "tau_joint"),
        ("elbow", "q"),
        ("elbow_Nm", "q"),
    ],
)
def test_what_does_not_look_like_it_is_left_alone(column: str, quantity: str) -> None:
    assert not lookalikes([column], quantity, range(6), UR)


def test_the_one_column_left_is_taken_for_the_one_joint_left() -> None:
    assert lookalikes(["tau_shoulder"], "tau_motor", [2], PLAIN) == {2: "tau_shoulder"}
    assert lookalikes(["tau_shoulder"], "tau_joint", [1], UR) == {1: "tau_shoulder"}
    assert lookalikes(["torque"], "tau_joint", [0], ("pivot",)) == {0: "torque"}
    assert not lookalikes(["torque_2"], "tau_joint", [2], PLAIN), "its name tells another joint"
    assert not lookalikes(["torque_limit"], "tau_joint", [2], PLAIN)


def test_columns_counted_from_zero() -> None:
    columns = ["torque_0", "torque_1", "torque_2"]
    assert lookalikes(columns, "tau_joint", range(3), ()) == dict(enumerate(columns))
    assert lookalikes(columns, "tau_joint", range(3), UR) == dict(enumerate(columns))


def test_a_joint_without_torque_is_asked_about() -> None:
    joints = JointNames(PLAIN, (False,) * 3)
    plan = resolve_columns(["t", "q1", "q2", "q3", "tau_m1", "tau_m2", "torque_3"], joints)
    (note,) = plan.notes
    assert note == (
        "log: no motor torque logged for joint3; did you mean 'torque_3'? If so, map it under [columns] of a study file: "
        'tau_m3 = "torque_3".'
    )
    assert plan.extra == ("torque_3",), "a question, no more"
    (note,) = resolve_columns(["t", "q1", "q2", "q3", "tau1", "tau2", "noise"], joints).notes
    assert note == "log: no torque logged for joint3."
    told = resolve_columns(["t", "q1", "q2", "q3", "tau_m1", "tau_m2", "torque_3"], joints, {"tau_m3": "torque_3"})
    assert not told.notes


def test_a_missing_position_is_asked_about() -> None:
    with pytest.raises(DataError, match=r"missing: q3 \(joint3\); did you mean 'pos_3'\? If so, .* q3 = \"pos_3\"\. Choose the robot"):
        resolve_columns(["t", "q1", "q2", "pos_3"], JointNames(PLAIN, (False,) * 3))


@pytest.fixture(scope="module")
def robot() -> Robot:
    links = "".join(f'<link name="l{j}"/>' for j in range(5))
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="l{j}"/><child link="l{j + 1}"/><axis xyz="0 0 1"/></joint>'
        for j, name in enumerate(ARM)
    )
    return Robot.from_urdf(f'<robot name="arm">{links}{joints}</robot>')


@pytest.mark.parametrize("streamed", [False, True])
@pytest.mark.parametrize(
    ("torques", "said"),
    [
        ([f"effort_joint{j + 1}" for j in range(4)], 'tau1 = "effort_joint1", tau2 = "effort_joint2", tau3 = "effort_joint3" … (tau_m1'),
        ([f"{name}_torque" for name in ARM], 'tau1 = "slide_torque", tau2 = "shoulder_torque", tau3 = "elbow_torque" …'),
        ([f"current_{j}" for j in range(4)], 'i1 = "current_0", i2 = "current_1", i3 = "current_2" …'),
        ([f"T_{j + 1} [Nm]" for j in range(4)], 'tau1 = "T_1 [Nm]", tau2 = "T_2 [Nm]", tau3 = "T_3 [Nm]" …'),
        (["tau_elbow"], 'tau3 = "tau_elbow" ('),
        (["load"], "Map the columns under [columns] of a study file."),
    ],
)
def test_a_log_without_torque_asks(tmp_path: Path, robot: Robot, torques: list[str], said: str, streamed: bool) -> None:
    path = tmp_path / "log.csv"
    header = ["t", "q1", "q2", "q3", "q4", *torques]
    rows = [",".join(str(0.01 * k + c) for c in range(len(header))) for k in range(400)]
    path.write_text("\n".join([",".join(header), *rows]) + "\n")
    log = store_logs(path, tmp_path / "stored", Reading(robot, None, "refuse"))[0].read(0, 400) if streamed else read_logs(path, robot)[0]
    with pytest.raises(DataError, match="nothing to fit to") as caught:
        measured(log, robot.transmission)
    assert said in str(caught.value)
    assert ("did you mean" in str(caught.value)) == ("load" not in torques)
    assert said in audit(LogSet((log,)), robot).of("torque_missing")[0].text
    assert ("did you mean" in audit(LogSet((log,))).of("torque_missing")[0].text) == ("load" not in torques), "without a robot, too"
