"""Files of a recording to a log by `ident.read_logs`, beside what libraries take to decode them, in one run."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import ident

from .limits import profiled
from .table import Row
from .timing import Work, together

#: Joints: with a time, and position, velocity and torque of each, a table of 13 columns.
_JOINTS = 4
#: Asked for: seconds of one thread for a million rows.
_TARGET = 2.0


def reading_rows(count: int) -> list[Row]:
    """Seconds for a million rows of each format, from `count` rows of it."""
    found = []
    with tempfile.TemporaryDirectory(prefix="ident-benchmark-") as name:
        for kind, write, raw, target in _KINDS:
            path = Path(name) / f"{kind.split()[0].lower()}{len(found)}{'.parquet' if raw is _PYARROW else ''}"
            write(path, *_recording(count))

            def read(path: Path = path) -> Any:
                path.touch()  # a file that changes is read anew
                return ident.read_logs(path)

            works = {"ident": Work(read, count), "raw": Work(lambda path=path, raw=raw: raw[1](path), count)}  # type: ignore[misc]
            us = together(works, rounds=3)
            others = ((raw[0], us["raw"], None),)
            why = profiled(read) if target is not None and us["ident"] > target else ""
            work = f"{kind} of {count} rows x {1 + 3 * _JOINTS} columns to a log"
            found.append(Row(work, us["ident"], "s per million rows", target, others, why))
    return found


def _recording(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    t = 0.001 * np.arange(count)
    w = 1.0 + 0.3 * np.arange(_JOINTS)
    return t, np.sin(np.outer(t, w)), w * np.cos(np.outer(t, w)), 3.0 * np.cos(np.outer(t, 2 * w)) + 0.1


def _parquet(path: Path, t: np.ndarray, q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    named = {f"{name}{j + 1}": x[:, j] for name, x in (("q", q), ("dq", dq), ("tau", tau)) for j in range(_JOINTS)}
    parquet.write_table(pa.table({"t": t} | named), path)


def _lists(path: Path, t: np.ndarray, q: np.ndarray, dq: np.ndarray, tau: np.ndarray) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    def lists(x: np.ndarray) -> Any:
        return pa.FixedSizeListArray.from_arrays(pa.array(x.ravel()), _JOINTS)

    table = pa.table({"timestamp": t, "position": lists(q), "velocity": lists(dq), "torque": lists(tau)})
    parquet.write_table(table, path)


def _bag(path: Path, t: np.ndarray, q: np.ndarray, dq: np.ndarray, tau: np.ndarray, *, mcap: bool) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind, header, stamp = (store.types[x] for x in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    names = [f"joint{j + 1}" for j in range(_JOINTS)]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3) as writer:
        topic = writer.add_connection("/joint_states", kind.__msgtype__, typestore=store)
        for k, at in enumerate(t.tolist()):
            ns = 10**9 + round(1e9 * at)
            message = kind(header(stamp(ns // 10**9, ns % 10**9), "base"), names, q[k], dq[k], tau[k])
            writer.write(topic, ns, store.serialize_cdr(message, kind.__msgtype__))


def _by_pyarrow(path: Path) -> None:
    from pyarrow import parquet

    table = parquet.ParquetFile(path).read(use_threads=False)
    for column in table.columns:
        np.asarray(column.combine_chunks().flatten() if "list" in str(column.type) else column)


def _by_rosbags(path: Path) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        for connection, _, raw in reader.messages():
            reader.deserialize(raw, connection.msgtype)


_PYARROW: tuple[str, Callable[[Path], None]] = ("pyarrow to arrays", _by_pyarrow)
_ROSBAGS: tuple[str, Callable[[Path], None]] = ("rosbags' own decoding, message by message", _by_rosbags)
_KINDS: tuple[tuple[str, Callable[..., None], tuple[str, Callable[[Path], None]], float | None], ...] = (
    ("Parquet", _parquet, _PYARROW, _TARGET),
    ("Parquet with lists", _lists, _PYARROW, _TARGET),
    ("MCAP", lambda *given: _bag(*given, mcap=True), _ROSBAGS, _TARGET),
    ("ROS 2 bag (SQLite)", lambda *given: _bag(*given, mcap=False), _ROSBAGS, None),
)
