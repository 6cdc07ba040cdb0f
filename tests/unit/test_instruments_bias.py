"""Instrumental variables where least squares is biased: on raw second differences of coarse encoders, near the Cramér-Rao bound."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest

from ident import Problem
from ident.estimators import Experiment, make_estimator
from ident.planning import default_model
from ident.robots import load_robot, nominal_values
from ident.robots.transmission import Side
from ident.signals.preparation import CentralDifference, ZeroPhase
from ident.simulation.controller import PDFeedforward
from ident.simulation.plant import Plant
from ident.simulation.sensors import Quantisation, Sensors, TorqueNoise, TorqueWindow
from ident.simulation.simulate import simulate
from ident.simulation.trajectory import FourierTrajectory

bound = pytest.importorskip("benchmarks.methods.bound")
RATE, SECONDS, SEEDS = 200.0, 15.0, 10
KINDS = ["reference", pytest.param("simulation", marks=pytest.mark.slow)]


@dataclass(frozen=True, eq=False)
class Trial:
    """Errors (S, b) over the bound, of the same logs; deviations of the instrumental estimate in its own intervals (S, b)."""

    names: tuple[str, ...]
    least_squares: np.ndarray
    instruments: np.ndarray
    deviations: np.ndarray

    def groups(self) -> dict[str, list[int]]:
        found: dict[str, list[int]] = {}
        for i, name in enumerate(self.names):
            found.setdefault("friction" if name.startswith("F") else "inertia", []).append(i)
        return found


@cache
def trial(kind: str) -> Trial:
    robot = load_robot("scara")
    model = default_model(robot)
    values = nominal_values(model)
    truth = model.base.base_values(values)
    sine, cosine = 0.35 * np.random.default_rng(5).normal(size=(2, 5, robot.n))
    way = FourierTrajectory(np.full(robot.n, 0.2), sine, cosine, 1 / SECONDS)
    controller = PDFeedforward.tuned(model, values)
    made = simulate(
        Plant(model, values), desired=way, controller=controller, rate=RATE, control_rate=1000.0, sensors=Sensors((), Side.MOTOR)
    )
    level = 0.02 * np.sqrt(np.mean(made.tau**2, axis=0))
    window = TorqueWindow(1 / RATE)
    exact = made.reread(Sensors((window,), Side.MOTOR)).log("run")
    sigma = bound.filtered_bound(Problem(model, ZeroPhase(cutoff_hz=20.0)([exact], robot)), level)
    read = Sensors((Quantisation.counts(500.0), window, TorqueNoise(tuple(level))), Side.MOTOR, columns=("q", "tau"))
    experiment = Experiment(controller=controller, desired={"*": way}, control_rate=RATE)
    iv = make_estimator("iv", instruments=kind, loop="open", experiment=experiment)
    least, found, deviations = [], [], []
    for seed in range(SEEDS):
        problem = Problem(model, CentralDifference()([made.reread(read, seed).log("run")], robot))
        least.append((make_estimator("ls").solve(problem).values - truth) / sigma)
        estimate = iv.solve(problem)
        found.append((estimate.values - truth) / sigma)
        deviations.append((estimate.values - truth) / estimate.std)
    return Trial(model.base.names, np.array(least), np.array(found), np.array(deviations))


def bias(errors: np.ndarray) -> float:
    """Rms of the mean errors, less what so few seeds show of the scatter."""
    chance = errors.var(axis=0, ddof=1) / len(errors)
    return float(np.sqrt(max(0.0, np.mean(errors.mean(axis=0) ** 2 - chance))))


@pytest.mark.parametrize("kind", KINDS)
def test_bias_is_at_most_a_fifth_of_that_of_least_squares(kind: str) -> None:
    t = trial(kind)
    for name, at in t.groups().items():
        own, least = bias(t.instruments[:, at]), bias(t.least_squares[:, at])
        assert least > 5.0, f"{name}: least squares is hardly biased, so nothing is shown"
        assert own <= 0.2 * least, f"{name}: bias {own:.2f} against {least:.2f} of least squares"
        in_interval = np.abs(t.deviations[:, at].mean(axis=0)) / 1.96
        assert in_interval.max() <= 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_errors_are_near_the_bound_and_intervals_hold_them(kind: str) -> None:
    t = trial(kind)
    for name, at in t.groups().items():
        error = float(np.sqrt(np.mean(t.instruments[:, at] ** 2)))
        assert error <= 1.15, f"{name}: {error:.2f} of the bound"
    assert float(np.mean(np.abs(t.deviations) < 1.96)) > 0.9
    assert float(np.sqrt(np.mean(t.deviations**2))) == pytest.approx(1.0, abs=0.2)
