"""Filters along time, compiled and in NumPy, against SciPy; and what the compiled ones refuse."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest
from rigid_models import kernels, using
from scipy.signal import lfilter

from ident.regressor import numpy_series
from ident.regressor.kernel_choice import Kernel, kernel

COMPILED = kernel().series
compiled = pytest.mark.skipif(COMPILED is numpy_series, reason="the compiled filters were not built")


@pytest.fixture(params=kernels())
def work(request: pytest.FixtureRequest) -> Iterator[Kernel]:
    with using(request.param) as found:
        yield found


@pytest.fixture(params=kernels())
def series(request: pytest.FixtureRequest) -> Iterator[ModuleType]:
    with using(request.param) as found:
        yield found.series


SIZES = pytest.mark.parametrize(
    ("order", "count", "width"), [(0, 7, 3), (1, 1, 8), (2, 3, 106), (40, 500, 112), (40, 9, 1), (7, 0, 16), (3, 5, 0)]
)


def process(order: int) -> np.ndarray:
    """A stable polynomial, first coefficient 1."""
    roots = 0.9 * np.exp(1j * np.random.default_rng(order).uniform(0.3, 2.8, order // 2))
    return np.atleast_1d(np.real(np.poly([*roots, *roots.conj(), *([0.5] * (order % 2))])))


@SIZES
def test_averages_are_those_of_scipy(series: ModuleType, order: int, count: int, width: int) -> None:
    x = np.random.default_rng(1).normal(size=(order + count, width))
    a = 3.0 * process(order)
    found = series.average(a, x)
    expected = lfilter(a, [1.0], x, axis=0)[order:] if x.size else np.zeros((count, width))
    assert found.shape == (count, width)
    assert np.abs(found - expected).max(initial=0.0) <= 1e-12 * np.abs(a).sum()


@SIZES
def test_recursions_are_those_of_scipy_wherever_they_are_cut(series: ModuleType, order: int, count: int, width: int) -> None:
    x, a = np.random.default_rng(2).normal(size=(count, width)), process(order)
    expected = lfilter([1.0], a, x, axis=0) if x.size else x
    cut, before, parts = count // 3, np.zeros((order, width)), []
    for part in (x[:cut], x[cut:]):
        whole = series.recursion(a, part, before)
        assert np.array_equal(whole[:order], before)
        before = whole[len(whole) - order :]
        parts.append(whole[order:])
    assert np.abs(np.concatenate(parts) - expected).max(initial=0.0) <= 1e-10 * np.abs(expected).max(initial=1.0)


@compiled
def test_arrays_of_the_wrong_size_are_refused() -> None:
    from ident._native import _kernel

    a, x, y = np.ones(3), np.zeros((7, 8)), np.zeros((5, 8))
    _kernel.filter_rows(0, a, 8, 5, x, y)
    for bad in (
        (0, a, 8, 6, x, y),
        (0, a, 7, 5, x, y),
        (0, a, 8, -1, x, y),
        (1, a, 8, 5, x, y),
        (0, a[:0], 8, 5, x, y),
        (0, None, 8, 5, x, y),
        (0, a, 8, 5, x.astype(int), y),
        (0, a, 8, 5, x.T, y),
    ):
        with pytest.raises(ValueError, match=r"\w"):
            _kernel.filter_rows(*bad)


def predictors(order: int) -> np.ndarray:
    """Any, of order 0 … `order`, each behind three zeros."""
    table = np.random.default_rng(order).normal(size=(order + 1, order + 7))
    return np.where(np.arange(order + 7) - 3 <= np.arange(order + 1)[:, None], table, 0.0) * (np.arange(order + 7) >= 3)


@pytest.mark.parametrize(
    ("order", "count", "wide", "rows"), [(0, 9, 5, 8), (1, 40, 8, 8), (4, 700, 21, 16), (40, 90, 106, 56), (7, 0, 3, 0)]
)
def test_rows_after_a_gap_go_through_the_predictor_of_their_order(series: ModuleType, order: int, count: int, wide: int, rows: int) -> None:
    rng, table, width = np.random.default_rng(5), predictors(order), -(-wide // 8) * 8
    x, valid = rng.normal(size=(count, wide + 2)), rng.random((count, 3)) > 0.03
    x[~valid[:, 1]] = np.nan
    past, age = np.zeros((order, width)), order // 2
    past[order - age :, :wide] = rng.normal(size=(age, wide))
    line, seen, expected = np.concatenate([past[:, :wide], x[:, 1:-1]]), age, np.zeros((count, width))
    for t in range(count):
        weights = table[min(seen, order), 3 : 4 + min(seen, order)]
        if valid[t, 1]:
            expected[t, :wide] = sum(w * line[order + t - k] for k, w in enumerate(weights))
        seen = seen + 1 if valid[t, 1] else 0
    out, products, cut = np.full((count, width), np.nan), np.ones((width, width)), count // 3
    for part in (slice(0, cut), slice(cut, count)):
        parts = [(x[part], slice(1, 1 + wide // 2)), (x[part], slice(1 + wide // 2, 1 + wide))]
        age = series.whiten(table, past, age, parts, (valid[part], 1), out[part], products, rows)
    assert age == min(seen, order)
    assert np.allclose(out, expected, rtol=1e-12, atol=1e-11)
    upper = np.triu(np.ones((width, width), bool))[:rows]
    assert np.allclose((products[:rows] - 1.0)[upper], (expected.T @ expected)[:rows][upper], rtol=1e-10, atol=1e-9)


def test_the_lattice_is_burgs_over_every_stretch(series: ModuleType) -> None:
    x = np.random.default_rng(6).normal(size=3000)
    x[[0, 7, 8, 500, 2999]] = np.nan
    stretches = [x[a:b] for a, b in ((1, 7), (9, 500), (501, 2999))]
    ahead, behind = [s[1:] for s in stretches], [s[:-1] for s in stretches]
    found = series.lattice(x)
    for reflection in (0.5, -0.3, 0.2, 0.1, 0.0, -0.6, 0.4):
        assert found.count == sum(len(a) for a in ahead)
        assert found.squares == pytest.approx(sum(a @ a + b @ b for a, b in zip(ahead, behind, strict=True)), rel=1e-12)
        assert found.products == pytest.approx(sum(a @ b for a, b in zip(ahead, behind, strict=True)), rel=1e-9)
        found.reflect(reflection)
        pairs = list(zip(ahead, behind, strict=True))
        ahead, behind = [a[1:] + reflection * b[1:] for a, b in pairs], [b[:-1] + reflection * a[:-1] for a, b in pairs]


@pytest.mark.parametrize(("n", "count"), [(1, 3), (6, 37), (9, 8)])
def test_accelerations_of_inertia_matrices_and_where_they_are_sound(work: Kernel, n: int, count: int) -> None:
    rng = np.random.default_rng(7)
    root, scale, carried = rng.normal(size=(count, n, n)), rng.uniform(0.5, 2.0, n), rng.normal(size=(n, n)) + 3.0 * np.eye(n)
    joint = root @ root.swapaxes(1, 2) + 0.02 * np.eye(n)
    joint[::3, 0, 0] -= 0.9 * joint[::3, 0, 0]  # some are not positive definite any more
    inertia, force = np.linalg.solve(carried, joint), rng.normal(size=(count, n))
    out, sound = work.drive.respond(inertia, force, carried, scale, 0.05)
    least = np.linalg.eigvalsh(joint / np.outer(scale, scale))[:, 0]
    assert np.array_equal(sound, least > 0.05)
    assert 0 < sound.sum() < count
    expected = np.linalg.solve(joint, (force @ carried.T)[:, :, None])[:, :, 0]
    assert np.allclose(out[sound], expected[sound], rtol=1e-7)


@compiled
def test_whitening_refuses_what_does_not_fit() -> None:
    from ident._native import _kernel

    table, past, x, valid, out, sums = (
        predictors(2),
        np.zeros((2, 8)),
        np.zeros((5, 4)),
        np.ones((5, 1), bool),
        np.zeros((5, 8)),
        np.zeros((8, 8)),
    )
    good = [table, 8, past, 0, 5, ((x, 4, 1, 3),), valid, 1, 0, out, sums, 8]
    assert _kernel.whiten(*good) == 2
    for place, bad in (
        (0, table[:2].copy()), (1, 7), (1, 16), (2, None), (2, past[:1].copy()), (3, 3), (4, 6), (4, -1), (6, valid[:4].copy()), (7, 0),
        (8, 1), (9, out[:4].copy()), (10, sums[:4].copy()), (11, 9), (11, 16), (11, 4), (5, ((x, 4, 2, 3),)), (5, ((x, 4, 0),)),
        (5, ((x, 4, 0, 3),) * 5), (5, ((x, 4, 0, 4),) * 3), (5, ((x, 4, -1, 3),)), (5, ((None, 4, 0, 3),)),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=r"\w"):
            _kernel.whiten(*good[:place], bad, *good[place + 1 :])
    stretches = np.array([[0, 5], [6, 9]])
    for bad in (np.array([[0, 10]]), np.array([[3, 2]]), np.array([[-1, 2]]), np.array([1, 2, 3]), None):
        with pytest.raises(ValueError, match=r"\w"):
            _kernel.lattice(np.zeros(9), np.zeros(9), 9, bad, 0, 0.0)
    with pytest.raises(ValueError, match=r"\w"):
        _kernel.lattice(np.zeros(9), np.zeros(8), 9, stretches, 0, 0.0)
    with pytest.raises(ValueError, match=r"\w"):
        _kernel.respond(np.zeros((3, 2, 2)), np.zeros((3, 2)), np.eye(2), np.ones(2), 0.1, 3, 2, np.zeros((3, 2)), np.zeros(2, bool))
