"""The noise's colour in instrumental variables: autoregressions over gaps, whitening, and what it buys."""

from __future__ import annotations

import warnings
from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import solve_triangular, toeplitz
from scipy.signal import lfilter

from ident.estimators.moments import _Windows
from ident.statistics.autoregression import burg, by_autocovariance, lower_orders, rising
from ident.statistics.noise import fit_noise
from ident.statistics.whitening import RowWhitener, padded


def spectrum(polynomial: np.ndarray, innovation: float, frequency: np.ndarray) -> np.ndarray:
    """Power at frequencies as a share of the rate."""
    lags = np.arange(len(polynomial))
    return innovation / np.abs(np.exp(-2j * np.pi * np.outer(frequency, lags)) @ polynomial) ** 2


def differenced(count: int, seed: int, share: float) -> np.ndarray:
    """White noise of variance one under second differences of white noise `share` times as large, with gaps."""
    rng = np.random.default_rng(seed)
    e = rng.normal(size=count) + share * np.diff(rng.normal(size=count + 2), 2)
    for start in range(200, count, 211):
        e[start : start + 9] = np.nan
    return e


@pytest.mark.parametrize("share", [3.0, 15.0])
def test_the_floor_under_differenced_noise_is_found_in_spite_of_gaps(share: float) -> None:
    e = differenced(12_000, 1, share)
    noise = fit_noise(e[:, None], [slice(0, len(e))])
    slow = np.array([0.002, 0.005, 0.01])
    true = 1 + share**2 * (2 * np.sin(np.pi * slow)) ** 4
    assert spectrum(noise.ar[0], float(noise.innovation[0, 0]), slow) == pytest.approx(true, rel=0.25)


def test_burg_is_stable_and_finds_a_process_over_gaps() -> None:
    rng = np.random.default_rng(2)
    a = np.array([1.0, -1.6, 0.95])
    e = lfilter([1.0], a, rng.normal(size=20_000))
    e[rng.integers(0, len(e), 300)] = np.nan
    found = burg(e, 10)
    assert found is not None
    assert found.polynomial[:3] == pytest.approx(a, abs=0.03)
    assert found.innovation == pytest.approx(1.0, rel=0.05)
    assert np.abs(np.roots(found.polynomial)).max() < 1.0


def test_too_short_for_any_order() -> None:
    assert burg(np.array([1.0, np.nan, 2.0, np.nan, 1.0]), 3) is None
    assert burg(np.full(5, np.nan), 3) is None
    assert list(by_autocovariance(np.zeros(3), 10)) == [1.0]


@pytest.mark.parametrize("rows", [9, 12, 20, 40, 90])
@pytest.mark.parametrize("seed", range(4))
def test_short_runs_are_fitted_without_a_warning(rows: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    e = rng.normal(size=(rows, 2))
    e[rng.random(e.shape) < 0.4] = np.nan
    shape = np.array([1.0, 0.8, 0.5, 0.2, 0.05])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for known in (None, shape):
            noise = fit_noise(e, [slice(0, rows // 2), slice(rows // 2, rows)], known)
            assert np.all(np.isfinite(noise.ar))
            assert np.all(np.isfinite(noise.innovation))
            assert np.all(noise.correlation_time >= 1.0)


def test_lower_orders_are_those_of_the_same_process() -> None:
    a = np.array([1.0, -1.2, 0.5])
    gamma = np.array([lfilter([1.0], a, np.eye(1, 800)[0]) @ np.roll(lfilter([1.0], a, np.eye(1, 800)[0]), -lag) for lag in range(3)])
    orders = lower_orders(a, 1.0)
    assert orders[0][1] == pytest.approx(gamma[0], rel=1e-6)
    assert orders[1][0][1] == pytest.approx(-gamma[1] / gamma[0], rel=1e-6)
    assert orders[2][0] == pytest.approx(a)


def test_rows_are_whitened_as_by_the_covariance_of_every_segment() -> None:
    rng = np.random.default_rng(3)
    a = np.array([1.0, -0.9, 0.4, -0.1])
    valid = np.ones(60, bool)
    valid[[17, 18, 40]] = False
    x = rng.normal(size=(60, 4))
    impulse = lfilter([1.0], a, np.eye(1, 2000)[0])
    gamma = 0.7 * np.array([impulse[: 2000 - lag] @ impulse[lag:] for lag in range(60)])
    wanted = np.zeros_like(x)
    for part in (slice(0, 17), slice(19, 40), slice(41, 60)):
        lower = np.linalg.cholesky(toeplitz(gamma[: part.stop - part.start]))
        wanted[part] = solve_triangular(lower, x[part], lower=True)
    left, right = np.ascontiguousarray(np.where(valid[:, None], x, np.nan)[:, :1]), np.c_[rng.normal(size=60), x[:, 1:]]
    for cuts in ([], [5], [1, 2, 3, 18, 19, 39, 42]):
        edges, products = [0, *cuts, 60], np.zeros((8, 8))
        rows, sums = RowWhitener(np.r_[a, 0.0, 0.0], 0.7), RowWhitener(np.r_[a, 0.0, 0.0], 0.7)
        for one in (rows, sums):
            one.reset(padded(4))
        blocks = []
        for i, j in pairwise(edges):
            parts = [(left[i:j], slice(0, 1)), (right[i:j], slice(1, 4))]
            used = np.c_[np.zeros(60, bool), valid][i:j]
            blocks.append(rows.rows(parts, (used, 1)))
            sums.add_products(parts, (used, 1), products, 8)
        found = np.concatenate(blocks)
        assert found[:, :4] == pytest.approx(wanted, rel=1e-6, abs=1e-9)
        assert not found[:, 4:].any()
        assert np.triu(products[:4, :4]) == pytest.approx(np.triu(wanted.T @ wanted), rel=1e-6)


def test_weighting_follows_noise_that_rises_and_nothing_else() -> None:
    frequency = np.linspace(0.0, 0.5, 201)
    slow = np.exp(-((frequency / 0.02) ** 2))
    falls = rising(np.array([1.0, -0.9]), 1.0, slow)
    assert list(falls.polynomial) == [1.0]
    assert falls.innovation < spectrum(np.array([1.0, -0.9]), 1.0, np.zeros(1))[0]
    blue = np.array([1.0, 0.8])
    rises = rising(blue, 1.0, slow)
    own = spectrum(blue, 1.0, frequency)
    weighed = spectrum(rises.polynomial, rises.innovation, frequency)
    assert weighed == pytest.approx(own, rel=0.1)
    assert np.all(np.diff(weighed) > -1e-2 * weighed[:-1])


def test_windows_do_not_depend_on_blocks() -> None:
    rng = np.random.default_rng(4)
    scores = rng.normal(size=(53, 3))

    def gram(cuts: list[int]) -> np.ndarray:
        windows = _Windows(7, 3)
        for run, (first, last) in enumerate(((0, 30), (30, 53))):
            edges = [first, *(c for c in cuts if first < c < last), last]
            for i, j in pairwise(edges):
                windows.add(run, scores[i:j])
        return windows.gram

    pieces = [scores[a : min(a + 7, end)].sum(axis=0) for begin, end in ((0, 30), (30, 53)) for a in range(begin, end, 7)]
    wanted = sum(np.outer(s, s) for s in pieces)
    for cuts in ([], [7, 14], [1, 6, 8, 13, 31, 37, 44], list(range(1, 53))):
        assert gram(cuts) == pytest.approx(wanted)
