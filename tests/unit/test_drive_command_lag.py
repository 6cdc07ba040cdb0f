"""Drives that smooth their commands by a first-order filter: its output, what a log determines of it, and what an export says."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drive_pendulum import astray, model_of, pendulum, written
from rigid_models import needs_native
from scipy.signal import lsim, lti

import ident
from benchmarks.actuators import commanded
from benchmarks.actuators.commanded import commanded_log
from ident.drives import DriveFit, DriveLaw, fit_drives
from ident.drives.given import CommandForm
from ident.drives.sent import at_instants, means
from ident.drives.torque import with_torque

TRUTH = {"kp": 25.0, "kd": 0.8, "Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "delay": 0.006, "lag": 0.018}
GAINS = {"kp": 25.0, "kd": 0.8}


@pytest.fixture(scope="module")
def robot():
    return pendulum()


def log_of(seed: int, **more) -> ident.Log:
    return commanded_log(pendulum(), {**TRUTH, **more}, seed=seed, rate=200, before=1.0, name=f"run{seed}")


def fitted(robot, log, **given) -> DriveFit:
    return fit_drives(ident.LogSet((log,)), model_of(robot), DriveLaw.of(robot, **{**GAINS, **given}))


def corners(form: CommandForm, lag: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times and values of a command at uneven samples, and what scipy's filter makes of it, delayed by 7 ms, every 10 µs."""
    rng = np.random.default_rng(3)
    t = 1e-3 * np.concatenate([[0], np.sort(rng.choice(np.arange(1, 400), 30, replace=False))])
    values, late = rng.normal(size=len(t)), 700
    fine = 1e-5 * np.arange(50_000)
    held = values[np.searchsorted(t, fine + 1e-9, side="right") - 1] if form == CommandForm.STAIRCASE else np.interp(fine, t, values)
    held = np.concatenate([np.full(late, values[0]), held])[: len(fine)]
    _, found, _ = lsim(lti([1.0], [lag, 1.0]), held - values[0], fine, interp=form == CommandForm.RAMP)
    return t, values, found + values[0]


@pytest.mark.parametrize("form", CommandForm)
@pytest.mark.parametrize("lag", [0.03, 0.002])
def test_the_filter_is_exact_between_uneven_samples(form, lag):
    t, values, truth = corners(form, lag)
    both = np.stack([values, 2.0 * values], axis=1)
    late = np.full(2, 0.007)
    found = at_instants(1e-5 * np.arange(50_000), t, both, late, np.array([lag, 0.0]), form)
    np.testing.assert_allclose(found[:, 0], truth, atol=1e-9)
    step = 1e-3
    mean = means(t, both, late, np.array([lag, lag]), step * np.arange(491), step, form)
    np.testing.assert_array_equal(mean[:, 1], 2.0 * mean[:, 0])
    if form == CommandForm.STAIRCASE:
        whole = np.array([np.trapezoid(truth[a : b + 1], dx=1e-5) / step for a, b in pairwise(range(0, 49_100, 100))])
        np.testing.assert_allclose(mean[:, 0], whole, atol=3e-5)
    else:
        np.testing.assert_allclose(mean[:, 0], truth[50:49_050:100], atol=1e-9)


@pytest.mark.parametrize("form", CommandForm)
def test_about_no_filter_the_slope_is_the_same_on_both_sides(form):
    """A difference about zero asks for a time constant below it."""
    t, values, _ = corners(form, 0.01)
    edges, late = 1e-3 * np.arange(491), np.zeros(1)

    def mean(lag: float) -> np.ndarray:
        return means(t, values[:, None], late, np.array([lag]), edges, 1e-3, form)

    ahead, behind = (mean(1e-7) - mean(0.0)) / 1e-7, (mean(0.0) - mean(-1e-7)) / 1e-7
    off = np.abs(ahead - behind) > 1e-3 * np.abs(ahead).max()
    assert off.mean() < (0.0 if form == CommandForm.STAIRCASE else 0.01) + 1e-12


@needs_native
def test_a_filter_is_found_beside_the_delay(robot):
    log = log_of(4200)
    fit = fitted(robot, log, command_lag_s="identify")
    assert fit.fit_rms[0] < 6e-4
    assert not astray(fit, {"lag": 0.018, "delay": 0.006, "Ia_joint1": 0.012, "Fc_joint1": 0.15})
    assert fitted(robot, log).fit_rms[0] > 3.0 * fit.fit_rms[0]
    assert fitted(robot, log, command_lag_s=0.018).fit_rms[0] < 6e-4


@needs_native
def test_what_is_fed_forward_is_not_smoothed(robot):
    """kp (q_cmd - q) is -kp q with kp q_cmd fed forward; of a command that stays at nothing the filter makes nothing."""
    log = log_of(4201, lag=0.0)
    sent = np.asarray(log.extra["q_cmd1"])
    forward = replace(log, extra={"q_cmd1": np.zeros_like(sent), "tau_ff1": GAINS["kp"] * sent})
    assert fitted(robot, forward, command_lag_s=0.05).fit_rms[0] < 6e-4


@needs_native
def test_slow_commands_do_not_tell_it_from_a_delay(robot, monkeypatch):
    def slow(seed, seconds, rate, n):
        return 0.5 - 0.5 * np.cos(1.9 * np.arange(round(seconds * rate)) / rate)[:, None]

    monkeypatch.setattr(commanded, "command", slow)
    log = commanded_log(robot, TRUTH, seed=1, rate=200, before=1.0, noise=2e-3)
    fit = fitted(robot, log, command_lag_s="identify")
    entries = {one["name"]: one for one in fit.to_dict()["parameters"]}
    assert not [name for name in ("lag", "delay", "Fv_joint1") if "value" in entries[name]]
    (together,) = (c for c in fit.determination.combinations if c.expression.startswith("Fv_joint1 + "))
    assert set(together.members) == {"Fv_joint1", "lag", "delay"}
    assert together.value == pytest.approx(TRUTH["Fv"] + (TRUTH["kp"] + TRUTH["kd"]) * (TRUTH["lag"] + TRUTH["delay"]), rel=0.05)
    assert together.separated_by == "step commands, or commands of a wider bandwidth"


@needs_native
def test_no_filter_is_no_value(robot):
    """Where there is none, no number is said, but a bound."""
    fit = fitted(robot, log_of(4201, lag=0.0), command_lag_s="identify", delay_s=0.006)
    (entry,) = (one for one in fit.to_dict()["parameters"] if one["name"] == "lag")
    assert entry["verdict"] == "unseen"
    assert entry["below"] < 1e-3


@pytest.mark.parametrize("ki", [0.0, 30.0])
def test_known_constants_give_the_torque(robot, ki):
    """Against a drive in steps of 20 µs; the filter runs beside it, and nothing of ours is used."""
    h, every, sent = 2e-5, 250, commanded.command(5, 2.0, 200, 1)[:, 0]
    q = 0.5 * np.sin(3.0 * h * np.arange(len(sent) * every))
    dq = 1.5 * np.cos(3.0 * h * np.arange(len(sent) * every))
    smooth, wound, torque = sent[0], 0.0, np.empty(len(q))
    for k in range(len(q)):
        torque[k] = 25.0 * (smooth - q[k]) - 0.8 * dq[k] + wound
        wound += h * ki * (smooth - q[k])
        smooth += h / 0.018 * (sent[max(k - 300, 0) // every] - smooth)
    log = ident.Log("run", t=np.arange(len(sent)) / 200, q=q[::every, None], dq=dq[::every, None], extra={"q_cmd1": sent})
    law = DriveLaw.of(robot, "pid_position", delay_s=0.006, command_lag_s=0.018, ki=ki, integral_start=0.0, **GAINS)
    found = with_torque(ident.LogSet((log,)), law, robot)[0].tau["joint"][:, 0]
    np.testing.assert_allclose(found, torque[::every], atol=0.02)


def test_one_for_all_joints_or_one_for_each(leg):
    assert "lag" in names_of(leg, command_lag_s="identify")
    assert {"lag_hip", "lag_knee"} <= set(names_of(leg, command_lag_s=["identify", "identify"]))
    assert "lag_knee" in names_of(leg, command_lag_s={"hip": 0.01, "knee": "identify"})
    assert not [name for name in names_of(leg) if name.startswith("lag")]


@pytest.fixture(scope="module")
def leg():
    return ident.Robot.from_urdf(commanded.LEG)


def names_of(leg, **given) -> list[str]:
    from ident.drives.unknowns import unknowns

    return [one.name for one in unknowns(model_of(leg), DriveLaw.of(leg, **{**GAINS, **given}))]


def test_what_is_refused(robot):
    with pytest.raises(ident.ConfigurationError, match="command_lag_s of joint 'joint1' is negative"):
        DriveLaw.of(robot, command_lag_s=-0.01, **GAINS)
    with pytest.raises(ident.ConfigurationError, match="'command_lag_s'"):
        DriveLaw.of(robot, "voltage", command_lag_s=0.01)


@needs_native
def test_from_a_study_to_simulators(tmp_path, ident):
    written(tmp_path, {"train": log_of(4202), "held": log_of(4203)})
    (tmp_path / "study.toml").write_text(
        '[robot]\nurdf = "pendulum.urdf"\n[drive]\nlaw = "pd_position"\nkp = 25.0\nkd = 0.8\ncommand_lag_s = "identify"\n'
        'effects = ["rotor_inertia", "viscous", "coulomb"]\n[logs]\nfit = ["train.csv"]\nvalidate = ["held.csv"]\n'
    )
    ran = ident("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    found = DriveFit.load(tmp_path / "out/fit.json")
    assert found.law.shared == {"delay_s", "command_lag_s"}
    assert found.heldout_rms[0] < 1e-3
    ran = ident("export", tmp_path / "out/fit.json", tmp_path / "arm.xml", "--to", "mujoco_actuator")
    assert ran.code == 0, ran.err
    assert "set the activations (mjData.act)" in " ".join(ran.out.split())
    assert f'dynprm="{found.value("lag")!r}"' in (tmp_path / "arm.xml").read_text()
    for kind in ("isaaclab", "genesis"):
        ran = ident("export", tmp_path / "out/fit.json", tmp_path / f"arm.{kind}", "--to", kind, "--log", tmp_path / "held.csv")
        said = " ".join(ran.out.split())
        assert "not expressible: filter of commands; without it the simulated position changes by 0." in said, kind
        assert "smooth your commands by a first-order filter: joint1 18" in said or "joint1 17.9" in said, kind
    for kind in ("json", "ranges"):
        ran = ident("export", tmp_path / "out/fit.json", tmp_path / f"arm.{kind}", "--to", kind)
        assert ran.code == 0, (kind, ran.err)
    assert '"command_lag_s"' in (tmp_path / "arm.json").read_text()
    assert '"command_lag_joint1"' in (tmp_path / "arm.ranges").read_text()
