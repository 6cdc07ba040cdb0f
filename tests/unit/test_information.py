"""Information blocks against the stacked least-squares problem."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import ConfigurationError
from ident.problem.information import Information


def sample(seed: int, m: int, n: int, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(m, n, k)) * 10.0 ** rng.uniform(-6, 6, k)
    columns[:, 1:, 0] = 0.0  # a column that row 0 alone sees
    return columns, rng.normal(size=(m, n)), rng.random((m, n)) > 0.2


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10_000), n=st.integers(1, 4), k=st.integers(1, 6), cut=st.integers(1, 199))
def test_merged_blocks_solve_like_the_stacked_problem(seed: int, n: int, k: int, cut: int) -> None:
    columns, tau, valid = sample(seed, 200, n, k)
    names = tuple("abcdefgh"[:k])
    empty = Information.empty(n, names)
    parts = [empty.with_rows(columns[s], tau[s], valid[s]) for s in (slice(0, cut), slice(cut, None))]
    merged = parts[0] + parts[1]
    weights = np.random.default_rng(seed + 1).uniform(0.5, 2.0, n)
    R, z, rss = merged.combined(weights)
    use = valid.reshape(-1)
    root = np.sqrt(np.tile(weights, 200))[use]
    A, b = columns.reshape(-1, k)[use] * root[:, None], tau.reshape(-1)[use] * root
    scale = np.linalg.norm(A, axis=0)
    expected = np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale
    values = np.linalg.solve(R / scale, z) / scale
    assert values == pytest.approx(expected, rel=1e-8)
    assert rss == pytest.approx(np.sum((b - A @ expected) ** 2), rel=1e-8)
    assert merged.counts == pytest.approx(valid.sum(axis=0))
    residual = np.where(valid, tau - columns @ values, 0.0)
    assert merged.residual_squares(values) == pytest.approx(np.sum(residual**2, axis=0), rel=1e-7)


def test_fewer_rows_than_columns_stay_exact() -> None:
    columns, tau, _ = sample(1, 3, 2, 5)
    block = Information.empty(2, tuple("abcde")).with_rows(columns, tau)
    for j in range(2):
        full = np.concatenate([columns[:, j], tau[:, j, None]], axis=1)
        assert block.factors[j].T @ block.factors[j] == pytest.approx(full.T @ full, rel=1e-10, abs=1e-12 * np.abs(full.T @ full).max())
        assert np.allclose(block.factors[j], np.triu(block.factors[j]))


def test_selection_and_forgetting() -> None:
    columns, tau, _ = sample(2, 100, 2, 4)
    block = Information.empty(2, tuple("abcd")).with_rows(columns, tau)
    chosen = block.selected(np.array([2, 0]))
    assert chosen.names == ("c", "a")
    direct = Information.empty(2, ("c", "a")).with_rows(columns[:, :, [2, 0]], tau)
    for a, b in zip(chosen.factors, direct.factors, strict=True):
        assert a.T @ a == pytest.approx(b.T @ b, rel=1e-9)
    assert block.scaled(0.25).torque_squares() == pytest.approx(0.25 * block.torque_squares())


def test_blocks_of_different_models_do_not_merge() -> None:
    with pytest.raises(ConfigurationError, match="cannot be merged"):
        Information.empty(2, ("a",)) + Information.empty(2, ("b",))
