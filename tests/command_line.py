"""What the command-line tests share: a small robot with logs of an analytic motion, and `ident` run in this process."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

Array = np.ndarray

#: Four joints, the first prismatic, the last without limits; inertials throughout.
ARM = """<?xml version="1.0"?>
<robot name="gantry_arm">
  <link name="base"/>
  <link name="carriage"><inertial><origin xyz="0.02 0.01 0.1"/><mass value="8"/>
    <inertia ixx="0.1" iyy="0.12" izz="0.09" ixy="0.001" ixz="0.002" iyz="0.003"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0.15 0.01 0.02"/><mass value="4"/>
    <inertia ixx="0.02" iyy="0.06" izz="0.06" ixy="0.001" ixz="0" iyz="0"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.12 0.01 0.01"/><mass value="2"/>
    <inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0.001" iyz="0"/></inertial></link>
  <link name="hand"><inertial><origin xyz="0.01 0.02 0.05"/><mass value="0.8"/>
    <inertia ixx="0.004" iyy="0.003" izz="0.002" ixy="0.0001" ixz="0.0002" iyz="0.0002"/></inertial></link>
  <joint name="slide" type="prismatic"><parent link="base"/><child link="carriage"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
    <limit lower="-0.4" upper="0.4" velocity="3" effort="500"/></joint>
  <joint name="shoulder" type="revolute"><parent link="carriage"/><child link="upper"/><origin xyz="0.1 0 0.1" rpy="1.5708 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" velocity="6" effort="100"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.35 0 0"/><axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="6" effort="100"/></joint>
  <joint name="wrist" type="continuous"><parent link="fore"/><child link="hand"/><origin xyz="0.3 0 0" rpy="0 1.5708 0"/>
    <axis xyz="0 0 1"/><limit velocity="12" effort="20"/></joint>
</robot>
"""
JOINTS = ("slide", "shoulder", "elbow", "wrist")
FRICTION = ("--effects", "viscous", "coulomb", "--cutoff", "10")


@dataclass(frozen=True)
class Ran:
    """What one call of the command line gave."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """Standard output as one JSON object: fails if anything else is there."""
        found = json.loads(self.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))
        require_published_form(found)
        return found


@cache
def published_results() -> Any:
    """The published schema of results as a validator; None where jsonschema is not installed."""
    try:
        import jsonschema
    except ImportError:
        return None
    text = (Path(__file__).parents[1] / "docs/results.schema.json").read_text(encoding="utf-8")
    return jsonschema.Draft202012Validator(json.loads(text))


def require_published_form(result: dict[str, Any]) -> None:
    """Fail where a result of ours has another form than docs/results.schema.json says."""
    validator = published_results()
    if validator is not None and str(result.get("schema", "")).startswith("ident."):
        wrong = [f"{'/'.join(map(str, e.absolute_path))}: {e.message[:200]}" for e in validator.iter_errors(result)]
        assert not wrong, f"{wrong}; if the form is meant to change: python docs/tools/make_schemas.py"


@pytest.fixture
def ident(capsys: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    """Run `ident` with these arguments in this process."""
    from ident.cli import main

    def run(*arguments: str | Path) -> Ran:
        capsys.readouterr()
        try:
            code = main([str(a) for a in arguments])
        except SystemExit as leaving:  # argparse
            code = int(leaving.code or 0)
        return Ran(code, *capsys.readouterr())

    return run


@dataclass(frozen=True)
class Arm:
    """The arm's folder: arm.urdf, train.csv, test.csv; `table` is the content of train.csv by column."""

    folder: Path
    table: dict[str, Array]

    @property
    def urdf(self) -> Path:
        return self.folder / "arm.urdf"

    @property
    def train(self) -> Path:
        return self.folder / "train.csv"

    @property
    def test(self) -> Path:
        return self.folder / "test.csv"


def write_csv(path: Path, table: dict[str, Array | list[Any]]) -> Path:
    """A table as CSV, numbers in full."""
    rows = zip(*(list(column) for column in table.values()), strict=True)
    path.write_text("\n".join([",".join(table), *(",".join("" if v is None else str(v) for v in row) for row in rows)]) + "\n")
    return path


def analytic_log(model: Any, values: Array, seed: int, seconds: float = 8.0, rate: float = 200.0, noise: float = 2e-3) -> dict[str, Array]:
    """Positions of a smooth motion and the torque that the model asks for along it, with white noise (a share of its rms)."""
    robot = model.robot
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1 / rate)
    q, dq, ddq = (np.zeros((len(t), robot.n)) for _ in range(3))
    for j, joint in enumerate(robot.joints):
        size, centre = (0.12, 0.0) if joint.prismatic else (0.5, 0.2 * rng.standard_normal())
        if np.isfinite(joint.lower) and np.isfinite(joint.upper):
            centre = 0.5 * (joint.lower + joint.upper)
            size = min(size, 0.25 * (joint.upper - joint.lower))
        q[:, j] = centre
        for k in range(3):
            w = 2 * np.pi * rng.uniform(0.15, 0.9)
            a, phase = size / (k + 1), rng.uniform(0, 2 * np.pi)
            q[:, j] += a * np.sin(w * t + phase)
            dq[:, j] += a * w * np.cos(w * t + phase)
            ddq[:, j] -= a * w**2 * np.sin(w * t + phase)
    tau = model.inverse_dynamics(q, dq, ddq, values)
    tau = tau + noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.standard_normal(tau.shape)
    side = {"motor": "tau_m", "joint": "tau"}[robot.transmission.measured.value]
    return {"t": t} | {f"q{j + 1}": q[:, j] for j in range(robot.n)} | {f"{side}{j + 1}": tau[:, j] for j in range(robot.n)}


@pytest.fixture(scope="session")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Arm:
    """The arm with two logs: friction 2 N m s/rad-ish and Coulomb, no rotor inertia."""
    from ident import Robot
    from ident import friction as fr

    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(ARM)
    robot = Robot.from_urdf(folder / "arm.urdf")
    model = robot.rigid_body() + fr.Viscous() + fr.Coulomb()
    assert robot.nominal is not None
    values = np.concatenate([robot.nominal, [20.0, 1.0, 0.5, 0.1], [10.0, 2.0, 1.0, 0.2]])
    tables = [analytic_log(model, values, seed) for seed in (1, 2)]
    write_csv(folder / "train.csv", tables[0])
    write_csv(folder / "test.csv", tables[1])
    return Arm(folder, tables[0])


@pytest.fixture(scope="session")
def saved_fit(arm: Arm, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """`ident fit --out`'s fit.json."""
    from ident.cli import main

    folder = tmp_path_factory.mktemp("fits") / "result"
    code = main(
        ["fit", "--urdf", str(arm.urdf), "--log", str(arm.train), "--validate", str(arm.test), *FRICTION, "--out", str(folder), "--quiet"]
    )
    assert code == 0
    return folder / "fit.json"


def python() -> list[str]:
    """Command of a fresh interpreter."""
    return [sys.executable]
