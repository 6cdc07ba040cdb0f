"""Files of named arrays that hold several recordings, or tell their sampling by a number instead of a time."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import ident

Array = np.ndarray
N, n, RATE = 240, 3, 200.0
T = np.arange(N) / RATE
_W = 2.0 + 1.3 * np.arange(n)
Q = 0.7 * np.sin(np.outer(T, _W) + np.arange(n))
DQ = 0.7 * _W * np.cos(np.outer(T, _W) + np.arange(n))
TAU = 20.0 * np.cos(np.outer(T, 1.7 * _W)) + 9.0 + 0.1 * np.random.default_rng(0).normal(size=(N, n))


def is_run(log: ident.Log, rows: int = N, share: float = 1.0) -> None:
    np.testing.assert_allclose(log.t - log.t[0], T[:rows], atol=1e-9)
    np.testing.assert_allclose(log.q, share * Q[:rows], atol=1e-9)
    np.testing.assert_allclose(log.tau["joint"], TAU[:rows], atol=1e-9)


def _matlab73(path: Path, runs: list[dict[str, Array]]) -> None:
    """An array of structs as MATLAB's `save -v7.3` lays it out: field by field, each a matrix of references."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w", userblock_size=512) as file:
        group, held = file.create_group("runs"), file.create_group("#refs#")
        group.attrs["MATLAB_class"] = np.bytes_("struct")
        for field in runs[0]:
            references = np.zeros((len(runs), 1), h5py.ref_dtype)
            for k, run in enumerate(runs):
                item = held.create_dataset(f"{field}{k}", data=run[field].T)
                item.attrs["MATLAB_class"] = np.bytes_("double")
                references[k, 0] = item.ref
            group.create_dataset(field, data=references, dtype=h5py.ref_dtype).attrs["MATLAB_class"] = np.bytes_("cell")
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, HDF5 schema 1.00 .".ljust(116) + bytes(8) + b"\x00\x02IM")


@pytest.mark.parametrize("kind", ["structs", "cells", "fields", "7.3"])
@pytest.mark.parametrize("equal", [False, True], ids=["lengths differ", "of one length"])
def test_runs_of_a_mat_file_are_logs_of_their_own(tmp_path: Path, kind: str, equal: bool) -> None:
    """Of three runs and three joints: runs of one length were once taken for the joints."""
    from scipy.io import savemat

    rows = [N] * 3 if equal else [100, 140, 180]
    runs: list[dict[str, Array]] = [{"t": T[:m, None], "q": (k + 1) / 3 * Q[:m], "tau": TAU[:m]} for k, m in enumerate(rows)]
    path = tmp_path / "a.mat"
    if kind == "structs":
        struct = np.zeros((1, 3), dtype=[("t", "O"), ("q", "O"), ("tau", "O")])
        for k, run in enumerate(runs):
            struct[0, k] = tuple(run.values())
        savemat(path, {"runs": struct})
    elif kind == "cells":
        cells = np.empty((1, 3), object)
        cells[0, :] = runs
        savemat(path, {"trial": cells})
    elif kind == "fields":
        savemat(path, {"exp": {f"run{k + 1}": run for k, run in enumerate(runs)}})
    else:
        _matlab73(path, runs)
    logs = ident.read_logs(path)
    assert [len(log) for log in logs] == rows
    for k, log in enumerate(logs):
        is_run(log, rows[k], (k + 1) / 3)
    second = path / {"structs": "runs(2)", "cells": "trial(2)", "fields": "exp.run2", "7.3": "runs(2)"}[kind]
    is_run(ident.read_logs(second)[0], rows[1], 2 / 3)
    with pytest.raises(ident.DataError, match="holds no recording 'runs\\(9\\)'; it has "):
        ident.read_logs(path / "runs(9)")


def test_structs_of_joints_are_one_run(tmp_path: Path) -> None:
    from scipy.io import savemat

    joints = np.zeros((1, n), dtype=[("q", "O"), ("tau", "O")])
    for j in range(n):
        joints[0, j] = (Q[:, [j]], TAU[:, [j]])
    savemat(tmp_path / "a.mat", {"time": T[:, None], "joint": joints})
    (log,) = ident.read_logs(tmp_path / "a.mat")
    is_run(log)


def test_a_number_behind_a_word_for_runs_counts_no_joints(tmp_path: Path) -> None:
    """Four runs of three joints in one table: of runs beside each other one is read, and the others are said."""
    table = {f"run{r}_{name}{j + 1}": (1 + r) * x[:, j] for r in range(1, 5) for name, x in (("pos", Q), ("torque", TAU)) for j in range(n)}
    np.savetxt(tmp_path / "a.csv", np.column_stack([T, *table.values()]), delimiter=",", header=",".join(["time", *table]), comments="")
    (log,) = ident.read_logs(tmp_path / "a.csv")
    assert log.q is not None
    share = log.q[0, 1] / Q[0, 1]
    np.testing.assert_allclose(log.q, share * Q, rtol=1e-6)
    np.testing.assert_allclose(log.tau["joint"], share * TAU, rtol=1e-6)
    assert any("hold positions" in note for note in log.notes)


TOLD: dict[str, dict[str, float]] = {
    "dt": {"dt": 1 / RATE}, "Ts": {"Ts": 1 / RATE}, "fs": {"fs": RATE}, "SampleTime_ms": {"SampleTime_ms": 1e3 / RATE},
    "dt and fs": {"dt": 1 / RATE, "fs": RATE}, "sampling_rate_hz": {"sampling_rate_hz": RATE},
}  # fmt: skip


@pytest.mark.parametrize("kind", TOLD)
@pytest.mark.parametrize("form", ["npz", "packed npz", "mat", "json", "h5", "h5 attribute"])
def test_a_period_or_a_rate_stands_for_a_time(tmp_path: Path, kind: str, form: str) -> None:
    content: dict[str, Any] = {"q": Q, "tau": TAU}
    path = tmp_path / f"a.{form.rsplit(maxsplit=1)[-1] if 'npz' in form else form.split(maxsplit=1)[0]}"
    if form == "npz":
        np.savez(path, **content, **TOLD[kind])
    elif form == "packed npz":
        np.savez_compressed(path, **content, **TOLD[kind])
    elif form == "mat":
        from scipy.io import savemat

        savemat(path, content | TOLD[kind])
    elif form == "json":
        path.write_text(json.dumps({name: x.tolist() for name, x in content.items()} | TOLD[kind]))
    else:
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["q"], file["tau"] = Q, TAU
            for name, value in TOLD[kind].items():
                if form == "h5":
                    file[name] = value
                else:
                    file.attrs[name] = value
    (log,) = ident.read_logs(path)
    is_run(log)
    assert any("holds no time; " in note and "200 samples per second" in note for note in log.notes)
    is_run(ident.read_logs(path, rate_hz=RATE)[0])


def test_a_period_or_a_rate_in_every_row(tmp_path: Path) -> None:
    from scipy.io import savemat

    table = {f"{name}{j + 1}": x[:, j] for name, x in (("q", Q), ("tau", TAU)) for j in range(n)}

    def read(first: dict[str, Array]) -> ident.Log:
        whole = first | table
        np.savetxt(tmp_path / "a.csv", np.column_stack([*whole.values()]), delimiter=",", header=",".join(whole), comments="", fmt="%.15g")
        return ident.read_logs(tmp_path / "a.csv")[0]

    is_run(read({"fs": np.full(N, RATE)}))
    is_run(read({"dt": np.full(N, 1 / RATE)}))
    is_run(read({"dt_ms": np.diff(T, prepend=0.0) * 1e3}))
    uneven = np.cumsum(0.005 * np.random.default_rng(1).uniform(0.5, 1.5, N))
    np.testing.assert_allclose(np.diff(read({"dt": np.diff(uneven, prepend=0.0)}).t), np.diff(uneven), atol=1e-9)
    np.testing.assert_allclose(np.diff(read({"dt": np.full(N, 1.0), "time": uneven}).t), np.diff(uneven), atol=1e-9)
    savemat(tmp_path / "b.mat", {"t": T[:, None], "q": Q, "tau": TAU, "Ts": 7.0})
    is_run(ident.read_logs(tmp_path / "b.mat")[0])


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"dt": 5.0}, "dt = 5 gives its sampling in an unknown unit.*--rate-hz 200\\) if it is in ms"),
        ({"dt": 0.001, "control_freq": 20.0}, "dt = 0.001, control_freq = 20, and it is not clear"),
        ({"gain": 5.0}, "holds no time: give its sample rate"),
    ],
)
def test_what_does_not_tell_the_sampling_is_asked(tmp_path: Path, told: dict[str, float], said: str) -> None:
    np.savez(tmp_path / "a.npz", q=Q, tau=TAU, **told)
    with pytest.raises(ident.DataError, match=said):
        ident.read_logs(tmp_path / "a.npz")


def test_a_counter_of_rows_is_no_period(tmp_path: Path) -> None:
    np.savetxt(
        tmp_path / "a.csv", np.column_stack([np.arange(N), Q, TAU]), delimiter=",", comments="", header="timestep,q1,q2,q3,tau1,tau2,tau3"
    )
    with pytest.raises(ident.DataError, match="no time column"):
        ident.read_logs(tmp_path / "a.csv")


@pytest.mark.parametrize(
    "kind", ["npz", "packed npz", "number behind", "mat", "json list", "json of one", "json by name", "json in a field"]
)
def test_runs_in_flat_names_and_lists(tmp_path: Path, kind: str) -> None:
    """`run1_q`, and a list of tables: each is a log of its own, whatever the lengths."""
    rows = [150, 200, N] if kind != "json of one" else [N]
    runs = [{"t": T[:m], "q": (k + 1) / 3 * Q[:m], "tau": TAU[:m]} for k, m in enumerate(rows)]
    flat = {f"run{k + 1}_{name}": x for k, run in enumerate(runs) for name, x in run.items()}
    path = tmp_path / ("a.json" if "json" in kind else "a.mat" if kind == "mat" else "a.npz")
    lists = [{name: x.tolist() for name, x in run.items()} for run in runs]
    if kind == "npz":
        np.savez(path, **flat)
    elif kind == "packed npz":
        np.savez_compressed(path, **flat, note=np.array("lab 3"))
    elif kind == "number behind":
        np.savez(path, **{f"{name}_trial_{k}": x for k, run in enumerate(runs) for name, x in run.items()})
    elif kind == "mat":
        from scipy.io import savemat

        savemat(path, flat)
    elif kind == "json by name":
        path.write_text(json.dumps({f"run{k + 1}": run for k, run in enumerate(lists)}))
    else:
        path.write_text(json.dumps({"robot": "z", "runs": lists} if "field" in kind else lists))
    logs = ident.read_logs(path)
    assert len(logs) == len(rows)
    for k, (log, m) in enumerate(zip(logs, rows, strict=True)):
        is_run(log, m, (k + 1) / 3)


def test_runs_of_npz_are_streamed_as_they_are_read(tmp_path: Path) -> None:
    from ident.streaming.ingest import Reading, store_logs

    path = tmp_path / "a.npz"
    arrays = {"t": T, "q": np.hstack([Q, 0.5 * Q]), "tau": np.hstack([TAU, TAU])}
    np.savez(path, **{f"run{k}_{name}": x[: 100 + k] for k in (1, 2) for name, x in arrays.items()})
    robot = ident.load_robot("puma560")
    for whole in ident.read_logs(path, robot):
        inside = Path(whole.source) / whole.name
        stored = list(store_logs(inside, tmp_path / whole.name, Reading(robot, None, "refuse", jobs=1)))
        np.testing.assert_array_equal(stored[0].read(0, len(stored[0])).q, whole.q)
    with pytest.raises(ident.DataError, match=r"holds no recording 'run7'; it has run1, run2"):
        ident.read_logs(path / "run7")


def test_messages_with_lists_are_no_runs(tmp_path: Path) -> None:
    messages = [{"stamp": t, "position": q, "effort": tau} for t, q, tau in zip(T.tolist(), Q.tolist(), TAU.tolist(), strict=True)]
    (tmp_path / "a.json").write_text(json.dumps(messages))
    (log,) = ident.read_logs(tmp_path / "a.json")
    is_run(log)
