"""Logs that are damaged: refused in one line whatever packs them, left out with a record where that is asked for, never a bomb."""

from __future__ import annotations

import bz2
import gzip
import lzma
from pathlib import Path

import numpy as np
import pytest

import ident
from ident import DataError
from ident.logs.readers import packed
from ident.streaming.ingest import Reading, store_logs
from tests.fuzz import recordings, seeds

PACKS = {"csv.gz": gzip.compress, "csv.bz2": bz2.compress, "csv.xz": lzma.compress}
TABLE = seeds.table(rows=900)
WRONG_UNIT = "t,q1_Nm,q2,tau1,tau2"


def damaged(folder: Path) -> dict[str, Path]:
    """One file of each kind of damage, by name."""
    content = {
        "empty.csv": b"",
        "byte.csv": b"\x1f",  # which Python takes for a space
        "bytes.csv": bytes(range(256)) * 40,
        "short.csv": b"t,q1\n0,1\n1,2\n",
        "unit.csv": seeds.table(WRONG_UNIT),
    }
    for suffix, pack in PACKS.items():
        whole = pack(TABLE)
        content[f"cut.{suffix}"] = whole[: len(whole) // 2]
        flipped = bytearray(whole)
        flipped[len(whole) // 2] ^= 0x5A
        content[f"flipped.{suffix}"] = bytes(flipped)
    stored = recordings.stored()
    for name, whole in stored.items():
        content[f"cut-{name}"] = whole[: len(whole) // 2]
        if name.endswith((".h5", ".hdf5", "new.mat")):  # the signatures of what the file lists
            content[f"flipped-{name}"] = whole.replace(b"TREE", b"TREF").replace(b"SNOD", b"SNOE")
    paths = {name: folder / name for name in content}
    for name, path in paths.items():
        path.write_bytes(content[name])
    (folder / "folder.csv").mkdir()
    return {**paths, "folder.csv": folder / "folder.csv", "absent.csv": folder / "absent.csv"}


def test_every_damage_is_told_in_one_line(tmp_path: Path) -> None:
    for name, path in damaged(tmp_path).items():
        with pytest.raises(ident.IdentError) as error:
            ident.read_logs(path, seeds.robot())
        told = str(error.value)
        assert name in told, told
        assert "\n" not in told
        assert len(told) < 600


def test_damaged_files_are_left_out_with_a_record(tmp_path: Path) -> None:
    (tmp_path / "good.csv").write_bytes(TABLE)
    bad = damaged(tmp_path)
    files = [*bad.values(), tmp_path / "good.csv"]
    logs = ident.read_logs(files, seeds.robot(), skip_bad_files=True)
    assert logs.names == ("good",)
    assert len(logs.left_out) == len(bad)
    for name, told in zip(bad, logs.left_out, strict=True):
        assert name in told
    assert logs.split(by="fraction", held=0.25)[0].left_out == logs.left_out
    with pytest.raises(DataError, match=f"none of {len(bad)} logs can be read; the first: "):
        ident.read_logs([*bad.values()], seeds.robot(), skip_bad_files=True)


def test_a_bomb_is_refused_before_it_fills_the_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packed, "_UNPACKED", 1 << 20)
    path = tmp_path / "bomb.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"t,q1,q2,tau1,tau2\n")
        for _ in range(40):
            file.write(b"0.5,0,0,0,0\n" * 10_000)
    with pytest.raises(DataError, match="expands to more than 200 times its size"):
        ident.read_logs(path, seeds.robot())


def bomb(path: Path) -> None:
    """Columns of a million zeros, in a file of a few thousand bytes."""
    zeros = np.zeros(1_000_000)
    if path.suffix == ".npz":
        np.savez_compressed(path, t=zeros, q=zeros)
    elif path.name == "a.mat":
        from scipy.io import savemat

        savemat(path, {"t": zeros, "q": zeros}, do_compression=True)
    elif path.suffix == ".parquet":
        import pyarrow as pa
        from pyarrow import parquet

        parquet.write_table(pa.table(dict.fromkeys(("t", "q1", "q2", "tau1", "tau2"), zeros)), path)
    else:
        h5py = pytest.importorskip("h5py")
        with h5py.File(path, "w", userblock_size=512) as file:
            file.create_dataset("t", data=zeros, compression="gzip", compression_opts=9)
        if path.suffix == ".mat":
            with path.open("r+b") as raw:
                raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")
        else:
            path.write_bytes(path.read_bytes()[512:])


@pytest.mark.parametrize("name", ["a.npz", "a.mat", "new.mat", "a.h5", "a.parquet"])
def test_a_bomb_of_another_format_is_refused_too(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packed, "_UNPACKED", 1 << 20)
    bomb(tmp_path / name)
    assert (tmp_path / name).stat().st_size < 40_000
    with pytest.raises(DataError, match="expands to more than 200 times its size"):
        ident.read_logs(tmp_path / name, seeds.robot())
    monkeypatch.setattr(packed, "_UNPACKED", 1 << 28)
    with pytest.raises(ident.IdentError) as other:
        ident.read_logs(tmp_path / name, seeds.robot())
    assert "expands" not in str(other.value)


@pytest.mark.parametrize("suffix", [*PACKS])
def test_a_packed_log_of_a_usual_ratio_is_read(tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packed, "_UNPACKED", 1 << 10)
    (tmp_path / f"a.{suffix}").write_bytes(PACKS[suffix](TABLE))
    np.testing.assert_array_equal(ident.read_logs(tmp_path / f"a.{suffix}", seeds.robot())[0].t, np.arange(900) / seeds.RATE)


def test_a_line_without_an_end_is_no_table_where_it_is_streamed(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(TABLE)
        for _ in range(12):
            file.write(b"1" * 1_000_000)
    with pytest.raises(DataError, match="line"):
        store_logs(path, tmp_path / "rows", Reading(seeds.robot()))


@pytest.mark.parametrize("value", ["inf", "-inf", "1e300", "1e400", ""])
def test_a_torque_that_is_none_is_told_and_left_out(tmp_path: Path, value: str) -> None:
    rows = TABLE.decode().splitlines()
    fields = rows[300].split(",")
    rows[300] = ",".join([*fields[:3], value, fields[4]])
    path = tmp_path / "a.csv"
    path.write_text("\n".join(rows) + "\n")
    logs = ident.read_logs(path, seeds.robot())
    assert np.flatnonzero(np.isnan(logs[0].tau["joint"][:, 0])).tolist() == [299]
    (found,) = ident.audit(logs, seeds.robot()).of("torque_nan")
    assert "1 sample;" in found.text
    (run,) = store_logs(path, tmp_path / "rows", Reading(seeds.robot()))
    np.testing.assert_array_equal(run.read(0, len(run)).tau["joint"], logs[0].tau["joint"])


def test_what_another_library_would_believe_is_checked_first(tmp_path: Path) -> None:
    """Mapped arrays by their sums, lists in Arrow files by their places, whole and in chunks; Feather's first version not at all."""
    feather = pytest.importorskip("pyarrow.feather")
    import pyarrow as pa

    path = tmp_path / "a.npz"
    np.savez(path, t=np.arange(400) / 50.0, q=np.sin(np.arange(800.0)).reshape(400, 2), tau=np.cos(np.arange(800.0)).reshape(400, 2))
    content = bytearray(path.read_bytes())
    content[content.index(b"q.npy") + 1000] ^= 0xFF
    path.write_bytes(bytes(content))
    lists = pa.table(
        {"timestamp": np.arange(400) / 50.0, "observation.state": list(np.zeros((400, 2))), "observation.effort": list(np.ones((400, 2)))}
    )
    feather.write_feather(lists, str(tmp_path / "a.arrow"), compression="uncompressed")
    offsets = np.arange(0, 40, 2, dtype=np.int32).tobytes()
    content = bytearray((tmp_path / "a.arrow").read_bytes())
    content[content.index(offsets) + 19] = 0x40
    (tmp_path / "a.arrow").write_bytes(bytes(content))
    (tmp_path / "old.feather").write_bytes(b"FEA1" + bytes(400) + b"FEA1")
    for name in ("a.npz", "a.arrow", "old.feather"):
        with pytest.raises(DataError, match=name):
            ident.read_logs(tmp_path / name, seeds.robot())
        with pytest.raises(DataError, match=name):
            store_logs(tmp_path / name, tmp_path / f"rows {name}", Reading(seeds.robot()))
