"""The compiled filters against SciPy and NumPy: the same numbers, bit by bit."""

from __future__ import annotations

import numpy as np
import pytest

from ident.signals.filters import central_differences, zero_phase_lowpass

Array = np.ndarray
pytest.importorskip("ident._native._filters", reason="the compiled filters were not built")


def both(monkeypatch: pytest.MonkeyPatch, work) -> list:  # type: ignore[no-untyped-def]
    """What the compiled and the other way give."""
    found = []
    for kernel in ("native", "numpy"):
        monkeypatch.setenv("IDENT_KERNEL", kernel)
        found.append(work())
    return found


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 6, 7, 8, 9, 30])
@pytest.mark.parametrize("order", [1, 4, 9, 10])
def test_lowpass_is_that_of_scipy(width: int, order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.random.default_rng(order).standard_normal((700, width)).cumsum(axis=0) * 1e3 ** np.linspace(-1, 1, width)
    fast, slow = both(monkeypatch, lambda: zero_phase_lowpass(x, 9.0, 250.0, order))
    assert np.array_equal(fast, slow)


def test_lowpass_of_short_and_odd_arrays(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(1)
    whole = rng.standard_normal((60, 12))
    cases = (
        rng.standard_normal((2, 3)),
        whole[::2, 1:7],
        whole[:, 0],
        whole.reshape(60, 3, 4),
        whole[:, ::-1],
        rng.integers(0, 9, (40, 2)),
    )
    for x in cases:
        fast, slow = both(monkeypatch, lambda x=x: zero_phase_lowpass(x, 4.0, 100.0))  # type: ignore[misc]
        assert fast.shape == x.shape
        assert np.array_equal(fast, slow)
    spoilt = whole.copy()
    spoilt[30, 2] = np.nan
    fast, slow = both(monkeypatch, lambda: zero_phase_lowpass(spoilt, 4.0, 100.0))
    assert np.array_equal(fast, slow, equal_nan=True)
    assert np.isnan(fast[:, 2]).all()
    assert np.isfinite(np.delete(fast, 2, axis=1)).all()


@pytest.mark.parametrize("accuracy", [2, 4, 6, 8])
def test_differences_are_those_of_numpy(accuracy: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(accuracy)
    for x in (
        rng.standard_normal((20_000, 3)),
        rng.standard_normal((accuracy + 1, 7)),
        rng.standard_normal((90, 8))[:, ::2],
        rng.standard_normal(50),
    ):
        fast, slow = both(monkeypatch, lambda x=x: central_differences(x, 500.0, accuracy))  # type: ignore[misc]
        assert fast[0].shape == (len(x) - accuracy, *x.shape[1:])
        assert np.array_equal(fast[0], slow[0])
        assert np.array_equal(fast[1], slow[1])


def test_sizes_are_checked() -> None:
    from ident._native import _filters

    table, x = np.ones((2, 7)), np.zeros((10, 2))
    with pytest.raises(ValueError, match="size"):
        _filters.zero_phase(table, x, 10, 3, 0, np.zeros((10, 3)))
    for pad, sections in ((10, table), (-1, table), (0, np.ones((6, 7))), (0, np.ones((0, 7)))):
        with pytest.raises(ValueError, match="padded"):
            _filters.zero_phase(sections, x, 10, 2, pad, x.copy())
    with pytest.raises(ValueError, match="size"):
        _filters.differences(x, 10, 2, np.ones(1), np.ones(1), x.copy(), x.copy())
    frozen = x.copy()
    frozen.flags.writeable = False
    with pytest.raises(ValueError, match="read-only"):
        _filters.zero_phase(table, x, 10, 2, 0, frozen)
