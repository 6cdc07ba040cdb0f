"""The same recording in other formats and dialects holds the same numbers: three robots, no bit of difference where none is rounded."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ident
from ident import Log
from tests.fuzz.recordings import PACK
from tests.invariances import ROBOTS, Case, case, write

Array = np.ndarray
Way = Callable[[Case, Path], object]


def short(name: str) -> Case:
    """A case with a log of two seconds."""
    c = case(name)
    part = slice(0, 400)
    assert c.log.q is not None
    return replace(c, log=replace(c.log, t=c.log.t[part], q=c.log.q[part], tau={k: v[part] for k, v in c.log.tau.items()}))


def rows(c: Case) -> list[list[float]]:
    return [[float(x) for x in row] for row in zip(*c.columns().values(), strict=True)]


def text(c: Case, path: Path, change: Callable[[list[str]], list[str]]) -> Path:
    """The lines of a table with all digits, changed."""
    lines = write(path, c.columns()).read_text().splitlines()
    path.write_text("\n".join(change(lines)) + "\n")
    return path


def zstandard(c: Case, folder: Path) -> Path:
    (folder / "a.csv.zst").write_bytes(PACK[".zst"](write(folder / "plain.txt", c.columns()).read_bytes()))
    return folder / "a.csv.zst"


def hdf5(c: Case, folder: Path) -> Path:
    h5py = pytest.importorskip("h5py")
    with h5py.File(folder / "a.h5", "w") as file:
        for name, values in c.columns().items():
            file.create_dataset(name, data=values, compression="gzip")
    return folder / "a.h5"


def npz(c: Case, folder: Path) -> Path:
    np.savez(folder / "a.npz", **c.columns())
    return folder / "a.npz"


def row_groups(c: Case, folder: Path) -> Path:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pa.table(c.columns()), folder / "a.parquet", row_group_size=37, compression="zstd", use_dictionary=True)
    return folder / "a.parquet"


def messages(c: Case, folder: Path) -> Path:
    names = list(c.columns())
    (folder / "a.jsonl").write_text("\n".join(json.dumps(dict(zip(names, row, strict=True))) for row in rows(c)))
    return folder / "a.jsonl"


def list_of_messages(c: Case, folder: Path) -> Path:
    names = list(c.columns())
    (folder / "a.json").write_text(json.dumps([dict(zip(names, row, strict=True)) for row in rows(c)], indent=1))
    return folder / "a.json"


def arrays_by_name(c: Case, folder: Path) -> Path:
    (folder / "a.json").write_text(json.dumps({k: v.tolist() for k, v in c.columns().items()}))
    return folder / "a.json"


def telegrams(c: Case, folder: Path) -> Path:
    names = list(c.columns())
    lines = ("<r " + " ".join(f'{n}="{x!r}"' for n, x in zip(names, row, strict=True)) + "/>" for row in rows(c))
    (folder / "a.xml").write_text("\n".join(lines))
    return folder / "a.xml"


def frame(c: Case, folder: Path) -> object:
    pandas = pytest.importorskip("pandas")
    return pandas.DataFrame(c.columns())


def by_csv_module(c: Case, folder: Path) -> Path:
    out = io.StringIO()
    csv.writer(out, quoting=csv.QUOTE_ALL).writerows([list(c.columns()), *rows(c)])
    (folder / "a.csv").write_text(out.getvalue())
    return folder / "a.csv"


def units_below(c: Case, folder: Path) -> Path:
    """A row of units below the names."""
    kinds = {"t": "s", "q": "rad", "tau": "Nm"}
    units = [kinds["t" if k == "t" else "q" if k.startswith("q") else "tau"] for k in c.columns()]
    slides = [k for k, j in enumerate(c.robot.joints) if j.prismatic]
    for k in slides:
        units[1 + k], units[1 + c.robot.n + k] = "m", "N"
    return text(c, folder / "a.csv", lambda lines: [lines[0], ",".join(units), *lines[1:]])


def in_a_folder(c: Case, folder: Path) -> Path:
    (folder / "logs").mkdir()
    write(folder / "logs/a.csv", c.columns())
    (folder / "logs/readme.md").write_text("by hand")
    return folder / "logs"


def pattern(c: Case, folder: Path) -> str:
    write(folder / "run-7.csv", c.columns())
    return str(folder / "run-*.csv")


def one_of_many(c: Case, folder: Path) -> list[str]:
    return [str(write(folder / "a.csv", c.columns()))]


def digits(form: str) -> Way:
    """Numbers in another notation that holds every digit."""

    def way(c: Case, folder: Path) -> Path:
        return text(
            c, folder / "a.csv", lambda lines: [lines[0], *(",".join(form.format(float(x)) for x in r.split(",")) for r in lines[1:])]
        )

    return way


EXACT: dict[str, Way] = {
    "Zstandard": zstandard, "HDF5": hdf5, "NPZ": npz, "Parquet in row groups": row_groups, "a message a line": messages,
    "a list of messages": list_of_messages, "arrays by name": arrays_by_name, "telegrams": telegrams, "a frame": frame,
    "every field in quotes": by_csv_module, "a row of units": units_below, "a folder": in_a_folder, "a pattern": pattern,
    "a list of files": one_of_many, "exponents": digits("{:.17e}"), "more digits than there are": digits("{:.25g}"),
    "signs": digits("{:+.17g}"), "numbers to the right": digits("{:>28.17g}"),
    "a comma at the end": lambda c, folder: text(c, folder / "a.csv", lambda lines: [f"{line}," for line in lines]),
    "small words for nothing": lambda c, folder: text(
        c, folder / "a.csv", lambda lines: [f"{lines[0]},temperature", *(f"{line},nan" for line in lines[1:])]
    ),
}  # fmt: skip


@contextmanager
def same_arrays(c: Case, tolerance: float = 0.0) -> Iterator[list[Log]]:
    """What is put into the list holds the case's numbers."""
    found: list[Log] = []
    yield found
    (log,) = found
    for one, two in ((log.t - log.t[0], c.log.t - c.log.t[0]), (log.q, c.log.q), (next(iter(log.tau.values())), c.tau)):
        assert one is not None
        np.testing.assert_allclose(one, two, rtol=tolerance, atol=tolerance * float(np.abs(two).max()))
    assert set(log.tau) == set(c.log.tau)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("way", [*EXACT])
def test_in_another_format_it_is_the_same(robot: str, way: str, tmp_path: Path) -> None:
    c = short(robot)
    with same_arrays(c) as found:
        found += ident.read_logs(EXACT[way](c, tmp_path), c.robot)


def renamed(c: Case, folder: Path, quantity: str, suffix: Callable[[bool], tuple[str, float]]) -> Path:
    """Columns of one quantity in a unit: `suffix` of a joint that slides, or not → suffix, how many of it are one of ours."""
    out = {}
    for key, values in c.columns().items():
        if key.startswith(quantity):
            unit, factor = suffix(c.robot.joints[int(key.removeprefix(c.torque_name).removeprefix("q")) - 1].prismatic)
            out[f"{key}_{unit}"] = factor * values
        else:
            out[key] = values
    return write(folder / "a.csv", out)


UNITS: dict[str, Way] = {
    "milliradians and centimetres": lambda c, f: renamed(c, f, "q", lambda slides: ("cm", 1e2) if slides else ("mrad", 1e3)),
    "millinewtons": lambda c, f: renamed(c, f, "tau", lambda slides: ("mN", 1e3) if slides else ("mNm", 1e3)),
    "kilonewtons": lambda c, f: renamed(c, f, "tau", lambda slides: ("kN", 1e-3) if slides else ("kNm", 1e-3)),
}


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("way", [*UNITS])
def test_in_another_unit_it_is_the_same(robot: str, way: str, tmp_path: Path) -> None:
    c = short(robot)
    with same_arrays(c, 1e-12) as found:
        found += ident.read_logs(UNITS[way](c, tmp_path), c.robot)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("plugin", ["MCAP", "SQLITE3"])
def test_in_a_bag_it_is_the_same(robot: str, plugin: str, tmp_path: Path) -> None:
    """Joints by name and in another order, effort where it is measured; stamps are whole nanoseconds."""
    rosbag2 = pytest.importorskip("rosbags.rosbag2")
    from rosbags.typesys import Stores, get_typestore

    c = short(robot)
    types = get_typestore(Stores.ROS2_HUMBLE)
    State, Head, Time = (types.types[n] for n in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    order = np.random.default_rng(4).permutation(c.robot.n)
    names = [c.robot.joint_names[k] for k in order]
    assert c.log.q is not None
    with rosbag2.Writer(tmp_path / "bag", version=8, storage_plugin=rosbag2.StoragePlugin[plugin]) as writer:
        topic = writer.add_connection("/joint_states", State.__msgtype__, typestore=types)
        for s, q, tau in zip(c.log.t, c.log.q, c.tau, strict=True):
            ns = round(1e9 * (s + 1))
            head = Head(stamp=Time(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            state = State(header=head, name=names, position=q[order], velocity=np.zeros(0), effort=tau[order])
            writer.write(topic, ns, types.serialize_cdr(state, State.__msgtype__))
    (log,) = ident.read_logs(tmp_path / "bag", c.robot)
    np.testing.assert_allclose(log.t - log.t[0], c.log.t, atol=1e-9)
    np.testing.assert_array_equal(log.q, c.log.q)
    np.testing.assert_array_equal(log.tau[c.robot.transmission.measured.value], c.tau)
