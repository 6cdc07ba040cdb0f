"""Messages beyond ROS's own files: documents of YAML as ROS prints them, Protocol Buffers in MCAP; desired motion of bags in streaming."""

from __future__ import annotations

import struct
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident
from ident.streaming import StreamedSession
from ident.study.session import Session
from ident.study.study import Study

Array = np.ndarray
N, n, RATE = 240, 3, 200.0
JOINTS, ORDER = ("shoulder", "elbow", "wrist"), (2, 0, 1)
SECONDS = 1_714_557_600
T = np.arange(N) / RATE
_W = 2.0 + 1.3 * np.arange(n)
Q = 0.7 * np.sin(np.outer(T, _W) + np.arange(n))
DQ = 0.7 * _W * np.cos(np.outer(T, _W) + np.arange(n))
TAU = 20.0 * np.cos(np.outer(T, 1.7 * _W)) + 9.0 + 0.1 * np.random.default_rng(0).normal(size=(N, n))


def urdf() -> str:
    parts = ['<robot name="arm"><link name="base"/>']
    for k, joint in enumerate(JOINTS):
        parent = "base" if k == 0 else f"l{k - 1}"
        body = '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
        parts.append(f'<link name="l{k}">{body}</link><joint name="{joint}" type="revolute"><parent link="{parent}"/>')
        parts.append(f'<child link="l{k}"/><axis xyz="0 1 0"/><limit lower="-6" upper="6" effort="50" velocity="9"/></joint>')
    return "".join(parts) + "</robot>"


def robot() -> ident.Robot:
    return ident.Robot.from_urdf(urdf())


def is_the_motion(log: ident.Log, rows: int = N) -> None:
    np.testing.assert_allclose(log.t - log.t[0], T[:rows], atol=1e-6)
    np.testing.assert_allclose(log.q, Q[:rows], atol=1e-9)
    np.testing.assert_allclose(log.dq, DQ[:rows], atol=1e-9)
    np.testing.assert_allclose(log.tau["joint"], TAU[:rows], atol=1e-5)


def _blocks(k: int) -> str:
    """A message as `ros2 topic echo` prints it."""
    text = f"header:\n  stamp:\n    sec: {SECONDS + int(T[k])}\n    nanosec: {round(1e9 * (T[k] % 1))}\n  frame_id: ''\nname:\n"
    text += "".join(f"- {JOINTS[j]}\n" for j in ORDER)
    return text + "".join(
        f"{word}:\n" + "".join(f"- {float(x[k, j])!r}\n" for j in ORDER) for word, x in (("position", Q), ("velocity", DQ), ("effort", TAU))
    )


def _flow(k: int) -> str:
    """As `rostopic echo` does, here with a long list that goes on in the next line."""

    def numbers(x: Array) -> str:
        a, b, c = (repr(float(x[k, j])) for j in ORDER)
        return f"[{a}, {b},\n  {c}]"

    text = f"header: \n  seq: {k}\n  stamp: \n    secs: {SECONDS + int(T[k])}\n    nsecs: {round(1e9 * (T[k] % 1)):9d}\n  frame_id: ''\n"
    names = ", ".join(JOINTS[j] for j in ORDER)
    return f"{text}name: [{names}]\nposition: {numbers(Q)}\nvelocity: {numbers(DQ)}\neffort: {numbers(TAU)}\n"


@pytest.mark.parametrize("write", [_blocks, _flow])
@pytest.mark.parametrize("name", ["echo.yaml", "echo.txt"])
def test_what_ros_prints(tmp_path: Path, write: Any, name: str) -> None:
    (tmp_path / name).write_text("---\n".join(write(k) for k in range(N)) + "---\n")
    (log,) = ident.read_logs(tmp_path / name, robot())
    is_the_motion(log)


def test_lost_and_unfinished_messages(tmp_path: Path) -> None:
    lost = "A message was lost!!!\n\ttotal count change:1\n\ttotal count: 1---\n"
    whole = "---\n".join(_blocks(k) for k in range(N)) + "---\n"
    text = whole[: whole.index("---\n") + 4] + lost + "---\n" + whole[whole.index("---\n") + 4 :]
    (tmp_path / "a.txt").write_text(text[:-150])
    (log,) = ident.read_logs(tmp_path / "a.txt", robot())
    is_the_motion(log, N - 1)
    assert any("the last message is truncated" in note for note in log.notes)


def test_yaml_agrees_with_a_library(tmp_path: Path) -> None:
    """Values nested in lists of fields, as a library writes them."""
    ruamel = pytest.importorskip("ruamel.yaml")

    def joint(k: int, j: int) -> dict[str, Any]:
        return {"name": JOINTS[j], "position": float(Q[k, j]), "velocity": float(DQ[k, j]), "torque": float(TAU[k, j])}

    messages = [{"time": float(T[k]), "joints": [joint(k, j) for j in ORDER]} for k in range(N)]
    writer = ruamel.YAML()
    with (tmp_path / "a.yaml").open("w") as file:
        writer.dump_all(messages, file)
    (log,) = ident.read_logs(tmp_path / "a.yaml", robot())
    is_the_motion(log)


def test_arrays_by_name_in_yaml(tmp_path: Path) -> None:
    rows = {name: "".join(f"- {[float(v) for v in row]}\n" for row in x) for name, x in (("q", Q), ("dq", DQ), ("tau", TAU))}
    (tmp_path / "a.yaml").write_text("dt: 0.005\n" + "".join(f"{name}:\n{text}" for name, text in rows.items()))
    is_the_motion(ident.read_logs(tmp_path / "a.yaml")[0])


def _number(value: int) -> bytes:
    out = b""
    while value > 0x7F:
        out, value = out + bytes([value & 0x7F | 0x80]), value >> 7
    return out + bytes([value])


def _held(number: int, value: bytes | int | float | str) -> bytes:
    """A field on the wire."""
    if isinstance(value, int):
        return _number(number << 3) + _number(value)
    if isinstance(value, float):
        return _number(number << 3 | 1) + struct.pack("<d", value)
    raw = value.encode() if isinstance(value, str) else value
    return _number(number << 3 | 2) + _number(len(raw)) + raw


def _described(name: str, fields: list[tuple[str, int, int, str]], package: str) -> bytes:
    """A file's descriptor with one message; fields: name, label, kind, type."""
    own = b"".join(
        _held(2, _held(1, f) + _held(3, k + 1) + _held(4, label) + _held(5, kind) + (_held(6, of) if of else b""))
        for k, (f, label, kind, of) in enumerate(fields)
    )
    return _held(1, _held(1, f"{name}.proto") + _held(2, package) + _held(4, _held(1, name) + own))


_STAMP = _described("Timestamp", [("seconds", 1, 3, ""), ("nanos", 1, 5, "")], "google.protobuf")
SCHEMAS = {
    "by names": _STAMP
    + _described("Joint", [("name", 1, 9, ""), ("position", 1, 1, ""), ("velocity", 1, 1, ""), ("effort", 1, 1, "")], "rig")
    + _described("State", [("stamp", 1, 11, ".google.protobuf.Timestamp"), ("joints", 3, 11, ".rig.Joint")], "rig"),
    "arrays": _described("State", [("timestamp_ns", 1, 3, ""), ("q", 3, 1, ""), ("dq", 3, 1, ""), ("tau", 3, 2, "")], "rig"),
}


def _sent(kind: str, k: int) -> bytes:
    if kind == "arrays":
        packed = [struct.pack(f"<{n}{code}", *x[k]) for x, code in ((Q, "d"), (DQ, "d"), (TAU, "f"))]
        return _held(1, SECONDS * 10**9 + round(1e9 * T[k])) + b"".join(_held(f, raw) for f, raw in enumerate(packed, 2))
    # Zeros are not sent.
    stamp = _held(1, SECONDS + int(T[k])) + (_held(2, round(1e9 * (T[k] % 1))) if T[k] % 1 else b"")
    joints = [_held(1, JOINTS[j]) + b"".join(_held(f, float(x[k, j])) for f, x in ((2, Q), (3, DQ), (4, TAU)) if x[k, j]) for j in ORDER]
    return _held(1, stamp) + b"".join(_held(2, joint) for joint in joints)


def _text(text: str | bytes) -> bytes:
    raw = text.encode() if isinstance(text, str) else text
    return struct.pack("<I", len(raw)) + raw


def _record(kind: int, body: bytes) -> bytes:
    return bytes([kind]) + struct.pack("<Q", len(body)) + body


def _mcap(path: Path, kind: str, schema: bytes) -> Path:
    body = _record(1, _text("") + _text("")) + _record(3, struct.pack("<H", 1) + _text("rig.State") + _text("protobuf") + _text(schema))
    body += _record(4, struct.pack("<HH", 1, 1) + _text("/rig/state") + _text("protobuf") + struct.pack("<I", 0))
    for k in range(N):
        ns = SECONDS * 10**9 + round(1e9 * T[k]) + 10**6 * (k % 3)
        body += _record(5, struct.pack("<HIQQ", 1, k, ns, ns) + _sent(kind, k))
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + body + _record(15, bytes(4)) + _record(2, bytes(20)) + magic)
    return path


@pytest.mark.parametrize("kind", SCHEMAS)
def test_protocol_buffers_in_mcap(tmp_path: Path, kind: str) -> None:
    pytest.importorskip("rosbags")
    path = _mcap(tmp_path / "a.mcap", kind, SCHEMAS[kind])
    (log,) = ident.read_logs(path, robot() if kind == "by names" else None)
    is_the_motion(log)
    path.write_bytes(path.read_bytes()[:-300])
    (log,) = ident.read_logs(path, robot() if kind == "by names" else None)
    assert any("truncated in the middle of a record" in note for note in log.notes)


def test_damaged_protocol_buffers_are_told(tmp_path: Path) -> None:
    """Whatever stands on the wire, the reader ends with a message of ours."""
    pytest.importorskip("rosbags")
    rng = np.random.default_rng(0)
    for kind, schema in SCHEMAS.items():
        whole = _mcap(tmp_path / "a.mcap", kind, schema).read_bytes()
        first = whole.index(_sent(kind, 1))
        for _ in range(40):
            raw = bytearray(whole)
            raw[first + int(rng.integers(len(_sent(kind, 1))))] = int(rng.integers(256))
            (tmp_path / "b.mcap").write_bytes(raw)
            with suppress(ident.DataError):
                ident.read_logs(tmp_path / "b.mcap")
    raw = bytearray(whole)
    assert raw[first + 10] == 2 << 3 | 2
    raw[first + 10] = 2 << 3  # doubles, as a number of variable length
    (tmp_path / "b.mcap").write_bytes(raw)
    with pytest.raises(ident.DataError, match="a message cannot be decoded"):
        ident.read_logs(tmp_path / "b.mcap")


def test_protocol_buffers_as_their_own_library_writes_them(tmp_path: Path) -> None:
    descriptors = pytest.importorskip("google.protobuf.descriptor_pb2")
    pool = pytest.importorskip("google.protobuf.descriptor_pool").DescriptorPool()
    factory = pytest.importorskip("google.protobuf.message_factory")
    schema = descriptors.FileDescriptorSet.FromString(SCHEMAS["arrays"])
    for file in schema.file:
        pool.Add(file)
    made = factory.GetMessageClass(pool.FindMessageTypeByName("rig.State"))
    for k in range(0, N, 7):
        own = made(timestamp_ns=SECONDS * 10**9 + round(1e9 * T[k]), q=Q[k], dq=DQ[k], tau=TAU[k])
        assert made.FromString(_sent("arrays", k)) == own


def test_a_schema_that_is_none_is_told(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    with pytest.raises(ident.DataError, match=r"topic /rig/state: a message cannot be decoded"):
        ident.read_logs(_mcap(tmp_path / "a.mcap", "arrays", b"\x0a\xff\xff"))


STATE = "control_msgs/msg/JointTrajectoryControllerState"


def _bag(folder: Path, told: str) -> Path:
    """A ROS 2 bag of joint states, and of what was asked for, half as often and later: in a controller's state, or on a topic."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    point = "trajectory_msgs/JointTrajectoryPoint"
    store.register(get_types_from_msg(f"std_msgs/Header header\nstring[] joint_names\n{point} reference\n{point} feedback", STATE))
    types, empty = store.types, np.zeros(0)
    span = types["builtin_interfaces/msg/Duration"](sec=0, nanosec=0)
    made, state = types["trajectory_msgs/msg/JointTrajectoryPoint"], types["sensor_msgs/msg/JointState"]

    def header(t: float) -> Any:
        ns = round(1e9 * t)
        return types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](SECONDS + ns // 10**9, ns % 10**9), "")

    with rosbag2.Writer(folder / "bag", version=9, storage_plugin=rosbag2.StoragePlugin.SQLITE3) as writer:
        joints = writer.add_connection("/joint_states", state.__msgtype__, typestore=store)
        name, kind = ("/ctl/controller_state", STATE) if told == "controller" else ("/joint_commands", state.__msgtype__)
        asked = writer.add_connection(name, kind, typestore=store)
        for k in range(N):
            ns = SECONDS * 10**9 + round(1e9 * T[k])
            own = state(header(T[k]), [JOINTS[j] for j in ORDER], *(x[k, list(ORDER)] for x in (Q, DQ, TAU)))
            writer.write(joints, ns, store.serialize_cdr(own, state.__msgtype__))
            if k % 2 == 0:
                wanted = made(Q[k] + 0.01, DQ[k], empty, empty, span)
                message: Any = types[STATE](header(T[k]), list(JOINTS), wanted, made(empty, empty, empty, empty, span))
                if told != "controller":
                    message = state(header(T[k]), list(JOINTS), Q[k] + 0.01, DQ[k], empty)
                writer.write(asked, ns + 2_000_000, store.serialize_cdr(message, kind))
    return folder / "bag"


@pytest.mark.parametrize("told", ["controller", "topic"])
def test_desired_motion_of_a_bag_in_streaming(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, told: str) -> None:
    monkeypatch.setattr("ident.logs.readers.bag.CHUNK", 40)
    monkeypatch.setattr("ident.logs.readers.bag._WAITING", 8)
    monkeypatch.setattr("ident.logs.readers.topics._GATHERED", 16)
    (tmp_path / "arm.urdf").write_text(urdf())
    study = Study.from_flags(urdf=tmp_path / "arm.urdf", logs=[_bag(tmp_path, told)])
    study = replace(study, signals=replace(study.signals, options={"cutoff_hz": 12.0}))
    (one,), (other,) = Session(study).recorded, StreamedSession.of(study, out=tmp_path / "out").stored
    again = other.read(0, len(other))
    is_the_motion(one)
    is_the_motion(again)
    for key in (f"{word}{j + 1}" for word in ("q_ref", "dq_ref") for j in range(n)):
        np.testing.assert_array_equal(one.extra[key], again.extra[key])
    known = np.isfinite(again.extra["q_ref2"])
    assert known.sum() > N - 4
    np.testing.assert_allclose(again.extra["q_ref2"][known], Q[known, 1] + 0.01, atol=1e-3)
