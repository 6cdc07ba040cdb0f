"""The motion that tells two effects apart, against least squares on noise drawn beside it."""

from __future__ import annotations

import numpy as np
import pytest

import ident
from ident.diagnosis.next_motion import separating
from ident.effects.motion import Motion
from ident.errors import UnsupportedError
from ident.robots import nominal_values

Array = np.ndarray


@pytest.fixture(scope="module")
def model() -> ident.Model:
    robot = ident.load_robot("scara")
    joint = robot.joint_names[1]
    return robot.rigid_body() + ident.friction.Viscous() + ident.friction.Coulomb() + ident.make_effect("linear_spring", joints=[joint])


def test_the_expected_error_rate_is_that_of_refits_on_noise(model: ident.Model) -> None:
    robot = model.robot
    spring = next(e for e in model.effects if e.name == "linear_spring")
    rival = ident.make_effect("nonlinear_viscous", joints=spring.joints, a=2.0)
    noise = np.full(robot.n, 0.05)
    width = len(spring.parameters(robot))
    values = np.concatenate([nominal_values(robot.rigid_body()), np.full(2 * robot.n, 0.01), np.full(width, 1.0)])
    options = {"seconds": 3.0, "rate": 50.0, "starts": 1, "iterations": 3}
    found = separating(model, values, noise, spring, rival, **options)
    # A spring so weak that the two are hard to tell apart: its distance is proportional to it.
    values[-width:] *= 2.0 / found.distance
    found = separating(model, values, noise, spring, rival, **options)
    assert found.distance == pytest.approx(2.0, rel=0.02)

    t = np.arange(151) / 50.0
    sample = found.excitation.trajectory.sample(t)
    motion = Motion.of(robot, sample.q, sample.dq, sample.ddq, t, rate=50.0)
    columns = model.columns(motion).reshape(len(t) * robot.n, -1)
    other = np.concatenate([columns[:, :-width], rival.columns(motion, robot).reshape(len(columns), -1)], axis=1)
    mean = columns @ values
    rng = np.random.default_rng(3)
    wrong = 0
    bases = [np.linalg.svd(A / np.maximum(np.linalg.norm(A, axis=0), 1e-12), full_matrices=False) for A in (columns, other)]
    spans = [U[:, s > 1e-9 * s[0]] for U, s, _ in bases]
    for _ in range(400):
        tau = mean + 0.05 * rng.normal(size=len(mean))
        left = [float(tau @ tau - np.sum((U.T @ tau) ** 2)) for U in spans]
        wrong += left[1] < left[0]
    # The two are not nested, so that the rate is that of one deviation on average over how the rival's own column lies.
    assert wrong / 400 < found.error_rate + 0.08
    assert found.error_rate == pytest.approx(0.159, abs=0.005)


def test_effects_that_are_the_same_are_refused(model: ident.Model) -> None:
    spring = next(e for e in model.effects if e.name == "linear_spring")
    values = np.zeros(len(model.parameters))
    with pytest.raises(UnsupportedError):
        separating(
            model, values, np.ones(model.robot.n), spring, ident.make_effect("linear_spring", joints=spring.joints), seconds=3.0, rate=50.0
        )
