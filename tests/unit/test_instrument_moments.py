"""Moments of instruments and the covariance of scores, packed and by blocks, against dense algebra with the noise's covariance."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.linalg import solve_triangular, toeplitz
from scipy.signal import lfilter

import ident
from ident.estimators.instrument_rows import InstrumentRows
from ident.estimators.instrument_scores import score_covariance
from ident.estimators.instruments import along
from ident.friction import Coulomb, Viscous
from ident.problem import problem as problems
from ident.problem.problem import Problem
from ident.regressor import numpy_series
from ident.signals.rows import Rows
from ident.statistics import noise as noises
from ident.statistics.autoregression import Autoregression
from ident.statistics.noise import NoiseModel, fit_noise, noise_gram

LAGS = (0, 5, 10)
#: A strong colour, and one of order one: in units of the torque.
COLOURS = (np.array([1.0, 0.9, 0.5, 0.2]), np.array([1.0, 0.6]))


@cache
def made(name: str, samples: int = 260, seed: int = 0) -> InstrumentRows:
    """Rows of a made-up motion in two runs with gaps, their instruments along another motion; the last column is not estimated."""
    robot = ident.load_robot(name)
    model = robot.rigid_body() + Viscous() + Coulomb()
    rng = np.random.default_rng(seed)
    t = np.arange(samples) / 100.0
    phase = rng.uniform(0, 2 * np.pi, (2, robot.n))
    rates = 1.0 + np.arange(robot.n)
    q, dq, ddq = (np.real((1j * rates) ** k * np.exp(1j * (t[:, None] * rates + phase[0]))) for k in range(3))
    signals = _signals(robot, t, q, dq, ddq, rng)
    problem = Problem(model, signals)
    moved = replace(signals, **{k: v + 0.1 * rng.normal(size=v.shape) for k, v in (("q", q), ("dq", dq), ("ddq", ddq))})
    usable = signals.valid & (rng.random(signals.valid.shape) > 0.02)
    columns, values = np.arange(model.base.count - 1), rng.normal(size=model.base.count)
    weighting = tuple(Autoregression(COLOURS[j % 2], 0.5 + j) for j in range(robot.n))
    noise = NoiseModel(np.ones((robot.n, 1)), np.eye(robot.n), np.ones(robot.n), np.ones(robot.n))
    return InstrumentRows(problem, along(problem, moved), usable, columns, values, noise, weighting)


def _signals(robot, t, q, dq, ddq, rng):  # type: ignore[no-untyped-def]
    from ident.signals.signals import PreparationReport, Signals

    count, cut = len(t), len(t) * 2 // 3
    valid = np.ones(q.shape, bool)
    valid[30:33] = False
    valid[cut + 20, 0] = False
    report = PreparationReport({}, None, "", None, 100.0, 100.0, count, count, count, "", ())
    tau = rng.normal(size=q.shape)
    return Signals(robot, t, q, dq, ddq, tau, tau, valid, (slice(0, cut), slice(cut, count)), ("a", "b"), 100.0, None, report)


def dense(rows: InstrumentRows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Whitened instruments, columns (M, n, b) and error (M, n), each segment by the Cholesky factor of its covariance."""
    problem, other = rows.problem, rows.instruments
    Phi, Z = (np.concatenate([r.columns for r in p.rows()]) for p in (problem, other))
    error = problem.tau - Phi @ rows.values
    everything = np.concatenate([Z[:, :, rows.columns], Phi[:, :, rows.columns], error[:, :, None]], axis=2)
    out = np.zeros_like(everything)
    for run in problem.row_runs:
        for j, colour in enumerate(rows.weighting):
            impulse = lfilter([1.0], colour.polynomial, np.eye(1, 3000)[0])
            gamma = colour.innovation * np.array([impulse[: 3000 - k] @ impulse[k:] for k in range(run.stop - run.start)])
            used = [i for i in range(run.start, run.stop) if rows.usable[i, j]]
            for segment in np.split(used, np.flatnonzero(np.diff(used) != 1) + 1):
                lower = np.linalg.cholesky(toeplitz(gamma[: len(segment)]))
                out[segment, j] = solve_triangular(lower, everything[segment, j], lower=True)
    b = len(rows.columns)
    return out[:, :, :b], out[:, :, b : 2 * b], out[:, :, -1]


def lagged(rows: InstrumentRows, Z: np.ndarray, lag: int) -> np.ndarray:
    """Instruments of `lag` rows ago, within each run, in rows that are used."""
    out = np.zeros_like(Z)
    for run in rows.problem.row_runs:
        out[run.start + lag : run.stop] = Z[run.start : run.stop - lag]
    return np.where(rows.usable[:, :, None], out, 0.0)


def close(found: np.ndarray, expected: np.ndarray, tolerance: float = 1e-9) -> bool:
    return bool(np.abs(found - expected).max() <= tolerance * np.abs(expected).max())


@pytest.mark.parametrize("block", [7, 64, 2048])
@pytest.mark.parametrize("name", ["scara", "palletiser", "puma560"])
def test_moments_are_those_of_the_covariance_of_every_segment(name: str, block: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(problems, "_PACKED_ROWS", block)
    rows = made(name)
    Z, Phi, error = dense(rows)
    found = rows.moments(LAGS, windowed=True)
    for i, lag in enumerate(LAGS):
        earlier = lagged(rows, Z, lag)
        assert close(found.cross[i], np.einsum("mna,mnb->ab", earlier, Phi)), lag
        assert close(found.gram[i], np.einsum("mna,mnb->ab", earlier, earlier)), lag
        assert close(found.miss[i], np.einsum("mna,mn->a", earlier, error)), lag
    assert close(found.own, np.einsum("mna,mnb->ab", Phi, Phi))
    assert close(found.own_miss, np.einsum("mna,mn->a", Phi, error))
    assert np.array_equal(np.isfinite(found.error), rows.usable)
    assert close(np.nan_to_num(found.error), error)
    step = rows.products()
    assert close(step.cross, found.cross[0], 1e-11)
    assert close(step.gram, found.gram[0], 1e-11)
    assert close(step.miss, found.miss[0], 1e-11)
    window = max(1, min(50, len(error) // 60))
    scores = np.einsum("mna,mn->ma", Z, error)
    parts = [scores[a : min(a + window, r.stop)].sum(axis=0) for r in rows.problem.row_runs for a in range(r.start, r.stop, window)]
    assert close(found.windowed, sum(np.outer(s, s) for s in parts))


@pytest.mark.parametrize("stationary", [False, True])
@pytest.mark.parametrize("name", ["scara", "palletiser", "puma560"])
def test_the_covariance_of_scores_is_that_of_dense_rows(name: str, stationary: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = made(name)
    Z, Phi, _ = dense(rows)
    error = rows.moments().error
    together = np.concatenate([lagged(rows, Z, lag) for lag in LAGS] + [Phi], axis=2)
    runs = rows.problem.row_runs
    blocks = [Rows(together[run], np.zeros(error[run].shape), rows.usable[run], run, i) for i, run in enumerate(runs)]
    expected = noise_gram(fit_noise(error, runs), blocks, np.ones(error.shape[1]), None if stationary else error)
    if stationary:
        for module in (noises, __import__("ident.estimators.instrument_scores", fromlist=["x"])):
            monkeypatch.setattr(module, "HELD_NUMBERS", 1)
    assert close(score_covariance(rows, error, LAGS), expected)


def test_numpy_gives_the_same_moments(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = made("scara")
    one = rows.moments(LAGS)
    monkeypatch.setenv("IDENT_KERNEL", "numpy")
    assert ident.regressor.kernel_choice.kernel().series is numpy_series
    other = rows.moments(LAGS)
    for name in ("cross", "gram", "miss", "own", "own_miss", "torques"):
        assert close(getattr(other, name), getattr(one, name), 1e-11), name


def test_memory_is_that_of_a_block() -> None:
    """Four times the rows must not take four times the memory."""
    peaks = []
    for samples in (10_000, 40_000):
        rows = made("scara", samples)
        rows.moments()
        tracemalloc.start()
        rows.moments()
        peaks.append(tracemalloc.get_traced_memory()[1] - rows.usable.size * 8)  # less the errors, one number per row
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0]


def test_a_prediction_is_the_columns_times_the_values() -> None:
    rows = made("puma560")
    expected = np.concatenate([r.columns for r in rows.problem.rows()]) @ rows.values
    assert close(rows.problem.predict(rows.values), expected, 1e-12)
