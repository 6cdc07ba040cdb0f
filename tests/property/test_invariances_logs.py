"""The same recording written otherwise is the same: three robots, each way with the tolerance that it deserves (0: no bit)."""

from __future__ import annotations

import bz2
import gzip
import lzma
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import ident
from ident import Estimate, Log, LogSet
from tests.invariances import ROBOTS, Case, case, same, usual, write

Array = np.ndarray
Way = Callable[[Case, Path], Estimate]


def text(name: str = "a.csv", **options: str) -> Way:
    return lambda c, folder: c.fit(write(folder / name, c.columns(), **options))


def packed(name: str, pack: Callable[[bytes], bytes]) -> Way:
    def way(c: Case, folder: Path) -> Estimate:
        plain = write(folder / "plain.csv", c.columns()).read_bytes()
        (folder / name).write_bytes(pack(plain))
        return c.fit(folder / name)

    return way


def changed(change: Callable[[dict[str, Array]], dict[str, Array]], **options: str) -> Way:
    return lambda c, folder: c.fit(write(folder / "a.csv", change(c.columns()), **options))


def bytes_changed(change: Callable[[bytes], bytes]) -> Way:
    def way(c: Case, folder: Path) -> Estimate:
        path = write(folder / "a.csv", c.columns())
        path.write_bytes(change(path.read_bytes()))
        return c.fit(path)

    return way


def shuffled(columns: dict[str, Array]) -> dict[str, Array]:
    order = np.random.default_rng(0).permutation(list(columns))
    return {str(k): columns[str(k)] for k in order}


def times(suffix: str, factor: float, start: float = 0.0) -> Way:
    return changed(lambda c: {f"t{suffix}": (c["t"] + start) * factor, **{k: v for k, v in c.items() if k != "t"}})


def named(c: Case, folder: Path) -> Estimate:
    """Columns called anything, and a mapping."""
    mapping = {key: f"channel {i}" for i, key in enumerate(c.columns())}
    path = write(folder / "a.csv", {mapping[k]: v for k, v in c.columns().items()})
    return c.fit(ident.read_logs(path, c.robot, mapping))


def by_joint(c: Case, folder: Path) -> Estimate:
    columns = c.columns()
    joints = c.robot.joint_names
    out = {"time": columns["t"]} | {f"{n}.position": columns[f"q{j + 1}"] for j, n in enumerate(joints)}
    return c.fit(write(folder / "a.csv", out | {f"{n}.effort": columns[f"tau{j + 1}"] for j, n in enumerate(joints)}))


def degrees(c: Case, folder: Path) -> Estimate:
    turning = [not j.prismatic for j in c.robot.joints]
    out = c.columns()
    for j, turns in enumerate(turning):
        values = out.pop(f"q{j + 1}")
        out[f"q{j + 1}_deg" if turns else f"q{j + 1}_mm"] = np.rad2deg(values) if turns else 1e3 * values
    return c.fit(write(folder / "a.csv", out))


def in_brackets(c: Case, folder: Path) -> Estimate:
    out = {}
    for key, values in c.columns().items():
        unit = "s" if key == "t" else ""
        if key.startswith("q"):
            unit = "m" if c.robot.joints[int(key[1:]) - 1].prismatic else "rad"
        out[f"{key} [{unit}]" if unit else key] = values
    return c.fit(write(folder / "a.csv", out))


def arrow(c: Case, folder: Path) -> Estimate:
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table(c.columns()), folder / "a.parquet")
    return c.fit(folder / "a.parquet")


def mat(c: Case, folder: Path) -> Estimate:
    from scipy.io import savemat

    savemat(folder / "a.mat", {"t": c.log.t, "q": c.log.q, c.torque_name: c.tau})
    return c.fit(folder / "a.mat")


def in_memory(c: Case, folder: Path) -> Estimate:
    return c.fit(LogSet((c.log,), c.robot))


def fortran(c: Case, folder: Path) -> Estimate:
    return c.fit(replace(c.log, q=np.asfortranarray(c.log.q), tau={k: np.asfortranarray(v) for k, v in c.log.tau.items()}))


def read_only(c: Case, folder: Path) -> Estimate:
    arrays = {"q": c.log.q.copy(), "t": c.log.t.copy(), "tau": {k: v.copy() for k, v in c.log.tau.items()}}
    for a in (arrays["q"], arrays["t"], *arrays["tau"].values()):
        a.setflags(write=False)
    return c.fit(replace(c.log, **arrays))


def with_other_columns(c: Case, folder: Path) -> Estimate:
    noise = np.random.default_rng(1).normal(size=len(c.log))
    return c.fit(write(folder / "a.csv", {"voltage": noise, **c.columns(), "cpu": noise}))


def missing_fields(c: Case, folder: Path) -> Estimate:
    """A column of words that nothing needs."""
    path = write(folder / "a.csv", c.columns())
    rows = path.read_text().splitlines()
    path.write_text("\n".join([rows[0] + ",state", *(row + ",moving" for row in rows[1:])]) + "\n")
    return c.fit(path)


def streamed(c: Case, folder: Path) -> Estimate:
    from ident.streaming.ingest import Reading, store_logs

    runs = store_logs(write(folder / "a.csv", c.columns()), folder / "rows", Reading(c.robot))
    return c.fit(LogSet(tuple(run.read(0, len(run)) for run in runs), c.robot))


def turned_by_full_turns(c: Case, folder: Path) -> Estimate:
    """Positions joined over a whole turn more, of joints that may turn on and have no motor coupled to them."""
    free = [j for j, joint in enumerate(c.robot.joints) if joint.kind == "continuous"]
    q = c.log.q.copy()
    q[:, free] += 2 * np.pi
    return c.fit(replace(c.log, q=q))


EXACT: dict[str, Way] = {
    "plain text": text(), "semicolons": text(delimiter=";"), "tabs": text("a.tsv", delimiter="\t"),
    "decimal commas": text(delimiter=";", decimal=","), "carriage returns": text(end="\r\n"), "old Mac": text(end="\r"),
    "a note before": text(head="# by hand\n"), "blank lines before": text(head="\n\n"), "sep=": text(head="sep=;\n", delimiter=";"),
    "mark of UTF-8": text(head="\ufeff"), "spaces": text(delimiter=" "), "another suffix": text("a.txt"),
    "gzip": packed("a.csv.gz", gzip.compress), "bzip2": packed("a.csv.bz2", bz2.compress), "xz": packed("a.csv.xz", lzma.compress),
    "two parts of gzip": packed("a.csv.gz", lambda b: gzip.compress(b[:999]) + gzip.compress(b[999:])),
    "order of columns": changed(shuffled), "names of columns": named, "other columns": with_other_columns,
    "words in another column": missing_fields, "capitals": changed(lambda c: {k.upper(): v for k, v in c.items()}),
    "time": changed(lambda c: {"time" if k == "t" else k: v for k, v in c.items()}), "units in brackets": in_brackets,
    "quotes": bytes_changed(lambda b: b'"' + b.split(b"\n", 1)[0].replace(b",", b'","') + b'"\n' + b.split(b"\n", 1)[1]),
    "header behind a hash": bytes_changed(lambda b: b"# " + b), "spaces after commas": bytes_changed(lambda b: b.replace(b",", b", ")),
    "no last line end": bytes_changed(lambda b: b.rstrip(b"\n")), "blank lines at the end": bytes_changed(lambda b: b + b"\n\n"),
    "Parquet": arrow, "MAT": mat, "memory": in_memory, "columns first in memory": fortran, "read-only arrays": read_only,
    "streamed": streamed,
}  # fmt: skip
#: Conversions round once a sample; the time's origin costs digits of the time steps.
CLOSE: dict[str, tuple[Way, float]] = {
    "degrees and millimetres": (degrees, 1e-6), "milliseconds": (times("_ms", 1e3), 1e-6), "microseconds": (times("_us", 1e6), 1e-6),
    "nanoseconds": (times("_ns", 1e9), 1e-6), "time of another origin": (times("", 1.0, 1e4), 1e-5),
    "seconds since 1970": (times("", 1.0, 1.7e9), 1e-3), "whole turns": (turned_by_full_turns, 1e-6),
}  # fmt: skip


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("way", [*EXACT])
def test_written_otherwise_it_is_the_same(robot: str, way: str, tmp_path: Path) -> None:
    found = EXACT[way](case(robot), tmp_path)
    assert found.names == usual(robot).names
    np.testing.assert_array_equal(found.values, usual(robot).values)
    np.testing.assert_array_equal(found.covariance, usual(robot).covariance)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("way", [*CLOSE])
def test_in_other_units_it_is_the_same(robot: str, way: str, tmp_path: Path) -> None:
    make, tolerance = CLOSE[way]
    same(usual(robot), make(case(robot), tmp_path), tolerance)


def test_columns_by_the_names_of_joints(tmp_path: Path) -> None:
    """Effort is torque at the joint: of the robot whose torque is measured there."""
    np.testing.assert_array_equal(by_joint(case("arm"), tmp_path).values, usual("arm").values)


@pytest.mark.parametrize("robot", ROBOTS)
def test_runs_in_one_file_or_in_two_and_in_any_order(robot: str, tmp_path: Path) -> None:
    c = case(robot)
    half = len(c.log) // 2
    parts = [{k: v[s] for k, v in c.columns().items()} for s in (slice(0, half), slice(half, None))]
    files = [write(tmp_path / f"{i}.csv", part) for i, part in enumerate(parts)]
    both = c.fit(files)
    same(both, c.fit([*reversed(files)]), 1e-9)
    # In one file, where the time starts again.
    restarted = {k: np.concatenate([parts[0][k], parts[1][k] - (parts[1][k][0] if k == "t" else 0.0)]) for k in parts[0]}
    same(both, c.fit(write(tmp_path / "one.csv", restarted)), 1e-9)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("factor", [-3.0, 1e-3, 250.0])
def test_torque_in_another_unit_scales_every_value(robot: str, factor: float) -> None:
    """Rigid body, viscous and Coulomb friction are linear: k times the torque is k times the parameters."""
    c = case(robot)
    scaled = Log("run", t=c.log.t, q=c.log.q, tau={k: factor * v for k, v in c.log.tau.items()})
    options = {"preparation": ident.ZeroPhase(cutoff_hz=8.0)}
    same(c.fit(scaled, **options), c.fit(**options), 1e-6, scale=factor)


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("way", ["order of effects", "method by name", "saved and loaded", "again"])
def test_said_otherwise_it_is_the_same(robot: str, way: str, tmp_path: Path) -> None:
    c, one = case(robot), usual(robot)
    if way == "order of effects":
        two = c.fit(effects=("coulomb", "viscous"))
        np.testing.assert_allclose([two.value(n) for n in one.names], one.values, rtol=1e-6)
    elif way == "method by name":
        same(one, c.fit(method=ident.make_estimator("wls")), 0.0)
    elif way == "saved and loaded":
        same(one, Estimate.load(one.save(tmp_path / "fit.json")), 0.0)
    else:
        same(one, c.fit(), 0.0)
