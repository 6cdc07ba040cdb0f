"""Drives to which small errors of position are none: what a log determines of the deadband, and what an export says."""

from __future__ import annotations

import numpy as np
import pytest
from drive_pendulum import INERTIA, WEIGHT, astray, model_of, pendulum, written
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import command
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.drives.torque import with_torque

pytestmark = needs_native

TRUTH = {"kp": 25.0, "kd": 0.8, "Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "delay": 0.006, "band": 0.02}
GAINS = {"kp": 25.0, "kd": 0.8}
RATE = 200


@pytest.fixture(scope="module")
def robot():
    return pendulum()


def run(sent: np.ndarray, ki: float = 0.0, limit: float = np.inf, **more: float) -> np.ndarray:
    """Position, speed and torque of the drive (3, N) at the samples, in steps of 20 µs, after a second at rest."""
    t, h, every = {**TRUTH, **more}, 2e-5, 250
    sent = np.concatenate([np.zeros(RATE), sent])
    late, inertia, q, dq, wound, out = round(t["delay"] / h), INERTIA + t["Ia"], 0.0, 0.0, 0.0, []
    for k in range(len(sent) * every):
        error = sent[max(k - late, 0) // every] - q
        felt = max(error - t["band"], 0.0) + min(error + t["band"], 0.0)
        asked = t["kp"] * felt - t["kd"] * dq + wound
        given = min(max(asked, -limit), limit)
        if given == asked or felt * (asked - given) < 0.0:
            wound += h * ki * felt
        if k % every == 0:
            out.append((q, dq, given))
        torque = given - t["Fv"] * dq - WEIGHT * np.sin(q)
        moved, most = dq + h * torque / inertia, h * t["Fc"] / inertia
        dq = 0.0 if abs(moved) <= most else moved - (most if moved > 0.0 else -most)
        q += h * dq
    return np.array(out).T[:, RATE:]


def log_of(seed: int, sent: np.ndarray | None = None, noise: float = 5e-4, **more: float) -> ident.Log:
    sent = command(seed, 5.0, RATE, 1)[:, 0] if sent is None else sent
    q = run(sent, **more)[0] + noise * np.random.default_rng([seed, 1]).standard_normal(len(sent))
    return ident.Log(f"run{seed}", t=np.arange(len(sent)) / RATE, q=q[:, None], extra={"q_cmd1": sent})


def fitted(robot, log, kind: str = "pd_position", **given) -> DriveFit:
    return fit_drives(ident.LogSet((log,)), model_of(robot), DriveLaw.of(robot, kind, **{**GAINS, **given}))


def entry(fit: DriveFit, name: str) -> dict:
    return next(one for one in fit.to_dict()["parameters"] if one["name"] == name)


def test_it_is_found_with_its_interval(robot):
    log = log_of(4200)
    fit = fitted(robot, log, deadband="identify")
    assert fit.fit_rms[0] < 6e-4
    assert not astray(fit, {"deadband_joint1": 0.02, "Ia_joint1": 0.012, "Fc_joint1": 0.15, "delay": 0.006})
    assert fit.value("deadband_joint1") == pytest.approx(0.02, rel=0.02)
    assert fitted(robot, log, deadband=0.02).fit_rms[0] < 6e-4
    assert fitted(robot, log).fit_rms[0] > 3.0 * fit.fit_rms[0]


def test_with_an_integral_and_a_limit(robot):
    """The integral stands still within it, as long as an error is none."""
    log = log_of(4201, ki=30.0, limit=2.0)
    fit = fitted(robot, log, "pid_position", deadband="identify", ki="identify", integral_start=0.0, effort_limit=2.0)
    assert fit.fit_rms[0] < 6e-4
    assert fit.value("deadband_joint1") == pytest.approx(0.02, rel=0.03)
    assert fit.value("ki_joint1") == pytest.approx(30.0, rel=0.03)


def test_where_there_is_none_is_a_bound(robot):
    fit = fitted(robot, log_of(4202, band=0.0), deadband="identify")
    found = entry(fit, "deadband_joint1")
    assert found["verdict"] == "unseen"
    assert found["below"] < 1e-3


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_small_slow_motion_does_not_tell_it_from_dry_friction(robot, seed):
    """A joint that creeps from stop to stop: the drive's error is always the deadband and what friction holds."""
    log = log_of(seed, 0.05 * np.sin(np.arange(1000) / RATE), noise=1e-3)
    fit = fitted(robot, log, deadband="identify", delay_s=0.006)
    for name in ("deadband_joint1", "Fc_joint1"):
        assert "value" not in entry(fit, name)
    (together,) = fit.determination.combinations
    assert together.expression == "Fc_joint1 + 25 deadband_joint1"
    assert abs(together.value - (0.15 + 25.0 * 0.02)) < 4.0 * together.std
    assert "deadband from the drive's settings" in together.separated_by


@pytest.mark.parametrize("ki", [0.0, 30.0])
def test_known_constants_give_the_torque(robot, ki):
    sent = command(7, 3.0, RATE, 1)[:, 0]
    q, dq, torque = run(sent, ki)
    log = ident.Log("run", t=np.arange(len(q)) / RATE, q=q[:, None], dq=dq[:, None], extra={"q_cmd1": sent})
    law = DriveLaw.of(robot, "pid_position", delay_s=0.006, deadband=0.02, ki=ki, integral_start=0.0, **GAINS)
    found = with_torque(ident.LogSet((log,)), law, robot)[0].tau["joint"][:, 0]
    # What the integral holds after the second before the log is not known to it.
    np.testing.assert_allclose(found, torque, atol=0.05 if ki else 1e-9)


def test_what_is_refused(robot):
    with pytest.raises(ident.ConfigurationError, match="deadband of joint 'joint1' is negative"):
        DriveLaw.of(robot, deadband=-0.01, **GAINS)
    for law, given in (("voltage", {}), ("pd_velocity", {"kd": 1.0})):
        with pytest.raises(ident.ConfigurationError, match="'deadband'"):
            DriveLaw.of(robot, law, deadband=0.01, **given)


def test_from_a_study_to_simulators(tmp_path, ident):
    written(tmp_path, {"train": log_of(4203), "held": log_of(4204)})
    (tmp_path / "study.toml").write_text(
        '[robot]\nurdf = "pendulum.urdf"\n[drive]\nlaw = "pd_position"\nkp = 25.0\nkd = 0.8\ndeadband = { joint1 = "identify" }\n'
        'effects = ["rotor_inertia", "viscous", "coulomb"]\n[logs]\nfit = ["train.csv"]\nvalidate = ["held.csv"]\n'
    )
    out = tmp_path / "out"
    ran = ident("fit", tmp_path / "study.toml", "--out", out)
    assert ran.code == 0, ran.err
    assert DriveFit.load(out / "fit.json").heldout_rms[0] < 1e-3
    for kind in ("mujoco_actuator", "isaaclab", "genesis", "mjlab"):
        ran = ident("export", out / "fit.json", tmp_path / f"arm.{kind}", "--to", kind, "--log", tmp_path / "held.csv")
        assert ran.code == 0, (kind, ran.err)
        said = " ".join(ran.out.split())
        assert "not expressible: deadband: up to 0." in said, kind
        assert "without it the simulated position changes by 0." in said, kind
        assert "errors of position within ±0.0" in said, kind
    for kind in ("json", "ranges"):
        assert ident("export", out / "fit.json", tmp_path / f"arm.{kind}", "--to", kind).code == 0
    assert '"deadband"' in (tmp_path / "arm.json").read_text()
    assert '"deadband_joint1"' in (tmp_path / "arm.ranges").read_text()
