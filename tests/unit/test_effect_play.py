"""Play in a gear: a link between two flanks, against closed forms and an integration of its own."""

from __future__ import annotations

import numpy as np
import pytest
from effect_robots import chain
from scipy.integrate import solve_ivp
from scipy.signal import butter, sosfiltfilt

from ident.effects.compliance import Backlash, JointElasticity
from ident.effects.motion import Motion
from ident.effects.play import Flights, Jolts, played
from ident.effects.reference import Reference
from ident.robots.robot import Robot

Array = np.ndarray
NOTHING = Jolts((np.zeros(0, int), np.zeros(0)), (np.zeros(0, int), np.zeros(0)), 1)


def swing(seconds: float, rate: float, period: float = 1.0) -> Array:
    """An acceleration that pushes to one side for half a period and to the other for the next."""
    t = np.arange(int(seconds * rate)) / rate
    return np.where((t % period) < 0.5 * period, 1.0, -1.0) * 2.0


def test_a_link_crosses_its_gap_as_a_body_falls_and_is_stopped_there() -> None:
    rate, gap = 1000.0, 0.02
    a = swing(3.0, rate)
    x, v, felt = played(Flights(a, 1.0 / rate), gap, 0.0, NOTHING, 1.0)
    assert np.abs(x).max() <= 0.5 * gap * (1 + 1e-9)
    # Let go at 0.5 s, it falls through the gap.
    landing = 0.5 + np.sqrt(2.0 * gap / 2.0)
    flying = np.arange(501, int(landing * rate) - 1)
    np.testing.assert_allclose(x[flying], 0.5 * gap - 1.0 * (flying / rate - 0.5) ** 2, atol=2e-5)
    assert np.all(x[int(landing * rate) + 2 : 999] == -0.5 * gap)
    # What stops it takes all its speed, when it lands.
    stop = slice(int(landing * rate) - 2, int(landing * rate) + 3)
    knock = felt[stop].sum() / rate
    assert knock == pytest.approx(2.0 * (landing - 0.5), rel=0.03)
    assert (felt[stop] @ (np.arange(5) / rate)) / felt[stop].sum() == pytest.approx(landing - (stop.start / rate), abs=1.5e-3)
    # Speed is what the acceleration makes of rest, but at the landings.
    assert np.mean(np.abs(np.cumsum(felt) / rate - v) < 6e-3) > 0.99


def test_the_middle_of_a_knock_comes_when_it_is_told_to() -> None:
    rate, gap = 1000.0, 0.02
    a = swing(0.9, rate)
    early, late = (played(Flights(a, 1.0 / rate), gap, knock, NOTHING, 1.0)[2] for knock in (0.0, 0.0124))
    middle = [float(np.arange(len(x)) @ x / x.sum()) for x in (np.maximum(x, 0.0) for x in (early[600:], late[600:]))]
    assert (middle[1] - middle[0]) / rate == pytest.approx(0.0124, abs=5e-4)


def test_a_link_arrives_when_the_motor_is_jolted() -> None:
    rate, gap, n = 1000.0, 0.02, 900
    due = 500 + int(np.sqrt(gap) * rate)
    for felt_at in (due - 30, due + 30):
        motor = 0.01 * np.random.default_rng(0).normal(size=n)
        # The link moves backwards, and throws the motor backwards.
        motor[felt_at] -= 5.0
        jolts = Jolts.of(motor, rate, float("inf"))
        x, _, _ = played(Flights(swing(0.9, rate), 1.0 / rate), gap, 0.0, jolts, 1.0)
        assert x[felt_at - 1] > -0.5 * gap
        assert np.all(x[felt_at : felt_at + 50] == -0.5 * gap)
        # Forwards it would have been something else.
        other = Jolts.of(-motor, rate, float("inf"))
        assert np.flatnonzero(played(Flights(swing(0.9, rate), 1.0 / rate), gap, 0.0, other, 1.0)[0] == -0.5 * gap)[0] == due + 1


def test_no_jolt_is_seen_in_noise_or_in_nothing() -> None:
    for motor in (np.random.default_rng(1).normal(size=20_000), np.zeros(500), np.sin(np.arange(4000) / 30.0)):
        jolts = Jolts.of(motor, 1000.0, 50.0)
        assert len(jolts.forwards[0]) == len(jolts.backwards[0]) == 0


def test_a_gap_of_nothing_does_nothing_and_one_never_left_stands() -> None:
    flights = Flights(swing(2.0, 500.0), 1.0 / 500.0)
    x, v, a = played(flights, 1e-12, 0.005, NOTHING, 1.0)
    assert np.abs(x).max() < 1e-11
    assert np.abs(v).max() < 1e-4
    assert np.abs(a).max() < 3.0
    held = Flights(np.full(100, 3.0), 0.01)
    x, v, a = played(held, 0.1, 0.005, NOTHING, 1.0)
    assert np.all(x == 0.05)
    assert not np.any([v, a])
    for few in (1, 2, 3):
        assert len(played(Flights(np.full(few, -1.0), 0.01), 0.1, 0.005, NOTHING, 1.0)[0]) == few


J, MGL = 0.8, 6.0


def pendulum(inertia: float) -> tuple[Robot, Array]:
    robot = Robot.from_urdf(chain("pendulum", [("revolute", "0 0 1", "0 0 0", "0 1 0")]))
    values = np.zeros(10)
    values[[0, 3, 6]] = 1.0, -MGL / 9.81, inertia
    return robot, values


def motor(s: Array) -> tuple[Array, Array, Array]:
    w, a, s = np.array([3.0, 7.3])[:, None], np.array([0.9, 0.15])[:, None], np.atleast_1d(s)
    return (a * np.sin(w * s)).sum(0), (a * w * np.cos(w * s)).sum(0), -(a * w**2 * np.sin(w * s)).sum(0)


def test_backlash_is_what_a_link_with_play_does() -> None:
    """A pendulum between stiff flanks behind a motor whose motion is given, integrated as it is; looked at up to 15 Hz, as in a log."""
    rate, gap, stiffness = 1000.0, 0.01, 4e5
    t = np.arange(3500) / rate
    d = 0.6 * 2.0 * np.sqrt(stiffness * J)

    def push(s: float | Array, q: Array, dq: Array) -> Array:
        x, v = q - motor(s)[0], dq - motor(s)[1]
        bent = np.sign(x) * np.maximum(np.abs(x) - gap / 2, 0.0)
        total = -(stiffness * bent + d * v)
        return np.where((bent != 0.0) & (np.sign(total) == -np.sign(x)), total, 0.0)

    def rates(s: float, y: Array) -> list[float]:
        return [y[1], (float(push(s, y[0], y[1])[0]) - MGL * np.sin(y[0])) / J]

    y = solve_ivp(rates, (0, t[-1]), [0.0, motor(0.0)[1][0]], t_eval=t, rtol=1e-8, atol=1e-10, max_step=1e-4).y
    robot, values = pendulum(J)
    motion = Motion.of(robot, *(x[:, None] for x in motor(t)), t, rate=rate).with_reference(Reference(robot.rigid_body(), values))
    sos = butter(4, 15.0, fs=rate, output="sos")
    keep = slice(500, 3300)
    missing = sosfiltfilt(sos, push(t, y[0], y[1]) - motion.predicted[:, 0])[keep]

    def left(**shape: float) -> float:
        column = sosfiltfilt(sos, Backlash(**shape).columns(motion, robot)[:, 0, 0])[keep]
        return float(np.std(missing - column) / np.std(missing))

    assert left(gap=gap, knock=0.001) < 0.3
    assert left(gap=0.3 * gap, knock=0.001) > 0.5
    assert left(gap=3.0 * gap, knock=0.001) > 0.5


@pytest.mark.parametrize("effect", [Backlash(gap=0.03), JointElasticity(stiffness=900.0, damping=0.1)])
def test_what_turns_with_the_motor_does_not_turn_with_the_link(effect: Backlash | JointElasticity) -> None:
    """A model whose link holds the rotor's inertia, and is told of it, corrects as one that has the link's alone."""
    t = np.arange(2000) / 500.0
    columns = []
    for rotor in (0.0, 0.5):
        robot, values = pendulum(J + rotor)
        motion = Motion.of(robot, *(x[:, None] for x in motor(t)), t, rate=500.0)
        motion = motion.with_reference(Reference(robot.rigid_body(), values))
        columns.append(effect.with_shape(rotor=rotor).columns(motion, robot)[:, 0, 0])
    assert np.abs(columns[0]).max() > 0.1
    np.testing.assert_allclose(columns[1], columns[0], atol=1e-6 * np.abs(columns[0]).max())
