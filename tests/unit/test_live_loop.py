"""One sample at a time: recursion, feedforward and forward dynamics against the regressor and the ways for whole logs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_robots import ROBOTS, smooth
from rigid_models import kernels, using

import ident
from ident.effects.motion import Motion
from ident.effects.registry import make_effect
from ident.errors import ConfigurationError, DataError, UnsupportedError
from ident.estimate.feedforward import FixedModel
from ident.estimators import RecursiveLeastSquares
from ident.model import Model
from ident.robots.robot import Robot
from ident.robots.transmission import Side

DECLARED = ("rotor_inertia", "viscous", "coulomb", "offset", "linear_spring")
FIXED = list(ROBOTS)


@pytest.fixture(params=["numpy", kernels()[-1]])
def kernel(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setenv("IDENT_KERNEL", "numpy" if request.param == "numpy" else "native")
    with using(request.param):
        yield request.param


def drives(robot: Robot) -> Model:
    """Links, all that drives are declared to have, and one of it again on the joint side."""
    more = make_effect("viscous", joints=[robot.joint_names[-1]], side=Side.JOINT, label="x")
    return Model(robot, (*robot.rigid_body().effects, *(make_effect(name) for name in DECLARED), more))


def values_of(model: Model) -> np.ndarray:
    values = np.random.default_rng(3).uniform(0.2, 1.0, len(model.parameters))
    values[: len(model.robot.nominal)] = model.robot.nominal
    return values


@pytest.mark.parametrize("name", FIXED)
def test_feedforward_is_the_regressor_times_the_values(name: str, kernel: str) -> None:
    robot = ROBOTS[name]()
    _, q, dq, ddq = smooth(robot, 40, 200.0, 0)
    dq[7] = 0.0  # at rest dry friction gives nothing
    model = drives(robot)
    values = values_of(model)
    expected = model.columns(Motion.of(robot, q, dq, ddq)) @ values
    fixed = FixedModel(model, values)
    assert fixed.compiled == robot.loop.is_trivial
    scale = np.abs(expected).max()
    assert np.abs(fixed.torque(q, dq, ddq) - expected).max() <= 1e-12 * scale
    one = np.array([fixed.torque(*state) for state in zip(q, dq, ddq, strict=True)])
    assert np.abs(one - expected).max() <= 1e-12 * scale


@pytest.mark.parametrize("name", FIXED)
def test_acceleration_is_the_one_that_takes_the_torque(name: str, kernel: str) -> None:
    robot = ROBOTS[name]()
    _, q, dq, ddq = smooth(robot, 40, 200.0, 0)
    model = drives(robot)
    fixed = FixedModel(model, values_of(model))
    tau = fixed.torque(q, dq, ddq)
    assert np.abs(fixed.acceleration(q, dq, tau) - ddq).max() <= 1e-9 * np.abs(ddq).max()
    one = np.array([fixed.acceleration(*state) for state in zip(q, dq, tau, strict=True)])
    assert np.abs(one - ddq).max() <= 1e-9 * np.abs(ddq).max()


def test_other_effects_take_the_general_way(kernel: str) -> None:
    robot = ident.load_robot("scara")
    model = drives(robot) + make_effect("stribeck", v_s=0.3) + make_effect("load_dependent_friction")
    _, q, dq, ddq = smooth(robot, 30, 200.0, 0)
    values = values_of(model)
    fixed = FixedModel(model, values)
    assert not fixed.compiled
    expected = model.inverse_dynamics(q, dq, ddq, values)
    assert np.abs(fixed.torque(q, dq, ddq) - expected).max() <= 1e-12 * np.abs(expected).max()
    assert fixed.torque(q[3], dq[3], ddq[3]).shape == (4,)


def test_a_state_that_is_of_no_use_is_refused(kernel: str) -> None:
    robot = ident.load_robot("scara")
    fixed = FixedModel(drives(robot), values_of(drives(robot)))
    q = np.zeros(4)
    for bad in (np.nan, np.inf):
        with pytest.raises(DataError, match="not finite"):
            fixed.torque(q, q + bad, q)
        with pytest.raises(DataError, match="not finite"):
            fixed.acceleration(q, q, q + bad)
    with pytest.raises(ConfigurationError, match="expected shape"):
        fixed.torque(q, np.zeros(3), q)
    with pytest.raises(ConfigurationError, match="expected shape"):
        fixed.torque(np.zeros((5, 4)), np.zeros((4, 4)), np.zeros((5, 4)))
    assert fixed.torque([0, 0, 0, 0], [0, 0, 0, 1], [1, 0, 0, 0]).shape == (4,)
    assert fixed.torque(*np.zeros((3, 4, 6))[:, :, ::2].swapaxes(1, 2)[:, :, :]).shape == (3, 4)
    with pytest.raises(UnsupportedError, match="more than the state"):
        FixedModel(robot.rigid_body() + make_effect("offset_drift"), np.ones(44))


def test_massless_links_have_no_acceleration(kernel: str) -> None:
    robot = ident.load_robot("scara")
    model = robot.rigid_body()
    with pytest.raises(DataError, match="singular"):
        FixedModel(model, np.zeros(40)).acceleration(*np.ones((3, 4)))


def test_an_estimate_feeds_forward_what_it_predicts(tmp_path: Path) -> None:
    train, test = ident.demo_logs()
    estimate = ident.fit(train, "puma560", held=0)
    signals = ident.ZeroPhase(decimate=False)(test, estimate.model.robot)
    expected = (
        estimate.problem_on(signals).model.columns(Motion.of(signals.robot, signals.q, signals.dq, signals.ddq)) @ estimate.all_values
    )
    found = estimate.feedforward(signals.q, signals.dq, signals.ddq)
    assert np.abs(found - expected).max() <= 1e-11 * np.abs(expected).max()
    back = estimate.forward_dynamics(signals.q[5], signals.dq[5], found[5])
    assert np.abs(back - signals.ddq[5]).max() <= 1e-8 * np.abs(signals.ddq[5]).max()
    again = ident.Estimate.load(estimate.save(tmp_path / "fit.json"))
    assert np.array_equal(
        again.feedforward(signals.q[5], signals.dq[5], signals.ddq[5]),
        estimate.feedforward(*(x[5] for x in (signals.q, signals.dq, signals.ddq))),
    )


@pytest.mark.parametrize("forgetting", [1.0, 0.98])
@pytest.mark.parametrize("name", FIXED)
def test_a_live_recursion_is_the_recursion(name: str, forgetting: float, kernel: str) -> None:
    robot = ROBOTS[name]()
    links = robot.rigid_body()
    model = Model(robot, (make_effect("coulomb"), *links.effects, make_effect("rotor_inertia"), make_effect("offset")))
    _, q, dq, ddq = smooth(robot, 150, 60.0, 2)
    tau = model.columns(Motion.of(robot, q, dq, ddq)) @ values_of(model) + 0.01 * np.random.default_rng(1).normal(size=q.shape)
    tau[40, 0] = np.nan
    tau[90] = np.nan
    start = RecursiveLeastSquares(noise_std=0.01, forgetting=forgetting).start(model).observe(q[:20], dq[:20], ddq[:20], tau[:20])
    expected = start.observe(q[20:], dq[20:], ddq[20:], tau[20:])
    live = start.live()
    for state in zip(q[20:], dq[20:], ddq[20:], tau[20:], strict=True):
        live.add(*state)
    found = live.state
    assert found.seen == expected.seen
    assert found.effective == pytest.approx(expected.effective, rel=1e-12)
    assert np.array_equal(found.information.counts, expected.information.counts)
    for R, S in zip(found.information.factors, expected.information.factors, strict=True):
        assert np.abs(R.T @ R - S.T @ S).max() <= 1e-11 * max(np.abs(S.T @ S).max(), 1e-12)
    known = np.isfinite(expected.values)
    assert np.array_equal(known, np.isfinite(found.values))
    if known.any():
        assert np.abs((found.values - expected.values) / expected.std)[known].max() < 1e-4
    assert live.state.observe(q[:3], dq[:3], ddq[:3], tau[:3]).seen == expected.seen + 3


def test_an_effect_that_declares_nothing_is_observed_as_ever() -> None:
    robot = ident.load_robot("scara")
    model = robot.rigid_body() + make_effect("stribeck", v_s=0.3)
    _, q, dq, ddq = smooth(robot, 12, 60.0, 2)
    start = RecursiveLeastSquares(noise_std=1.0).start(model)
    live = start.live()
    for state in zip(q, dq, ddq, q, strict=True):
        live.add(*state)
    expected = start.observe(q, dq, ddq, q)
    for R, S in zip(live.state.information.factors, expected.information.factors, strict=True):
        assert np.allclose(R.T @ R, S.T @ S, rtol=1e-10, atol=1e-12)


def test_a_sample_of_no_use_leaves_the_recursion_as_it_was(kernel: str) -> None:
    robot = ident.load_robot("scara")
    live = RecursiveLeastSquares().start(robot.rigid_body()).live()
    live.add(*np.ones((4, 4)))
    before = live.state
    with pytest.raises(DataError, match="not finite"):
        live.add(np.ones(4), np.full(4, np.nan), np.ones(4), np.ones(4))
    with pytest.raises(ConfigurationError, match="4 joints"):
        live.add(np.ones(3), np.ones(4), np.ones(4), np.ones(4))
    after = live.state
    assert after.seen == before.seen == 1
    assert np.array_equal(after.information.factors, before.information.factors)
    assert replace(before, seen=2).seen == 2
