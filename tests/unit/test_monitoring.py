"""Watching a robot: what changed is named with its size, from which log on; what lies in the doubt of the fit is no change."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_robots import pendulum

from ident.diagnosis import Verdict, diagnose
from ident.effects.motion import Motion
from ident.effects.registry import make_effect
from ident.errors import ConfigurationError
from ident.estimate.estimate import Estimate
from ident.estimators import WeightedLeastSquares
from ident.friction import Coulomb, Viscous
from ident.logs.log import Log, LogSet
from ident.model import Model
from ident.monitoring import How, monitor
from ident.monitoring.watch import level_of
from ident.problem.problem import Problem
from ident.signals import Signals, ZeroPhase
from ident.simulation.trajectory import FourierTrajectory

ROBOT = pendulum()
MODEL = ROBOT.rigid_body() + Viscous() + Coulomb()
FRICTION = np.array([1.2, 0.9])


def logged(*seeds: int, friction: np.ndarray = FRICTION, later: np.ndarray = FRICTION, unchanged: int = 0) -> Signals:
    """Logs of a pendulum along sines, with white torque noise; those after the first `unchanged` ones with other friction."""
    logs = []
    t = np.arange(round(16.0 * 100.0)) / 100.0
    for i, seed in enumerate(seeds):
        rng = np.random.default_rng(seed)
        sine, cosine = rng.normal(size=(2, 5, 1)) / np.arange(1, 6)[None, :, None]
        c = FourierTrajectory(np.zeros(1), 0.7 * sine, 0.7 * cosine, 0.15).sample(t)
        values = np.concatenate([ROBOT.nominal, friction if i < unchanged else later])
        tau = MODEL.torque(Motion.of(ROBOT, c.q, c.dq, c.ddq, t, rate=100.0), values) + 0.02 * rng.normal(size=c.q.shape)
        logs.append(Log(f"night{i + 1}", t, q=c.q, tau={ROBOT.transmission.measured.value: tau}))
    return ZeroPhase(cutoff_hz=12.0)(LogSet(tuple(logs), robot=ROBOT))


@pytest.fixture(scope="module")
def fit() -> Estimate:
    return WeightedLeastSquares().solve(Problem(Model(ROBOT, MODEL.effects), logged(1)))


def test_viscous_friction_that_grew_is_viscous_friction(fit: Estimate) -> None:
    found = monitor(fit, logged(2, later=FRICTION * [1.3, 1.0]))
    assert found.verdict == "changed"
    (change,) = found.changes
    assert (change.name, change.how) == ("viscous", How.CHANGED)
    (p,) = change.parameters
    assert abs(p.value - 0.36) < 4.0 * p.std < 0.1
    assert p.before == fit.value(p.name)
    assert change.heldout_gain > 0.8
    assert found.corrected.rms[0] < 0.5 * found.error.rms[0]
    # It fell as surely.
    (change,) = monitor(fit, logged(3, later=FRICTION * [0.7, 1.0])).changes
    assert (change.name, change.how) == ("viscous", How.CHANGED)
    assert change.parameters[0].value == pytest.approx(-0.36, abs=0.05)


def test_a_change_of_several_logs_is_told_since_when(fit: Estimate) -> None:
    found = monitor(fit, logged(4, 5, 6, 7, later=FRICTION * [1.0, 1.4], unchanged=2))
    assert [(c.name, c.since) for c in found.changes] == [("coulomb", "night3")]
    assert found.changes[0].parameters[0].value == pytest.approx(0.36, abs=0.05)
    assert found.to_dict()["changes"][0]["since"] == "night3"


def test_the_doubt_of_the_fit_is_no_change(fit: Estimate) -> None:
    off = replace(fit, values=np.where([n.startswith("Fv") for n in fit.names], 1.1, 1.0) * fit.values)
    assert [c.name for c in monitor(off, logged(8)).changes] == ["viscous"]
    # The same distance from a fit that knew it no better.
    doubtful = replace(off, covariance=fit.covariance + np.diag((0.05 * np.abs(fit.values)) ** 2))
    assert monitor(doubtful, logged(8)).changes == ()


def test_effects_that_follow_what_the_model_predicts_may_be_its_own() -> None:
    signals = logged(1)
    model = MODEL + make_effect("load_dependent_friction")
    values = np.concatenate([ROBOT.nominal, FRICTION, [0.0]])
    estimate = WeightedLeastSquares().solve(Problem(model, signals, reference=values))
    assert monitor(estimate, logged(2), reference=signals).changes == ()
    assert diagnose(estimate, fit=signals).verdict == Verdict.CLEAN


def test_all_looks_together_raise_as_few_false_alarms_as_one(fit: Estimate) -> None:
    assert sum(level_of(k) for k in range(1, 10_000)) <= 0.01
    assert level_of(1) > 0.005
    with pytest.raises(ConfigurationError, match="look"):
        monitor(fit, logged(9), look=0)
