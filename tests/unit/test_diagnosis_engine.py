"""The parts of the diagnosis engine against what they stand for: direct refits, brute force, noise of known kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_robots import ROBOTS, declared

from ident.effects.motion import Motion
from ident.effects.registry import make_effect
from ident.logs.log import Log, LogSet
from ident.model import Model
from ident.monitoring.stages.analysis import stretches, thinned, without_reversals
from ident.monitoring.stages.frame import Frame, raw_columns
from ident.monitoring.stages.motion_noise import less_noise
from ident.monitoring.stages.motion_spectrum import noise_share
from ident.monitoring.stages.motions import Motions
from ident.monitoring.stages.spectral import harmonics, promising_orders
from ident.monitoring.stages.whitening import plain_whitener, whitener
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

Array = np.ndarray
RATE = 200.0


def signals(seed: int, noise: float = 0.02, decimate: int | bool = True) -> tuple[Model, Signals]:
    """A log of an arm along sines, with white torque noise, and the model that it is of."""
    rng = np.random.default_rng(seed)
    robot = ROBOTS["scara"]()
    model, values = declared(robot)
    order = np.arange(1, 9)
    weight = (1.0 / order)[:, None] * np.where([j.prismatic for j in robot.joints], 0.1, 1.0)
    motion = FourierTrajectory(np.zeros(robot.n), rng.normal(size=(8, robot.n)) * weight, rng.normal(size=(8, robot.n)) * weight, 0.15)
    t = np.arange(round(20.0 * RATE)) / RATE
    c = motion.sample(t)
    tau = model.torque(Motion.of(robot, c.q, c.dq, c.ddq, t, rate=RATE), values)
    tau = tau + noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    logs = LogSet((Log("run", t, q=c.q, tau={robot.transmission.measured.value: tau}),), robot=robot)
    return model, ZeroPhase(cutoff_hz=15.0, decimate=decimate)(logs)


@pytest.fixture(scope="module")
def frame() -> Frame:
    model, prepared = signals(1)
    problem = Problem(model, prepared)
    return Frame.build(problem, plain_whitener(problem, prepared.tau))


def test_a_score_is_the_exact_refit_and_the_error_on_blocks_left_out(frame: Frame) -> None:
    rng = np.random.default_rng(2)
    n, M, b = frame.columns.shape
    valid = frame.problem.signals.valid.T
    Z = rng.normal(size=(n, M, 2)) * valid[:, :, None]
    Z[0] = 0.0
    score = frame.score(Z)
    X, z, y = frame.columns.reshape(-1, b), Z.reshape(-1, 2), frame.torque.reshape(-1)
    wide = np.concatenate([X, z], axis=1)

    def loss(A: Array, use: Array, at: Array) -> float:
        return float(np.sum((y[at] - A[at] @ np.linalg.lstsq(A[use], y[use], rcond=None)[0]) ** 2))

    everything = np.ones(n * M, bool)
    assert score.fit_gain == pytest.approx(loss(X, everything, everything) - loss(wide, everything, everything), rel=1e-6)
    np.testing.assert_allclose(score.values, np.linalg.lstsq(wide, y, rcond=None)[0][b:], rtol=1e-6)
    assert frame.fit_gain(Z) == pytest.approx(score.fit_gain, rel=1e-6)
    held = 0.0
    for fold in range(frame.n_folds):
        out = np.zeros((n, M), bool)
        for rows, own in zip(frame.block_rows, frame.folds, strict=True):
            out[:, rows] |= own == fold
        out = out.reshape(-1)
        held += loss(X, ~out, out) - loss(wide, ~out, out)
    assert score.heldout == pytest.approx(held, rel=1e-5)


def test_values_that_are_held_are_not_fitted(frame: Frame) -> None:
    rng = np.random.default_rng(3)
    n, M, b = frame.columns.shape
    Z = rng.normal(size=(n, M, 1)) * frame.problem.signals.valid.T[:, :, None]
    X, y = frame.columns.reshape(-1, b), frame.torque.reshape(-1)
    for value in (0.3, -2.0):
        rest = y - value * Z.reshape(-1)
        left = rest - X @ np.linalg.lstsq(X, rest, rcond=None)[0]
        assert frame.fit_gain(Z, np.array([value])) == pytest.approx(frame.loss - float(left @ left), rel=1e-6)


def test_several_candidates_at_once_gain_what_each_gains_by_itself(frame: Frame) -> None:
    rng = np.random.default_rng(7)
    n, M, _ = frame.columns.shape
    Z = rng.normal(size=(n, M, 6)) * frame.problem.signals.valid.T[:, :, None]
    Z[1:] = 0.0
    held = [None, np.array([0.2, -1.0]), None]
    gains, free = frame.fit_gains(Z, 2, held)
    for i, values in enumerate(held):
        own = Z[:, :, 2 * i : 2 * i + 2]
        assert gains[i] == pytest.approx(frame.fit_gain(own, values), rel=1e-9)
        assert free[i] == pytest.approx(frame.fit_gain(own), rel=1e-9)
    nothing, _ = frame.fit_gains(np.zeros((n, M, 4)), 2, [None, None])
    assert nothing.tolist() == [0.0, 0.0]


def test_whitened_noise_is_white_on_its_rows_and_on_others() -> None:
    from scipy.signal import lfilter

    rng = np.random.default_rng(4)
    coloured = lfilter([1.0], [1.0, -0.8, 0.2], rng.normal(size=(6000, 2)), axis=0) * [0.3, 7.0]
    valid = rng.random(coloured.shape) < 0.97
    runs = [slice(0, 3500), slice(3500, 6000)]
    white = whitener(coloured, valid, runs)
    other = ~(np.arange(6000) % 50 < 5)[:, None] & np.ones(2, bool)
    for matrices, use in ((white, valid), (white.on(other, runs), other)):
        for j in range(2):
            rows = matrices(np.where(use[:, j], coloured[:, j], 0.0), j)
            assert not rows[~use[:, j]].any()
            used = rows[use[:, j]]
            assert np.std(used) == pytest.approx(1.0, abs=0.05)
            assert abs(np.corrcoef(used[1:], used[:-1])[0, 1]) < 0.06


@pytest.mark.parametrize("seed", [5, 6])
def test_motion_less_its_noise_does_not_shrink_parameters(seed: int) -> None:
    """Least squares on noisy accelerations shrinks; where each frequency is weighed by its share of motion, it does not."""
    rng = np.random.default_rng(seed)
    _, prepared = signals(seed)
    t = prepared.t
    # A broad motion whose upper part drowns in noise.
    tones = rng.uniform(0.3, 12.0, 60)
    exact = np.sum(np.sin(2 * np.pi * np.multiply.outer(t, tones) + rng.uniform(0, 6, 60)) / tones, axis=1)
    a = np.gradient(np.gradient(exact, t), t)
    sigma = 0.2 * np.std(exact)
    noisy = exact + sigma * rng.normal(size=len(t))
    b = np.gradient(np.gradient(noisy, t), t)
    # Differences flatten the noise of the highest frequencies; the share is that of a low-pass there.
    band = np.fft.rfftfreq(len(t), 1 / RATE) < 15.0
    b = np.fft.irfft(np.fft.rfft(b) * band, len(t))
    a = np.fft.irfft(np.fft.rfft(a) * band, len(t))
    n = prepared.robot.n
    joints = tuple(replace(j, noise=float(sigma)) for j in prepared.report.joints)
    q, ddq = np.tile(noisy[:, None], n), np.tile(b[:, None], n)
    whole = replace(prepared, q=q, dq=q, ddq=ddq, report=replace(prepared.report, joints=joints))
    better = less_noise(whole).ddq[:, 0]
    inside = slice(200, -200)
    raw = float(b[inside] @ a[inside] / (b[inside] @ b[inside]))
    mended = float(better[inside] @ a[inside] / (better[inside] @ better[inside]))
    assert raw < 0.93
    assert abs(mended - 1.0) < 0.25 * (1.0 - raw)
    assert np.std((better - a)[inside]) < np.std((b - a)[inside])


def test_exact_motion_is_left_alone() -> None:
    _, prepared = signals(7)
    joints = tuple(replace(j, noise=0.0) for j in prepared.report.joints)
    same = less_noise(replace(prepared, report=replace(prepared.report, joints=joints)))
    np.testing.assert_allclose(same.ddq, prepared.ddq, atol=1e-9 * np.abs(prepared.ddq).max())
    assert not noise_share(prepared.ddq, prepared.rate, np.zeros(prepared.robot.n)).any()


def test_thinned_samples_make_the_same_rows() -> None:
    model, prepared = signals(8, decimate=12)
    fast = replace(prepared, report=replace(prepared.report, cutoff_hz=prepared.report.cutoff_hz / 4.0))
    few = thinned(fast)
    assert len(few) < 0.6 * len(fast)
    np.testing.assert_array_equal(few.tau, fast.tau)
    np.testing.assert_allclose(few.row_time, fast.row_time, atol=1e-9)
    rigid = Model(model.robot, model.effects[:1])
    a, b = (raw_columns(Problem(rigid, s)) for s in (fast, few))
    assert np.abs(a - b).max() < 2e-3 * np.abs(a).max()
    assert thinned(prepared) is prepared


def test_stretches_of_a_long_log_are_rows_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    import ident.monitoring.stages.analysis as analysis

    _, prepared = signals(9)
    assert stretches(prepared) is prepared
    monkeypatch.setattr(analysis, "_MOST_ROWS", 100 * prepared.robot.n)
    some = stretches(prepared)
    assert 60 <= len(some.tau) <= 100
    assert len(some.runs) > 5
    places = np.searchsorted(prepared.row_time, some.row_time - 1e-9)
    np.testing.assert_array_equal(prepared.tau[places], some.tau)
    assert places[0] < 20
    assert places[-1] == len(prepared.tau) - 1


@pytest.mark.parametrize("order", [1.7, 13.3])
def test_the_order_of_a_periodic_effect_is_read_from_the_residual(order: float) -> None:
    robot = ROBOTS["scara"]()
    effect = replace(make_effect("cogging", joints=robot.joint_names[:1], angle="joint"), order=order)
    true = Model(robot, (effect,))
    values = np.zeros(len(true.names))
    model, prepared = signals(10, noise=1e-3)
    motion = Motion.of(robot, prepared.q, prepared.dq, prepared.ddq, prepared.t, rate=prepared.rate)
    values[0] = 1.0
    added = prepared.filtered(true.torque(motion, values))
    size = 0.3 * np.std(prepared.tau[:, 0]) / np.std(added[:, 0])
    problem = Problem(model, without_reversals(replace(prepared, tau=prepared.tau + size * added)))
    built = Frame.build(problem, plain_whitener(problem, problem.signals.tau))
    motions = Motions(problem)
    found = harmonics(replace(effect, label="+"), built, motions)
    assert found is not None
    turns = np.ptp(prepared.q[:, 0])
    assert min(abs(o - order) for o in promising_orders(found, built, motions)) < 1.0 / turns


@pytest.mark.parametrize("seconds", [40.0, 12.0])
def test_noise_is_taken_out_of_a_motion_that_is_cut_off_without_bending_its_ends(seconds: float) -> None:
    robot = ROBOTS["scara"]()
    rng = np.random.default_rng(12)
    t = np.arange(round(seconds * 200.0)) / 200.0
    w = 2.0 * np.pi * np.array([0.17, 0.43, 0.9])
    phase = rng.uniform(0.0, 2.0 * np.pi, (robot.n, 3))
    angle = w * t[:, None, None] + phase
    q, ddq = np.sum(0.3 * np.sin(angle), axis=2), np.sum(-0.3 * w**2 * np.sin(angle), axis=2)
    log = Log("run", t, q=q + 1e-6 * rng.normal(size=q.shape), tau={"motor": np.sin(angle[:, :, 0])})
    noisy = ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot))
    less = less_noise(noisy)
    at = np.round(noisy.t * 200.0).astype(int)
    before, after = (np.abs(s.ddq - ddq[at]) for s in (noisy, less))
    ends = np.minimum(noisy.t - noisy.t[0], noisy.t[-1] - noisy.t) < 1.5
    # At the ends next to nothing of the bend, away from them less noise.
    assert np.all(np.sqrt(np.mean(after[ends] ** 2, axis=0)) < 2.0 * np.sqrt(np.mean(before[ends] ** 2, axis=0)))
    assert np.all(np.sqrt(np.mean(after[~ends] ** 2, axis=0)) < 0.7 * np.sqrt(np.mean(before[~ends] ** 2, axis=0)))


@pytest.mark.parametrize("turns", [3e-4, 6e-4, 8e-4, 9.8e-4, 2e-3])
def test_orders_stay_within_what_the_effect_may_have(turns: float) -> None:
    """A joint that moves so little that the slowest order which shows is near the fastest that there may be."""
    robot = ROBOTS["scara"]()
    effect = replace(make_effect("cogging", joints=robot.joint_names[:1], angle="joint"), label="+")
    model, prepared = signals(10, noise=1e-3)
    q = prepared.q.copy()
    q[:, 0] *= 2.0 * np.pi * turns / np.ptp(q[:, 0])
    problem = Problem(model, replace(prepared, q=q))
    built = Frame.build(problem, plain_whitener(problem, problem.signals.tau))
    found = harmonics(effect, built, Motions(problem))
    if found is not None:
        assert effect.shape()[0].lower <= found.orders[0] < found.orders[-1] <= effect.shape()[0].upper
