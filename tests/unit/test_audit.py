"""The audit finds what was put into a log, names where, and stays quiet on a good one."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from ident.auditing import Audit, Severity, audit
from ident.logs.log import Log, LogSet
from ident.robots.robot import Robot
from ident.signals.filters import zero_phase_lowpass

Array = np.ndarray
URDF = """<robot name="arm"><link name="base"/><link name="a"/><link name="b"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-2.8" upper="2.8" velocity="6" effort="200"/></joint>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
<limit lower="-0.8" upper="0.8" velocity="2" effort="400"/></joint></robot>"""
#: Link masses, first moments and inertias (Pinocchio's order) that the simulated torque comes from.
INERTIA = np.array([4, 0.8, 0, 0.1, 0.1, 0, 0.3, 0, 0, 0.3, 3, 0.4, 0, 0, 0.05, 0, 0.1, 0, 0, 0.1], float)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_urdf(URDF)


def motion(t: Array) -> tuple[Array, Array, Array]:
    w, amplitude = 2 * np.pi * np.array([[0.23, 0.31], [0.71, 0.57]]), np.array([[1.2, 0.3], [0.5, 0.2]])
    angle = w * t[:, None, None] + np.array([[0.0, 1.0], [2.0, 0.5]])
    return (
        (amplitude * np.sin(angle)).sum(1),
        (amplitude * w * np.cos(angle)).sum(1),
        -(amplitude * w**2 * np.sin(angle)).sum(1),
    )


def good(robot: Robot, rate: float = 500.0, duration: float = 30.0, noise: float = 1e-5) -> Log:
    from ident.regressor.rigid import inverse_dynamics

    rng = np.random.default_rng(0)
    t = np.arange(int(rate * duration)) / rate
    q, v, a = motion(t)
    tau = inverse_dynamics(robot.tree, INERTIA, q, v, a) + 1.2 * v + 2.0 * np.sign(v) + 0.05 * rng.standard_normal(q.shape)
    return Log("good", t, q + noise * rng.standard_normal(q.shape), dq=v, tau={"joint": tau})


def look(log: Log, robot: Robot | None) -> Audit:
    return audit(LogSet((log,)), robot)


def test_a_good_log_is_called_good(robot: Robot) -> None:
    audit = look(good(robot), robot)
    assert audit.ok
    assert not audit.warnings, audit.warnings
    assert {"sample_rate", "standstill", "cutoff", "delay"} <= {f.code for f in audit.findings}
    assert audit.of("sample_rate")[0].value == pytest.approx(500)


def with_q(change: Callable[[Array], Array]) -> Callable[[Log], Log]:
    return lambda log: replace(log, q=change(log.q.copy()), dq=None)


def with_tau(change: Callable[[Array], Array]) -> Callable[[Log], Log]:
    return lambda log: replace(log, tau={"joint": change(log.tau["joint"].copy())})


def put(array: Array, rows: slice | Array, column: int, value: object) -> Array:
    array[rows, column] = value
    return array


def jittered(log: Log, t: Array) -> Log:
    """The same motion sampled at other instants."""
    return replace(log, t=t, q=np.column_stack([np.interp(t, log.t, c) for c in log.q.T]), dq=None)


def thinned(log: Log, share: float, seed: int = 5) -> tuple[Log, int]:
    """The log without a share of its rows, never three in a row, and how many were left out."""
    drop = np.random.default_rng(seed).random(len(log)) < share
    drop[[0, -1]] = False
    for k in np.flatnonzero(drop[2:] & drop[1:-1] & drop[:-2]) + 2:
        drop[k] &= not (drop[k - 1] and drop[k - 2])
    return log.rows(np.flatnonzero(~drop)), int(drop.sum())


CASES: dict[str, tuple[Callable[[Log], Log], str, Severity]] = {
    "jitter": (lambda log: jittered(log, log.t + 4e-4 * np.random.default_rng(1).uniform(-1, 1, len(log))), "", Severity.WARNING),
    "missing_samples": (lambda log: thinned(log, 0.03)[0], "", Severity.WARNING),
    "gaps": (lambda log: log.rows(np.flatnonzero((log.t < 10) | (log.t > 10.5))), "", Severity.WARNING),
    "time_backwards": (lambda log: replace(log, t=put(log.t[:, None].copy(), slice(77, 78), 0, 0.0)[:, 0]), "", Severity.ERROR),
    "time_repeated": (lambda log: replace(log, t=put(log.t[:, None].copy(), slice(77, 78), 0, log.t[76])[:, 0]), "", Severity.ERROR),
    "too_short": (lambda log: log.rows(slice(0, 150)), "", Severity.WARNING),
    "constant": (with_q(lambda q: put(q, slice(None), 0, 0.3)), "shoulder", Severity.WARNING),
    "never_moved": (
        with_q(lambda q: put(q, slice(None), 0, 1e-4 * np.random.default_rng(2).integers(0, 2, len(q)))),
        "shoulder",
        Severity.WARNING,
    ),
    "no_motion": (with_q(lambda q: np.tile(q[:1], (len(q), 1))), "", Severity.ERROR),
    "position_missing": (with_q(lambda q: put(q, slice(5, 6), 1, np.nan)), "slide", Severity.ERROR),
    "unit": (with_q(lambda q: put(q, slice(None), 0, np.degrees(q[:, 0]))), "shoulder", Severity.WARNING),
    "wrapped": (with_q(lambda q: put(q, slice(None), 0, (2 * q[:, 0] + np.pi) % (2 * np.pi) - np.pi)), "shoulder", Severity.INFO),
    "outside_limits": (with_q(lambda q: put(q, slice(None), 0, q[:, 0] + 1.9)), "shoulder", Severity.WARNING),
    "quantisation": (with_q(lambda q: np.round(q / 1e-3) * 1e-3), "slide", Severity.INFO),
    "spike": (with_q(lambda q: put(q, slice(4000, 4001), 1, 0.7)), "slide", Severity.WARNING),
    "standstill": (lambda log: with_q(lambda q: put(q, log.t > 8, 1, q[4001, 1]))(log), "slide", Severity.WARNING),
    "noise": (
        with_q(lambda q: put(q, slice(None), 1, 3e-2 * q[:, 1] + 3e-4 * np.random.default_rng(3).standard_normal(len(q)))),
        "slide",
        Severity.WARNING,
    ),
    "torque_missing": (with_tau(lambda tau: put(tau, slice(None), 0, np.nan)), "shoulder", Severity.WARNING),
    "torque_nan": (with_tau(lambda tau: put(tau, slice(500, 520), 0, np.nan)), "shoulder", Severity.WARNING),
    "torque_constant": (with_tau(lambda tau: put(tau, slice(None), 1, 0.0)), "slide", Severity.WARNING),
    "torque_zero": (with_tau(lambda tau: put(tau, slice(3000, 6000), 1, 0.0)), "slide", Severity.WARNING),
    "torque_spike": (with_tau(lambda tau: put(tau, slice(3333, 3335), 1, 1e6)), "slide", Severity.WARNING),
    "torque_frozen": (with_tau(lambda tau: put(tau, slice(3000, 3400), 1, tau[3000, 1])), "slide", Severity.WARNING),
    "torque_steps": (with_tau(lambda tau: np.round(tau / 2.0) * 2.0), "slide", Severity.WARNING),
    "torque_large": (with_tau(lambda tau: 1000 * tau), "shoulder", Severity.WARNING),
    "saturation": (with_tau(lambda tau: np.clip(tau, [-12, -1e9], [12, 1e9])), "shoulder", Severity.WARNING),
    "velocity_sign": (lambda log: replace(log, dq=-log.dq), "slide", Severity.WARNING),
    "velocity_scale": (lambda log: replace(log, dq=np.degrees(log.dq)), "shoulder", Severity.WARNING),
    "velocity": (lambda log: replace(log, dq=log.dq[:, ::-1]), "shoulder", Severity.WARNING),
}


@pytest.mark.parametrize("code", CASES)
def test_each_fault_is_found_where_it_is(robot: Robot, code: str) -> None:
    fault, where, severity = CASES[code]
    audit = look(fault(good(robot)), robot)
    found = [f for f in audit.of(code) if f.severity == severity and f.where == where]
    assert found, str(audit)
    assert len(found[0].text) > 20
    assert found[0].text.rstrip().endswith((".", ")")), "a whole sentence that says what to do"
    assert audit.ok == (severity != Severity.ERROR)


@pytest.mark.parametrize(("code", "at"), [("gaps", 10.0), ("spike", 8.0), ("torque_spike", 6.666)])
def test_times_are_told_to_the_millisecond_in_logs_stamped_since_1970(robot: Robot, code: str, at: float) -> None:
    fault, _, _ = CASES[code]
    log = fault(good(robot))
    (found,) = look(replace(log, t=log.t + 1.76e9), robot).of(code)
    told = [float(x) for x in re.findall(r"at (\d+\.?\d*) s", found.text)]
    assert told == [pytest.approx(1.76e9 + at, abs=0.1, rel=0)], found.text


def test_a_gap_is_found_in_a_plot_of_a_log_stamped_since_1970(robot: Robot) -> None:
    log = CASES["gaps"][0](good(robot))
    (found,) = look(replace(log, t=log.t + 1.76e9), robot).of("gaps")
    assert "(9.998 s after the first)" in found.text
    (found,) = look(log, robot).of("gaps")
    assert "after the first" not in found.text


@pytest.mark.parametrize("code", ["jitter", "missing_samples", "gaps", "quantisation", "wrapped", "torque_nan", "velocity_scale"])
def test_faults_that_need_no_robot(robot: Robot, code: str) -> None:
    fault, _, _ = CASES[code]
    assert look(fault(good(robot)), None).of(code)


def test_no_fault_raises_the_alarm_of_another(robot: Robot) -> None:
    """Only consequences of a fault come with it (torque of a motion that the positions do not show is unrelated to them)."""
    follow: dict[str, set[str]] = {
        "too_short": {"noise", "cutoff"},
        "constant": {"never_moved"},
        "spike": {"noise"},
        "unit": {"spike", "outside_limits"},
        "wrapped": {"outside_limits"},
        "torque_zero": {"free_motion"},
        "saturation": {"free_motion"},
    }
    for code, (fault, _, severity) in CASES.items():
        if severity == Severity.ERROR:
            continue
        for f in look(fault(good(robot)), robot).findings:
            if f.severity != Severity.INFO and f.code != code:
                assert f.code in follow.get(code, set()) | {"torque_unrelated"}, f"{code}: {f}"


def test_a_small_slip_in_fast_motion_is_told(robot: Robot) -> None:
    log = good(robot)
    at = int(np.argmax(np.abs(np.diff(log.q[1000:-1000, 0])))) + 1000
    slipped = with_q(lambda q: put(q, slice(at, None), 0, q[at:, 0] + 4e-3))(log)
    assert not look(log, robot).of("spike")
    (found,) = look(slipped, robot).of("spike")
    assert found.where == "shoulder"
    assert f"jumps at {log.t[at]:.6g} s" in found.text or f"jumps at {log.t[at - 1]:.6g} s" in found.text
    assert "slipped" in found.text
    assert found.value == pytest.approx(4e-3, rel=0.2)


@pytest.mark.parametrize("share", [2e-4, 0.005, 0.03, 0.15])
@pytest.mark.parametrize("rate", [100.0, 300.0, 1000.0])
def test_missing_samples_are_no_jitter(robot: Robot, rate: float, share: float) -> None:
    log, missing = thinned(good(robot, rate), share)
    assert missing > 0
    audit = look(log, robot)
    (found,) = audit.of("missing_samples")
    assert found.value == pytest.approx(missing / (len(log) + missing))
    assert found.text.startswith(f"{missing} sample{'s are' if missing > 1 else ' is'} missing ({found.value:.2%})")
    assert found.severity == (Severity.WARNING if share > 0.01 else Severity.INFO)
    assert not audit.of("jitter")
    assert not audit.of("gaps")
    assert not audit.of("spike")
    assert audit.of("sample_rate")[0].value == pytest.approx(rate, rel=1e-9)


def test_missing_samples_under_rounded_stamps(robot: Robot) -> None:
    """Stamps in whole milliseconds at 300 Hz make steps of 3 and 4 ms: neither jitter nor a rate of 333 Hz."""
    log, missing = thinned(good(robot, 300.0), 0.03)
    audit = look(replace(log, t=np.round(log.t, 3)), robot)
    assert audit.of("missing_samples")[0].value == pytest.approx(missing / (len(log) + missing))
    assert audit.of("sample_rate")[0].value == pytest.approx(300, rel=1e-4)
    assert not audit.of("jitter")


@pytest.mark.parametrize("share", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("scatter", [0.02, 0.06, 0.1])
@pytest.mark.parametrize("seed", [0, 1])
def test_jitter_and_missing_samples_are_told_apart(robot: Robot, scatter: float, share: float, seed: int) -> None:
    """Instants that scatter about the period by a share of it (standard deviation), with and without rows cut out."""
    whole = good(robot)
    rng = np.random.default_rng(seed)
    log, missing = thinned(jittered(whole, np.sort(whole.t + scatter / 500 * rng.standard_normal(len(whole)))), share, seed)
    audit = look(log, robot)
    # Steps lie between two instants; what multiples hide of them, and resting on few, is left some room.
    assert audit.of("jitter")[0].value == pytest.approx(np.sqrt(2) * scatter, rel=0.05)
    assert audit.of("sample_rate")[0].value == pytest.approx(500, rel=3e-3)
    if share:
        assert audit.of("missing_samples")[0].value == pytest.approx(missing / (len(log) + missing), rel=0.03)
    else:
        assert not audit.of("missing_samples")


@pytest.mark.parametrize("scatter", [0.2, 0.3, 0.5])
def test_wild_jitter_is_not_taken_for_missing_samples(robot: Robot, scatter: float) -> None:
    whole = good(robot)
    rng = np.random.default_rng(8)
    instants = np.sort(whole.t + scatter / 500 * rng.standard_normal(len(whole)))
    late = np.cumsum(1 + scatter * rng.exponential(size=len(whole))) / 500
    for t in (instants, late):
        audit = look(jittered(whole, t), robot)
        assert audit.of("jitter")
        assert not audit.of("missing_samples")


@pytest.mark.parametrize("delay", [-0.012, 0.02])
def test_delay_between_torque_and_motion(robot: Robot, delay: float) -> None:
    log = good(robot)
    tau = np.column_stack([np.interp(log.t - delay, log.t, c) for c in log.tau["joint"].T])
    found = look(replace(log, tau={"joint": tau}), robot).of("delay")[0]
    assert found.severity == Severity.WARNING
    assert found.value == pytest.approx(delay, abs=2e-3)
    assert ("later" if delay > 0 else "earlier") in found.text


def test_the_least_delay_that_would_be_detected_is_said(robot: Robot) -> None:
    """It was said that none can be, whatever its size."""
    log = good(robot)
    told = re.search(r"one below ([\d.]+) ms", look(log, robot).of("delay")[0].text)
    assert told
    least = 1e-3 * float(told[1])
    for times, severity in ((0.6, Severity.INFO), (1.6, Severity.WARNING)):
        tau = np.column_stack([np.interp(log.t - times * least, log.t, c) for c in log.tau["joint"].T])
        assert look(replace(log, tau={"joint": tau}), robot).of("delay")[0].severity == severity
    loud = replace(log, tau={"joint": log.tau["joint"] + 50.0 * np.random.default_rng(1).standard_normal(log.q.shape)})
    assert re.search(r"one of up to [\d.]+ ms would not be", look(loud, robot).of("delay")[0].text)


def test_noise_of_the_torque_is_no_delay() -> None:
    """Between two samples interpolation would take half of it away, and what is left be least there: of such logs, half were said to be
    late."""
    one = Robot.from_urdf(
        '<robot name="one"><link name="base"/><link name="a"><inertial><mass value="3"/>'
        '<inertia ixx="0.04" iyy="0.04" izz="0.04" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="j" type="revolute">'
        '<parent link="base"/><child link="a"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="9" effort="99"/></joint></robot>'
    )
    t = np.arange(1000) / 100.0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        w, phase, size = 2 * np.pi * rng.uniform(0.1, 0.5, 4), rng.uniform(0, 6, 4), rng.normal(scale=0.2, size=4)
        angle = w * t[:, None] + phase
        q, v, a = (np.sum(x, axis=1) for x in (size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle)))
        tau = 0.04 * a + 2.0 * v + np.sign(v)
        tau += 0.02 * tau.std() * rng.normal(size=len(t))
        log = Log("one", t, q=q[:, None], tau={"joint": tau[:, None]})
        assert [f.severity.value for f in look(log, one).of("delay")] == ["info"], seed


@pytest.mark.parametrize("delay", [-0.008, 0.015])
def test_lag_of_measured_velocity(robot: Robot, delay: float) -> None:
    log = good(robot)
    late = replace(log, dq=motion(log.t - delay)[1])
    for f in look(late, robot).of("velocity_lag"):
        assert f.value == pytest.approx(delay, abs=1e-3)
    assert len(look(late, robot).of("velocity_lag")) == 2


def test_velocity_behind_a_filter_lags(robot: Robot) -> None:
    log = good(robot)
    smooth = zero_phase_lowpass(log.dq, 40.0, 500.0)
    assert not look(replace(log, dq=smooth), robot).of("velocity_lag")


def test_almost_free_motion(robot: Robot) -> None:
    """A pendulum that swings by itself: inertia and gravity cancel, only little torque is left."""
    pendulum = Robot.from_urdf(
        '<robot name="p"><link name="a"/><link name="b"/><joint name="pivot" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 1 0"/></joint></robot>'
    )
    from scipy.integrate import solve_ivp

    t = np.arange(0, 20, 0.002)
    path = solve_ivp(lambda _, x: [x[1], -9.81 * np.sin(x[0]) - 0.02 * x[1]], (0, 20), [1.2, 0.0], t_eval=t, rtol=1e-9)
    rng = np.random.default_rng(0)
    noise = 0.02 * rng.standard_normal((len(t), 1))
    free = Log("free", t, path.y[:1].T, tau={"joint": noise})
    assert look(free, pendulum).of("torque_unrelated"), "nothing but noise drives it"
    pushed = solve_ivp(
        lambda s, x: [x[1], -9.81 * np.sin(x[0]) - 0.02 * x[1] + 0.5 * np.sin(2 * s)], (0, 20), [1.2, 0.0], t_eval=t, rtol=1e-9
    )
    assert look(Log("pushed", t, pushed.y[:1].T, tau={"joint": 0.5 * np.sin(2 * t)[:, None] + noise}), pendulum).of("free_motion")
    w = 2 * np.pi * 0.9
    driven = (np.sin(w * t) * 0.8)[:, None]
    tau = -(w**2) * driven + 9.81 * np.sin(driven)
    assert not look(Log("driven", t, driven, tau={"joint": tau}), pendulum).of("free_motion")


def test_units_without_limits() -> None:
    """Without a robot, angles of more than one and a half turns are asked about; those of a continuous joint are not."""
    t = np.arange(0, 20, 0.002)
    log = Log("x", t, 120 * np.sin(t)[:, None], tau={"joint": np.sin(t)[:, None]})
    assert "degrees" in look(log, None).of("unit")[0].text
    wheel = Robot.from_urdf(
        '<robot name="w"><link name="a"/><link name="b"/><joint name="wheel" type="continuous"><parent link="a"/><child link="b"/>'
        '<axis xyz="0 0 1"/></joint></robot>'
    )
    turning = replace(log, q=(3 * t)[:, None])
    assert not look(turning, wheel).of("unit")


def test_millimetres() -> None:
    slide = Robot.from_urdf(URDF)
    log = good(slide)
    q = log.q.copy()
    q[:, 1] *= 1000
    found = look(replace(log, q=q, dq=None), slide).of("unit")[0]
    assert found.where == "slide"
    assert '_mm = "' in found.text


def test_one_wrong_sample_says_nothing_about_the_unit(robot: Robot) -> None:
    log = good(robot)
    q = log.q.copy()
    q[5000, 1] = 400.0
    audit = look(replace(log, q=q, dq=None), robot)
    assert audit.of("spike")
    assert not audit.of("unit")


def test_notes_of_reading_are_findings(robot: Robot) -> None:
    log = replace(good(robot), notes=("log x: 3 rows repeat the time stamp.",))
    assert "3 rows repeat" in look(log, robot).of("repaired")[0].text


def test_no_torque_at_all(robot: Robot) -> None:
    audit = look(replace(good(robot), tau={}), robot)
    assert audit.of("torque_missing")[0].severity == Severity.ERROR
    assert not audit.ok


def test_several_runs_are_told_once(robot: Robot) -> None:
    fault, _, _ = CASES["gaps"]
    logs = [replace(fault(good(robot)), name=f"run{k}") for k in range(3)]
    logs[1] = replace(good(robot).rows(np.flatnonzero((good(robot).t < 10) | (good(robot).t > 11.5))), name="run1")
    found = audit(LogSet(tuple(logs)), robot)
    assert len(found.of("gaps")) == 1
    assert found.of("gaps")[0].run == "run1 and 2 more", "the worst is named"
    assert found.of("gaps")[0].value == pytest.approx(1.5, abs=0.01)


def test_table_and_json(robot: Robot) -> None:
    fault, _, _ = CASES["unit"]
    found = look(fault(good(robot)), robot)
    text = str(found)
    assert text.splitlines()[0].startswith("Audit of 1 run (good): ")
    assert max(len(line) for line in text.splitlines()) <= 140
    assert text.index("warning") < text.index("info")
    data = json.loads(json.dumps(found.to_dict()))
    assert data["ok"] is True
    assert {"code", "severity", "where", "run", "text", "value"} == set(data["findings"][0])
    assert any("shoulder" in w for w in found.warnings)


def one_at_a_time(robot: Robot, moving: int, noise: float = 2e-5) -> Log:
    """A run in which one joint moves and a controller holds the other, within the noise of its encoder."""
    from ident.regressor.rigid import inverse_dynamics

    rng = np.random.default_rng(moving)
    t = np.arange(10_000) / 500.0
    q, v, a = (np.where(np.arange(2) == moving, x, 0.0) for x in motion(t))
    tau = inverse_dynamics(robot.tree, INERTIA, q, v, a) + 1.2 * v + 2.0 * np.sign(v) + 0.05 * rng.standard_normal(q.shape)
    return Log(robot.joint_names[moving], t, q + noise * rng.standard_normal(q.shape), tau={"joint": tau})


def test_joints_held_still_on_purpose_are_no_warning(robot: Robot) -> None:
    """Tests of one joint after the other: what is still in one run moves in another; alone, it is warned of."""
    runs = [one_at_a_time(robot, j) for j in (0, 1)]
    held = {f.where for f in look(runs[0], robot).findings if f.severity == Severity.WARNING}
    assert held == {"slide"}
    both = audit(LogSet(tuple(runs)), robot)
    assert not both.warnings, both.warnings
    assert {f.where for f in both.findings if "other runs" in f.text.lower()} == {"shoulder", "slide"}
    # A joint that moves in no run is warned of, however many there are.
    again = audit(LogSet((runs[0], replace(runs[0], name="again"))), robot)
    assert {f.where for f in again.findings if f.severity == Severity.WARNING} == {"slide"}


def test_a_wild_sample_of_torque_does_not_make_its_joint_look_unrelated(robot: Robot) -> None:
    log = good(robot)
    tau = log.tau["joint"].copy()
    tau[3333, 1] = 1e6
    audit = look(replace(log, tau={"joint": tau}), robot)
    assert audit.of("torque_spike")
    assert not audit.of("torque_unrelated")
