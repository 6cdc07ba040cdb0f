"""Streamed logs give what logs in memory give: rows, masks, estimates, covariance, reports, errors; and go on where they were cut off."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import analytic_log, write_csv

import ident
from ident.errors import ConfigurationError, DataError, UnsupportedError
from ident.estimators import Capability, estimator_types
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import nominal_values
from ident.streaming import StreamedSession
from ident.study.session import Session
from ident.study.study import Study
from ident.study.tables import Strategy

Array = np.ndarray


@pytest.fixture(scope="module")
def table() -> dict[str, Array]:
    """A minute of the PUMA at 200 Hz."""
    robot = ident.load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    found = analytic_log(model, nominal_values(model), 3, seconds=60.0, rate=200.0, noise=0.02)
    # Noise of its own, so that the noise that reports tell is not that of rounding.
    rng = np.random.default_rng(4)
    return found | {k: v + 1e-6 * rng.standard_normal(len(v)) for k, v in found.items() if k.startswith("q")}


@pytest.fixture(autouse=True)
def small_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """Many pieces from a small log."""
    monkeypatch.setattr("ident.streaming.motion.PIECE", 500)
    monkeypatch.setattr("ident.streaming.tables.TEXT_PIECE", 1 << 16)
    monkeypatch.setattr("ident.streaming.ingest._BLOCK", 1000)


def both(folder: Path, path: Path, **signals: Any) -> tuple[Session, StreamedSession]:
    """The same study in memory and streamed."""
    study = Study.from_flags(robot="puma560", logs=[path])
    study = replace(study, signals=replace(study.signals, options={"cutoff_hz": 12.0, **signals}))
    (folder / "out").mkdir(exist_ok=True)
    return Session(study), StreamedSession.of(study, out=folder / "out", jobs=2)


def agree(memory: Session, streamed: StreamedSession, tolerance: float = 1e-12) -> None:
    """Rows and masks, values and covariance, errors and what is said."""
    a, b = memory.fit_signals, streamed.fit_signals
    assert np.array_equal(a.valid, b.valid)
    assert (a.near_reversal is None) == (b.near_reversal is None)
    assert a.near_reversal is None or np.array_equal(a.near_reversal, b.near_reversal)
    assert np.nanmax(np.abs(a.tau - b.tau)) <= tolerance * np.nanmax(np.abs(a.tau))
    assert str(a.report) == str(b.report)
    x, y = memory.estimate, streamed.estimate
    assert x.names == y.names
    assert np.linalg.norm(x.values - y.values) <= tolerance * np.linalg.norm(x.values)
    assert np.all(np.abs(x.values - y.values) <= 1e-9 * x.std + tolerance * np.abs(x.values))
    assert np.linalg.norm(x.covariance - y.covariance) <= tolerance * np.linalg.norm(x.covariance)
    assert x.heldout_error is not None
    assert y.heldout_error is not None
    np.testing.assert_allclose(x.heldout_error.rms, y.heldout_error.rms, rtol=1e-11)
    assert (x.status, x.warnings, x.inputs, x.samples) == (y.status, y.warnings, y.inputs, y.samples)


def test_csv_equals_memory(tmp_path: Path, table: dict[str, Array]) -> None:
    memory, streamed = both(tmp_path, write_csv(tmp_path / "log.csv", table))
    agree(memory, streamed)
    assert len(streamed.fit_signals.parts) > 2
    assert streamed.audit.to_dict() == memory.audit.to_dict()


def test_gzip_and_parquet_equal_memory(tmp_path: Path, table: dict[str, Array]) -> None:
    pa = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    plain = write_csv(tmp_path / "log.csv", table)
    squeezed = tmp_path / "a" / "log.csv.gz"
    squeezed.parent.mkdir()
    squeezed.write_bytes(gzip.compress(plain.read_bytes()))
    parquet.write_table(pa.table({f"{name} ": column for name, column in table.items()}), tmp_path / "log.parquet", row_group_size=5000)
    for path in (squeezed, tmp_path / "log.parquet"):
        memory, streamed = both(path.parent, path)
        assert np.array_equal(streamed.stored[0].t[:], memory.recorded[0].t)
        assert np.array_equal(streamed.stored[0].arrays["q"][:], memory.recorded[0].q)
        assert str(memory.fit_signals.report) == str(streamed.fit_signals.report)
        shutil.rmtree(path.parent / "out")


def damaged(kind: str, table: dict[str, Array]) -> dict[str, Array]:
    """A log with something wrong that both ways must treat alike."""
    out = {k: np.array(v) for k, v in table.items()}
    rng = np.random.default_rng(0)
    if kind == "gap":
        keep = np.ones(len(out["t"]), bool)
        keep[4000:4400] = False
        out = {k: v[keep] for k, v in out.items()}
    elif kind == "torque holes":
        out["tau_m2"][700:705] = np.nan
        out["tau_m4"][3000:3900] = np.nan
        out["tau_m5"][:] = np.nan
        out["tau_m1"][2000:2003] = np.inf, -np.inf, np.nan
    elif kind == "dead torque":
        out["tau_m4"][:] = 0.25
    elif kind == "position holes":
        out["q3"][1000:1004] = np.nan
    elif kind == "missing samples":
        keep = rng.random(len(out["t"])) > 0.03
        moved = out["t"] + 2e-4 * rng.uniform(-1, 1, len(out["t"]))
        out = {"t": moved[keep]} | {k: np.interp(moved, out["t"], v)[keep] for k, v in out.items() if k != "t"}
    elif kind == "jitter":
        moved = out["t"] + 5e-4 * rng.uniform(-1, 1, len(out["t"]))
        out = {"t": moved} | {k: np.interp(moved, out["t"], v) for k, v in out.items() if k != "t"}
    elif kind == "wrapped":
        out["q1"] = np.angle(np.exp(1j * (out["q1"] + 2.6)))
    elif kind == "saturated":
        top = 0.7 * out["tau_m2"].max()
        out["tau_m2"] = np.minimum(out["tau_m2"], top)
    elif kind == "saturated and uneven":
        out = damaged("saturated", damaged("jitter", table))
    elif kind == "repeated stamps":
        out["t"][5000] = out["t"][4999]
    elif kind == "two runs":
        out = {k: np.concatenate([v[:9000], v[9000:]]) for k, v in out.items()}
        out["t"][9000:] -= out["t"][9000]
    elif kind == "degrees":
        out = {(f"{k}_deg" if k.startswith("q") else k): (np.rad2deg(v) if k.startswith("q") else v) for k, v in out.items()}
    return out


KINDS = (
    "gap",
    "torque holes",
    "dead torque",
    "position holes",
    "missing samples",
    "jitter",
    "wrapped",
    "saturated",
    "saturated and uneven",
    "repeated stamps",
    "two runs",
    "degrees",
)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_wrong_with_a_log_is_treated_alike(kind: str, tmp_path: Path, table: dict[str, Array]) -> None:
    path = write_csv(tmp_path / "log.csv", damaged(kind, table))
    memory, streamed = both(tmp_path, path)
    a, b = memory.fit_signals, streamed.fit_signals
    assert ("saturated" in kind) == any("stays at its extreme" in w for w in a.report.warnings)
    assert str(a.report) == str(b.report)
    assert np.array_equal(a.valid, b.valid)
    assert np.nanmax(np.abs(a.tau - b.tau)) <= 1e-12 * np.nanmax(np.abs(a.tau))
    x, y = memory.problem.information, streamed.problem.information
    np.testing.assert_allclose(x.residual_squares(np.zeros(x.k)), y.residual_squares(np.zeros(y.k)), rtol=1e-12)
    scale = np.linalg.norm(x.factors, axis=(1, 2))[:, None, None]
    both_grams = [np.swapaxes(f.factors, 1, 2) @ f.factors / np.maximum(scale, 1e-100) ** 2 for f in (x, y)]
    assert np.abs(both_grams[0] - both_grams[1]).max() <= 1e-12


def test_rows_near_reversals_are_kept_if_asked(tmp_path: Path, table: dict[str, Array]) -> None:
    """Torque disturbed where joint 2 reverses: its rows there are left out of both fits, and kept in both where the study asks for it."""
    slow = np.abs(np.gradient(table["q2"], table["t"])) < 0.05
    rough = table | {"tau_m2": table["tau_m2"] + 5.0 * slow * np.sign(np.sin(np.arange(len(slow)) / 37.0))}
    path = write_csv(tmp_path / "log.csv", rough)
    for folder, signals, left_out in (("usual", {}, {"joint2"}), ("kept", {"rows_near_reversals": "keep"}, set())):
        (tmp_path / folder).mkdir()
        sessions = both(tmp_path / folder, path, **signals)
        agree(*sessions, tolerance=1e-11)
        assert all({r.joint for r in s.estimate.reversals_left_out} == left_out for s in sessions)
        assert sessions[0].estimate.reversals_left_out == sessions[1].estimate.reversals_left_out


def test_errors_name_file_column_and_row(tmp_path: Path, table: dict[str, Array]) -> None:
    path = write_csv(tmp_path / "log.csv", table)
    lines = path.read_text().splitlines()
    fields = lines[9001].split(",")
    fields[3] = "oops"
    lines[9001] = ",".join(fields)
    path.write_text("\n".join(lines) + "\n")
    memory, streamed = both(tmp_path, path)
    messages = []
    for session in (memory, streamed):
        with pytest.raises(DataError) as caught:
            session.fit_signals  # noqa: B018
        messages.append(str(caught.value))
    assert messages[0] == messages[1]
    assert "line 9002" in messages[1]
    assert "'q3'" in messages[1]


def test_bad_files_are_skipped_if_asked(tmp_path: Path, table: dict[str, Array]) -> None:
    good = write_csv(tmp_path / "good.csv", table)
    bad = tmp_path / "bad.csv"
    bad.write_text("t,q1\n0,1\n")
    study = Study.from_flags(robot="puma560", logs=[good, bad])
    with pytest.raises(DataError, match=r"bad\.csv"):
        StreamedSession.of(study).stored  # noqa: B018
    session = StreamedSession.of(study, skip_bad_files=True)
    assert [log.name for log in session.stored] == ["good"]
    assert "bad.csv" in session.skipped[0]
    assert any("bad.csv" in w for w in session.estimate.warnings)
    session.checkpoint.remove()


@pytest.mark.parametrize("method", ["didim", "iv"])
def test_method_that_needs_the_whole_log_is_refused(method: str) -> None:
    study = Study.from_flags(robot="puma560", logs=["none.csv"], method=method)
    with pytest.raises(UnsupportedError, match=rf"method '{method}' needs the whole log .*wls"):
        StreamedSession.of(study)


@pytest.mark.parametrize("method", [name for name, kind in estimator_types().items() if Capability.STREAMING in kind.capabilities])
def test_every_method_that_says_so_streams(method: str, tmp_path: Path, table: dict[str, Array]) -> None:
    path = write_csv(tmp_path / "log.csv", {k: v[:3000] for k, v in table.items()})
    memory, streamed = both(tmp_path, path)
    options = {"acceleration_std": (0.05,) * 6} if method == "tls" else {}
    x, y = (replace(s, study=replace(s.study, estimator=Strategy(method, options))).estimate for s in (memory, streamed))
    assert np.all(np.abs(x.values - y.values) <= 1e-3 * x.std + 1e-9 * np.abs(x.values))


FIT = ("fit", "--robot", "puma560", "--stream", "--jobs", "1", "--quiet")
#: A process that reads slowly and in small pieces, so that it can be killed on the way.
SLOW = """
import sys, time
import ident.streaming.ingest as ingest, ident.streaming.tables as tables
tables.TEXT_PIECE, ingest._RECORD_S = 1 << 16, 0.0
whole = ingest.pieces
def slowly(*args):
    for piece in whole(*args):
        yield piece
        time.sleep(0.05)
ingest.pieces = slowly
from ident.cli import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.skipif(os.name != "posix", reason="SIGKILL is POSIX")
def test_killed_and_resumed_gives_the_same(tmp_path: Path, table: dict[str, Array], ident: Callable[..., Any]) -> None:
    path, out = write_csv(tmp_path / "log.csv", table), tmp_path / "out"
    process = subprocess.Popen([sys.executable, "-c", SLOW, *FIT, "--log", str(path), "--out", str(out)], stderr=subprocess.DEVNULL)
    record = out / "checkpoint" / "fit-0" / "read.json"
    deadline = time.monotonic() + 30
    while not (record.exists() and json.loads(record.read_text())["kept"] > 2000) and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert 0 < json.loads(record.read_text())["kept"] < len(table["t"])
    refused = ident(*FIT, "--log", path, "--out", out)
    assert refused.code == 2
    assert "--resume" in refused.err
    other = ident(*FIT, "--log", path, "--out", out, "--resume", "--cutoff", "5")
    assert other.code == 2
    assert "other work" in other.err
    resumed = ident(*FIT, "--log", path, "--out", out, "--resume")
    assert resumed.code == 0, resumed.err
    whole = ident(*FIT, "--log", path, "--out", tmp_path / "whole")
    assert whole.code == 0
    found = [json.loads((folder / "fit.json").read_text()) for folder in (out, tmp_path / "whole")]
    for one in found:
        one.pop("created"), one.pop("checksum")  # the one is of the clock, the other of all fields with it
    assert found[0] == found[1]
    assert not (out / "checkpoint").exists()


def test_jobs_do_not_change_the_result(tmp_path: Path, table: dict[str, Array]) -> None:
    path = write_csv(tmp_path / "log.csv", table)
    study = Study.from_flags(robot="puma560", logs=[path])
    found = []
    for jobs in (1, 3):
        session = StreamedSession.of(study, jobs=jobs)
        found.append(session.estimate)
        session.checkpoint.remove()
    assert np.array_equal(found[0].values, found[1].values)
    assert np.array_equal(found[0].covariance, found[1].covariance)


def test_a_folder_that_is_no_checkpoint_is_left_alone(tmp_path: Path) -> None:
    from ident.streaming.checkpoint import Checkpoint

    (tmp_path / "checkpoint").mkdir()
    (tmp_path / "checkpoint" / "mine.txt").write_text("x")
    with pytest.raises(ConfigurationError, match="no checkpoint"):
        Checkpoint.beside(tmp_path, {}, resume=True, force=True)
    assert (tmp_path / "checkpoint" / "mine.txt").exists()
