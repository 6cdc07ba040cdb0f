"""Dry friction in simulation: it holds, lets go and never chatters; checked against closed forms."""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
from effect_robots import pendulum, slide
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import ConfigurationError
from ident.friction import AsymmetricCoulomb, Coulomb, LoadDependentFriction, RotorInertia, Stribeck, Viscous
from ident.robots import load_robot, nominal_values
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission
from ident.simulation.contact import resolve
from ident.simulation.flexible import FlexibleJoints
from ident.simulation.forces import ForceModel
from ident.simulation.plant import Plant
from ident.simulation.simulate import simulate


def _block(friction: float, gravity: tuple[float, float, float] = (0, 0, 0)) -> Plant:
    """A block of 2 kg on a horizontal slide."""
    urdf = (
        '<robot name="block"><link name="a"/><link name="b"><inertial><mass value="2"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="x" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>'
        '<limit lower="-9" upper="9" velocity="9" effort="9"/></joint></robot>'
    )
    robot = Robot.from_urdf(urdf, gravity=gravity)
    model = robot.rigid_body() + Coulomb()
    return Plant(model, np.append(robot.nominal, friction))


def test_a_sliding_block_stops_where_it_must_and_stays() -> None:
    plant = _block(3.0)
    run = simulate(plant, torque=np.zeros((101, 1)), start=(np.zeros(1), np.array([1.1])), rate=50.0)
    a = 3.0 / 2.0
    stop = 1.1 / a
    moving = run.t < stop
    np.testing.assert_allclose(run.q[moving, 0], 1.1 * run.t[moving] - 0.5 * a * run.t[moving] ** 2, atol=1e-12)
    np.testing.assert_allclose(run.q[~moving, 0], 1.1**2 / (2 * a), atol=1e-12)
    assert np.all(run.dq[~moving] == 0)
    assert np.all(run.ddq[~moving] == 0)
    assert np.all(run.friction[~moving] == 0)
    assert run.held[~moving].all()
    assert not run.held[moving].any()


def test_stick_on_a_slope_and_letting_go_at_the_limit() -> None:
    """Gravity of 9.81 sin(20°) along the slide: held up to the limit; then it slides with the difference."""
    along = 9.81 * np.sin(np.radians(20))
    weight = 2.0 * along
    for friction, moves in ((1.001 * weight, False), (0.999 * weight, True)):
        run = simulate(_block(friction, (along, 0, -9)), torque=np.zeros((51, 1)), start=(np.zeros(1), np.zeros(1)), rate=50.0)
        if moves:
            np.testing.assert_allclose(run.q[:, 0], 0.5 * (weight - friction) / 2 * run.t**2, rtol=1e-6, atol=1e-14)
        else:
            assert np.all(run.q == 0)
            np.testing.assert_allclose(run.friction, weight, rtol=1e-12)


def test_break_away_time_under_a_ramp() -> None:
    """A force that rises straight: the block moves from the instant it exceeds the friction, on a cubic."""
    t = np.arange(101) / 100.0
    run = simulate(_block(1.234), torque=3.0 * t[:, None], start=(np.zeros(1), np.zeros(1)), rate=100.0, hold="first_order")
    since = np.maximum(run.t - 1.234 / 3.0, 0.0)
    np.testing.assert_allclose(run.q[:, 0], 3.0 / 2.0 * since**3 / 6.0, atol=1e-9)


def test_reversal_under_a_sine_passes_without_chatter() -> None:
    """Driven block with |force| well above friction: one crossing each half period, and force balance at all times."""
    plant = _block(0.8)
    t = np.arange(2001) / 1000.0
    force = 5.0 * np.sin(2 * np.pi * 2 * t)[:, None]
    run = simulate(plant, torque=force, start=(np.zeros(1), np.zeros(1)), rate=1000.0)
    sign = np.sign(run.dq[:, 0])
    assert np.count_nonzero(np.diff(sign[sign != 0])) <= 8
    rest = run.held[:, 0]
    np.testing.assert_allclose((2 * run.ddq + 0.8 * np.sign(run.dq))[~rest], run.tau[~rest], atol=1e-12)
    np.testing.assert_allclose(2 * run.ddq + run.friction, run.tau, atol=1e-12)


@pytest.mark.parametrize("friction", [Coulomb(), AsymmetricCoulomb(), Stribeck(v_s=0.2)])
def test_every_law_that_jumps_holds_within_its_own_limits(friction) -> None:
    robot = pendulum()
    model = (
        robot.rigid_body() + RotorInertia() + Coulomb() + friction
        if friction.name != "coulomb"
        else robot.rigid_body() + RotorInertia() + Coulomb()
    )
    extra = [0.3] * (len(model.parameters) - 12)
    values = np.concatenate([robot.nominal, [0.2, 4.0], extra])
    up = simulate(Plant(model, values), torque=np.full((301, 1), 0.0), start=(np.array([1.4]), np.zeros(1)), rate=100.0)
    tau = model.inverse_dynamics(up.q, up.dq, up.ddq, values)
    moving = ~up.held[:, 0]
    np.testing.assert_allclose(tau[moving], up.tau[moving], atol=1e-11)
    assert up.held[-1, 0]
    assert np.ptp(up.q[-20:]) == 0


def test_held_motor_of_a_coupled_wrist_turns_nothing_else_off() -> None:
    """Only motor 4 is driven: motors 5 and 6 are held by their friction, joints 5 and 6 turn through the coupling."""
    robot = load_robot("puma560").with_gravity([0, 0, 0])
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    values = nominal_values(model)
    torque = np.zeros((201, 6))
    torque[:, 3] = 0.06
    run = simulate(Plant(model, values), torque=torque, start=(np.array([0.0, -1.0, 1.5, 0.3, 0.2, 0.1]), np.zeros(6)), rate=200.0)
    assert run.held[:, [0, 1, 2, 4, 5]].all()
    np.testing.assert_allclose(run.motor.dq[:, [4, 5]], 0.0, atol=1e-14)
    K = robot.transmission.K
    np.testing.assert_allclose(run.dq[:, 4], K[4, 3] * run.motor.dq[:, 3], rtol=1e-12, atol=1e-15)
    assert run.motor.dq[-1, 3] > 5
    assert np.all(np.abs(run.friction) <= values[-6:] * (1 + 1e-9))


def test_motor_and_joint_friction_of_a_coupled_axis_share_the_load() -> None:
    """More contacts than coordinates: six motors and six joints with dry friction. Limits hold and motion satisfies the model."""
    robot = load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Coulomb() + Coulomb(side=Side.JOINT)
    base = robot.rigid_body() + RotorInertia() + Coulomb()
    values = np.concatenate([nominal_values(base), np.array([3.0, 3, 2, 0.3, 0.3, 0.3])])
    t = np.arange(301) / 300.0
    torque = np.outer(np.sin(2 * np.pi * t), [0.5, 1.0, 0.5, 0.1, 0.08, 0.09])
    run = simulate(
        Plant(model, values), torque=torque, start=(np.array([0.0, -1.0, 1.5, 0.3, 0.2, 0.1]), np.zeros(6)), rate=300.0, hold="first_order"
    )
    free = np.zeros(values.size)
    free[:-12] = values[:-12]
    gap = run.tau - model.inverse_dynamics(run.q, run.dq, run.ddq, free) - run.friction
    np.testing.assert_allclose(gap, 0.0, atol=1e-9)
    quiet = ~(run.held.any(axis=1))
    np.testing.assert_allclose(model.inverse_dynamics(run.q, run.dq, run.ddq, values)[quiet], run.tau[quiet], atol=1e-9)


def test_friction_that_grows_with_load_holds_a_load_it_may_hold() -> None:
    """Self-locking: with a loss of more than the whole load the slide holds any weight without Coulomb friction."""
    robot = slide()
    model = robot.rigid_body() + RotorInertia() + LoadDependentFriction()
    for share, holds in ((1.2, True), (0.8, False)):
        values = np.concatenate([robot.nominal, [1e-5, share]])
        run = simulate(Plant(model, values), torque=np.zeros((51, 1)), start=(np.array([0.2]), np.zeros(1)), rate=100.0)
        assert bool(np.ptp(run.q) == 0) == holds
        if not holds:
            np.testing.assert_allclose(model.inverse_dynamics(run.q, run.dq, run.ddq, values)[1:], run.tau[1:], atol=1e-10)


def test_friction_of_the_wrong_sign_still_moves() -> None:
    """An estimate may have a negative Coulomb parameter. Replaying it must neither hang nor hold."""
    run = simulate(_block(-0.5), torque=np.sin(np.arange(401) / 40.0)[:, None], start=(np.zeros(1), np.zeros(1)), rate=400.0)
    moving = ~run.held[:, 0]
    np.testing.assert_allclose((2 * run.ddq - 0.5 * np.sign(run.dq))[moving], run.tau[moving], atol=1e-12)
    assert moving.sum() > 390


class _Bristle(ForceModel):
    """Dahl friction with a state that follows the path."""

    side = Side.JOINT

    def start(self, motion, robot):
        return np.zeros((len(motion), robot.n))

    def carried(self, before, state, now, robot):
        way = now.joint.q - before.joint.q
        s = np.sign(way)
        return s + (state - s) * np.exp(-np.abs(way) / 1e-3)

    def torque(self, motion, state, robot):
        return 2.0 * state


def test_a_force_with_a_path_state_is_exact_on_a_monotone_path() -> None:
    """Dahl friction F z(q) is a function of the path on one stroke: energy is conserved with its integral."""
    plant = _block(0.0)
    plant = Plant(plant.model, plant.values, extra=(_Bristle(),))
    run = simulate(plant, torque=np.full((101, 1), 3.0), start=(np.zeros(1), np.zeros(1)), rate=200.0)
    q = run.q[:, 0]
    lost = 2.0 * (q - 1e-3 * (1 - np.exp(-q / 1e-3)))
    np.testing.assert_allclose(run.dq[:, 0] ** 2, 3.0 * q - lost, atol=1e-6)
    np.testing.assert_allclose(run.states[1:, 0], 1 - np.exp(-q[1:] / 1e-3), atol=1e-12)


def _two_mass(gap: float = 0.0, damping: float = 0.0) -> Plant:
    robot = pendulum().with_gravity([0, 0, 0])
    robot = robot.with_transmission(Transmission(np.array([[0.01]]), np.zeros(1), Side.MOTOR))
    model = robot.rigid_body() + RotorInertia()
    spring = FlexibleJoints(joints=("j1",), stiffness=(4000.0,), damping=(damping,), gap=(gap,))
    return Plant(model, np.append(robot.nominal, 2e-4), flexible=spring)


def test_elastic_joint_swings_at_its_natural_frequency() -> None:
    plant = _two_mass()
    link, rotor = plant.robot.nominal[6], 2e-4 / 0.01**2
    w = np.sqrt(4000.0 * (1 / link + 1 / rotor))
    run = simulate(plant, torque=np.full((301, 1), 0.05), start=(np.zeros(1), np.zeros(1)), rate=1000.0, step=1e-4)
    # Under a constant torque from rest: deflection d (1 - cos wt), the centre of inertia accelerates evenly.
    torque = 0.05 / 0.01
    d = torque / rotor / w**2
    np.testing.assert_allclose((run.motor.q * 0.01 - run.q)[:, 0], d * (1 - np.cos(w * run.t)), atol=5e-6 * d)
    centre = (rotor * run.motor.q * 0.01 + link * run.q)[:, 0] / (rotor + link)
    np.testing.assert_allclose(centre, 0.5 * torque / (rotor + link) * run.t**2, rtol=1e-9, atol=1e-12)


def test_backlash_leaves_the_link_alone_within_the_gap() -> None:
    plant = _two_mass(gap=0.02, damping=5.0)
    run = simulate(plant, torque=np.full((401, 1), 0.05), start=(np.zeros(1), np.zeros(1)), rate=1000.0, step=2e-4)
    play = (run.motor.q * 0.01 - run.q)[:, 0]
    free = play < 0.01 - 1e-12
    assert free[:20].all()
    assert not free.all()
    first = np.flatnonzero(~free)[0]
    np.testing.assert_allclose(run.q[:first], 0.0, atol=1e-15)


def test_steps_too_long_for_a_spring_are_refused_with_those_that_do() -> None:
    """A flank that is damped faster than a step shakes between its sides without growing: nothing else would tell."""
    push = {"torque": np.full((41, 1), 0.05), "start": (np.zeros(1), np.zeros(1)), "rate": 1000.0}
    plant = _two_mass(gap=0.02, damping=5000.0)
    with pytest.raises(ConfigurationError, match=r"joint 'j1' .* step of 0.001 s: give simulate\(\) step=(\S+) or less") as refused:
        simulate(plant, **push)
    step = float(re.search(r"step=(\S+)", str(refused.value)).group(1))
    settled = simulate(plant, **push, step=step)
    finer = simulate(plant, **push, step=step / 8)
    np.testing.assert_allclose(settled.q, finer.q, atol=1e-3 * np.abs(finer.q).max())


@settings(max_examples=200, deadline=None)
@given(st.integers(1, 5), st.integers(0, 10_000))
def test_complementarity_is_solved_as_by_trying_every_case(p: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(p, p + 1))
    W = A @ A.T + 1e-3 * np.eye(p)
    b = rng.normal(size=p) * rng.choice([0.3, 3.0, 30.0])
    s, loose = resolve(W, b)
    z = b - W @ s
    answers = []
    for case in itertools.product((-1, 0, 1), repeat=p):
        side = np.array(case)
        held = side == 0
        trial = side.astype(float)
        if held.any():
            trial[held] = np.linalg.solve(W[np.ix_(held, held)], b[held] - W[np.ix_(held, ~held)] @ trial[~held])
        rate = b - W @ trial
        if np.all(np.abs(trial) <= 1 + 1e-9) and np.all((rate * side)[~held] >= -1e-9):
            answers.append(trial)
    assert answers
    np.testing.assert_allclose(s, answers[0], atol=1e-6)
    assert np.all(np.abs(z[loose == 0]) < 1e-6 * (1 + np.abs(b).max()))
    assert np.all((z * loose)[loose != 0] >= -1e-6)
