"""The recursion's end against the batch on the PUMA 560, and instruments against noise in the regressor."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from ident import Problem
from ident.effects.motion import Motion
from ident.estimate.status import StatusCode
from ident.estimators import make_estimator
from ident.logs.log import Log, LogSet
from ident.planning import default_model
from ident.robots import load_robot, nominal_values
from ident.robots.transmission import Side
from ident.signals import CentralDifference, Recorded
from ident.simulation.command import Feedback
from ident.simulation.controller import PDFeedforward
from ident.simulation.plant import Plant
from ident.simulation.sensors import Quantisation, Sensors
from ident.simulation.simulate import simulate
from ident.simulation.trajectory import FourierTrajectory


def wave(n: int, seconds: float, seed: int, size: float) -> FourierTrajectory:
    sine, cosine = size * np.random.default_rng(seed).normal(size=(2, 5, n))
    return FourierTrajectory(np.full(n, 0.3), sine, cosine, 0.1, round(seconds * 0.1))


def long_problem(std: float = 0.0) -> Problem:
    """120,000 samples of the PUMA at 5 ms, 2 % torque noise; `std`: white noise of the accelerations, rad/s²."""
    robot = load_robot("puma560")
    model = default_model(robot)
    values = nominal_values(model)
    t = np.arange(120_000) * 0.005
    motion = wave(robot.n, 600.0, 1, 0.3).sample(t)
    tau = model.torque(Motion.of(robot, motion.q, motion.dq, motion.ddq, t), values)
    rng = np.random.default_rng(2)
    tau = tau + 0.02 * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    ddq = motion.ddq + std * rng.normal(size=motion.ddq.shape)
    return Problem(model, Recorded()(LogSet((Log("long", t, motion.q, dq=motion.dq, ddq=ddq, tau={"motor": tau}),), robot)))


@pytest.mark.slow
def test_the_recursion_ends_at_the_batch_on_120000_samples_of_the_puma() -> None:
    problem = long_problem()
    batch = make_estimator("wls").solve(problem)
    recursive = make_estimator("rls", follow=["Izz_joint1", "Izz_joint5"]).solve(problem)
    assert np.abs((recursive.values - batch.values) / batch.values).max() < 1e-10
    assert recursive.trace["names"] == ["Izz_joint1", "Izz_joint5"]
    assert recursive.trace["samples"][-1] == len(problem.valid)
    assert np.shape(recursive.trace["values"]) == (100, 2)


@pytest.mark.slow
def test_recursive_instruments_end_at_the_batch_on_120000_samples_of_the_puma() -> None:
    problem = long_problem(2.0)
    assert len(problem.valid) == 120_000
    plain = {"loop": "open", "weighting": "none", "instruments": "forward_dynamics"}
    batch = make_estimator("iv", **plain, iterations=2).solve(problem)
    recursive = make_estimator("riv", loop="open", passes=len(batch.trace["steps"])).solve(problem)
    assert np.abs((recursive.values - batch.values) / batch.values).max() < 1e-8
    assert recursive.trace["samples"][-1] == 120_000
    # The noise of the accelerations matters, or least squares would do.
    least = make_estimator("ls").solve(problem)
    assert np.abs((least.values - batch.values) / batch.std).max() > 20


@cache
def looped(seconds: float = 20.0):
    """The SCARA under a stiff controller that answers to a coarse encoder, exact torque recorded."""
    robot = load_robot("scara")
    model = default_model(robot)
    values = nominal_values(model)
    controller = PDFeedforward.tuned(model, values, frequency_hz=8.0)
    made = simulate(
        Plant(model, values), desired=wave(robot.n, seconds, 3, 0.12), controller=controller, rate=200.0, control_rate=200.0, step=5e-3,
        feedback=Feedback(counts=200.0), sensors=Sensors((Quantisation.counts(200.0),), Side.MOTOR, columns=("q", "tau")),
    )  # fmt: skip
    return robot, model, values, made.log("loop")


def test_measured_torque_in_a_loop_makes_no_instruments_and_the_test_says_so() -> None:
    robot, model, _, log = looped()
    problem = Problem(model, CentralDifference()(LogSet((log,), robot)))
    found = make_estimator("iv").solve(problem)
    assert found.status.code == StatusCode.INVALID_INSTRUMENTS
    assert found.trace["validity"]["p_value"] < 1e-3


def test_a_joint_whose_torque_stays_unexplained_is_not_ok() -> None:
    robot = load_robot("scara")
    model = default_model(robot)
    values = nominal_values(model)
    t = np.arange(0.0, 20.0, 0.01)
    motion = wave(robot.n, 20.0, 3, 0.3).sample(t)
    tau = model.torque(Motion.of(robot, motion.q, motion.dq, motion.ddq, t), values)
    level = np.sqrt(np.mean(tau**2, axis=0))
    noise = np.random.default_rng(0).normal(size=tau.shape) * level
    for share, code in ((0.01, StatusCode.OK), (0.6, StatusCode.POOR_FIT)):
        mixed = tau + noise * np.array([0.01, share, 0.01, 0.01])
        log = Log("run", t, motion.q, dq=motion.dq, ddq=motion.ddq, tau={robot.transmission.measured.value: mixed})
        status = make_estimator("wls").solve(Problem(model, Recorded()(LogSet((log,), robot)))).status
        assert status.code == code, status.text
        assert (code == StatusCode.OK) or robot.joint_names[1] in status.text
