"""Replay of a model against measured motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from effect_robots import pendulum

from ident.effects.offset import Offset
from ident.effects.timing import Delay
from ident.errors import ConfigurationError, DataError
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.model import Model
from ident.robots import load_robot, nominal_values
from ident.signals import Recorded, Signals
from ident.simulation.plant import Plant
from ident.simulation.replay import replay
from ident.simulation.result import Simulation
from ident.simulation.simulate import simulate
from ident.simulation.trajectory import FourierTrajectory


def _arm() -> tuple[Model, np.ndarray]:
    robot = load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    return model, nominal_values(model)


@pytest.fixture(scope="module")
def arm_run() -> tuple[Model, np.ndarray, Simulation]:
    """The PUMA in closed loop, controller at the log's rate, so that the torque between samples is known."""
    model, values = _arm()
    rng = np.random.default_rng(0)
    wave = FourierTrajectory(np.array([0, -1.2, 1.4, 0, 0.3, 0]), rng.normal(size=(3, 6)) * 0.5, rng.normal(size=(3, 6)) * 0.5, 0.5)
    return model, values, simulate(Plant(model, values), desired=wave, rate=500.0, control_rate=500.0, step=2e-3)


def _signals(model: Model, run: Simulation) -> Signals:
    return Recorded()(run.log(), model.robot)


def test_the_true_model_replays_the_motion(arm_run) -> None:
    model, values, run = arm_run
    signals = _signals(model, run)
    # The torque was held between samples: shifting it by half a sample makes straight lines of it right to second order.
    mean = 0.5 * (signals.torque + np.vstack([signals.torque[:1], signals.torque[:-1]]))
    result = replay(model, values, replace(signals, torque=mean), window=0.4, windows=8)
    assert not result.diverged.any()
    assert np.all(result.position_error < 2e-4)
    assert np.all(result.relative_error < 0.02)
    wrong = values.copy()
    wrong[model.names.index("Fc_joint1")] *= 1.5
    worse = replay(model, wrong, replace(signals, torque=mean), window=0.4, windows=8)
    assert worse.position_error[0] > 10 * result.position_error[0]


def test_a_replay_that_takes_too_long_ends_and_says_why(arm_run) -> None:
    model, values, run = arm_run
    signals = _signals(model, run)
    with pytest.raises(DataError, match=r"more than 40 evaluations .* lets go and catches"):
        replay(model, values, signals, window=0.4, windows=8, most=40)
    assert len(replay(model, values, signals, window=0.4, windows=2, most=100_000).starts) == 2


def test_an_observer_holds_the_simulation_and_reports_its_torque(arm_run) -> None:
    model, values, run = arm_run
    signals = _signals(model, run)
    wrong = values.copy()
    wrong[model.names.index("Fc_joint1")] += 0.05
    free = replay(model, wrong, signals, window=0.6, windows=4)
    pulled = replay(model, wrong, signals, window=0.6, windows=4, observer_hz=4.0)
    assert pulled.position_error[0] < 0.5 * free.position_error[0]
    assert np.all(free.correction == 0)
    error = pulled.to_dict()["correction_rms"]
    assert 0.01 < error[0] < 0.1


def test_a_joint_without_torque_and_unusable_windows_are_said(arm_run) -> None:
    model, values, run = arm_run
    signals = _signals(model, run)
    torque = signals.torque.copy()
    torque[200:, 2] = np.nan
    few = replay(model, values, replace(signals, torque=torque), window=0.3, windows=40)
    assert np.all(few.starts + 0.3 <= signals.t[200] + 1e-9)
    with pytest.raises(DataError, match="torque on every joint"):
        replay(model, values, replace(signals, torque=torque), window=0.6)
    with pytest.raises(ConfigurationError, match="parameters"):
        replay(model, values[:-1], signals)


def test_compiled_windows_equal_those_of_the_general_integrator(arm_run) -> None:
    """Reversals of dry friction included. The general integrator is taken where evaluations are counted."""
    model, values, run = arm_run
    signals = _signals(model, run)
    compiled = replay(model, values, signals, window=0.4, windows=6)
    general = replay(model, values, signals, window=0.4, windows=6, most=10**9)
    assert np.all(np.ptp(np.sign(compiled.simulated_rate), axis=0).max(axis=0) == 2)  # speeds of every joint change their sign
    assert compiled.simulated == pytest.approx(general.simulated, rel=0, abs=1e-12)
    assert compiled.simulated_rate == pytest.approx(general.simulated_rate, rel=0, abs=1e-11)


def test_a_window_that_runs_away_leaves_the_others_alone(arm_run) -> None:
    model, values, run = arm_run
    signals = _signals(model, run)
    torque = signals.torque.copy()
    first = replay(model, values, signals, window=0.4, windows=3)
    torque[: round(0.4 * signals.rate)] *= 1e6
    hit = replay(model, values, replace(signals, torque=torque), window=0.4, windows=3)
    assert hit.diverged.tolist() == [True, False, False]
    assert np.isnan(hit.simulated[-1, 0]).all()
    assert hit.simulated[:, 1:] == pytest.approx(first.simulated[:, 1:], rel=0, abs=1e-12)
    general = replay(model, values, replace(signals, torque=torque), window=0.4, windows=3, most=10**9)
    assert np.array_equal(np.isnan(hit.simulated), np.isnan(general.simulated))


def test_a_model_that_runs_away_is_reported_not_raised(arm_run) -> None:
    model, values, run = arm_run
    signals = _signals(model, run)
    bad = values.copy()
    bad[: 10 * model.robot.n] *= -1.0
    result = replay(model, bad, signals, window=0.8, windows=3)
    assert result.diverged.any()
    assert "diverged" in str(result)
    assert result.to_dict()["diverged"] == int(result.diverged.sum())


def test_effects_of_measurement_act_along_the_measured_motion() -> None:
    """A log whose torque lags: the model with the delay replays it, the one without does not."""
    robot = pendulum()
    plain = robot.rigid_body() + RotorInertia() + Viscous() + Offset()
    values = np.concatenate([robot.nominal, [0.2, 0.6, 0.1]])
    t = np.arange(2001) / 1000.0
    torque = (6.0 * np.sin(2 * np.pi * 1.5 * t) + 3.0)[:, None]
    run = simulate(Plant(plain, values), torque=torque, start=(np.array([0.3]), np.zeros(1)), rate=1000.0, hold="first_order")
    late = 0.01
    shifted = np.interp(t - late, t, torque[:, 0])[:, None]
    signals = replace(_signals(plain, run), torque=shifted)
    model = plain + Delay()
    known = np.append(values, np.full(len(model.parameters) - len(values), late))
    with_delay = replay(model, known, signals, window=0.5, windows=3)
    without = replay(plain, values, signals, window=0.5, windows=3)
    assert with_delay.position_error[0] < 0.2 * without.position_error[0]
