"""Drives that are sent voltages: a pendulum under known voltages, what its log determines, and what it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drive_pendulum import INERTIA, WEIGHT, model_of, pendulum
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import PENDULUM
from ident.drives import DriveFit, DriveLaw, DriveLog, fit_drives
from ident.drives.torque import with_torque

pytestmark = needs_native

#: s (N m/V), back-EMF (N m s/rad), rotor inertia, viscous and dry friction, delay.
TRUTH = {"s": 0.3, "ke": 0.1, "Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "delay": 0.006}


@pytest.fixture(scope="module")
def robot():
    return pendulum()


def voltages(seed: int, seconds: float, rate: int) -> np.ndarray:
    """(N,) V: sines and steps after half a second of none."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * rate)) / rate
    out = sum(1.2 * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.0)) for f in rng.uniform(0.4, 4.0, 4))
    for _ in range(4):
        out = out + rng.uniform(-2.0, 2.0) * (t > rng.uniform(0.5, seconds))
    return np.where(t < 0.5, 0.0, out)


def driven(seed: int = 0, *, seconds: float = 6.0, rate: int = 200, noise: float = 5e-4, limit: float = np.inf, off: float = 0.0):
    """A log of the pendulum under voltages, integrated in steps of 20 µs; for the last `off` seconds the drive is switched off."""
    sent, every = voltages(seed, seconds, rate), 50_000 // rate
    h, late = 1.0 / (rate * every), round(TRUTH["delay"] * rate * every)
    inertia, q, dq, out = INERTIA + TRUTH["Ia"], 0.0, 0.0, []
    enabled = np.arange(len(sent)) < (seconds - off) * rate
    for k in range(len(sent) * every):
        if k % every == 0:
            out.append(q)
        on = enabled[k // every]
        volt = min(max(sent[max(k - late, 0) // every], -limit), limit)
        torque = on * (TRUTH["s"] * volt - TRUTH["ke"] * dq) - TRUTH["Fv"] * dq - WEIGHT * np.sin(q)
        moved, most = dq + h * torque / inertia, h * TRUTH["Fc"] / inertia
        dq = 0.0 if abs(moved) <= most else moved - (most if moved > 0.0 else -most)
        q += h * dq
    q = np.array(out) + noise * np.random.default_rng([seed, 1]).standard_normal(len(out))
    extra = {"voltage1_V": sent} | ({"torque_enable1": enabled.astype(float)} if off else {})
    return ident.Log(f"run{seed}", t=np.arange(len(sent)) / rate, q=q[:, None], extra=extra)


def fitted(robot, *logs, **given) -> DriveFit:
    return fit_drives(ident.LogSet(logs), model_of(robot), DriveLaw.of(robot, "voltage", **given))


def off_by(fit: DriveFit, name: str, true: float) -> float:
    """How many of its standard deviations a determined value is away from the truth."""
    i = fit.names.index(name)
    assert fit.determination.verdicts[i] == "determined", name
    return abs(float(fit.values[i]) - true) / float(fit.determination.std[i])


def test_a_known_load_gives_the_scale_and_back_emf_adds_to_viscous_friction(robot):
    fit = fitted(robot, driven(1))
    for name, true in (("s_joint1", 0.3), ("Ia_joint1", 0.012), ("Fc_joint1", 0.15), ("delay", 0.006)):
        assert off_by(fit, name, true) < 4.0, name
    assert fit.value("s_joint1") == pytest.approx(0.3, rel=0.02)
    (found,) = fit.determination.combinations
    assert found.expression == "Fv_joint1 + ke_joint1"
    assert abs(found.value - 0.18) < 4.0 * found.std
    assert "torque_enable" in found.separated_by
    assert {u.name: u.unit for u in fit.unknowns}["s_joint1"] == "N m/V"


def test_a_swing_without_torque_separates_back_emf(robot):
    fit = fitted(robot, driven(1, off=2.0))
    for name, true in (("ke_joint1", 0.1), ("Fv_joint1", 0.08)):
        assert off_by(fit, name, true) < 4.0, name


def test_without_a_known_load_everything_is_over_the_scale(robot):
    fit = fitted(robot, driven(2), links="identify")
    told = {c.expression: c for c in fit.determination.combinations}
    for expression, true in (
        ("(Iyy_joint1 + Ia_joint1) / s_joint1", (INERTIA + 0.012) / 0.3),
        ("(Fv_joint1 + ke_joint1) / s_joint1", 0.18 / 0.3),
        ("Fc_joint1 / s_joint1", 0.15 / 0.3),
    ):
        found = told[expression]
        assert abs(found.value - true) < 4.0 * found.std
        assert "data sheet" in found.separated_by
    for entry in fit.to_dict()["parameters"]:
        assert ("value" in entry) == (entry["name"] == "delay")


def test_millivolts_are_volts(robot):
    log = driven(0, seconds=1.0)
    other = replace(log, extra={"voltage1_mV": 1e3 * log.extra["voltage1_V"]})
    law = DriveLaw.of(robot, "voltage")
    np.testing.assert_allclose(*(DriveLog.of(one, robot, law).tau_ff for one in (log, other)), rtol=1e-12)


def test_a_limit_in_volts_clips(robot):
    log = driven(3, limit=3.0)
    right = fitted(robot, log, torque_scale=0.3, back_emf=0.1, effort_limit=3.0)
    assert right.fit_rms[0] < 6e-4 < fitted(robot, log, torque_scale=0.3, back_emf=0.1).fit_rms[0]
    for name, true in (("Ia_joint1", 0.012), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15)):
        assert off_by(right, name, true) < 4.0, name


def test_known_constants_give_the_torque(robot):
    log = driven(4, noise=0.0)
    law = DriveLaw.of(robot, "voltage", torque_scale=0.3, back_emf=0.1, delay_s=0.01, effort_limit=3.0)
    (found,) = with_torque(ident.LogSet((log,)), law, robot)
    sent, speed = np.roll(log.extra["voltage1_V"], 2), np.gradient(log.q[:, 0], log.t)
    clipped = np.abs(sent) >= 3.0
    torque = found.tau["joint"][:, 0]
    assert 0.0 < clipped[2:].mean() < 0.5
    assert np.array_equal(np.isnan(torque[2:]), clipped[2:])
    np.testing.assert_allclose(torque[2:][~clipped[2:]], (0.3 * sent - 0.1 * speed)[2:][~clipped[2:]], atol=1e-12)
    with pytest.raises(ident.ConfigurationError, match="torque_scale"):
        with_torque(ident.LogSet((log,)), DriveLaw.of(robot, "voltage", delay_s=0.0, back_emf=0.1), robot)


def test_what_is_refused(robot):
    log = driven(0, seconds=1.0)
    with pytest.raises(ident.DataError, match=r"column voltage1_V, and the log has none"):
        fitted(robot, replace(log, extra={"supply1_V": log.extra["voltage1_V"]}))
    with pytest.raises(ident.ConfigurationError, match="unknown constant of \\[drive\\] law 'voltage' 'kp'"):
        DriveLaw.of(robot, "voltage", kp=1.0)
    with pytest.raises(ident.ConfigurationError, match="'kd'"):
        DriveLaw.of(robot, "voltage", by_log={"run*": {"kd": 1.0}})


def test_from_csv_to_a_simulator(tmp_path, ident):
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    for seed, name in ((1, "train"), (5, "held")):
        log = driven(seed, seconds=4.0)
        rows = np.column_stack([log.t, log.q, log.extra["voltage1_V"]])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="time_s,q1_rad,voltage1_V", comments="")
    (tmp_path / "study.toml").write_text(
        '[robot]\nurdf = "pendulum.urdf"\n[drive]\nlaw = "voltage"\neffects = ["rotor_inertia", "viscous", "coulomb"]\n'
        '[logs]\nfit = ["train.csv"]\nvalidate = ["held.csv"]\n'
    )
    ran = ident("check", tmp_path / "study.toml")
    assert ran.code == 0, ran.err
    assert "s_joint1" in ran.out
    ran = ident("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    fit = DriveFit.load(tmp_path / "out/fit.json")
    assert fit.law.kind == "voltage"
    assert fit.heldout_rms[0] < 1e-3
    ran = ident("export", tmp_path / "out/fit.json", tmp_path / "arm.xml", "--to", "mujoco_actuator")
    assert ran.code == 0, ran.err
    assert "voltages times torque_scale (joint1 0.3" in ran.out
    text = (tmp_path / "arm.xml").read_text()
    assert "<motor" in text
    for kind in ("isaaclab", "mjlab", "genesis", "usd", "json", "ranges", "urdf"):
        ran = ident("export", tmp_path / "out/fit.json", tmp_path / f"arm.{kind}", "--to", kind)
        assert ran.code == 0, (kind, ran.err)
