"""Logs as strangers write them: names in other orders and languages, units that nobody knows, stamps of all kinds, several senders."""

from __future__ import annotations

import json
import struct
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident

Array = np.ndarray
N, n, RATE = 300, 3, 250.0
JOINTS = ("shoulder", "elbow", "wrist")
ORDER = (2, 0, 1)
EPOCH = 1_714_557_600


def robot() -> ident.Robot:
    parts = ['<robot name="arm"><link name="base"/>']
    for k, joint in enumerate(JOINTS):
        parent = "base" if k == 0 else JOINTS[k - 1]
        body = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
        parts.append(f'<link name="{joint}">{body}</link><joint name="{joint}_joint" type="revolute"><parent link="{parent}"/>')
        parts.append(f'<child link="{joint}"/><axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="50" velocity="9"/></joint>')
    return ident.Robot.from_urdf("".join(parts) + "</robot>")


def motion() -> tuple[Array, Array, Array, Array]:
    t, w = np.arange(N) / RATE, 1.0 + 0.5 * np.arange(n)
    phase = np.outer(3 * t, w) + np.arange(n)
    noise = 0.01 * np.random.default_rng(0).normal(size=(N, n))
    return t, 0.8 * np.sin(phase), 2.4 * w * np.cos(phase), 5.0 * np.cos(np.outer(4 * t, w)) + np.arange(n) + noise


T, Q, DQ, TAU = motion()


def write(path: Path, names: list[str], rows: Any, mark: str = ",") -> Path:
    table = [[x if isinstance(x, str) else repr(float(x)) for x in row] for row in rows]
    path.write_text("\n".join([mark.join(names), *(mark.join(row) for row in table)]) + "\n", encoding="utf-8")
    return path


def each(pattern: str, first: int = 1) -> list[str]:
    return [pattern.format(k) for k in range(first, first + n)]


def is_the_motion(log: ident.Log, side: str | None = "joint", tolerance: float = 1e-6) -> None:
    np.testing.assert_allclose(log.t - log.t[0], T[: len(log)], atol=tolerance)
    assert log.q is not None
    np.testing.assert_allclose(log.q, Q[: len(log)], atol=tolerance)
    if log.dq is not None:
        np.testing.assert_allclose(log.dq, DQ[: len(log)], atol=tolerance)
    assert list(log.tau) == ([] if side is None else [side])
    for torque in log.tau.values():
        np.testing.assert_allclose(torque, TAU[: len(log)], atol=1e-5)


Q_TAU = np.hstack([Q, TAU])
HEADERS: dict[str, tuple[str, str, str, float, float]] = {
    "turns": ("time", "axis{}.pos_estimate [turns]", "axis{} torque [N·m]", 2 * np.pi, 1.0),
    "kgf.cm": ("Time [min]", "J{} angle (deg)", "J{} torque (kgf.cm)", np.pi / 180, 0.0980665),
    "Ncm": ("time [s]", "q{} [rad]", "tau{} [Ncm]", 1.0, 0.01),
    "lbf-in": ("ts", "theta_{}", "trq_{} [lbf-in]", 1.0, 0.1129848290276167),
    "glued": ("time", "jpos{}", "jtorque{}", 1.0, 1.0),
    "French": ("temps (s)", "angle axe {} (°)", "couple axe {} (Nm)", np.pi / 180, 1.0),
    "by unit alone": ("时间(ms)", "关节{}位置(°)", "关节{}力矩(Nm)", np.pi / 180, 1.0),
}


@pytest.mark.parametrize("kind", HEADERS)
def test_names_and_units(tmp_path: Path, kind: str) -> None:
    time, q, tau, angle, torque = HEADERS[kind]
    clock = {"Time [min]": 60.0, "时间(ms)": 1e-3}.get(time, 1.0)
    path = write(tmp_path / "a.csv", [time, *each(q), *each(tau)], np.column_stack([T / clock, Q / angle, TAU / torque]))
    is_the_motion(ident.read_logs(path)[0])


@pytest.mark.parametrize("units", [False, True])
def test_a_torque_in_a_unit_that_nobody_knows_is_never_taken_for_si(tmp_path: Path, units: bool) -> None:
    names = ["time", *each("pos{}"), *each("torque{}" if units else "torque{} [%]")]
    rows: list[Any] = [["s", *["rad"] * n, *["%"] * n]] if units else []
    path = write(tmp_path / "a.csv", names, [*rows, *np.column_stack([T, Q, TAU])])
    log = ident.read_logs(path)[0]
    is_the_motion(log, None)
    assert any("are in '%', which is not a known unit, and are not used" in note for note in log.notes)
    path = write(tmp_path / "b.csv", ["time", *each("pos{} [gon]"), *each("torque{}")], np.column_stack([T, Q, TAU]))
    with pytest.raises(ident.DataError, match="are in 'gon', which is not a known unit"):
        ident.read_logs(path)


def test_a_row_of_units_counts_for_columns_of_our_own_names_too(tmp_path: Path) -> None:
    rows = [["ms", *["deg"] * n, *["N.m"] * n], *np.column_stack([1e3 * T, np.rad2deg(Q), TAU])]
    is_the_motion(ident.read_logs(write(tmp_path / "a.csv", ["t", *each("q{}"), *each("tau{}")], rows))[0])


def _moment(t: float, form: str) -> str:
    return (datetime(2024, 5, 1, 23, 59, 59, tzinfo=UTC) + timedelta(seconds=float(t))).strftime(form)


STAMPS: dict[str, tuple[list[str], Any]] = {
    "ISO 8601": (["timestamp"], lambda t: [_moment(t, "%Y-%m-%dT%H:%M:%S.%f+00:00")]),
    "over midnight": (["Time"], lambda t: [_moment(t, "%H:%M:%S.%f")]),
    "date and time": (["Date", "Time"], lambda t: _moment(t, "%d.%m.%Y|%H:%M:%S.%f").split("|")),
    "nanoseconds since 1970": (["timestamp"], lambda t: [str(EPOCH * 10**9 + round(1e9 * t))]),
    "milliseconds since 1970": (["t"], lambda t: [str(EPOCH * 10**3 + round(1e3 * t))]),
    "sec and nanosec": (["sec", "nanosec"], lambda t: [str(EPOCH + int(t)), str(round(1e9 * (t % 1)))]),
    "tv_sec and tv_usec": (["tv_sec", "tv_usec"], lambda t: [str(EPOCH + int(t)), str(round(1e6 * (t % 1)))]),
}


@pytest.mark.parametrize("kind", STAMPS)
@pytest.mark.parametrize("own", [False, True])
def test_time_stamps(tmp_path: Path, kind: str, own: bool) -> None:
    names, stamp = STAMPS[kind]
    columns = [*each("q{}"), *each("tau{}")] if own else [*each("position_{}"), *each("effort_{}")]
    rows = [[*stamp(t), *row] for t, row in zip(T, Q_TAU, strict=True)]
    is_the_motion(ident.read_logs(write(tmp_path / "a.csv", [*names, *columns], rows))[0])


def test_what_is_wrong_with_a_time_is_said(tmp_path: Path) -> None:
    rows = np.column_stack([T, Q_TAU])[np.random.default_rng(0).permutation(N)]
    path = write(tmp_path / "a.csv", ["time", *each("position_{}"), *each("effort_{}")], rows)
    with pytest.raises(ident.DataError, match=r"a\.csv: column 'time' does not increase.*rate_hz"):
        ident.read_logs(path)


def test_a_line_of_text_between_stamps_is_told_with_what_to_do(tmp_path: Path) -> None:
    stamps = [f"09:00:{t:09.6f}" for t in T]
    rows = [[stamp, *row] for stamp, row in zip(stamps, Q_TAU, strict=True)]
    path = write(tmp_path / "a.csv", ["stamp", *each("position_{}"), *each("effort_{}")], rows)
    lines = path.read_text().split("\n")
    path.write_text("\n".join([*lines[:20], "--- recorder restarted ---", *lines[20:]]))
    with pytest.raises(ident.DataError, match=r"data row 20: '--- recorder restarted ---'.*Correct or remove"):
        ident.read_logs(path)


@pytest.mark.parametrize("names", [["t", *each("q{}"), *each("tau{}")], ["time", *each("position_{}"), *each("effort_{}")]])
@pytest.mark.parametrize("line", ["!!! CAN timeout", "!!! CAN timeout, node 3"])
def test_a_line_that_is_no_row_is_quoted(tmp_path: Path, names: list[str], line: str) -> None:
    """It was said that there is no time, or that a part of the line is not a position."""
    path = write(tmp_path / "a.csv", names, np.column_stack([T, Q_TAU]))
    lines = path.read_text().split("\n")
    path.write_text("\n".join([*lines[:20], line, *lines[20:]]))
    with pytest.raises(ident.DataError) as refused:
        ident.read_logs(path)
    said = str(refused.value)
    assert said.startswith(f"log {path}: line 21 (data row 20) is not a row of numbers: {line!r}")
    assert "remove that line" in said
    assert "no time" not in said


def test_a_time_that_is_no_number_is_told_first(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", ["time", *each("position_{}"), *each("effort_{}")], np.column_stack([T, Q_TAU]))
    lines = path.read_text().split("\n")
    lines[20] = ",".join(["ERR", *lines[20].split(",")[1:]])
    path.write_text("\n".join(lines))
    with pytest.raises(ident.DataError, match=r"a\.csv: column 'time', line 21 \(data row 20\): 'ERR' is not a number\. Correct or remove"):
        ident.read_logs(path)


DIALECTS: dict[str, Any] = {
    "separators at the end": lambda text: text.replace("\n", ",\n").replace(",\n", "\n", 1),
    "bars": lambda text: text.replace(",", "|"),
    "quoted decimal commas": lambda text: (
        "\n".join(
            [
                text.split("\n")[0],
                *(",".join(f'"{x}"' for x in row.replace(".", ";").split(",")).replace(";", ",") for row in text.split("\n")[1:-1]),
            ]
        )
        + "\n"
    ),
    "missing torques of Windows": lambda text: text.replace(repr(float(TAU[7, 1])), "-nan(ind)").replace(repr(float(TAU[9, 2])), "1.#QNAN"),
    "header behind a comment": lambda text: "% recorded in lab 3\n% " + text,
    "comments with slashes": lambda text: "// recorded in lab 3\n" + text,
}


@pytest.mark.parametrize("kind", [*DIALECTS, "UTF-16"])
def test_dialects(tmp_path: Path, kind: str) -> None:
    path = write(tmp_path / "a.csv", ["time", *each("q{}"), *each("tau{}")], np.column_stack([T, Q_TAU]))
    text = path.read_text()
    path.write_bytes(DIALECTS.get(kind, str)(text).encode("utf-16" if kind == "UTF-16" else "utf-8"))
    log = ident.read_logs(path)[0]
    if kind.startswith("missing"):
        assert np.isnan(log.tau["joint"][7, 1])
        assert np.isnan(log.tau["joint"][9, 2])
        log.tau["joint"][[7, 9], [1, 2]] = TAU[[7, 9], [1, 2]]
    is_the_motion(log)


def test_lists_in_cells_and_joint_states_as_they_are_echoed(tmp_path: Path) -> None:
    cells = [[repr(float(t)), f'"{q.tolist()}"', f'"{u.tolist()}"'] for t, q, u in zip(T, Q, TAU, strict=True)]
    is_the_motion(ident.read_logs(write(tmp_path / "a.csv", ["time", "q", "tau"], cells))[0])
    rows = [
        [str(EPOCH + int(t)), str(round(1e9 * (t % 1))), "base", *(JOINTS[k] for k in ORDER), *row]
        for t, row in zip(T, np.hstack([x[:, ORDER] for x in (Q, DQ, TAU)]), strict=True)
    ]
    path = tmp_path / "echo.csv"
    path.write_text("\n".join(",".join(x if isinstance(x, str) else repr(float(x)) for x in row) for row in rows) + "\n")
    log = ident.read_logs(path)[0]
    assert log.joint_names == tuple(JOINTS[k] for k in ORDER)
    np.testing.assert_allclose(log.q[:, np.argsort(ORDER)], Q)
    np.testing.assert_allclose(log.tau["joint"][:, np.argsort(ORDER)], TAU)


def _named(folder: Path, kind: str) -> Path:
    """A recording whose joints come in another order than the robot's, which only names beside the numbers tell."""
    names = [JOINTS[k] for k in ORDER]
    q, dq, tau = (x[:, ORDER] for x in (Q, DQ, TAU))
    path = folder / f"log.{kind.split(maxsplit=1)[0]}"
    if kind == "npz":
        np.savez(path, time=T, joint_positions=q, joint_velocities=dq, joint_torques=tau, joint_names=np.array(names))
    elif kind == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["time"], file["position"], file["velocity"], file["effort"] = T, q, dq, tau
            file["joint_names"] = np.array(names, "S")
    elif kind == "mat":
        from scipy.io import savemat

        joints = np.zeros((1, n), dtype=[("name", "O"), ("q", "O"), ("qd", "O"), ("tau", "O")])
        for k in range(n):
            joints[0, k] = (names[k], q[:, [k]], dq[:, [k]], tau[:, [k]])
        savemat(path, {"time": T[:, None], "joints": joints})
    elif kind.startswith("parquet"):
        pa = pytest.importorskip("pyarrow")
        from pyarrow import parquet

        rows = [[{"name": names[j], "position": q[k, j], "effort": tau[k, j]} for j in range(n)] for k in range(N)]
        table = {"t": T, "joints": pa.array(rows)}
        if kind == "parquet lists":
            table = {"t": T, "name": pa.array([names] * N), "position": pa.array(list(q)), "effort": pa.array(list(tau))}
        parquet.write_table(pa.table(table), path)
    elif kind == "jsonl":
        rows = [{"ts": T[k], "joints": [{"name": names[j], "angle": q[k, j], "torque": tau[k, j]} for j in range(n)]} for k in range(N)]
        path.write_text("\n".join(json.dumps(row) for row in rows) + "\n")
    elif kind == "csv numbers":
        write(path, ["time", "id", "position", "effort"], [[T[k], str(j + 1), Q[k, j], TAU[k, j]] for k in range(N) for j in ORDER])
    elif kind == "csv blocks":
        write(path, ["time", "joint", "position", "effort"], [[T[k], JOINTS[j], Q[k, j], TAU[k, j]] for j in ORDER for k in range(N)])
    else:
        write(path, ["time", "joint_name", "position", "effort"], [[T[k], JOINTS[j], Q[k, j], TAU[k, j]] for k in range(N) for j in ORDER])
    return path


@pytest.mark.parametrize(
    "kind", ["npz", "h5", "mat", "parquet lists", "parquet structs", "jsonl", "csv names", "csv blocks", "csv numbers"]
)
def test_names_beside_the_numbers_put_the_joints_in_order(tmp_path: Path, kind: str) -> None:
    is_the_motion(ident.read_logs(_named(tmp_path, kind), robot())[0])


def test_names_that_are_not_the_robots_are_said(tmp_path: Path) -> None:
    names = ["Time [s]", *(f"{x} Position [rad]" for x in "SLU"), *(f"{x} Torque [Nm]" for x in "SLU")]
    log = ident.read_logs(write(tmp_path / "a.csv", names, np.column_stack([T, Q_TAU])), robot())[0]
    is_the_motion(log)
    assert any("joints S, L, U; the robot's" in note for note in log.notes)


def test_units_that_data_sets_tell(tmp_path: Path) -> None:
    with pytest.importorskip("h5py").File(tmp_path / "a.h5", "w") as file:
        for name, values, unit in (("time", 1e3 * T, "ms"), ("joint_position", np.rad2deg(Q), "deg"), ("joint_torque", 1e3 * TAU, "mNm")):
            file[name] = values
            file[name].attrs["units"] = unit
    is_the_motion(ident.read_logs(tmp_path / "a.h5")[0])


def test_tables_in_hdf5(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    table = np.zeros(N, dtype=[("t", "f8"), ("q", "f8", n), ("dq", "f8", n), ("tau", "f8", n)])
    table["t"], table["q"], table["dq"], table["tau"] = T, Q, DQ, TAU
    names = ["t", *each("q{}"), *each("tau{}")]
    with h5py.File(tmp_path / "a.h5", "w") as file, h5py.File(tmp_path / "b.h5", "w") as frame:
        file["log"] = table
        frame["df/block0_items"], frame["df/block0_values"] = np.array(names, "S"), np.column_stack([T, Q_TAU])
    np.save(tmp_path / "c.npy", table)
    for name in ("a.h5", "b.h5", "c.npy"):
        is_the_motion(ident.read_logs(tmp_path / name)[0])


def test_dspace_and_simulink(tmp_path: Path) -> None:
    from scipy.io import savemat

    channels = [
        (f"Model Root/Arm/{word}{j + 1}", x[:, j], unit)
        for word, x, unit in (("q", np.rad2deg(Q), "deg"), ("tau", TAU, "Nm"))
        for j in range(n)
    ]
    y = np.zeros((1, 2 * n), dtype=[("Name", "O"), ("Unit", "O"), ("Data", "O")])
    for k, (name, values, unit) in enumerate(channels):
        y[0, k] = (name, unit, values[None])
    savemat(tmp_path / "a.mat", {"exp": {"X": {"Name": "time", "Data": T[None]}, "Y": y}})
    savemat(
        tmp_path / "b.mat", {"q": {"Time": T[:, None], "Data": Q.T[:, None, :]}, "tau": {"Time": T[:, None], "Data": TAU.T[:, None, :]}}
    )
    for name in ("a.mat", "b.mat"):
        is_the_motion(ident.read_logs(tmp_path / name)[0])
    savemat(tmp_path / "c.mat", {"t": T[:, None], "q": Q, "t_tau": T[::2, None], "tau": TAU[::2]})
    log = ident.read_logs(tmp_path / "c.mat")[0]
    is_the_motion(log, None)
    assert any("t_tau, tau have a different number of samples" in note for note in log.notes)


def test_objects_of_matlab_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with pytest.importorskip("h5py").File(path, "w", userblock_size=512) as file:
        item = file.create_dataset("q", data=np.array([[0xDD000000, 2, 1, 1, 1, 1]], np.uint32))
        item.attrs["MATLAB_class"], item.attrs["MATLAB_object_decode"] = np.bytes_("timeseries"), np.int32(3)
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(116) + bytes(8) + b"\x00\x02IM")
    with pytest.raises(ident.DataError, match="only MATLAB can read: save their Time and Data"):
        ident.read_logs(path)


def test_a_computed_torque_stands_behind_currents(tmp_path: Path) -> None:
    names = ["time", *each("actual_position_{}"), *each("motor_current_{} [A]"), *each("estimated_torque_{} [Nm]")]
    log = ident.read_logs(write(tmp_path / "a.csv", names, np.column_stack([T, Q, TAU, 9 * TAU])))[0]
    is_the_motion(log, "current")
    names = ["time", *each("actual_position_{}"), *each("estimated_torque_{} [Nm]")]
    log = ident.read_logs(write(tmp_path / "b.csv", names, np.column_stack([T, Q, TAU])))[0]
    is_the_motion(log)
    assert any("are computed" in note for note in log.notes)


def test_torques_of_motors_that_turn_faster_are_the_motors(tmp_path: Path) -> None:
    names = ["time [s]", *each("joint position {} [deg]"), *each("motor speed {} [rpm]"), *each("motor torque {} [Nm]")]
    for gear in (100.0, 1.0):
        table = np.column_stack([T, np.rad2deg(Q), gear * DQ * 30 / np.pi, TAU])
        log = ident.read_logs(write(tmp_path / "a.csv", names, table))[0]
        is_the_motion(log, "motor" if gear > 1 else "joint")
        said = "motor-side torques" if gear > 1 else "taken as joint torques"
        assert any(said in note for note in log.notes)
    is_the_motion(ident.read_logs(write(tmp_path / "b.csv", names, np.column_stack([T, np.rad2deg(Q), 900 * DQ, TAU])), torque="link")[0])


def test_another_arm_in_the_file_is_said(tmp_path: Path) -> None:
    names = ["time", *each("left_j{}_pos"), *each("right_j{}_pos"), *each("left_j{}_tau"), *each("right_j{}_tau")]
    log = ident.read_logs(write(tmp_path / "a.csv", names, np.column_stack([T, Q, -Q[:, ::-1], TAU, -TAU])))[0]
    is_the_motion(log)
    assert any("'right_j1_pos' … 'right_j3_pos' also hold positions" in note for note in log.notes)


def test_a_velocity_without_noise_in_another_unit_is_audited() -> None:
    """Rounding made what is left of it negative, and the audit ended in a traceback."""
    arm, t = robot(), np.arange(2500) / RATE
    c = np.stack([np.sin(t), np.sin(1.3 * t), np.sin(0.7 * t)], axis=1)
    rates = np.stack([np.cos(t), 1.3 * np.cos(1.3 * t), 0.7 * np.cos(0.7 * t)], axis=1)
    for scale in (np.pi / 180, 101.0, 0.5):
        log = ident.Log("run", t, q=c, dq=scale * rates, tau={"joint": c + 0.1 * rates})
        assert "times the rate of change of the position" in str(ident.audit(ident.LogSet((log,), arm), arm))


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def _record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


@pytest.mark.parametrize("kind", ["ros", "foxglove", "free"])
def test_mcap_in_json(tmp_path: Path, kind: str) -> None:
    body = _record(3, struct.pack("<H", 1) + _text("a.Schema") + _text("jsonschema") + _text("{}"))
    body += _record(4, struct.pack("<HH", 1, 1) + _text("/joints") + _text("json") + _text(""))
    names = [JOINTS[k] for k in ORDER]
    for k in range(N):
        ns = EPOCH * 10**9 + round(1e9 * T[k])
        q, tau, stamp = Q[k, list(ORDER)], TAU[k, list(ORDER)], {"sec": ns // 10**9, "nsec": ns % 10**9}
        message = {
            "ros": {"header": {"stamp": stamp}, "name": names, "position": q.tolist(), "velocity": [], "effort": tau.tolist()},
            "foxglove": {
                "timestamp": stamp,
                "joints": [{"name": x, "position": a, "effort": b} for x, a, b in zip(names, q, tau, strict=True)],
            },
            "free": {"q": Q[k].tolist(), "tau": TAU[k].tolist()},
        }[kind]
        late = 10**7 * (k % 3) if kind != "free" else 0
        body += _record(5, struct.pack("<HIQQ", 1, k, ns + late, ns + late) + json.dumps(message).encode())
    magic = b"\x89MCAP0\r\n"
    (tmp_path / "log.mcap").write_bytes(
        magic + _record(1, _text("") + _text("")) + body + _record(15, bytes(4)) + _record(2, bytes(20)) + magic
    )
    pytest.importorskip("rosbags")
    is_the_motion(ident.read_logs(tmp_path / "log.mcap", robot())[0])


def test_two_senders_of_the_same_joints(tmp_path: Path) -> None:
    """A driver, and a publisher of zeros for a model that is shown: the driver's count."""
    pytest.importorskip("rosbags")
    from rosbags import rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header, stamp = (store.types[x] for x in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    with rosbag2.Writer(tmp_path / "bag", version=9) as writer:
        topic = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        for k in range(N):
            for late, numbers in ((0, (Q[k], DQ[k], TAU[k])), (1_500_000, (np.zeros(n), np.zeros(0), np.zeros(0))))[: 1 + (k % 5 == 0)]:
                ns = EPOCH * 10**9 + round(1e9 * T[k]) + late
                message = state(header(stamp(ns // 10**9, ns % 10**9), ""), list(JOINTS), *numbers)
                writer.write(topic, ns, store.serialize_cdr(message, state.__msgtype__))
    log = ident.read_logs(tmp_path / "bag", robot())[0]
    is_the_motion(log)
    assert any("60 messages on the same topic name the same joints without effort, velocity" in note for note in log.notes)


KINDS = {
    "d.ulg": (b"ULog\x01\x12\x35\x01" + bytes(range(200, 255)), "a PX4 ULog file.*ulog2csv"),
    "d.tdms": (b"TDSm\x0e\x00\x00\x00" + bytes(range(200, 255)), "TDMS"),
    "d.pkl": (b"\x80\x04\x95" + bytes(range(200, 255)), "a Python pickle.*it may run code"),
    "d.xlsx": (b"PK\x03\x04" + bytes(60) + b"xl/workbook.xml", "an Excel workbook.*save the sheet as CSV"),
    "d.zip": (b"PK\x03\x04" + bytes(60) + b"log.csv", "a ZIP archive.*decompress it"),
    "d.tfrecord": (bytes(range(200)), "TFRecord"),
}


@pytest.mark.parametrize("name", KINDS)
def test_other_kinds_of_file_are_told_by_what_they_are(tmp_path: Path, name: str) -> None:
    content, said = KINDS[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ident.DataError, match=said):
        ident.read_logs(tmp_path / name)


def test_a_stream_of_arrow_that_is_cut_off(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    table = pa.table({"time": T} | {f"q{j + 1}": Q[:, j] for j in range(n)} | {f"tau{j + 1}": TAU[:, j] for j in range(n)})
    path = tmp_path / "log.ipc"
    with pa.OSFile(str(path), "wb") as file, pa.ipc.new_stream(file, table.schema) as writer:
        writer.write_table(table, max_chunksize=50)
    path.write_bytes(path.read_bytes()[:-1000])
    log = ident.read_logs(path)[0]
    is_the_motion(log)
    assert len(log) == N - 50
    assert any("is truncated" in note for note in log.notes)


_MIXED = {
    "joints' names": ("turn pos [°]", "lift pos [mm]", "tilt pos [°]", "turn torque [Nm]", "lift force [N]", "tilt torque [Nm]"),
    "numbers": ("J1 pos [deg]", "J2 pos [mm]", "J3 pos [deg]", "J1 torque [Nm]", "J2 force [N]", "J3 torque [Nm]"),
    "a row of units": ("turn pos", "lift pos", "tilt pos", "turn torque", "lift torque", "tilt torque"),
}
_PICKER = """<robot name="picker"><link name="base"/><link name="a"/><link name="b"/><link name="c"/>
<joint name="turn" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
<joint name="lift" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1" velocity="1" effort="9"/></joint>
<joint name="tilt" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" velocity="9" effort="9"/></joint></robot>"""


@pytest.mark.parametrize("told", list(_MIXED))
@pytest.mark.parametrize("with_robot", [True, False], ids=["robot", "no robot"])
def test_joints_may_have_units_of_their_own(tmp_path: Path, told: str, with_robot: bool) -> None:
    """Ways in millimetres beside angles in degrees: of a row of units the first was once taken for all, in silence."""
    t = np.arange(200) / 100.0
    q = np.stack([1.2 * np.sin(2 * t), 0.3 + 0.2 * np.cos(3 * t), 0.8 * np.cos(t)], axis=1)
    tau = np.stack([np.sin(t), 40.0 + np.cos(t), np.cos(2 * t)], axis=1)
    table = np.concatenate([t[:, None], np.degrees(q[:, [0]]), 1e3 * q[:, [1]], np.degrees(q[:, [2]]), tau], axis=1)
    units = "s,deg,mm,deg,Nm,N,Nm\n" if told == "a row of units" else ""
    rows = "".join(",".join(f"{x:.9g}" for x in row) + "\n" for row in table)
    (tmp_path / "a.csv").write_text("time," + ",".join(_MIXED[told]) + "\n" + units + rows, encoding="utf-8")
    (log,) = ident.read_logs(tmp_path / "a.csv", ident.Robot.from_urdf(_PICKER) if with_robot else None)
    assert np.allclose(log.q, q, atol=1e-6)
    assert np.allclose(log.tau["joint"], tau, atol=1e-6)


def test_positions_in_two_units_of_all_joints_are_not_put_together(tmp_path: Path) -> None:
    t = np.arange(200) / 100.0
    q = np.stack([np.sin(2 * t), 0.8 * np.cos(t)], axis=1)
    header = "time,J1 pos [deg],J2 pos [deg],J1 pos [rad],J2 pos [rad],J1 torque [Nm],J2 torque [Nm]"
    np.savetxt(tmp_path / "a.csv", np.column_stack([t, np.degrees(q), q, q]), delimiter=",", header=header, comments="")
    (log,) = ident.read_logs(tmp_path / "a.csv")
    assert np.allclose(log.q, q, atol=1e-6)


def test_logs_in_a_list_are_fitted_like_a_set_of_them() -> None:
    train, test = ident.demo_logs()
    logs = [train[0], test[0]]
    assert np.array_equal(ident.fit(logs, "puma560", held=0).values, ident.fit(ident.LogSet(tuple(logs)), "puma560", held=0).values)


def test_a_header_that_stands_again_has_no_date(tmp_path: Path) -> None:
    names = ["stamp", *each("q{}"), *each("tau{}")]
    start = datetime.fromtimestamp(EPOCH, UTC)
    rows = [[(start + timedelta(seconds=t)).isoformat(), *q, *tau] for t, q, tau in zip(T, Q, TAU, strict=True)]
    plain, again = (write(tmp_path / f"{k}.csv", names, [*rows[:100], *more, *rows[100:]]) for k, more in enumerate(([], [names])))
    one, two = (ident.read_logs(path)[0] for path in (plain, again))
    np.testing.assert_array_equal(one.t, two.t)
    np.testing.assert_array_equal(one.q, two.q)


def test_a_mark_at_the_end_of_each_line_is_no_column(tmp_path: Path) -> None:
    names = ["time [us]", *each("pos j{} (deg)"), *each("eff j{} (Nm)"), ""]
    rows = [[1e6 * t, *np.rad2deg(q), *tau, ""] for t, q, tau in zip(T, Q, TAU, strict=True)]
    log = ident.read_logs(write(tmp_path / "a.csv", names, rows, ";"))[0]
    is_the_motion(log)
    assert log.recording is not None
    assert log.recording.ignored == ()
