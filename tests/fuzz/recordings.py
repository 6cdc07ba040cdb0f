"""Logs that are no tables of text: messages, packed texts, tables of other programs, bags; small, and right."""

from __future__ import annotations

import bz2
import gzip
import io
import json
import lzma
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from .seeds import motion, table

Array = np.ndarray


@lru_cache(maxsize=1)
def messages() -> dict[str, bytes]:
    """Logs as JSON and XML, and a table with a row for each joint."""
    t, q, tau = motion()
    names = ["j1", "j2"]
    states = [
        {"time": float(s), "name": names, "position": a.tolist(), "effort": b.tolist(), "mode": "run"}
        for s, a, b in zip(t, q, tau, strict=True)
    ]
    record = '<Rob Type="x"><Pos A1="{:.7g}" A2="{:.7g}"/><Torque A1="{:.7g}" A2="{:.7g}"/><time>{:.7g}</time></Rob>'
    telegrams = "\n".join(record.format(*a, *b, s) for s, a, b in zip(t, q, tau, strict=True))
    long = [f"{s:.7g},{k + 1},{a[k]:.7g},{b[k]:.7g}" for s, a, b in zip(t, q, tau, strict=True) for k in range(2)]
    lists = ["time,name,position,effort"] + [
        f'{s:.7g},"[\'j1\', \'j2\']","[{a[0]:.7g}, {a[1]:.7g}]","[{b[0]:.7g}, {b[1]:.7g}]"' for s, a, b in zip(t, q, tau, strict=True)
    ]
    echoed = ["%time,field.name0,field.name1,field.position0,field.position1,field.effort0,field.effort1"] + [
        f"{round(1e9 * s)},j1,j2,{a[0]:.7g},{a[1]:.7g},{b[0]:.7g},{b[1]:.7g}" for s, a, b in zip(t, q, tau, strict=True)
    ]
    arrays = {"t": t.tolist(), "q": q.tolist(), "tau": tau.tolist(), "note": "x"}
    return {
        "states.jsonl": "\n".join(map(json.dumps, states)).encode(),
        "list.json": json.dumps(states).encode(),
        "arrays.json": json.dumps(arrays).encode(),
        "telegrams.xml": telegrams.encode(),
        "document.xml": f'<?xml version="1.0"?>\n<log>{telegrams}</log>'.encode(),
        "lists.csv": "\n".join([*lists, ""]).encode(),
        "echoed.csv": "\n".join([*echoed, ""]).encode(),
        "long.csv": "\n".join(["time,id,position,effort", *long, ""]).encode(),
    }


def _zstandard(data: bytes) -> bytes:
    import pyarrow as pa

    # With its size in the head, as the program of that name writes it.
    return bytes(pa.Codec("zstd").compress(data, asbytes=True))


#: How a text is packed, by suffix.
PACK: dict[str, Callable[[bytes], bytes]] = {
    ".gz": lambda data: gzip.compress(data, mtime=0),
    ".bz2": bz2.compress,
    ".xz": lzma.compress,
    ".zst": _zstandard,
}


@lru_cache(maxsize=1)
def packed() -> dict[str, bytes]:
    """Compressed logs."""
    return {f"a.csv{suffix}": pack(table()) for suffix, pack in PACK.items()}


def _made(name: str, write: Callable[[Path], object]) -> bytes:
    """A file that is written, or the one file of data in a folder that is."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        if path.is_dir():
            path = next(p for p in path.iterdir() if p.suffix == path.suffix)
        return path.read_bytes()


@lru_cache(maxsize=1)
def stored() -> dict[str, bytes]:
    """Binary logs: Parquet, Arrow, MAT, NPZ; HDF5 and MAT 7.3 where `h5py` is installed, bags where `rosbags` is."""
    import pyarrow as pa
    from pyarrow import feather, parquet
    from scipy.io import savemat

    t, q, tau = motion()
    columns = {"t": t, "q1": q[:, 0], "q2": q[:, 1], "tau1": tau[:, 0], "tau2": tau[:, 1]}
    lists = {"timestamp": t, "observation.state": list(q), "observation.effort": list(tau)}
    stamped = {**columns, "t": (t * 1e9).astype("datetime64[ns]")}
    npz, packed_npz = io.BytesIO(), io.BytesIO()
    np.savez(npz, t=t, q=q, tau=tau)
    np.savez_compressed(packed_npz, t=t, q=q, tau=tau)
    return {
        "a.parquet": _made("a.parquet", lambda p: parquet.write_table(pa.table(columns), p)),
        "stamped.parquet": _made("s.parquet", lambda p: parquet.write_table(pa.table(stamped), p)),
        "lists.parquet": _made("l.parquet", lambda p: parquet.write_table(pa.table(lists), p)),
        "a.mat": _made("a.mat", lambda p: savemat(p, {"t": t, "q": q, "tau": tau})),
        "packed.mat": _made("p.mat", lambda p: savemat(p, {"log": {"t": t, "q": q, "tau": tau}}, do_compression=True)),
        "a.npz": npz.getvalue(),
        "packed.npz": packed_npz.getvalue(),
        "a.arrow": _made("a.arrow", lambda p: feather.write_feather(pa.table(columns), str(p), compression="uncompressed")),
        "a.feather": _made("a.feather", lambda p: feather.write_feather(pa.table(lists), str(p))),
        **_hdf5(t, q, tau),
        **_bags(t, q, tau),
    }


def _hdf5(t: Array, q: Array, tau: Array) -> dict[str, bytes]:
    try:
        import h5py
    except ImportError:
        return {}

    def plain(path: Path) -> None:
        with h5py.File(path, "w") as file:
            file["t"], file["q"], file["tau"] = t, q, tau

    def demos(path: Path) -> None:
        with h5py.File(path, "w") as file:
            for k in range(2):
                group = file.create_group(f"data/demo_{k}")
                group["t"] = t
                group.create_dataset("obs/joint_pos", data=q + 0.1 * k, compression="gzip", chunks=(40, 2))
                group["obs/joint_torque"] = tau

    def matlab(path: Path) -> None:
        with h5py.File(path, "w", userblock_size=512) as file:
            for name, values in (("t", t[None, :]), ("q", q.T), ("tau", tau.T)):
                file[name] = values
                file[name].attrs["MATLAB_class"] = np.bytes_("double")
        with path.open("r+b") as raw:
            raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")

    return {"a.h5": _made("a.h5", plain), "demos.hdf5": _made("d.hdf5", demos), "new.mat": _made("n.mat", matlab)}


def _bags(t: Array, q: Array, tau: Array) -> dict[str, bytes]:
    try:
        from rosbags import rosbag1, rosbag2
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        return {}

    def fill(writer: Any, store: Any, serialize: str, **more: object) -> None:
        types = get_typestore(store)
        State, Head, Time = (types.types[n] for n in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
        with writer:
            connection = writer.add_connection("/joint_states", State.__msgtype__, typestore=types)
            for i, s in enumerate(t):
                head = Head(**({"seq": i} if more else {}), stamp=Time(sec=1 + int(s), nanosec=int((s % 1) * 1e9)), frame_id="")
                message = State(header=head, name=["j1", "j2"], position=q[i], velocity=np.zeros(0), effort=tau[i])
                writer.write(connection, int(1e9 * (1 + s)), getattr(types, serialize)(message, State.__msgtype__))

    def first(path: Path) -> None:
        fill(rosbag1.Writer(path), Stores.ROS1_NOETIC, "serialize_ros1", sequence=True)

    def second(plugin: Any) -> Callable[[Path], None]:
        return lambda path: fill(rosbag2.Writer(path, version=8, storage_plugin=plugin), Stores.ROS2_HUMBLE, "serialize_cdr")

    plugins = rosbag2.StoragePlugin
    return {
        "a.bag": _made("a.bag", first),
        "a.mcap": _made("a.mcap", second(plugins.MCAP)),
        "a.db3": _made("a.db3", second(plugins.SQLITE3)),
    }
