"""Problem: blocks, the kernel's short way, and predictions against the plain columns."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from ident.effects.motion import Motion
from ident.effects.offset import Offset
from ident.errors import ConfigurationError, DataError
from ident.estimators import WeightedLeastSquares
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.logs.log import Log, LogSet
from ident.problem.information import Information
from ident.robots import nominal_values
from ident.robots.robot import Robot
from ident.signals import Recorded, ZeroPhase

SECONDS, RATE = 20.0, 200.0


@pytest.fixture(scope="module")
def puma() -> Robot:
    return ident.load_robot("puma560")


def motion(robot: Robot, seed: int) -> Motion:
    """Analytic Fourier motion."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, SECONDS, 1 / RATE)
    q, dq, ddq = (np.zeros((len(t), robot.n)) for _ in range(3))
    for h in range(1, 7):
        w = 2 * np.pi * 0.1 * h
        a, b = rng.normal(size=(2, robot.n)) * 0.6 / np.sqrt(h)
        q += a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None]
        dq += w * (a * np.cos(w * t)[:, None] - b * np.sin(w * t)[:, None])
        ddq -= w * w * (a * np.sin(w * t)[:, None] + b * np.cos(w * t)[:, None])
    return Motion.of(robot, q, dq, ddq, t)


@pytest.fixture(scope="module")
def case(puma: Robot):
    model = puma.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    values = nominal_values(model)
    m = motion(puma, 1)
    return model, values, m, model.torque(m, values)


def log(case, tau: np.ndarray | None = None) -> LogSet:
    model, _, m, clean = case
    return LogSet((Log(name="run", t=m.t, q=m.joint.q, tau={"motor": clean if tau is None else tau}),), model.robot)


@pytest.mark.parametrize("decimate", [True, False])
def test_information_equals_that_of_all_columns_at_once(case, decimate: bool) -> None:
    model = case[0]
    problem = ident.Problem(model, ZeroPhase(cutoff_hz=10, decimate=decimate)(log(case)))
    direct = Information.empty(6, problem.base.names)
    for rows in problem.rows():
        direct = direct.with_rows(rows.columns, rows.tau, rows.valid)
    assert np.array_equal(problem.information.counts, direct.counts)
    for a, b in zip(problem.information.factors, direct.factors, strict=True):
        assert a.T @ a == pytest.approx(b.T @ b, rel=1e-10, abs=1e-10 * np.abs(b.T @ b).max())


def test_noise_free_log_gives_all_52_parameters_to_1e_8(case) -> None:
    model, values, m, tau = case
    logs = LogSet((Log(name="run", t=m.t, q=m.joint.q, dq=m.joint.dq, ddq=m.joint.ddq, tau={"motor": tau}),), model.robot)
    estimate = WeightedLeastSquares().solve(ident.Problem(model, Recorded()(logs)))
    truth = model.base.base_values(values)
    assert len(truth) == 52
    assert estimate.values == pytest.approx(truth, rel=1e-8)


def test_derivatives_of_a_noise_free_log_cost_less_than_1e_6(case) -> None:
    model, values, _, _ = case
    estimate = WeightedLeastSquares().solve(ident.Problem(model, ZeroPhase(cutoff_hz=30)(log(case))))
    assert estimate.values == pytest.approx(model.base.base_values(values), rel=1e-6)


def test_prediction_is_the_columns_times_the_values(case) -> None:
    model, values, _, _ = case
    problem = ident.Problem(model, ZeroPhase(cutoff_hz=10)(log(case)))
    base = problem.base.base_values(values)
    assert np.nanmax(np.abs(problem.residual(base))) < 1e-6 * np.abs(problem.tau).max()


def test_signals_of_another_robot_are_refused(case, puma: Robot) -> None:
    other = ident.load_robot("scara")
    with pytest.raises(ConfigurationError, match="the model is of"):
        ident.Problem(other.rigid_body(), ZeroPhase(cutoff_hz=10)(log(case)))


def test_a_log_without_torque_is_refused(case) -> None:
    nothing = np.full_like(case[3], np.nan)
    with pytest.raises(DataError):
        ident.Problem(case[0], ZeroPhase(cutoff_hz=10)(log(case, nothing))).information  # noqa: B018


def test_check_counts_and_names_what_is_poorly_excited(case) -> None:
    model = case[0] + Offset()
    check = ident.Problem(model, ZeroPhase(cutoff_hz=10)(log(case))).check()
    assert check.base.count == check.rank == 58
    assert check.agreement
    assert set(check.poor) <= set(check.base.names)
    assert "58 base parameters" in str(check)


@pytest.mark.slow
@pytest.mark.parametrize("colour", [0.0, 0.9])
@pytest.mark.parametrize("counts", [None, 1000.0])
def test_intervals_cover_the_truth_at_their_rate(case, colour: float, counts: float | None) -> None:
    """200 logs with encoder quantisation and torque noise: 92 to 98 % of the 95 % intervals of each group hold the truth."""
    from scipy.signal import lfilter

    model, values, _, _ = case
    robot = model.robot
    long = [motion(robot, seed) for seed in (1, 2)]
    truth = model.base.base_values(values)
    clean = [model.torque(m, values) for m in long]
    level = 0.03 * np.sqrt(np.mean(np.concatenate(clean) ** 2, axis=0))
    inside = []
    for run in range(200):
        rng = np.random.default_rng(run)
        logs = []
        for i, (m, tau) in enumerate(zip(long, clean, strict=True)):
            noise = lfilter([np.sqrt(1 - colour**2)], [1, -colour], rng.normal(size=tau.shape), axis=0) * level
            step = 2 * np.pi / counts if counts else 0.0
            q_motor = np.round((m.motor.q + rng.uniform(0, step, robot.n)) / step) * step if counts else m.motor.q
            logs.append(Log(name=f"run{i}", t=m.t, q_motor=q_motor, tau={"motor": tau + noise}))
        estimate = WeightedLeastSquares().solve(ident.Problem(model, ZeroPhase()(LogSet(tuple(logs), robot))))
        low, high = estimate.confidence_interval().T
        inside.append((low <= truth) & (truth <= high))
    covered = np.mean(inside, axis=0)
    groups = np.array([name.split("_")[0] for name in model.base.names])
    for group in dict.fromkeys(groups):
        assert 0.92 <= covered[groups == group].mean() <= 0.98, (group, covered[groups == group])


@pytest.mark.parametrize("size", [2.0, 0.05])
def test_rows_of_a_sticking_joint_are_left_out_and_others_stay(case, size: float) -> None:
    """Torque disturbed only where joint 3 reverses, much and little: its rows near reversals go, those of the other joints stay."""
    model, values, m, clean = case
    rng = np.random.default_rng(0)
    tau = clean + 0.01 * np.sqrt(np.mean(clean**2, axis=0)) * rng.normal(size=clean.shape)
    slow = np.abs(m.joint.dq[:, 2]) < 0.03 * np.abs(m.joint.dq[:, 2]).max()
    # A constant sign for each reversal: noise that changes at every sample would be filtered away.
    signs = np.sign(np.sin(np.arange(len(slow)) / 37.0))
    tau[slow, 2] += size * values[model.names.index("Fc_joint3")] * signs[slow]
    signals = ZeroPhase(cutoff_hz=10)(log(case, tau))
    estimate = WeightedLeastSquares().solve(ident.Problem(model, signals))
    quiet = WeightedLeastSquares().solve(ident.Problem(model, ZeroPhase(cutoff_hz=10)(log(case))))
    assert [r.joint for r in estimate.reversals_left_out] == ["joint3"]
    assert quiet.reversals_left_out == ()
    left = estimate.reversals_left_out[0]
    assert f"rows near reversals of joint3 {left.rows} ({100 * left.rows / left.usable:.0f} %)" in estimate.summary()
    kept = WeightedLeastSquares().solve(ident.Problem(model, ZeroPhase(cutoff_hz=10, rows_near_reversals="keep")(log(case, tau))))
    assert kept.reversals_left_out == ()
    assert kept.samples == estimate.samples + left.rows
    assert np.all(np.abs(estimate.values - model.base.base_values(values)) < 5 * estimate.std)
