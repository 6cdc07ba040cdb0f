"""Forward dynamics through the transmission against independent oracles."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from effect_robots import pendulum, seven, slide

from ident.errors import ConfigurationError, DataError, UnsupportedError
from ident.friction import Coulomb, LoadDependentFriction, RotorInertia, Viscous
from ident.model import Model
from ident.robots import load_robot, nominal_values
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission
from ident.simulation.forces import ForceModel
from ident.simulation.plant import Plant, Schedule
from ident.simulation.rigid import PinocchioTerms, RigidDynamics
from ident.simulation.simulate import simulate


def _drive(robot: Robot) -> Model:
    return robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()


def _values(model: Model, rng: np.random.Generator) -> np.ndarray:
    n = model.robot.n
    K = np.abs(np.diag(model.robot.transmission.K))
    drive = [0.3 * K**2 * rng.uniform(0.5, 2, n), 0.5 * K**2 * rng.uniform(0.5, 2, n), 1.0 * K * rng.uniform(0.5, 2, n)]
    return np.concatenate([model.robot.nominal, *drive])


def test_diagonal_gears_agree_with_aba_and_armature() -> None:
    rng = np.random.default_rng(0)
    robot = seven()
    model = _drive(robot)
    values = _values(model, rng)
    k = np.diag(robot.transmission.K)
    n = robot.n
    Ia, Fv, Fc = values[-3 * n :].reshape(3, n)
    q, dq, tau = (rng.normal(size=(20, n)) for _ in range(3))
    got = Plant(model, values).forward_dynamics(q, dq, robot.transmission.torque(tau * 30, Side.JOINT, robot.transmission.measured))
    reference = robot.model.copy()
    reference.armature[:] = Ia / k**2
    data = reference.createData()
    for i in range(20):
        friction = Fv / k**2 * dq[i] + Fc / np.abs(k) * np.sign(dq[i])
        want = pin.aba(reference, data, q[i], dq[i], tau[i] * 30 - friction)
        np.testing.assert_allclose(got[i], want, rtol=1e-10, atol=1e-10)


def test_coupled_wrist_satisfies_the_inverse_dynamics() -> None:
    rng = np.random.default_rng(1)
    robot = load_robot("puma560")
    model = _drive(robot)
    values = nominal_values(model)
    q, dq = rng.uniform(-2, 2, (30, 6)), rng.normal(size=(30, 6))
    tau = rng.normal(size=(30, 6)) * 0.5
    ddq = Plant(model, values).forward_dynamics(q, dq, tau)
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, values), tau, atol=1e-12)


def test_load_dependent_friction_is_solved_for_the_load_it_depends_on() -> None:
    rng = np.random.default_rng(2)
    robot = load_robot("puma560")
    model = _drive(robot) + LoadDependentFriction()
    values = np.concatenate([nominal_values(_drive(robot)), rng.uniform(0.05, 0.2, 6)])
    q, dq, tau = rng.uniform(-2, 2, (30, 6)), rng.normal(size=(30, 6)), rng.normal(size=(30, 6)) * 0.5
    ddq = Plant(model, values).forward_dynamics(q, dq, tau)
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, values), tau, atol=1e-10)


def test_parameters_without_mass_give_the_same_dynamics_as_the_general_kernel() -> None:
    from ident.regressor.rigid import bias_torque, mass_matrix

    rng = np.random.default_rng(3)
    robot = seven()
    inertia = rng.normal(size=70)
    inertia[0::10] = rng.choice([0.0, -0.3, 1e-9, 2.0], 7)
    q, dq = rng.normal(size=(9, 7)), rng.normal(size=(9, 7))
    for terms in (RigidDynamics(robot, inertia), PinocchioTerms(robot, inertia)):
        H, h = terms.terms(q, dq)
        np.testing.assert_allclose(H, mass_matrix(robot.tree, inertia, q), atol=1e-11)
        np.testing.assert_allclose(h, bias_torque(robot.tree, inertia, q, dq), atol=1e-11)


def test_loop_closure_moves_the_whole_tree() -> None:
    robot = Robot.from_urdf(_bars(), loop={"j3": {"j1": -1.0, "j2": 1.0}})
    model = robot.rigid_body() + RotorInertia()
    rng = np.random.default_rng(4)
    values = np.concatenate([robot.nominal, [0.1, 0.2]])
    q, dq, tau = (rng.normal(size=(12, 2)) for _ in range(3))
    ddq = Plant(model, values).forward_dynamics(q, dq, tau)
    np.testing.assert_allclose(model.inverse_dynamics(q, dq, ddq, values), tau, atol=1e-12)


def _bars() -> str:
    from effect_robots import chain

    return chain(
        "bars",
        [("revolute", "0 0 0", "0 0 0", "0 1 0"), ("revolute", "0.3 0 0", "0 0 0", "0 1 0"), ("revolute", "0.3 0 0", "0 0 0", "0 1 0")],
    )


def test_energy_balances_through_a_coupled_transmission() -> None:
    """Work of the motors = gain of kinetic and potential energy (links and rotors) + loss in friction."""
    robot = load_robot("puma560")
    model = _drive(robot)
    values = nominal_values(model)
    n, count, rate = 6, 801, 400.0
    t = np.arange(count) / rate
    torque = 0.25 * np.sin(np.outer(2 * np.pi * t, [0.9, 0.7, 1.1, 2.0, 1.7, 2.3]) + np.arange(6))
    torque[:, 3:] *= 0.25
    run = simulate(
        Plant(model, values), torque=torque, start=(np.array([0.1, -1.2, 1.4, 0.2, 0.4, 0.1]), np.zeros(6)), rate=rate, hold="first_order"
    )
    Ia, Fv, Fc = values[-3 * n :].reshape(3, n)
    w = run.motor.dq
    power = np.sum(run.tau * w, axis=1) - np.sum(Fv * w**2 + Fc * np.abs(w), axis=1)
    data = robot.model.createData()
    full = robot.model.copy()
    for i, part in enumerate(robot.nominal.reshape(-1, 10)):
        full.inertias[i + 1] = pin.Inertia.FromDynamicParameters(part)
    energy = [
        pin.computeKineticEnergy(full, data, q, dq) + pin.computePotentialEnergy(full, data, q) + 0.5 * float(Ia @ w_**2)
        for q, dq, w_ in zip(run.q, run.dq, w, strict=True)
    ]
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) / rate])
    moved = float(np.sum(np.abs(np.diff(energy))))
    assert moved > 3.0
    # The trapezium rule limits this check, not the simulation.
    assert np.abs(np.array(energy) - energy[0] - work).max() < 2e-4 * moved


def test_smooth_motion_has_order_four() -> None:
    robot = pendulum()
    model = robot.rigid_body() + RotorInertia() + Viscous()
    values = np.concatenate([robot.nominal, [0.1, 0.2]])
    torque = np.zeros((11, 1))
    ends = []
    for step in (0.1, 0.05, 0.025, 0.001):
        run = simulate(Plant(model, values), torque=torque, start=(np.array([1.0]), np.array([0.0])), rate=10.0, step=step)
        ends.append(run.q[-1, 0])
    errors = np.abs(np.array(ends[:3]) - ends[3])
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 3.6)


def test_values_that_change_take_effect_at_their_time() -> None:
    robot = slide()
    model = robot.rigid_body()
    light, heavy = robot.nominal.copy(), robot.nominal.copy()
    heavy[0] *= 2
    plant = Plant(model, Schedule([0.5], [light, heavy]))
    # On the joint side f = 10 N along the slide.
    torque = np.tile(robot.transmission.torque(np.array([10.0]), Side.JOINT, Side.MOTOR), (1001, 1))
    run = simulate(plant, torque=torque, start=(np.zeros(1), np.zeros(1)), rate=1000.0)
    slope = -9.81 * np.cos(0.4)
    np.testing.assert_allclose(run.ddq[run.t < 0.4995, 0], 10.0 / light[0] + slope, rtol=1e-12)
    np.testing.assert_allclose(run.ddq[run.t > 0.4995, 0], 10.0 / heavy[0] + slope, rtol=1e-12)


class _Wind(ForceModel):
    """A force with memory: a gust that dies away."""

    side = Side.JOINT

    def start(self, motion, robot):
        return np.full((len(motion), 1), 3.0)

    def rate(self, motion, state, robot):
        return -2.0 * state

    def torque(self, motion, state, robot):
        return state * np.ones((1, robot.n))


def test_a_force_of_ones_own_keeps_its_state() -> None:
    robot = pendulum().with_gravity([0, 0, 0])
    values = robot.nominal.copy()
    run = simulate(
        Plant(robot.rigid_body(), values, extra=(_Wind(),)), torque=np.zeros((501, 1)), start=(np.zeros(1), np.zeros(1)), rate=500.0
    )
    np.testing.assert_allclose(run.states[:, 0], 3.0 * np.exp(-2 * run.t), rtol=1e-10)
    inertia = values[6]  # Iyy about the axis
    np.testing.assert_allclose(run.ddq[:, 0], -3.0 * np.exp(-2 * run.t) / inertia, rtol=1e-9)


def test_wrong_requests_are_explained() -> None:
    robot = pendulum()
    model = _drive(robot)
    with pytest.raises(ConfigurationError, match="13 parameters"):
        Plant(model, np.zeros(4))
    bad = np.zeros(13)
    bad[11] = np.nan
    with pytest.raises(ConfigurationError, match="Fv_j1"):
        Plant(model, bad)
    plant = Plant(model, np.concatenate([robot.nominal, [0.1, 0.1, 0.1]]))
    with pytest.raises(ConfigurationError, match="either a desired motion"):
        simulate(plant)
    with pytest.raises(ConfigurationError, match="start"):
        simulate(plant, torque=np.zeros((10, 1)))
    with pytest.raises(ConfigurationError, match="1 columns"):
        simulate(plant, torque=np.zeros((10, 3)), start=(np.zeros(1), np.zeros(1)))
    with pytest.raises(ConfigurationError, match="whole multiple"):
        simulate(plant, torque=np.zeros((10, 1)), start=(np.zeros(1), np.zeros(1)), rate=300.0, control_rate=1000.0)
    with pytest.raises(DataError, match="singular"):
        Plant(model, np.zeros(13)).forward_dynamics(np.zeros(1), np.zeros(1), np.ones(1))
    with pytest.raises(DataError, match="grows without bound"):
        simulate(
            Plant(robot.rigid_body() + Viscous(), np.concatenate([robot.nominal, [-3000.0]])),
            torque=np.zeros((2001, 1)), start=(np.zeros(1), np.ones(1)), rate=100.0, step=0.01,
        )  # fmt: skip


def test_a_floating_base_is_refused_with_a_way_out() -> None:
    from effect_robots import chain

    robot = Robot.from_urdf(chain("p", [("revolute", "0 0 1", "0 0 0", "0 1 0")]), floating_base=True)
    with pytest.raises(UnsupportedError, match="forward_dynamics"):
        Plant(robot.rigid_body(), robot.nominal).dynamics()


def test_transmission_zero_and_negative_ratio() -> None:
    robot = pendulum()
    robot = robot.with_transmission(Transmission(np.array([[-0.02]]), np.array([0.3]), Side.MOTOR))
    model = _drive(robot)
    values = np.concatenate([robot.nominal, [1e-3, 1e-3, 0.05]])
    run = simulate(Plant(model, values), torque=np.zeros((201, 1)), start=(np.array([0.5]), np.array([0.2])), rate=200.0)
    np.testing.assert_allclose(robot.transmission.joint_position(run.motor.q), run.q, atol=1e-12)
    moving = ~run.held[:, 0]
    np.testing.assert_allclose(model.inverse_dynamics(run.q, run.dq, run.ddq, values)[moving], run.tau[moving], atol=1e-12)
