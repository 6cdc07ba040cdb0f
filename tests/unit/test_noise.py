"""The residual's noise model against known processes."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from ident.signals.rows import Rows
from ident.statistics.noise import NoiseModel, autocovariance, fit_noise, noise_gram


def test_autocovariance_skips_absent_samples_exactly() -> None:
    rng = np.random.default_rng(0)
    e = rng.normal(size=300)
    e[rng.random(300) < 0.3] = np.nan
    gamma, count = autocovariance(e, [slice(0, 150), slice(150, 300)], 5)
    assert 0 < count <= np.isfinite(e).sum()
    for lag in range(6):
        products = np.concatenate([e[a : b - lag] * e[a + lag : b] for a, b in ((0, 150), (150, 300))])
        assert gamma[lag] == pytest.approx(np.nanmean(products), rel=1e-9)


def test_colour_and_correlation_are_recovered() -> None:
    rng = np.random.default_rng(1)
    a = np.array([1.0, -1.2, 0.5])
    innovation = np.array([[1.0, 0.6], [0.6, 2.0]])
    white = rng.multivariate_normal(np.zeros(2), innovation, size=40_000)
    e = lfilter([1.0], a, white, axis=0)
    noise = fit_noise(e, [slice(0, len(e))])
    assert noise.ar[0, 1:3] == pytest.approx(a[1:], abs=0.03)
    assert noise.innovation == pytest.approx(innovation, rel=0.05)
    h = lfilter([1.0], a, np.eye(1, 500)[0])
    assert noise.correlation_time[0] == pytest.approx(h.sum() ** 2 / np.sum(h**2), rel=0.1)


def test_gram_under_colour_equals_the_dense_product() -> None:
    rng = np.random.default_rng(2)
    m, b = 400, 3
    a = np.array([1.0, -0.8])
    noise = NoiseModel(a[None], np.array([[0.7]]), np.array([1.0]), np.array([1.0]))
    columns, valid = rng.normal(size=(m, 1, b)), rng.random((m, 1)) > 0.3
    blocks = [Rows(columns[s], np.zeros((len(columns[s]), 1)), valid[s], s, 0) for s in (slice(0, 130), slice(130, 400))]
    gram = noise_gram(noise, blocks, np.array([2.0]))
    shaping = toeplitz(lfilter([1.0], a, np.eye(1, m)[0]), np.zeros(m))
    X = np.where(valid[:, 0, None], columns[:, 0], 0.0) * 2.0
    assert gram == pytest.approx(X.T @ shaping.T @ shaping @ X * 0.7, rel=0.05, abs=0.02 * np.abs(gram).max())


def test_white_noise_is_called_white() -> None:
    e = np.random.default_rng(3).normal(size=(5000, 1)) * 3
    noise = fit_noise(e, [slice(0, 5000)])
    assert noise.correlation_time[0] == pytest.approx(1.0, abs=0.25)
    assert noise.variance[0] == pytest.approx(9.0, rel=0.1)
