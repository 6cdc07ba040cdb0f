"""The same motion, whatever the names, the order, the units and the format in which a recorder wrote it."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest

import ident

Array = np.ndarray
N = 300
#: How recorders name position, velocity, torque and desired position of joint {}, and from which number they count.
SCHEMES = (
    ("pos_{}", "vel_{}", "torque_{}", "pos_ref_{}", 0),
    ("q[{}]", "qd[{}]", "tau[{}]", "q_des[{}]", 0),
    ("actual.position.{}", "actual.velocity.{}", "actual.effort.{}", "goal.position.{}", 1),
    ("Axis{} Angle", "Axis{} Speed", "Axis{} Moment", "Axis{} Angle Soll", 1),
    ("jointPosition{}", "jointVelocity{}", "jointTorque{}", "commandedPosition{}", 1),
    ("state/{}/pos", "state/{}/vel", "state/{}/eff", "target/{}/pos", 0),
    ("meas_q{}_act", "meas_dq{}_act", "meas_tau{}_act", "cmd_q{}_set", 1),
)
FORMATS = ("csv", "semicolon", "tab", "spaces", "gz", "parquet", "npz", "mat", "hdf5", "jsonl")


def written(path: Path, kind: str, table: dict[str, Array]) -> Path:
    """The table in a format."""
    names, rows = list(table), np.column_stack(list(table.values()))
    if kind in ("csv", "semicolon", "tab", "spaces", "gz"):
        mark = {"semicolon": ";", "tab": "\t", "spaces": " "}.get(kind, ",")
        text = "\n".join([mark.join(names), *(mark.join(repr(float(x)) for x in row) for row in rows)]) + "\n"
        path = path.with_suffix(".csv.gz" if kind == "gz" else ".csv")
        path.write_bytes(gzip.compress(text.encode()) if kind == "gz" else text.encode())
    elif kind == "parquet":
        pa = pytest.importorskip("pyarrow")
        from pyarrow import parquet

        path = path.with_suffix(".parquet")
        parquet.write_table(pa.table(table), path)
    elif kind == "npz":
        path = path.with_suffix(".npz")
        np.savez(path, **{name.replace("/", "|"): values for name, values in table.items()})
    elif kind == "mat":
        from scipy.io import savemat

        path = path.with_suffix(".mat")
        savemat(path, {"log": {"".join(c if c.isalnum() else "_" for c in name): values for name, values in table.items()}})
    elif kind == "hdf5":
        h5py = pytest.importorskip("h5py")
        path = path.with_suffix(".h5")
        with h5py.File(path, "w") as file:
            for name, values in table.items():
                file[name] = values
    else:
        path = path.with_suffix(".jsonl")
        path.write_text("\n".join(json.dumps(dict(zip(names, map(float, row), strict=True))) for row in rows))
    return path


@pytest.mark.parametrize("seed", range(40))
def test_a_log_in_a_random_dialect(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng([77, seed])
    n = int(rng.integers(2, 8))
    t = 0.01 * np.arange(N)
    w = rng.uniform(1.0, 4.0, n)
    q = rng.uniform(0.3, 1.0, n) * np.sin(np.outer(t, w) + rng.uniform(0, 6, n))
    dq = np.gradient(q, t, axis=0)
    tau = 5.0 * np.cos(np.outer(t, w)) + rng.normal(size=(N, n))
    position, velocity, torque, wanted, first = SCHEMES[int(rng.integers(len(SCHEMES)))]
    kind = FORMATS[seed % len(FORMATS)]
    if kind == "spaces":
        position, velocity, torque, wanted = (name.replace(" ", "_") for name in (position, velocity, torque, wanted))
    degrees, milliseconds = bool(rng.integers(2)), bool(rng.integers(2))
    angle = 180 / np.pi if degrees else 1.0
    # Degrees are told by positions beyond two turns' worth of radians.
    assert not degrees or np.abs(angle * q).max() > 14
    clock = "time_ms" if milliseconds else "time"
    columns: dict[str, Array] = {clock: (1e3 if milliseconds else 1.0) * (t + 50.0)}
    groups = [(position, angle * q), (torque, tau), (wanted, angle * (q + 0.01))]
    if rng.integers(2):
        groups.append((velocity, angle * dq))
    if rng.integers(2):
        groups.append(("temperature_{}", 30 + rng.normal(size=(N, n))))
    rng.shuffle(groups)  # type: ignore[arg-type]
    for name, values in groups:
        columns |= {name.format(first + j): values[:, j] for j in range(n)}
    (log,) = ident.read_logs(written(tmp_path / "log", kind, columns))
    np.testing.assert_allclose(log.t - log.t[0], t, atol=1e-9)
    np.testing.assert_allclose(log.q, q, atol=1e-12)
    if log.dq is not None:
        np.testing.assert_allclose(log.dq, dq, atol=1e-10)
    assert (log.dq is not None) == any(name == velocity for name, _ in groups)
    np.testing.assert_allclose(log.tau["joint"], tau, atol=1e-12)
    for j in range(n):
        np.testing.assert_allclose(log.extra[f"q_ref{j + 1}"], q[:, j] + 0.01, atol=1e-12)
