"""Real logs, prepared and fitted, against published values and plain baselines (see each log's NOTE)."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.auditing import audit
from ident.auditing.columns import position_jumps
from ident.effects.offset import Offset
from ident.estimators import WeightedLeastSquares
from ident.friction.drive import Coulomb, RotorInertia, Viscous
from ident.logs.log import LogSet
from ident.logs.reading import read_logs
from ident.logs.unwrap import unwrapped
from ident.problem.problem import Problem
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission
from ident.signals import NearReversals, Standstill, ZeroPhase

#: The published values were fitted with the low speeds in: friction there is weaker than the line through higher speeds.
PUBLISHED = Standstill(fraction=0.01, share=0.3)
EMPS = """<robot name="emps"><link name="base"/><link name="car"/><joint name="axis" type="prismatic">
<parent link="base"/><child link="car"/><axis xyz="1 0 0"/></joint></robot>"""


def tx40(folder: Path) -> LogSet:
    drive = json.loads((folder / "tx40/drive.json").read_text())
    transmission = Transmission(np.linalg.inv(np.array(drive["R"])), np.array(drive["joint_offset_rad"]), Side.MOTOR)
    return read_logs(folder / "tx40/tx40_traj1.csv.gz", Robot.from_urdf(folder / "tx40/tx40.urdf", transmission=transmission))


@pytest.mark.parametrize("cutoff", [100.0, None])
def test_emps(data_folder: Path, cutoff: float | None) -> None:
    logs = read_logs(data_folder / "emps/emps_id.csv.gz", Robot.from_urdf(EMPS))
    robot = logs.robot
    assert robot is not None
    # The published fit holds the rows near reversals, which scatter more: on the same rows its values come out.
    signals = ZeroPhase(cutoff_hz=cutoff, standstill=PUBLISHED, rows_near_reversals=NearReversals.KEEP)(logs)
    estimate = WeightedLeastSquares().solve(Problem(robot.rigid_body() + Viscous() + Coulomb() + Offset(), signals))
    found = {p.name.split("_")[0]: v for p, v in zip(estimate.parameters, estimate.values, strict=True)}
    assert found["m"] == pytest.approx(95.11, rel=0.003)
    assert found["Fv"] == pytest.approx(203.5, rel=0.01)
    assert found["Fc"] == pytest.approx(20.39, rel=0.01)
    assert found["offset"] == pytest.approx(-3.16, rel=0.03)
    assert estimate.fit_error.relative_all <= 0.0415
    assert 20 <= (signals.report.cutoff_hz or 0) <= 150


@pytest.mark.parametrize("cutoff", [100.0, None])
def test_tx40(data_folder: Path, cutoff: float | None) -> None:
    logs = tx40(data_folder)
    robot = logs.robot
    assert robot is not None
    prep = ZeroPhase(cutoff_hz=cutoff, standstill=PUBLISHED)
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb() + Offset()
    # The published fit holds the rows near reversals.
    estimate = WeightedLeastSquares().solve(Problem(model, replace(prep, rows_near_reversals=NearReversals.KEEP)(logs)))
    assert estimate.fit_error.relative_all <= 0.059
    # Joints 1 to 4 are not coupled: their friction compares directly, carried to the joint side.
    reference = json.loads((data_folder / "tx40/reference_drive_parameters.json").read_text())
    found = {p.name: v for p, v in zip(estimate.parameters, estimate.values, strict=True)}
    for j, ratio in enumerate((32, 32, 45, 48)):
        assert found[f"Fv_joint_{j + 1}"] * ratio**2 == pytest.approx(reference["fv"][j], rel=0.05)
        assert found[f"Fc_joint_{j + 1}"] * ratio == pytest.approx(reference["fc"][j], rel=0.05)
    first, second = logs.split(by="fraction", held=0.5)
    half = WeightedLeastSquares().solve(Problem(model, prep(first)))
    assert half.torque_error(prep(second)).relative_all <= 0.077


@pytest.mark.parametrize("cutoff", [10.0, None])
def test_panda(data_folder: Path, cutoff: float | None) -> None:
    logs = read_logs(data_folder / "panda_gaz/panda_exciting_traj1.csv.gz", Robot.from_urdf(data_folder / "panda_gaz/panda_mdh.urdf"))
    robot = logs.robot
    assert robot is not None
    prep = ZeroPhase(cutoff_hz=cutoff)
    signals = prep(logs)
    assert "resampled" in signals.report.resampled
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb() + Offset()
    assert WeightedLeastSquares().solve(Problem(model, signals)).fit_error.relative_all <= 0.0156
    first, last = logs.split(by="fraction", held=0.4)
    estimate = WeightedLeastSquares().solve(Problem(model, prep(first)))
    assert estimate.torque_error(prep(last)).relative_all <= 0.0175


def test_chosen_cutoffs_are_those_of_experts(data_folder: Path) -> None:
    """Within a factor of about two of what was chosen by hand for each machine, over two decades."""
    panda = read_logs(data_folder / "panda_gaz/panda_exciting_traj1.csv.gz", Robot.from_urdf(data_folder / "panda_gaz/panda_mdh.urdf"))
    pendulum = Robot.from_urdf(data_folder / "dfki_double_pendulum/dp_designA.urdf")
    slow = read_logs(data_folder / "dfki_double_pendulum/dp_A0_0812_slow75s.csv.gz", pendulum)
    fast = read_logs(data_folder / "dfki_double_pendulum/dp_A0_0812_exc1.csv.gz", pendulum)
    for logs, expert in ((tx40(data_folder), 100), (panda, 10), (slow, 8), (fast, 8)):
        chosen = ZeroPhase()(logs).report.cutoff_hz
        assert expert / 2.5 < chosen < 2.5 * expert, (logs.names, chosen)


def test_audit_of_tx40_panda_and_pendulum(data_folder: Path) -> None:
    found = audit(tx40(data_folder))
    assert found.ok
    assert not found.of("unit")
    panda = Robot.from_urdf(data_folder / "panda_gaz/panda_mdh.urdf")
    found = audit(read_logs(data_folder / "panda_gaz/panda_exciting_traj1.csv.gz", panda))
    assert found.of("jitter")[0].value > 0.1
    lags = [f.value for f in found.of("velocity_lag")]
    assert len(lags) >= 6
    assert np.median(lags) == pytest.approx(5.4e-3, abs=1e-3)
    pendulum = Robot.from_urdf(data_folder / "dfki_double_pendulum/dp_designA.urdf")
    swing = audit(read_logs(data_folder / "dfki_double_pendulum/dp_A0_0815_traj00.csv.gz", pendulum))
    assert swing.of("free_motion"), "almost free swings, on which least squares shrinks"
    driven = audit(read_logs(data_folder / "dfki_double_pendulum/dp_A0_0812_slow75s.csv.gz", pendulum))
    assert not driven.of("free_motion")
    assert driven.of("quantisation")[0].value == pytest.approx(2 * np.pi / 4096 / 4, rel=0.02)
    off = audit(read_logs(data_folder / "dfki_double_pendulum/dp_A0_0812_exc1.csv.gz", pendulum))
    assert off.of("torque_zero")[0].value == pytest.approx(0.5, abs=0.01)


def test_no_position_of_a_real_log_jumps(data_folder: Path) -> None:
    files = sorted(data_folder.glob("*/*.csv.gz"))
    assert len(files) >= 19
    for file in files:
        log = read_logs(file)[0]
        q = log.q if log.q is not None else log.q_motor
        for j, x in enumerate(unwrapped(q).T):
            assert len(position_jumps(log.t, x)) == 0, (file.name, j + 1)


def test_tiago_currents_through_a_mapping(data_folder: Path) -> None:
    drive = json.loads((data_folder / "tiago_arm/drive.json").read_text())
    arm = Robot.from_urdf(data_folder / "tiago_arm/tiago_48_schunk_nomesh.urdf", joints=drive["joints"])
    transmission = Transmission(
        np.diag(1 / np.array(drive["reduction_ratio"], float)), np.zeros(arm.n), Side.JOINT, np.array(drive["kmotor"], float)
    )
    robot = arm.with_transmission(transmission)
    logs = read_logs(data_folder / "tiago_arm/tiago_exc.csv.gz", robot, {f"i{j + 1}": f"effort{j + 1}_A" for j in range(robot.n)})
    signals = ZeroPhase(standstill=None)(logs)
    assert 1.0 < signals.report.cutoff_hz < 8.0
    assert any("torque constant" in w for w in signals.report.warnings)
