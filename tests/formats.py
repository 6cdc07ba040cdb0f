"""The same recording in every format that is read, written by the writers' own libraries."""

from __future__ import annotations

import gzip
import json
import lzma
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident

Array = np.ndarray
ROBOT, N = "puma560", 1200
#: Formats that are read in chunks, and those that are read whole.
CHUNKED = ("npz", "hdf5", "parquet", "parquet_lists", "arrow", "feather", "mcap", "ros2", "ros1")
WHOLE = ("semicolon", "tab", "spaces", "gz", "xz", "npz_packed", "mat", "mat73", "jsonl", "json", "xml", "long")
#: Formats whose channels do not tell that a torque is the motor's.
UNTOLD = ("mcap", "ros2", "ros1", "parquet_lists", "hdf5", "mat73", "long")


def motion() -> tuple[Array, Array, Array, Array]:
    """Times, positions, velocities and motor torques of the demo of the PUMA."""
    log = ident.demo_logs()[0][0]
    part = slice(0, N)
    assert log.q is not None
    return log.t[part], log.q[part], np.gradient(log.q[part], log.t[part], axis=0), log.tau["motor"][part]


def bag(path: Path, kind: str, names: tuple[str, ...], t: Array, q: Array, dq: Array, tau: Array) -> Path:
    pytest.importorskip("rosbags")
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if kind == "ros1" else Stores.ROS2_HUMBLE)
    joint_state, stamp = store.types["sensor_msgs/msg/JointState"], store.types["builtin_interfaces/msg/Time"]
    header = store.types["std_msgs/msg/Header"]
    plugin = rosbag2.StoragePlugin.MCAP if kind == "mcap" else rosbag2.StoragePlugin.SQLITE3
    path = path / "log.bag" if kind == "ros1" else path / "log"
    writer: Any = rosbag1.Writer(path) if kind == "ros1" else rosbag2.Writer(path, version=9, storage_plugin=plugin)
    with writer:
        topic = writer.add_connection("/joint_states", joint_state.__msgtype__, typestore=store)
        other = writer.add_connection("/other/joint_states", joint_state.__msgtype__, typestore=store)
        order = np.argsort(np.arange(len(t)) + 20.0 * np.random.default_rng(1).random(len(t)))
        for at, k in enumerate(order.tolist()):
            ns = 10**12 + round(1e9 * t[k])
            own = (
                (header(0, stamp(ns // 10**9, ns % 10**9), "base"),)
                if kind == "ros1"
                else (header(stamp(ns // 10**9, ns % 10**9), "base"),)
            )
            message = joint_state(*own, list(names), q[k], dq[k], tau[k])
            raw = (store.serialize_ros1 if kind == "ros1" else store.serialize_cdr)(message, joint_state.__msgtype__)
            writer.write(topic, 10**12 + 1000 * at, raw)
            if k % 7 == 0:
                writer.write(other, 10**12 + 1000 * at + 1, raw)
    return path


def written(folder: Path, kind: str) -> Path:
    """The recording in a format, in the folder."""
    t, q, dq, tau = motion()
    table: dict[str, Array] = {"t": t} | {
        f"{name}{j + 1}": x[:, j] for name, x in (("q", q), ("dq", dq), ("tau_m", tau)) for j in range(q.shape[1])
    }
    path = folder / f"log.{kind.split('_', maxsplit=1)[0]}"
    if kind in ("mcap", "ros2", "ros1"):
        return bag(folder, kind, ident.load_robot(ROBOT).joint_names, t, q, dq, tau)
    if kind in WHOLE:
        return _whole(folder, kind, table)
    if kind == "npz":
        tail = {name: np.concatenate([x, np.zeros(77)]) for name, x in table.items()}
        np.savez(path, **tail)
    elif kind == "hdf5":
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w") as file:
            file["rec/t"] = t
            file["rec/q"], file["rec/dq"], file["rec/tau_m"] = q, dq.T, tau
            file["rec/image"] = np.zeros((N, 4, 4, 3), np.uint8)
    else:
        pa = pytest.importorskip("pyarrow")
        from pyarrow import feather, parquet

        whole = pa.table(table)
        if kind == "parquet":
            parquet.write_table(whole, path, row_group_size=350)
        elif kind == "parquet_lists":
            lists = {"timestamp": t, "position": q.tolist(), "velocity": dq.tolist(), "motor_torque": tau.tolist()}
            parquet.write_table(pa.table(lists), path, row_group_size=350)
        elif kind == "feather":
            feather.write_feather(whole, str(path), chunksize=500)
        else:
            with pa.OSFile(str(path), "wb") as file, pa.ipc.new_file(file, whole.schema) as writer:
                writer.write_table(whole, max_chunksize=500)
    return path


def _text(table: dict[str, Array], mark: str, comma: str = ".") -> str:
    rows = np.column_stack(list(table.values())).tolist()
    return "\n".join([mark.join(table), *(mark.join(repr(x).replace(".", comma) for x in row) for row in rows)]) + "\n"


def _whole(folder: Path, kind: str, table: dict[str, Array]) -> Path:
    text = {"semicolon": _text(table, ";", ","), "tab": _text(table, "\t"), "spaces": _text(table, "   ")}
    path = folder / f"log.{dict.fromkeys(text, 'csv').get(kind, kind)}"
    if kind in text:
        path.write_text(text[kind])
    elif kind in ("gz", "xz"):
        path = folder / f"log.csv.{kind}"
        path.write_bytes((gzip if kind == "gz" else lzma).compress(_text(table, ",").encode()))
    elif kind == "npz_packed":
        path = folder / "log.npz"
        np.savez_compressed(path, **table)
    elif kind == "mat":
        from scipy.io import savemat

        savemat(path, {"rec": table})
    elif kind == "mat73":
        path = folder / "log.mat"
        _matlab(path, table)
    elif kind == "json":
        path.write_text(json.dumps({name: x.tolist() for name, x in table.items()}))
    else:
        rows = np.column_stack(list(table.values())).tolist()
        messages = [dict(zip(table, row, strict=True)) for row in rows]
        if kind == "jsonl":
            path.write_text("\n".join(json.dumps(m) for m in messages))
        elif kind == "xml":
            path.write_text("\n".join("<Rob>" + "".join(f"<{k}>{v!r}</{k}>" for k, v in m.items()) + "</Rob>" for m in messages))
        else:
            path = folder / "log.csv"
            lines = [f"{m['t']!r},{j},{m[f'q{j}']!r},{m[f'dq{j}']!r},{m[f'tau_m{j}']!r}" for m in messages for j in range(1, 7)]
            path.write_text("\n".join(["time,joint,position,velocity,torque", *lines]) + "\n")
    return path


def _matlab(path: Path, table: dict[str, Array]) -> None:
    """As MATLAB's `save -v7.3` lays a struct `rec` out: columns as rows of an HDF5 file behind a block of 512 bytes."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("rec")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        matrices = {"t": table["t"][None]} | {name: np.stack([table[f"{name}{j}"] for j in range(1, 7)]) for name in ("q", "dq", "tau_m")}
        for name, values in matrices.items():
            group[name] = values
            group[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as raw:
        raw.write(
            b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Fri Nov 27 2026 HDF5 schema 1.00 .".ljust(116) + bytes(8) + b"\x00\x02IM"
        )
