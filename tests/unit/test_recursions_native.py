"""The compiled recursion over springs against the same in NumPy, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest

from ident.effects import flexing

recursions = pytest.importorskip("ident._native._recursions", reason="the compiled recursions were not built")


def case(samples: int, lanes: int, seed: int = 0) -> tuple:
    """Arguments of `_follow` but for where the result goes: forces, step coefficients."""
    rng = np.random.default_rng(seed)
    omega = rng.uniform(20.0, 400.0, (samples, lanes))
    coefficients = np.stack(flexing._spring_step(omega, rng.uniform(0.0, 1.0, lanes), 1e-3))
    return np.ascontiguousarray(100.0 * rng.standard_normal((samples, lanes)).cumsum(axis=0)), coefficients


@pytest.mark.parametrize(("samples", "lanes"), [(1, 3), (2, 1), (400, 1), (400, 7), (50, 0), (0, 4)])
def test_springs_are_those_of_numpy(samples: int, lanes: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("IDENT_KERNEL", "native")
    given = case(samples, lanes, seed=samples + lanes)
    found = []
    for work in (flexing._follow, flexing._follow_plainly):
        position, velocity = np.full((samples, lanes), 1e-3), np.zeros((samples, lanes))
        work(*given, position, velocity)
        found.append((position, velocity))
    for fast, slow in zip(*found, strict=True):
        assert np.abs(fast - slow).max(initial=0.0) <= 1e-12 * np.abs(slow).max(initial=0.0)


def test_arrays_of_the_wrong_size_are_refused() -> None:
    force, coefficients = case(20, 3)
    position, velocity = np.zeros((2, 20, 3))
    with pytest.raises(ValueError, match="wrong size"):
        recursions.springs(force, coefficients[:7].copy(), 20, 3, position, velocity)
    with pytest.raises(ValueError, match="wrong size"):
        recursions.springs(force, coefficients, -20, -3, position, velocity)
    position.flags.writeable = False
    with pytest.raises((ValueError, BufferError)):
        recursions.springs(force, coefficients, 20, 3, position, velocity)
