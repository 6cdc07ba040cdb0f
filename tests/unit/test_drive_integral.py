"""Drives that integrate their error: what a log of them determines, where the integral begins, and what the limit does to it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from drive_pendulum import INERTIA, LANES, WEIGHT, lanes_of, model_of, pendulum
from rigid_models import needs_native

import ident
from benchmarks.actuators.commanded import LEG, PENDULUM, command
from ident.diagnosis.drives import diagnose_drives
from ident.drives import DriveFit, DriveLaw, DriveLog, fit_drives, simulate
from ident.drives.descent import SimulatedSearch
from ident.drives.links import ElasticLinks, KnownLinks
from ident.drives.plant import DrivePlant
from ident.drives.starts import starts
from ident.drives.torque import with_torque

pytestmark = needs_native

TRUTH = {"kp": 20.0, "ki": 40.0, "kd": 0.8, "Ia": 0.012, "Fv": 0.08, "Fc": 0.15, "delay": 0.006, "offset": 0.0}
KNOWN = {"kp": 20.0, "kd": 0.8, "ki": 40.0}


@pytest.fixture(scope="module")
def robot():
    return pendulum()


def run(sent: np.ndarray, rate: int, *, limit: float = np.inf, off: tuple[float, float] = (0.0, 0.0), start: float = 0.0, **other: float):
    """Positions (N,) of the pendulum and the integral's part of the command (N,), N m, in steps of 20 µs. `start`: the integral at first;
    `off`: seconds between which the drive is switched off."""
    own = TRUTH | other
    every = 50_000 // rate
    h, late = 1.0 / (rate * every), round(own["delay"] * rate * every)
    inertia, q, dq, wound, out = INERTIA + own["Ia"], 0.0, 0.0, start, []
    for k in range(len(sent) * every):
        on = not off[0] <= (k // every) / rate < off[1]
        wound *= on
        if k % every == 0:
            out.append((q, wound))
        error = sent[max(k - late, 0) // every] - q
        asked = own["kp"] * error + wound - own["kd"] * dq
        given = min(max(asked, -limit), limit)
        if given == asked or error * asked < 0.0:
            wound += h * own["ki"] * error
        torque = on * given - own["Fv"] * dq - own["offset"] - WEIGHT * np.sin(q)
        moved, most = dq + h * torque / inertia, h * own["Fc"] / inertia
        dq = 0.0 if abs(moved) <= most else moved - (most if moved > 0.0 else -most)
        q += h * dq
    return np.array(out).T


def driven(seed: int = 0, *, seconds: float = 6.0, rate: int = 200, noise: float = 5e-4, name: str = "", **given) -> ident.Log:
    """A log of the pendulum."""
    sent = command(seed, seconds, rate, 1)[:, 0]
    q, _ = run(sent, rate, **given)
    q = q + noise * np.random.default_rng([seed, 1]).standard_normal(len(q))
    t, off = np.arange(len(sent)) / rate, given.get("off")
    extra = {"q_cmd1": sent} | ({"torque_enable1": 1.0 - ((off[0] <= t) & (t < off[1]))} if off else {})
    return ident.Log(name or f"run{seed}", t=t, q=q[:, None], extra=extra)


def fitted(robot, *logs, offset: bool = False, **given) -> DriveFit:
    model = model_of(robot) + ident.make_effect("offset") if offset else model_of(robot)
    return fit_drives(ident.LogSet(logs), model, DriveLaw.of(robot, "pid_position", **given))


def off_by(fit: DriveFit, name: str, true: float) -> float:
    """How many of its standard deviations a determined value is away from the truth."""
    i = fit.names.index(name)
    assert fit.determination.verdicts[i] == "determined", name
    return abs(float(fit.values[i]) - true) / float(fit.determination.std[i])


def told(fit: DriveFit) -> dict[str, object]:
    return {c.expression: c for c in fit.determination.combinations}


def test_known_gains_and_an_unknown_one_of_the_integral(robot):
    log = driven(1)
    fit = fitted(robot, log, **KNOWN | {"ki": "identify"})
    for name, true in (("ki_joint1", 40.0), ("Ia_joint1", 0.012), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15), ("delay", 0.006)):
        assert off_by(fit, name, true) < 4.0, name
    assert fit.value("ki_joint1") == pytest.approx(40.0, rel=0.01)
    assert {u.name: u.unit for u in fit.unknowns}["ki_joint1"] == "N m/(rad s)"
    assert fit.fit_rms[0] < 6e-4
    # Without the integral the very same log is far from explained.
    plain = fit_drives(ident.LogSet((log,)), model_of(robot), DriveLaw.of(robot, kp=20.0, kd=0.8))
    assert plain.fit_rms[0] > 10 * fit.fit_rms[0]


def test_unknown_gains_have_the_scale_of_the_urdf(robot):
    fit = fitted(robot, driven(1), kp="identify", kd="identify", ki="identify")
    for name, true in (("kp_joint1", 20.0), ("ki_joint1", 40.0), ("Fc_joint1", 0.15), ("delay", 0.006)):
        assert off_by(fit, name, true) < 4.0, name
    both = told(fit)["Fv_joint1 + kd_joint1"]
    assert abs(both.value - 0.88) < 4.0 * both.std
    assert any("gains are identified against the inertial parameters" in text for text in fit.warnings)


def test_without_a_known_load_everything_is_over_kp(robot):
    fit = fitted(robot, driven(2), kp="identify", kd="identify", ki="identify", links="identify")
    for expression, true in (
        ("(Iyy_joint1 + Ia_joint1) / kp_joint1", (INERTIA + 0.012) / 20.0),
        ("(Fv_joint1 + kd_joint1) / kp_joint1", 0.88 / 20.0),
        ("Fc_joint1 / kp_joint1", 0.15 / 20.0),
        ("ki_joint1 / kp_joint1", 2.0),
    ):
        assert abs(told(fit)[expression].value - true) < 4.0 * told(fit)[expression].std, expression
    for entry in fit.to_dict()["parameters"]:
        assert ("value" in entry) == (entry["name"] == "delay")


def test_a_scale_of_torque_is_none_without_a_known_load(robot):
    fit = fitted(robot, driven(2), torque_scale="identify", links="identify", **KNOWN | {"ki": "identify"})
    assert abs(told(fit)["Fc_joint1 / s_joint1"].value - 0.15) < 4.0 * told(fit)["Fc_joint1 / s_joint1"].std
    values = {entry["name"] for entry in fit.to_dict()["parameters"] if "value" in entry}
    assert values == {"delay", "ki_joint1"}  # a gain in the drive's own units, beside others that are known


def test_what_the_integral_begins_with_adds_to_a_constant_torque(robot):
    """A drive that ran before holds an offset by its integral: of the two a log shows the difference, in whatever posture."""
    log = driven(3, offset=0.2, start=0.3)
    fit = fitted(robot, log, offset=True, **KNOWN)
    apart = told(fit)["offset_joint1 - I0_joint1_run3"]
    assert abs(apart.value + 0.1) < 4.0 * apart.std < 0.02
    assert "switched on" in apart.separated_by
    assert "postures" not in apart.separated_by
    values = {entry["name"]: entry.get("value") for entry in fit.to_dict()["parameters"]}
    assert values["offset_joint1"] is None
    assert values["I0_joint1_run3"] is None
    assert off_by(fitted(robot, log, **KNOWN), "I0_joint1_run3", 0.1) < 4.0


def test_switched_on_as_the_log_begins(robot):
    """Where the integral is known to begin with nothing, the offset has a value; so it has beside other logs that begin anywhere."""
    log = driven(3, offset=0.1)
    fit = fitted(robot, log, offset=True, integral_start=0.0, **KNOWN)
    assert off_by(fit, "offset_joint1", 0.1) < 4.0
    more = driven(4, offset=0.1, start=0.2)
    both = fitted(robot, log, more, offset=True, by_log={"run3": {"integral_start": 0.0}}, **KNOWN)
    assert off_by(both, "offset_joint1", 0.1) < 4.0
    assert off_by(both, "I0_joint1_run4", 0.2) < 4.0


def test_logs_that_begin_apart(robot):
    fit = fitted(robot, driven(3, offset=0.2, start=0.3), driven(4, offset=0.2, start=0.1), offset=True, **KNOWN)
    one, other = (told(fit)[f"{first} - I0_joint1_run3"] for first in ("offset_joint1", "I0_joint1_run4"))
    assert abs(one.value + 0.1) < 4.0 * one.std
    assert abs(other.value + 0.2) < 4.0 * other.std


def test_derivatives_of_several_logs_are_taken_together(robot):
    """What one log begins with moves no other: all of them in one simulation."""
    law = DriveLaw.of(robot, "pid_position", **KNOWN)
    logs = [driven(seed, seconds=1.5, name="run") for seed in (5, 6, 7)]
    plant = DrivePlant(model_of(robot), law, tuple(DriveLog.of(log, robot, law) for log in logs))
    assert [u.name for u in plant.unknowns if u.log] == ["I0_joint1_run #1", "I0_joint1_run #2", "I0_joint1_run #3"]
    at, sizes = starts(plant)
    measured = np.concatenate([log.q for log in plant.logs])
    search = SimulatedSearch(plant, measured, sizes, np.ones_like(measured))
    own = np.array([i for i, u in enumerate(plant.unknowns) if u.log])
    assert len(search._slots(own.tolist())) == 1
    together = search.along(at[0], own)
    np.testing.assert_array_equal(together, np.concatenate([search.along(at[0], own[[i]]) for i in range(3)], axis=2))
    ends = np.cumsum([len(log.t) for log in plant.logs])
    for i, part in enumerate(np.split(together, ends[:-1])):
        assert [bool(np.any(part[..., k])) for k in range(3)] == [k == i for k in range(3)]


def test_the_integral_stands_still_at_the_limit(robot):
    log = driven(3, limit=2.0)
    right = fitted(robot, log, effort_limit=2.0, **KNOWN)
    assert right.fit_rms[0] < 6e-4
    for name, true in (("Ia_joint1", 0.012), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15), ("delay", 0.006)):
        assert off_by(right, name, true) < 4.0, name
    assert fitted(robot, log, **KNOWN).fit_rms[0] > 0.01


def test_a_drive_that_is_off_forgets(robot):
    fit = fitted(robot, driven(4, off=(2.0, 3.0), start=0.1), **KNOWN | {"ki": "identify"})
    assert fit.fit_rms[0] < 6e-4
    for name, true in (("ki_joint1", 40.0), ("Fv_joint1", 0.08), ("Fc_joint1", 0.15)):
        assert off_by(fit, name, true) < 4.0, name


def test_logs_that_no_fit_saw_are_replayed_from_what_they_begin_with(robot):
    """Also a later part of a recording, of which a declared start says nothing."""
    fit = fitted(robot, driven(3, offset=0.2, start=0.25), offset=True, **KNOWN)
    assert fit.with_heldout(ident.LogSet((driven(8, offset=0.2, start=0.1),))).heldout_rms[0] < 6e-4
    first, last = ident.LogSet((driven(1),)).split(by="fraction")
    fit = fit_drives(first, model_of(robot), DriveLaw.of(robot, "pid_position", integral_start=0.0, **KNOWN), held=last)
    assert [u.name for u in fit.unknowns] == ["Ia_joint1", "Fv_joint1", "Fc_joint1", "delay"]
    # Its first speed is that of a line through the first readings.
    assert fit.heldout_rms[0] < 1.5e-3


def test_known_constants_give_the_torque(robot):
    """Beside the same drive without the integral: the integral's part, held where the limit holds, gone where the drive is off."""
    sent = command(4, 6.0, 200, 1)[:, 0]
    q, wound = run(sent, 200, limit=2.0, off=(3.0, 3.5), start=0.1)
    t = np.arange(len(q)) / 200
    log = ident.Log("run", t=t, q=q[:, None], extra={"q_cmd1": sent, "torque_enable1": 1.0 - ((t >= 3.0) & (t < 3.5))})
    given = {"kp": 20.0, "kd": 0.8, "delay_s": 0.006, "effort_limit": 2.0}
    law = DriveLaw.of(robot, "pid_position", ki=40.0, integral_start=0.1, **given)
    torques = [with_torque(ident.LogSet((log,)), one, robot)[0].tau["joint"][:, 0] for one in (law, DriveLaw.of(robot, **given))]
    found = torques[0] - torques[1]
    known = np.isfinite(found)
    assert 0.5 < known.mean() < 0.95
    assert np.ptp(wound[known]) > 1.0
    np.testing.assert_allclose(found[known], wound[known], atol=0.02)
    with pytest.raises(ident.ConfigurationError, match="integral_start into \\[drive\\], 0 where the drive is switched on"):
        with_torque(ident.LogSet((log,)), DriveLaw.of(robot, "pid_position", ki=40.0, **given), robot)
    with pytest.raises(ident.ConfigurationError, match="what the integral of the drive law begins with is not known"):
        with_torque(ident.LogSet((log,)).split(by="fraction")[1], law, robot)


def test_a_gain_that_differs_from_the_declared_is_named(robot):
    law = DriveLaw.of(robot, "pid_position", delay_s=0.006, **KNOWN | {"ki": 25.0})
    found = diagnose_drives(ident.LogSet((driven(5),)), model_of(robot), law)
    assert [finding.effect for finding in found.findings] == ["ki"]
    assert found.findings[0].values[0][1] == pytest.approx(40.0, rel=0.03)


def leg_log(seed: int, *, seconds: float = 4.0, rate: int = 200, noise: float = 1e-3) -> ident.Log:
    """A log of the leg's two joints, which act on each other, in steps of 25 µs."""
    sent, every = command(seed, seconds, rate, 2), 40_000 // rate
    h, late = 1.0 / (rate * every), round(0.005 * rate * every)
    gains, drag, level = ((40.0, 60.0, 1.2, 8.0), (20.0, 50.0, 0.5, 3.0)), (0.08, 0.05), (0.15 * h, 0.1 * h)
    q, dq, wound, out = [0.0, 0.0], [0.0, 0.0], [0.1, -0.05], []
    across, far = 0.3 * 0.2 * 0.12, 0.002 + 0.3 * 0.12**2
    near = 0.005 + 1.0 * 0.1**2 + 0.3 * 0.2**2 + far
    for k in range(len(sent) * every):
        if k % every == 0:
            out.append(list(q))
        torque, wanted = [0.0, 0.0], sent[max(k - late, 0) // every].tolist()
        for j, (kp, ki, kd, limit) in enumerate(gains):
            error = wanted[j] - q[j]
            asked = kp * error + wound[j] - kd * dq[j]
            given = min(max(asked, -limit), limit)
            if given == asked or error * asked < 0.0:
                wound[j] += h * ki * error
            torque[j] = given - drag[j] * dq[j]
        turn, weight = across * np.sin(q[1]), 0.3 * 0.12 * 9.81 * np.sin(q[0] + q[1])
        torque[0] -= -turn * (2.0 * dq[0] + dq[1]) * dq[1] + (1.0 * 0.1 + 0.3 * 0.2) * 9.81 * np.sin(q[0]) + weight
        torque[1] -= turn * dq[0] ** 2 + weight
        # The inverse of the inertia matrix, rotors included.
        a, b, d = near + 2.0 * across * np.cos(q[1]) + 0.012, far + across * np.cos(q[1]), far + 0.01
        det = a * d - b * b
        inverse = ((d / det, -b / det), (-b / det, a / det))
        moved = [dq[j] + h * (inverse[j][0] * torque[0] + inverse[j][1] * torque[1]) for j in (0, 1)]
        # Dry friction: impulses within their levels that stop the joints, one after the other.
        impulse = [0.0, 0.0]
        for _ in range(3):
            for j in (0, 1):
                free = moved[j] - inverse[j][0] * impulse[0] - inverse[j][1] * impulse[1]
                impulse[j] = min(max(impulse[j] + free / inverse[j][j], -level[j]), level[j])
        for j in (0, 1):
            speed = moved[j] - inverse[j][0] * impulse[0] - inverse[j][1] * impulse[1]
            dq[j] = 0.0 if abs(impulse[j]) < level[j] else speed
        q = [q[0] + h * dq[0], q[1] + h * dq[1]]
    q = np.array(out) + noise * np.random.default_rng([seed, 1]).standard_normal((len(out), 2))
    extra = {"q_cmd1": sent[:, 0], "q_cmd2": sent[:, 1]}
    return ident.Log("leg", t=np.arange(len(sent)) / rate, q=q, extra=extra)


@pytest.mark.parametrize("known", [True, False])
def test_two_joints_that_act_on_each_other(known):
    robot = ident.Robot.from_urdf(LEG)
    gains = {"kp": [40.0, 20.0], "kd": [1.2, 0.5], "ki": [60.0, 50.0]} if known else {"kp": "identify", "kd": [1.2, 0.5], "ki": "identify"}
    fit = fitted(robot, leg_log(1), effort_limit=[8.0, 3.0], **gains)
    assert np.all(fit.fit_rms < 1.1e-3)
    truth = {"Ia_hip": 0.012, "Ia_knee": 0.01, "Fv_hip": 0.08, "Fv_knee": 0.05, "Fc_hip": 0.15, "Fc_knee": 0.1, "delay": 0.005}
    truth |= {} if known else {"kp_hip": 40.0, "kp_knee": 20.0, "ki_hip": 60.0, "ki_knee": 50.0}
    determined = {u.name for u, v in zip(fit.unknowns, fit.determination.verdicts, strict=True) if v == "determined"}
    assert determined >= {"Fc_hip", "Fc_knee", "delay"} | (set() if known else {"ki_hip", "ki_knee"})
    for name in determined & set(truth):
        assert off_by(fit, name, truth[name]) < 4.0, name


@pytest.mark.parametrize(("joints", "elastic"), [(1, False), (1, True), (3, False), (8, False)])
def test_the_compiled_step_integrates_as_the_plain_one_does(monkeypatch, joints, elastic):
    """At the limit, switched off, behind a spring, one joint from beginning to end and several step by step."""
    pytest.importorskip("ident._native._recursions", reason="the compiled recursions were not built")
    rng = np.random.default_rng(6)
    lanes, n, steps, h = LANES, joints, 500, 0.002
    links, some = lanes_of(n, rng)
    none = np.zeros((lanes, n))
    drives = simulate.LaneDrives(
        armature=some(0.02), viscous=some(0.1), dry=some(0.2), load=none, excess=none, fall=some(0.5), offset=some(0.1), kp=some(20.0),
        kd=some(0.5), limit=some(4.0), back_emf=some(0.05), spring=some(0.5), loss=none, loss_square=none, loss_slow=none, slow=some(0.5),
    )  # fmt: skip
    time = h * np.arange(steps)[:, None, None]
    wanted = np.sin(6.0 * time + rng.uniform(0.0, 6.0, (lanes, n)))
    strength = np.where((time > 0.5) & (time < 0.6), 0.0, 1.0) * np.ones_like(wanted)
    integrals = simulate.LaneIntegrals(some(30.0), wanted, some(0.5))
    groups, target, q = [slice(j, j + 1) for j in range(n)], drives.kp * wanted, none
    if elastic:
        links = ElasticLinks(links, 1, np.array([0]), some(200.0), some(0.1))
        drives, target, q, groups = links.drives(drives), links.widened(target), links.resting(none), links.groups
        integrals, strength = links.integrals(integrals), links.widened(strength)
    moving = lambda own: simulate.simulated(links, drives, target, strength, q, np.zeros_like(q), h, groups, own)  # noqa: E731
    monkeypatch.setenv("IDENT_KERNEL", "native")
    compiled, without = moving(integrals), moving(None)
    monkeypatch.setenv("IDENT_KERNEL", "numpy")
    assert np.abs(compiled - without)[..., :n].max(axis=0).min() > 1e-3  # the integral matters on every joint
    np.testing.assert_allclose(compiled, moving(integrals), atol=1e-9)
    np.testing.assert_allclose(without, moving(None), atol=1e-9)


def test_half_the_step_is_a_quarter_of_its_error(robot):
    """The integral is as much of second order as the rest of a step is."""
    links = KnownLinks(robot, robot.nominal)
    one = lambda x: np.full((1, 1), x)  # noqa: E731
    given = {key: one(0.0) for key in ("dry", "load", "excess", "offset", "back_emf", "spring", "loss", "loss_square", "loss_slow")}
    drives = simulate.LaneDrives(
        armature=one(0.012), viscous=one(0.1), kp=one(20.0), kd=one(0.8), limit=one(np.inf), fall=one(1.0), slow=one(1.0), **given
    )

    def end(h: float) -> np.ndarray:
        count = round(1.0 / h)
        wanted = np.full((count, 1, 1), 0.5)
        integrals = simulate.LaneIntegrals(one(200.0), wanted, one(0.3))
        moved = simulate.simulated(links, drives, 20.0 * wanted, None, one(0.0), one(0.0), h, [slice(0, 1)], integrals)
        return moved[:: count // 50]

    coarse, middle, fine = end(0.004), end(0.002), end(0.001)
    ratio = np.abs(coarse - middle).max() / np.abs(middle - fine).max()
    assert 3.5 < ratio < 4.5


def test_what_is_refused(robot):
    with pytest.raises(ident.ConfigurationError, match="unknown constant of \\[drive\\] law 'pd_position' 'ki'"):
        DriveLaw.of(robot, kp=1.0, ki=1.0)
    with pytest.raises(ident.ConfigurationError, match="'integral_start'"):
        DriveLaw.of(robot, kp=1.0, by_log={"run*": {"integral_start": 0.0}})
    with pytest.raises(ident.ConfigurationError, match="law 'pid_position' needs ki"):
        DriveLaw.of(robot, "pid_position", kp=1.0)
    with pytest.raises(ident.ConfigurationError, match="ki of joint 'joint1' is negative"):
        DriveLaw.of(robot, "pid_position", kp=1.0, ki=-1.0)
    assert DriveLaw.of(robot, "pid_position", kp=1.0, ki=1.0, integral_start=-1.0).constants["integral_start"][0] == -1.0


def test_a_gain_of_none_is_the_law_without(robot):
    log = driven(1, seconds=2.0)
    pid = DriveLaw.of(robot, "pid_position", kp=20.0, kd=0.8, ki=0.0)
    plain = DriveLaw.of(robot, kp=20.0, kd=0.8)
    plants = [DrivePlant(model_of(robot), law, (DriveLog.of(log, robot, law),)) for law in (pid, plain)]
    assert [u.name for u in plants[0].unknowns] == [u.name for u in plants[1].unknowns]
    values = starts(plants[1])[0][0]
    np.testing.assert_array_equal(*(plant.positions(values)[0] for plant in plants))


def test_from_csv_to_simulators(tmp_path, ident):
    (tmp_path / "pendulum.urdf").write_text(PENDULUM)
    for name, log in (("train", driven(1, seconds=4.0)), ("other", driven(2, seconds=4.0)), ("held", driven(5, seconds=4.0))):
        rows = np.column_stack([log.t, log.q, log.extra["q_cmd1"]])
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="time_s,q1_rad,q_cmd1_rad", comments="")
    (tmp_path / "study.toml").write_text(
        '[robot]\nurdf = "pendulum.urdf"\n[drive]\nlaw = "pid_position"\nkp = 20.0\nkd = 0.8\nki = "identify"\n'
        'effects = ["rotor_inertia", "viscous", "coulomb"]\n[drive.by_log.other]\nintegral_start = 0.0\n'
        '[logs]\nfit = ["train.csv", "other.csv"]\nvalidate = ["held.csv"]\n'
    )
    ran = ident("check", tmp_path / "study.toml")
    assert ran.code == 0, ran.err
    assert "ki_joint1, I0_joint1_train" in ran.out.replace("\n  ", " ")
    assert "I0_joint1_other" not in ran.out
    ran = ident("fit", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert ran.code == 0, ran.err
    fit = DriveFit.load(tmp_path / "out/fit.json")
    assert (fit.law.kind, fit.names[-1]) == ("pid_position", "I0_joint1_train")
    assert fit.heldout_rms[0] < 7e-4
    assert "integrates its error" in (tmp_path / "out/report.html").read_text()
    for kind in ("mujoco_actuator", "isaaclab", "mjlab", "genesis", "usd"):
        ran = ident("export", tmp_path / "out/fit.json", tmp_path / f"arm.{kind}", "--to", kind, "--log", tmp_path / "held.csv")
        assert ran.code == 0, (kind, ran.err)
        said = " ".join(ran.out.split())
        assert "not expressible: integral of the error; without it the simulated position changes by 0." in said, kind
        assert "at rest joints stay off their commands: joint1 by up to 0.05" in said
    for kind in ("json", "ranges", "urdf"):
        ran = ident("export", tmp_path / "out/fit.json", tmp_path / f"arm.{kind}", "--to", kind)
        assert ran.code == 0, (kind, ran.err)
    ki = json.loads((tmp_path / "arm.json").read_text())["law"]["ki"]
    assert ki == [pytest.approx(fit.value("ki_joint1"))]
    assert "ki_joint1" in [field["name"] for field in json.loads((tmp_path / "arm.ranges").read_text())["fields"]]


def test_a_saved_fit_is_the_same(tmp_path, robot):
    fit = fitted(robot, driven(3, seconds=2.0), driven(4, seconds=2.0), **KNOWN)
    again = DriveFit.load(fit.save(tmp_path / "fit.json"))
    assert again.names == fit.names
    assert [u.log for u in again.unknowns] == [u.log for u in fit.unknowns]
    log = ident.LogSet((replace(driven(5, seconds=2.0), name="new"),))
    np.testing.assert_allclose(again.replay(log)["new"], fit.replay(log)["new"], atol=1e-12)
