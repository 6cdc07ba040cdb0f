"""Layouts of the families of recorders that are known, as other versions of them, or other programs, write them."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident

Array = np.ndarray
N, n = 600, 6


def motion() -> tuple[Array, Array, Array, Array]:
    t, w = 0.002 * np.arange(N), 1.0 + 0.5 * np.arange(n)
    phase = np.outer(3 * t, w) + np.arange(n)
    noise = 0.01 * np.random.default_rng(0).normal(size=(N, n))
    return t, 0.8 * np.sin(phase), 2.4 * w * np.cos(phase), 5.0 * np.cos(np.outer(4 * t, w)) + np.arange(n) + noise


def is_the_motion(log: ident.Log, side: str = "joint") -> None:
    t, q, dq, tau = motion()
    np.testing.assert_allclose(log.t - log.t[0], t, atol=1e-9)
    assert log.q is not None
    np.testing.assert_allclose(log.q[:, :n], q, atol=1e-7)
    if log.dq is not None:
        np.testing.assert_allclose(log.dq[:, :n], dq, atol=1e-7)
    np.testing.assert_allclose(log.tau[side][:, :n], tau, atol=1e-7)


def test_episodes_of_lerobot_3_share_a_file(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    (tmp_path / "data/chunk-000").mkdir(parents=True)
    (tmp_path / "meta/episodes/chunk-000").mkdir(parents=True)
    motors = [f"{name}.pos" for name in ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")]
    state = np.rad2deg(motion()[1]).astype(np.float32)

    def lists(x: Array) -> Any:
        return pa.FixedSizeListArray.from_arrays(pa.array(x.ravel()), n)

    episode = np.arange(N) // 200
    columns = {
        "observation.state": lists(state),
        "action": lists(state + np.float32(1.0)),
        "timestamp": (np.arange(N) % 200 / 30).astype(np.float32),
        "frame_index": np.arange(N) % 200,
        "episode_index": episode,
        "index": np.arange(N),
    }
    parquet.write_table(pa.table(columns), tmp_path / "data/chunk-000/file-000.parquet")
    parquet.write_table(pa.table({"episode_index": [0, 1, 2], "length": [200] * 3}), tmp_path / "meta/episodes/chunk-000/file-000.parquet")
    feature = {"dtype": "float32", "shape": [n], "names": motors}
    info = {"codebase_version": "v3.0", "fps": 30, "features": {"observation.state": feature, "action": feature}}
    (tmp_path / "meta/info.json").write_text(json.dumps(info))
    logs = ident.read_logs(tmp_path)
    assert [len(log) for log in logs] == [200, 200, 200]
    assert logs[1].joint_names == ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    assert logs[1].q is not None
    np.testing.assert_allclose(logs[1].q, np.deg2rad(state[200:400, :5]), rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(logs[1].extra["q_ref2"], np.deg2rad(state[200:400, 1] + 1.0), rtol=1e-5, atol=1e-6)


def test_robomimic_takes_the_observations_not_the_next_ones(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    _, q, dq, _ = motion()
    with h5py.File(tmp_path / "low_dim.hdf5", "w") as file:
        for k in range(2):
            demo = file.create_group(f"data/demo_{k}")
            demo["actions"], demo["states"] = np.ones((N - 1, 7)), np.ones((N - 1, 45))
            for name, rows in (("obs", slice(0, N - 1)), ("next_obs", slice(1, N))):
                demo[f"{name}/robot0_joint_pos"], demo[f"{name}/robot0_joint_vel"] = q[rows], dq[rows]
                demo[f"{name}/robot0_joint_pos_cos"], demo[f"{name}/robot0_eef_pos"] = np.cos(q[rows]), q[rows, :3]
    with pytest.raises(ident.DataError, match="rate_hz = 20"):
        ident.read_logs(tmp_path / "low_dim.hdf5")
    one, other = ident.read_logs(tmp_path / "low_dim.hdf5", rate_hz=20.0)
    for log in (one, other):
        assert log.q is not None
        np.testing.assert_array_equal(log.q, q[: N - 1])


@pytest.mark.parametrize(("mark", "comma"), [("\t", "."), (";", ",")])
def test_twincat_scope(tmp_path: Path, mark: str, comma: str) -> None:
    """A pair of columns for each channel, behind what is told of the channels; torques sampled half as often come later in the file."""
    t, q, _, tau = motion()
    channels = [(f"Axis {j + 1} ActPos", np.rad2deg(q[:, j])) for j in range(n)] + [
        (f"Axis {j + 1} ActTorque", tau[:, j]) for j in range(n)
    ]
    head = {"Data-Type": "LREAL", "SampleTime[ms]": "2", "VariableSize": "8", "SymbolBased": "True"}
    lines = ["Name" + mark + "Scope Project", "File" + mark + "C:\\scope.tcscopex", "Starttime" + mark + "132000000000000000", ""]
    lines += [mark.join(x for name, _ in channels for x in ("Name", name))]
    lines += [mark.join(x for _ in channels for x in pair) for pair in head.items()]
    lines += ["", *(mark.join(x for _, v in channels for x in (f"{1e3 * t[k]:g}", f"{v[k]:.12g}".replace(".", comma))) for k in range(N))]
    (tmp_path / "scope.csv").write_text("\n".join(lines) + "\n")
    is_the_motion(ident.read_logs(tmp_path / "scope.csv")[0])


@pytest.mark.parametrize("mark", ["\t", ";", ","])
@pytest.mark.parametrize("units", [False, True])
def test_a_header_behind_lines_that_tell_of_the_recording(tmp_path: Path, mark: str, units: bool) -> None:
    t, q, _, tau = motion()
    told = [("Name", "trace 1"), ("Start", "01.02.2024 10:00:00"), ("Samples", "600")]
    names = ["Time" if units else "Time [ms]", *(f"Axis {j + 1} ActPos" for j in range(n)), *(f"Axis {j + 1} ActTorque" for j in range(n))]
    lines = [*(mark.join(pair) for pair in told), "", mark.join(names)]
    lines += [mark.join(["ms", *["°"] * n, *["Nm"] * n])] if units else []
    lines += [mark.join(f"{x:.12g}" for x in (1e3 * t[k], *np.rad2deg(q[k]), *tau[k])) for k in range(N)]
    (tmp_path / "trace.csv").write_text("\n".join(lines) + "\n")
    is_the_motion(ident.read_logs(tmp_path / "trace.csv")[0])


@pytest.mark.parametrize("german", [True, False])
def test_traces_of_kuka(tmp_path: Path, german: bool) -> None:
    t, q, _, tau = motion()
    mark, comma = (";", ",") if german else (",", ".")
    patterns = (
        ("Istposition Achse {}", "Sollposition Achse {}", "Istmoment Achse {}")
        if german
        else ("AxisAct_A{} [deg]", "AxisCmd_A{} [deg]", "Torque_A{} [Nm]")
    )
    names = ["Zeit" if german else "Time", *(p.format(j + 1) for p in patterns for j in range(n))]
    lines = [mark.join(names), *([mark.join(["[s]", *["[Grad]"] * 2 * n, *["[Nm]"] * n])] if german else [])]
    table = np.column_stack([t, np.rad2deg(q), np.rad2deg(q + 0.01), tau])
    lines += [mark.join(f"{x:.12g}".replace(".", comma) for x in row) for row in table]
    (tmp_path / "trace.csv").write_bytes(("\n".join(lines) + "\n").encode("cp1252"))
    log = ident.read_logs(tmp_path / "trace.csv")[0]
    is_the_motion(log)
    np.testing.assert_allclose(log.extra["q_ref3"], q[:, 2] + 0.01, atol=1e-7)


def test_older_libfranka_writes_no_time_and_no_brackets(tmp_path: Path) -> None:
    _, q, dq, tau = motion()
    seventh = np.sin(np.arange(N) / 50)[:, None]
    names = [f"state.{word}{j}" for word in ("q", "q_d", "dq", "tau_J") for j in range(7)] + [f"cmd.tau_J_d{j}" for j in range(7)]
    table = np.column_stack([x for v in (q, q + 0.01, dq, tau, 0.5 * tau) for x in (v, seventh)])
    lines = [", ".join(names), *(", ".join(f"{x:.12g}" for x in row) for row in table)]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    with pytest.raises(ident.DataError, match=r"libfranka recording.*rate_hz = 1000"):
        ident.read_logs(tmp_path / "log.csv")
    log = ident.read_logs(tmp_path / "log.csv", rate_hz=500.0)[0]
    is_the_motion(log)
    assert log.n == 7


def test_the_hand_that_no_log_holds_is_named_to_be_locked(tmp_path: Path) -> None:
    from ident.cli import main

    t, q, _, tau = motion()
    names = ["time", *(f"state.q[{j}]" for j in range(n + 1)), *(f"state.tau_J[{j}]" for j in range(n + 1)), "tau_ext_hat_filtered[0]"]
    table = np.column_stack([t, q, -1.0 + 0.1 * np.sin(3 * t), tau, np.cos(t), 0 * t])
    path = tmp_path / "log.csv"
    path.write_text("\n".join([",".join(names), *(",".join(f"{x:.9g}" for x in row) for row in table)]))
    with pytest.raises(ident.DataError, match="--lock panda_finger_joint1"):
        ident.read_logs(path, ident.load_robot("panda"))
    study = tmp_path / "study.toml"
    flags = ["--robot", "panda", "--lock", "panda_finger_joint1", "--log", str(path), "--write-study", str(study)]
    assert main(["check", *flags]) == 0
    assert "panda_finger_joint1 = 0.0" in study.read_text()
    with pytest.raises(SystemExit):
        main(["check", *flags[:2], "--lock", "panda_finger_joint1=far", "--log", str(path)])


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text.encode())) + text.encode()


def _record(kind: int, body: bytes) -> bytes:
    return struct.pack("<BQ", kind, len(body)) + body


def _mcap(path: Path, packed: str) -> Path:
    """MCAP as its specification has it: no profile, no summary, no metadata; two topics, messages in chunks or alone."""
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    joint_state, header, stamp = (
        store.types[x] for x in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    t, q, dq, tau = motion()
    body = _record(3, struct.pack("<H", 1) + _text(joint_state.__msgtype__) + _text("ros2msg") + _text(""))
    for number, topic in ((7, "/joint_states"), (9, "/gripper/joint_states")):
        body += _record(4, struct.pack("<HH", number, 1) + _text(topic) + _text("cdr") + _text(""))
    for k in range(N):
        ns = 10**12 + round(1e9 * t[k])
        told = header(stamp(ns // 10**9, ns % 10**9), "")
        message = joint_state(told, [f"joint_{j}" for j in range(n)], q[k], dq[k], tau[k])
        raw = bytes(store.serialize_cdr(message, joint_state.__msgtype__))
        body += _record(5, struct.pack("<HIQQ", 7, k, ns, ns) + raw)
        if k % 50 == 0:
            other = joint_state(told, ["finger"], np.ones(1), np.ones(1), np.zeros(0))
            body += _record(5, struct.pack("<HIQQ", 9, k, ns, ns) + bytes(store.serialize_cdr(other, joint_state.__msgtype__)))
    if packed:
        import pyarrow as pa

        content = b""
        if packed == "lz4":
            import lz4.frame

            content = lz4.frame.compress(body)
        elif packed == "zstd":
            content = pa.Codec("zstd").compress(body, asbytes=True)
        body = _record(6, struct.pack("<QQQI", 0, 2**62, len(body), 0) + _text(packed) + struct.pack("<Q", len(content)) + content)
    end = _record(15, struct.pack("<I", 0)) + _record(2, struct.pack("<QQI", 0, 0, 0))
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + _record(1, _text("") + _text("a recorder")) + body + end + magic)
    return path


@pytest.mark.parametrize("packed", ["", "lz4", "zstd"])
def test_mcap_without_metadata(tmp_path: Path, packed: str) -> None:
    pytest.importorskip("pyarrow")
    log = ident.read_logs(_mcap(tmp_path / "log.mcap", packed))[0]
    is_the_motion(log)
    assert any("/gripper/joint_states" in note for note in log.notes)


def test_mcap_that_is_cut_off_or_damaged(tmp_path: Path) -> None:
    content = _mcap(tmp_path / "log.mcap", "").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(content[: len(content) // 2])
    cut = ident.read_logs(tmp_path / "cut.mcap")[0]
    assert 0.45 * N < len(cut) < 0.55 * N
    np.testing.assert_array_equal(cut.q, ident.read_logs(tmp_path / "log.mcap")[0].q[: len(cut)])
    assert any("truncated in the middle of a record" in note for note in cut.notes)
    (tmp_path / "cut.mcap").write_bytes(content[:300])
    with pytest.raises(ident.DataError, match="holds no message of type JointState"):
        ident.read_logs(tmp_path / "cut.mcap")
    at = content.index(b"joint_3") - 4
    (tmp_path / "odd.mcap").write_bytes(content[:at] + b"\xff\xff\xff\x0f" + content[at + 4 :])
    with pytest.raises(ident.DataError, match="JointState"):
        ident.read_logs(tmp_path / "odd.mcap")


@pytest.mark.parametrize("library", [True, False])
def test_legs_in_unitrees_order_are_put_into_the_robots(tmp_path: Path, library: bool) -> None:
    """The SDK counts FR, FL, RR, RL; the URDF of the Go1 begins with FL. Names tell; where they do not, it is said."""
    t = np.arange(N) / 50.0
    sdk = [f"{leg}_{part}" for leg in ("FR", "FL", "RR", "RL") for part in ("hip", "thigh", "calf")]
    legs = ("FL", "FR", "RL", "RR") if library else ("left_front", "right_front", "left_rear", "right_rear")
    own = [f"{leg}_{part}_joint" for leg in legs for part in ("hip", "thigh", "calf")]
    q = {name: 0.3 * np.sin((1.0 + 0.2 * k) * t + k) for k, name in enumerate(sdk)}
    names = ["time", *(f"{word}_{k}" for word in ("q", "dq", "tau") for k in range(12)), "foot_force_0", "imu_roll"]
    columns = [t, *(q[x] for x in sdk), *(np.gradient(q[x], t) for x in sdk), *(3.0 * q[x] + 0.1 for x in sdk), 0 * t, 0 * t]
    rows = [",".join(names), *(",".join(f"{x:.10g}" for x in row) for row in np.stack(columns, axis=1))]
    (tmp_path / "lowstate.csv").write_text("\n".join(rows) + "\n")
    robot = ident.Robot.from_urdf(_legs(own))
    log = ident.read_logs(tmp_path / "lowstate.csv", robot)[0]
    assert log.q is not None
    if library:
        for j, name in enumerate(own):
            np.testing.assert_allclose(log.q[:, j], q[name.removesuffix("_joint")], atol=1e-9)
            np.testing.assert_allclose(log.tau["joint"][:, j], 3.0 * q[name.removesuffix("_joint")] + 0.1, atol=1e-9)
        assert any("put into the robot's order by name" in note for note in log.notes)
    else:
        assert any("Unitree's legs come as FR, FL, RR, RL" in note for note in log.notes)


def _legs(joints: list[str]) -> str:
    parts = ['<robot name="legs"><link name="trunk"/>']
    for k, joint in enumerate(joints):
        parent = "trunk" if k % 3 == 0 else f"l{k - 1}"
        inertial = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
        parts.append(f'<link name="l{k}">{inertial}</link><joint name="{joint}" type="revolute"><parent link="{parent}"/>')
        parts.append(f'<child link="l{k}"/><axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="50" velocity="9"/></joint>')
    return "".join(parts) + "</robot>"
