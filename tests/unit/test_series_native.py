"""Filters along time, compiled and in NumPy, against SciPy; and what the compiled ones refuse."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

import numpy as np
import pytest
from rigid_models import kernels, using
from scipy.signal import lfilter

from ident.regressor import numpy_series
from ident.regressor.kernel_choice import kernel

COMPILED = kernel().series
compiled = pytest.mark.skipif(COMPILED is numpy_series, reason="the compiled filters were not built")


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
