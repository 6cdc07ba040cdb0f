"""Velocities beside `q1`, `tau1` under names that are not ours, and joints of hands: read where the numbers say so, and said otherwise."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import ident

Array = np.ndarray
N, n = 400, 2
T = np.arange(N) / 250
_W = np.array([2.0, 3.3])
Q = 0.7 * np.sin(np.outer(T, _W) + np.arange(n))
DQ = 0.7 * _W * np.cos(np.outer(T, _W) + np.arange(n))
TAU = 5.0 * np.cos(np.outer(T, 1.7 * _W)) + 9.0


def written(path: Path, columns: dict[str, Array]) -> Path:
    rows = [",".join(f"{x:.12g}" for x in row) for row in np.column_stack([*columns.values()])]
    path.write_text("\n".join([",".join(columns), *rows]) + "\n")
    return path


def table(names: str, values: Array, noise: float = 0.0) -> dict[str, Array]:
    q = Q + noise * np.random.default_rng(0).normal(size=Q.shape)
    own = {"t": T, **{f"q{j + 1}": q[:, j] for j in range(n)}, **{f"tau{j + 1}": TAU[:, j] for j in range(n)}}
    return own | {names.format(j + 1): values[:, j] for j in range(n)}


@pytest.mark.parametrize("noise", [0.0, 1e-3], ids=["exact", "noisy positions"])
@pytest.mark.parametrize(
    ("names", "unit"),
    [("qd{}", 1.0), ("qdot_{}", 1.0), ("vel{}", 1.0), ("velocity_{} [deg/s]", np.pi / 180), ("actual_speed_{}", 1.0), ("v{}", 1.0)],
)
def test_the_rate_of_the_positions_is_read_whatever_its_name(names: str, unit: float, noise: float, tmp_path: Path) -> None:
    log = ident.read_logs(written(tmp_path / "a.csv", table(names, DQ / unit, noise)))[0]
    np.testing.assert_allclose(log.dq, DQ, atol=1e-9)
    assert any("are the velocities of the positions" in note for note in log.notes)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (Q + 0.02, "follow the positions themselves"),
        (100.0 * DQ, r"are 100 times the velocities, and are not used; if they are velocities, map them under \[columns\]"),
        (np.random.default_rng(1).normal(size=Q.shape), "are not the velocities of these positions"),
    ],
    ids=["desired positions", "of the motors", "noise"],
)
def test_what_is_no_rate_is_not_read_and_said(values: Array, said: str, tmp_path: Path) -> None:
    log = ident.read_logs(written(tmp_path / "a.csv", table("qd{}", values)))[0]
    assert log.dq is None
    assert any(re.search(rf"'qd1'.*{said}", note) for note in log.notes)


def test_our_own_velocities_come_first(tmp_path: Path) -> None:
    own = table("qd{}", 0.5 * DQ) | {f"dq{j + 1}": DQ[:, j] for j in range(n)}
    log = ident.read_logs(written(tmp_path / "a.csv", own))[0]
    np.testing.assert_allclose(log.dq, DQ, atol=1e-9)


@pytest.mark.parametrize("driven", [True, False])
def test_a_joint_named_hand_is_a_joint_where_it_has_a_torque(driven: bool, tmp_path: Path) -> None:
    names = ["Schulter", "Ellbogen", "Hand"]
    q, tau = np.column_stack([Q, 0.3 * np.sin(5 * T)]), np.column_stack([TAU, np.cos(T) if driven else np.zeros(N)])
    columns = {"Zeit [s]": T} | {f"{name} Position [rad]": q[:, j] for j, name in enumerate(names)}
    columns |= {f"{name} Drehmoment [Nm]": tau[:, j] for j, name in enumerate(names)}
    log = ident.read_logs(written(tmp_path / "a.csv", columns))[0]
    assert log.joint_names == tuple(names if driven else names[:2])
    np.testing.assert_allclose(log.q, q[:, : log.n], atol=1e-9)
    assert any(note.partition(": ")[2].startswith("Hand: ") or note.startswith("Hand: ") for note in log.notes) == (not driven)
