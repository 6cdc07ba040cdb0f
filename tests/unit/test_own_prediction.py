"""Fits whose columns depend on the model's own prediction, where repeating them does not settle: a tilted base under a SCARA."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import ROBOTS, declared
from recorded import recorded

from ident.effects.registry import make_effect
from ident.estimate.estimate import Estimate
from ident.estimators import WeightedLeastSquares, own_prediction
from ident.estimators.base import Capability, estimator_types, make_estimator
from ident.estimators.own_prediction import Linearised
from ident.logs.log import LogSet
from ident.problem.problem import Problem
from ident.signals import ZeroPhase

TILT = (0.1, -0.07)


def tilted(seed: int) -> Problem:
    robot, tilt = ROBOTS["scara"](), make_effect("base_tilt")
    model, values = declared(robot)
    whole = model + tilt
    log = recorded(robot, whole, np.append(values, [*TILT, *([0.0] * (len(tilt.parameters(robot)) - 2))]), seed, seconds=20.0)
    return Problem(whole, ZeroPhase(cutoff_hz=15.0)(LogSet((log,), robot=robot)))


def unsettled(estimate: Estimate) -> bool:
    return any("not consistent with its own prediction" in w for w in estimate.warnings)


def squares(problem: Problem, estimate: Estimate) -> float:
    there = problem.with_reference(estimate.all_values)
    return float(np.nansum((there.residual(problem.base.base_values(estimate.all_values)) / estimate.fit_error.rms) ** 2))


def test_slopes_are_those_of_the_prediction_through_columns_and_values() -> None:
    problem = tilted(1)
    estimate = WeightedLeastSquares().solve(problem)
    values = problem.base.base_values(estimate.all_values)
    size = np.where(values == 0.0, 1e-3, 0.01 * np.abs(values))
    linear = Linearised.of(problem, values, own_prediction._bending(problem, values, size))
    rng = np.random.default_rng(2)

    def predicted(base: np.ndarray) -> np.ndarray:
        return problem.with_reference(np.asarray(problem.base.expand(base))).predict(base)

    for _ in range(3):
        move = size * rng.normal(size=len(values))
        slope = predicted(values + 0.5 * move) - predicted(values - 0.5 * move)
        assert np.sqrt(np.mean((slope - linear.slopes @ move) ** 2)) < 0.02 * np.sqrt(np.mean(slope**2))
        assert linear.tau - linear.predict(values) == pytest.approx(problem.tau - predicted(values), abs=1e-9 * np.abs(problem.tau).max())


def test_where_repetition_does_not_settle_newtons_steps_do(monkeypatch: pytest.MonkeyPatch) -> None:
    scores = []
    for seed in range(6):
        problem = tilted(20 + seed)
        monkeypatch.setattr(own_prediction, "MOST", 2)
        with monkeypatch.context() as without:
            without.setattr(own_prediction, "_STEPS", 0)
            repeated = WeightedLeastSquares().solve(problem)
        assert unsettled(repeated)
        found = WeightedLeastSquares().solve(problem)
        assert not unsettled(found)
        assert squares(problem, found) < squares(problem, repeated)
        # Long repetition gets to the same, but for what their equations differ in.
        monkeypatch.setattr(own_prediction, "MOST", 60)
        long = WeightedLeastSquares().solve(problem)
        assert squares(problem, found) <= squares(problem, long) * (1.0 + 1e-4)
        names = list(found.names)
        scores += [(found.values[names.index(n)] - x) / found.std[names.index(n)] for n, x in zip(("tiltx", "tilty"), TILT, strict=True)]
    z = np.abs(scores)
    # 12 scores: 95 % intervals that hold cover fewer than 9 of them once in 4000 tries.
    assert np.sum(z < 1.96) >= 9
    assert np.median(z) > 0.1


def test_slopes_that_would_fill_the_memory_are_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_prediction, "MOST", 2)
    monkeypatch.setattr(own_prediction, "_MOST_NUMBERS", 1000)
    estimate = WeightedLeastSquares().solve(tilted(3))
    assert unsettled(estimate)


def by_rows_alone() -> list[str]:
    """Methods that take other rows than a problem's own."""
    every = estimator_types().items()
    return [n for n, e in every if not e.files and not e.whole_logs and Capability.NOISY_REGRESSOR not in e.capabilities]


@pytest.mark.parametrize("name", by_rows_alone())
def test_every_method_ends_well_where_repetition_does_not_settle(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_prediction, "MOST", 2)
    estimator = make_estimator(name)
    estimate = estimator.solve(tilted(4))
    assert not unsettled(estimate)
    if Capability.PRIOR not in estimator.capabilities:  # a prior pulls
        for angle, truth in zip(("tiltx", "tilty"), TILT, strict=True):
            assert estimate.value(angle) == pytest.approx(truth, abs=0.02)


def test_a_method_with_instruments_keeps_its_own_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_prediction, "MOST", 2)
    monkeypatch.setattr(own_prediction, "_by_newton", lambda *_: pytest.fail("given other rows"))
    assert np.isfinite(make_estimator("iv").solve(tilted(4)).values).all()
