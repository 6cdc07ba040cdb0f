"""Shapes of candidates are sought from every peak of a grid: along one shape at a time a search stays on the ridge that it began on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import ident
from ident.diagnosis.inference.refinement import anywhere, refined
from tests.pendulum_logs import diagnosed, recorded

TRUE = ident.effects.Counterbalance(joints=("j1",), angle=0.9, ratio=0.6)


def balanced(seed: int) -> ident.LogSet:
    """A log of a pendulum with a spring on a linkage."""

    def spring(rng: np.random.Generator, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        alpha = q - TRUE.angle
        length = np.sqrt(1.0 + TRUE.ratio**2 - 2.0 * TRUE.ratio * np.cos(alpha))
        return 40.0 * np.sin(alpha) - 25.0 * np.sin(alpha) / length

    return recorded(seed, spring)


@pytest.fixture(scope="module")
def fit():
    """What is declared, fitted without the spring."""
    return diagnosed(balanced(3), balanced(4)).decision.fit.with_effects(())


@pytest.mark.parametrize("angle", [0.9, 0.9 - np.pi, -0.5])
def test_a_springs_mirror_is_left(fit, angle: float) -> None:
    """Half a turn away, at the shortest lever, it is the same law, and leads nowhere."""
    frame = fit.solved(1)
    found = anywhere(replace(TRUE, angle=angle, ratio=0.05), ("j1",), fit, frame)
    assert found.angle == pytest.approx(TRUE.angle, abs=0.03)
    assert found.ratio == pytest.approx(TRUE.ratio, abs=0.05)


def test_a_search_along_one_shape_at_a_time_stays_there(fit) -> None:
    """What `anywhere` is for; of one shape it leaves an effect as it is."""
    frame = fit.solved(1)
    mirror = replace(TRUE, angle=TRUE.angle - np.pi, ratio=0.05)
    near = refined(mirror, ("j1",), fit, frame, near=True)
    assert abs(near.angle - TRUE.angle) > 1.0
    lag = ident.make_effect("filter_lag", joints=("j1",))
    assert anywhere(lag, ("j1",), fit, frame) is lag
