"""Simulated runs end to end: tracking, actuators, sensors, logs."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import pendulum, slide

from ident.errors import ConfigurationError
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.robots import load_robot, nominal_values
from ident.robots.transmission import Side
from ident.simulation.actuators import CurrentLoop, Gain, TorqueLimit
from ident.simulation.command import Feedback
from ident.simulation.controller import CascadedPPI, ComputedTorque, PDFeedforward, typical_inertia
from ident.simulation.plant import Plant
from ident.simulation.sensors import (
    EncoderError,
    Jitter,
    Lag,
    MeasurementDelay,
    PositionNoise,
    Quantisation,
    Sensors,
    TorqueNoise,
    TorqueScale,
    TorqueWindow,
)
from ident.simulation.simulate import simulate, simulate_batch
from ident.simulation.trajectory import FourierTrajectory, PointToPoint


@pytest.fixture(scope="module")
def puma() -> Plant:
    robot = load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    return Plant(model, nominal_values(model))


def _wave(seed: int = 0) -> FourierTrajectory:
    rng = np.random.default_rng(seed)
    return FourierTrajectory(np.array([0, -1.2, 1.4, 0, 0.3, 0]), rng.normal(size=(3, 6)) * 0.3, rng.normal(size=(3, 6)) * 0.3, 0.5)


@pytest.mark.parametrize("kind", ["pd", "cascade", "computed torque"])
def test_controllers_track_and_the_log_satisfies_the_model(puma: Plant, kind: str) -> None:
    model, values = puma.model, np.asarray(puma.values)
    rigid = puma.robot.rigid_body() + RotorInertia()
    part = values[: len(rigid.parameters)]
    controller = {
        "pd": PDFeedforward.tuned(rigid, part, 6.0),
        "cascade": CascadedPPI.tuned(rigid, part),
        "computed torque": ComputedTorque(model=rigid, values=part, kp=900.0, kd=60.0),
    }[kind]
    wave = _wave()
    run = simulate(puma, desired=wave, controller=controller, rate=100.0, control_rate=500.0, step=2e-3)
    wanted = wave.sample(run.t)
    assert np.abs(run.q - wanted.q).max() < 0.1
    assert np.ptp(wanted.q, axis=0).min() > 0.1
    moving = ~run.held
    gap = np.abs(model.inverse_dynamics(run.q, run.dq, run.ddq, values) - run.tau)
    assert gap[moving].max() < 1e-11
    log = run.log("a")
    assert log.q is not None
    np.testing.assert_array_equal(log.q, run.q)
    np.testing.assert_array_equal(log.tau["motor"], run.tau)


def test_noise_free_simulation_gives_back_every_parameter(puma: Plant) -> None:
    model, values = puma.model, np.asarray(puma.values)
    run = simulate(puma, desired=_wave(3), rate=100.0, control_rate=500.0, step=2e-3)
    from ident.effects.motion import Motion

    rows = model.columns(Motion.of(puma.robot, run.q, run.dq, run.ddq))
    use = ~run.held
    base = model.base
    A, b = rows[use][:, base.independent], run.tau[use]
    scale = np.linalg.norm(A, axis=0)
    found = np.linalg.lstsq(A / scale, b, rcond=None)[0] / scale
    truth = base.base_values(values)
    assert len(truth) == 52
    np.testing.assert_allclose(found, truth, rtol=1e-8, atol=1e-8 * np.abs(truth).min())


def test_a_batch_equals_its_runs_alone(puma: Plant) -> None:
    waves = [_wave(1), _wave(2)]
    together = simulate_batch(
        puma, desired=waves, rate=50.0, control_rate=250.0, step=4e-3, duration=0.6, sensors=Sensors.typical(torque_noise=0.1), seeds=[5, 6]
    )
    for wave, run, seed in zip(waves, together, (5, 6), strict=True):
        alone = simulate(
            puma, desired=wave, rate=50.0, control_rate=250.0, step=4e-3, duration=0.6, sensors=Sensors.typical(torque_noise=0.1), seed=seed
        )
        np.testing.assert_allclose(run.q, alone.q, atol=1e-10)
        np.testing.assert_allclose(run.readings.tau, alone.readings.tau, atol=1e-7)


def test_saturation_gain_and_current_loop() -> None:
    robot = slide()
    model = robot.rigid_body() + RotorInertia()
    plant = Plant(model, np.append(robot.nominal, 1e-5))
    torque = np.full((201, 1), 0.2)
    start = (np.zeros(1), np.zeros(1))
    clipped = simulate(plant, torque=torque, start=start, rate=1000.0, actuators=[TorqueLimit((0.05,))])
    np.testing.assert_allclose(clipped.applied, 0.05)
    np.testing.assert_allclose(clipped.tau, 0.2)
    weak = simulate(plant, torque=torque, start=start, rate=1000.0, actuators=[Gain((0.9,))])
    np.testing.assert_allclose(model.inverse_dynamics(weak.q, weak.dq, weak.ddq, np.asarray(plant.values)), 0.18, rtol=1e-10)
    torque[0] = 0.0
    slow = simulate(plant, torque=torque, start=start, rate=1000.0, actuators=[CurrentLoop(0.02)])
    # Mean over each millisecond of 0.2 (1 - exp(-(t - 1 ms)/20 ms)).
    t = slow.t[1:]
    lag = 0.2 * (1 - (np.exp(-(t - 1e-3) / 0.02) - np.exp(-t / 0.02)) * 0.02 / 1e-3)
    np.testing.assert_allclose(slow.applied[1:, 0], lag, rtol=1e-9)


def _still_run():
    robot = pendulum()
    model = robot.rigid_body() + Viscous()
    plant = Plant(model, np.append(robot.nominal, 0.5))
    t = np.arange(2001) / 500.0
    torque = 6.0 * np.sin(2 * np.pi * t)[:, None]
    return simulate(plant, torque=torque, start=(np.array([0.3]), np.zeros(1)), rate=500.0, hold="first_order")


def test_sensors_do_what_they_say() -> None:
    run = _still_run()
    q, tau, t = run.q, run.tau, run.t

    def read(*distortions):
        return run.reread(Sensors(distortions), seed=1).readings

    late = read(MeasurementDelay("torque", 0.01)).tau
    np.testing.assert_allclose(late[5:], tau[:-5], atol=1e-12)
    early = read(MeasurementDelay("position", 0.004)).motion.q
    np.testing.assert_allclose(early[2:], q[:-2], atol=1e-12)
    lag = read(Lag("torque", 0.01)).tau
    w = 2 * np.pi
    want = 6.0 / np.sqrt(1 + (0.01 * w) ** 2) * np.sin(w * t - np.arctan(0.01 * w))
    np.testing.assert_allclose(lag[100:, 0], want[100:], atol=1e-3)
    eccentric = read(EncoderError(amplitude=0.01, order=2.0, phase=0.3)).motion
    np.testing.assert_allclose(eccentric.q - q, 0.01 * np.sin(2 * q + 0.3), atol=1e-15)
    np.testing.assert_allclose(np.gradient(eccentric.q[:, 0], t)[5:-5], eccentric.dq[5:-5, 0], atol=1e-3)
    counted = read(Quantisation.counts(1000)).motion.q
    step = 2 * np.pi / 1000
    assert np.abs(counted - q).max() <= step / 2 + 1e-12
    np.testing.assert_allclose(counted / step, np.round(counted / step), atol=1e-9)
    noisy = read(PositionNoise(1e-3)).motion.q - q
    assert abs(noisy.std() - 1e-3) < 1e-4
    scaled = read(TorqueScale(1.1, 0.2)).tau
    np.testing.assert_allclose(scaled, 1.1 * tau + 0.2)
    mean = read(TorqueWindow(0.02)).tau
    np.testing.assert_allclose(mean[20:-20, 0], (tau[20:-20] * np.sinc(1.0 * 0.02))[:, 0], atol=2e-3)


def test_coloured_noise_has_its_variance_and_correlation() -> None:
    run = _still_run()
    errors = np.concatenate([run.reread(Sensors((TorqueNoise(0.3, 0.8),)), seed=s).readings.tau - run.tau for s in range(30)])
    assert abs(errors.std() - 0.3) < 0.01
    each = errors.reshape(30, -1)
    assert abs(np.mean(each[:, 1:] * each[:, :-1]) / 0.09 - 0.8) < 0.02


def test_jitter_keeps_true_stamps_unless_told_otherwise() -> None:
    run = _still_run()
    told = run.reread(Sensors((Jitter(2e-4),)), seed=1).readings
    hidden = run.reread(Sensors((Jitter(2e-4, "nominal"),)), seed=1).readings
    np.testing.assert_array_equal(told.motion.q, hidden.motion.q)
    np.testing.assert_array_equal(hidden.t, run.t)
    assert np.all(np.diff(told.t) > 0)
    # At its true time a sample is true.
    mid = np.interp(told.t[100:-100], run.t, run.q[:, 0])
    np.testing.assert_allclose(told.motion.q[100:-100, 0], mid, atol=1e-4)
    assert np.abs(hidden.motion.q - run.q).max() > 1e-4


def test_averaged_torque_shows_no_delay_of_the_hold() -> None:
    """A torque that is held for 4 ms acts 2 ms late; the mean over the sample's neighbourhood is where the motion sees it."""
    robot = pendulum().with_gravity([0, 0, 0])
    plant = Plant(robot.rigid_body(), robot.nominal)
    t = np.arange(1001) / 250.0
    wave = np.sin(2 * np.pi * t)[:, None]
    run = simulate(
        plant, torque=wave, start=(np.zeros(1), np.zeros(1)), rate=250.0, sensors=Sensors.typical(counts=None, torque_window=4e-3)
    )
    smooth = np.gradient(run.dq[:, 0], run.t) * robot.nominal[6]
    mean = run.readings.tau[:, 0]
    inside = slice(5, -5)
    assert np.abs(mean - smooth)[inside].max() < 0.02 * np.abs(run.tau[:, 0] - smooth)[inside].max()


@pytest.mark.parametrize("name", ["panda", "kinova", "xarm7"])
def test_tuned_gains_bear_joints_that_give_way_to_each_other(name: str) -> None:
    robot = load_robot(name)
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    values = nominal_values(model)
    own, plant = typical_inertia(model, values, Side.MOTOR), Plant(model, values)
    rng = np.random.default_rng(1)
    q = rng.uniform(-2.0, 2.0, (20, robot.n))
    H = plant.dynamics().rigid.terms(q, np.zeros_like(q))[0] + plant.dynamics().inertia[: robot.n, : robot.n]
    H = robot.transmission.K.T @ H @ robot.transmission.K
    # A damper of w D at every joint is stable at a period h while w h λ(H⁻¹ D) < 2.
    assert 2.0 * np.pi * 10.0 * 1e-3 * np.abs(np.linalg.eigvals(np.linalg.solve(H, np.diag(own)))).max() < 1.5
    calm = 0.3 * np.ones(robot.n) * np.where([j.prismatic for j in robot.joints], 0.02, 1.0)
    wave = FourierTrajectory(np.clip(0.0, [j.lower for j in robot.joints], [j.upper for j in robot.joints]), [calm], [0.0 * calm], 0.5)
    run = simulate(plant, desired=wave, duration=2.0, rate=100.0)
    assert np.abs(run.q - wave.sample(run.t).q).max() < 0.1


def test_gains_of_joints_that_move_alone_heed_the_mean_inertia(puma: Plant) -> None:
    model, values = puma.model, np.asarray(puma.values)
    K, n = puma.robot.transmission.K, puma.robot.n
    rng = np.random.default_rng(0)
    lower, upper = ([max(j.lower, -np.pi) for j in puma.robot.joints], [min(j.upper, np.pi) for j in puma.robot.joints])
    q = rng.uniform(lower, upper, (32, n))
    H = K.T @ (puma.dynamics().rigid.terms(q, np.zeros_like(q))[0] + puma.dynamics().inertia[:n, :n]) @ K
    np.testing.assert_allclose(typical_inertia(model, values, Side.MOTOR), np.diagonal(H, axis1=1, axis2=2).mean(axis=0), rtol=1e-9)


def test_feedback_through_a_coarse_encoder_still_tracks(puma: Plant) -> None:
    wave = _wave()
    run = simulate(puma, desired=wave, rate=100.0, control_rate=500.0, step=2e-3, feedback=Feedback(counts=1000.0), duration=1.0)
    assert np.abs(run.q - wave.sample(run.t).q).max() < 0.1


def test_a_log_goes_to_csv_and_comes_back(puma: Plant, tmp_path) -> None:
    from ident.logs.reading import read_logs

    way = PointToPoint(np.array([0, -1.2, 1.4, 0, 0.3, 0]), np.array([0.2, -1.0, 1.2, 0.3, 0.1, -0.4]), 0.5)
    motor = Sensors((Quantisation.counts(4000), TorqueNoise(0.01)), Side.MOTOR, Side.MOTOR, ("q", "dq", "tau"))
    run = simulate(puma, desired=way, rate=100.0, control_rate=500.0, step=2e-3, sensors=motor)
    file = run.to_csv(tmp_path / "run.csv.gz")
    with pytest.raises(ConfigurationError, match="exists"):
        run.to_csv(file)
    back = read_logs(file, robot=puma.robot)[0]
    log = run.log()
    assert back.q_motor is not None
    np.testing.assert_array_equal(back.q_motor, log.q_motor)
    np.testing.assert_array_equal(back.tau["motor"], log.tau["motor"])
    np.testing.assert_allclose(back.t, run.t)
    again = run.to_csv(tmp_path / "again.csv.gz")
    assert again.read_bytes() == file.read_bytes()


def test_wrong_gains_and_sensors_are_named(puma: Plant) -> None:
    with pytest.raises(ConfigurationError, match="kp"):
        simulate(puma, desired=_wave(), controller=PDFeedforward(kp=(1.0, 2.0), kd=1.0))
    with pytest.raises(ConfigurationError, match="columns"):
        Sensors(columns=("tau",))
    with pytest.raises(ConfigurationError, match="colour"):
        TorqueNoise(1.0, 1.0)
    with pytest.raises(ConfigurationError, match="either"):
        simulate(puma, desired=_wave(), torque=np.zeros((3, 6)))
