"""DIDIM on logs that its own experiment made: without noise the truth comes back to the integrator's precision, however torque
was logged and the controller saw the motion; told wrongly, it does not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ident import Problem
from ident.errors import ConfigurationError
from ident.estimators import Experiment, assumed_experiment, make_estimator
from ident.logs.log import LogSet
from ident.planning import default_model
from ident.robots import load_robot, nominal_values
from ident.signals import Recorded
from ident.simulation.command import Feedback
from ident.simulation.controller import PDFeedforward
from ident.simulation.plant import Plant
from ident.simulation.sensors import Sensors, TorqueWindow
from ident.simulation.simulate import simulate_batch
from ident.simulation.trajectory import FourierTrajectory

RATE = 200.0
ROBOT = load_robot("scara")
MODEL = default_model(ROBOT)
VALUES = nominal_values(MODEL)
TRUTH = MODEL.base.base_values(VALUES)
#: So fine that nothing is rounded, but speeds come from differences of positions, and late.
DIFFERENCES = Feedback(counts=1e12)


def way(seed: int) -> FourierTrajectory:
    sine, cosine = 0.3 * np.random.default_rng(seed).normal(size=(2, 3, ROBOT.n))
    return FourierTrajectory(np.full(ROBOT.n, 0.2), sine, cosine, 0.4)


WAYS = {f"run{i}": way(i) for i in range(2)}
CONTROLLER = PDFeedforward.tuned(MODEL, VALUES)


@cache
def made(window: float, differences: bool, control_rate: float) -> Problem:
    sensors = Sensors((TorqueWindow(window),) if window else ())
    runs = simulate_batch(
        Plant(MODEL, VALUES), desired=list(WAYS.values()), controller=CONTROLLER, rate=RATE, control_rate=control_rate,
        step=1.0 / control_rate, feedback=DIFFERENCES if differences else Feedback(), sensors=sensors,
    )  # fmt: skip
    logs = tuple(run.log(name) for run, name in zip(runs, WAYS, strict=True))
    return Problem(MODEL, Recorded()(LogSet(logs, ROBOT)))


def error(window: float, differences: bool, control_rate: float, **told: object) -> float:
    """Largest relative error of a base parameter."""
    experiment = Experiment(controller=CONTROLLER, desired=WAYS, control_rate=control_rate, **told)  # type: ignore[arg-type]
    found = make_estimator("didim", experiment=experiment, starts=1).solve(made(window, differences, control_rate))
    values = MODEL.base.base_values(found.all_values)
    return float(np.max(np.abs(values - TRUTH) / np.maximum(np.abs(TRUTH), 1e-3 * np.abs(TRUTH).max())))


@pytest.mark.parametrize(
    ("window", "differences", "control_rate"),
    [(w, d, r) for w in (0.0, 0.005) for d, r in ((False, RATE), (False, 5 * RATE), (True, RATE))],
)
def test_truth_comes_back(window: float, differences: bool, control_rate: float) -> None:
    told = error(window, differences, control_rate, torque_window=window, sensing=DIFFERENCES if differences else None)
    assert told < 1e-7


def test_torque_that_is_a_mean_is_not_the_torque_of_the_instant() -> None:
    """The half period by which held torque comes late is what biased DIDIM."""
    assert error(0.005, False, RATE) > 1e-2


def test_speeds_from_differences_come_late() -> None:
    assert error(0.0, True, RATE) > 1e-2


def test_rounding_is_not_repeated() -> None:
    """A coarse encoder in the controller is repeated as one that does not round."""
    assert error(0.0, True, RATE, sensing=Feedback(counts=100.0)) < 1e-7


def test_a_window_is_a_time() -> None:
    with pytest.raises(ConfigurationError, match="torque_window"):
        Experiment(torque_window=-1.0)


def test_where_nothing_is_known_a_controller_is_assumed_and_the_estimate_says_so() -> None:
    problem = made(0.0, False, 5 * RATE)
    start = make_estimator("wls").solve(problem)
    assert problem.signals.source is not None
    experiment = assumed_experiment(problem.signals.source.logs, MODEL, start.all_values, 20.0)
    found = make_estimator("didim", experiment=experiment, starts=1).solve(problem)
    assert any("20 Hz" in warning for warning in found.warnings)
    rigid = [i for i, name in enumerate(MODEL.base.names) if name.startswith(("I", "m"))]
    values = MODEL.base.base_values(found.all_values)
    assert np.abs(values - TRUTH)[rigid] == pytest.approx(0.0, abs=0.05 * np.abs(TRUTH[rigid]).max())
