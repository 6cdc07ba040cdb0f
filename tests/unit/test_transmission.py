"""The transmission: both sides agree in power, and what is not invertible is refused."""

from __future__ import annotations

import numpy as np
import pytest

from ident import ConfigurationError, Side, Transmission

K = np.array([[0.1, 0, 0], [0.02, -0.2, 0.01], [0, 0.03, 0.5]])


def test_power_is_the_same_on_both_sides():
    drive = Transmission(K, np.array([0.1, 0.2, 0.3]))
    rng = np.random.default_rng(0)
    dq, tau = rng.normal(size=(2, 7, 3))
    motor = drive.torque(tau, Side.JOINT, Side.MOTOR)
    assert np.sum(motor * drive.motor_rate(dq), axis=1) == pytest.approx(np.sum(tau * dq, axis=1))
    assert drive.torque(motor, Side.MOTOR, Side.JOINT) == pytest.approx(tau)
    assert drive.torque(tau, Side.JOINT, Side.JOINT) is tau


def test_positions_and_rates_go_both_ways():
    drive = Transmission(K, np.array([0.1, 0.2, 0.3]))
    q = np.random.default_rng(1).normal(size=(5, 3))
    assert drive.joint_position(drive.motor_position(q)) == pytest.approx(q)
    assert drive.joint_rate(drive.motor_rate(q)) == pytest.approx(q)
    assert drive.joint_position(np.zeros(3)) == pytest.approx([0.1, 0.2, 0.3])


def test_ratio_is_motor_turns_per_joint_turn():
    drive = Transmission.from_ratio([100, -50], Side.MOTOR)
    assert drive.motor_rate(np.ones(2)) == pytest.approx([100, -50])
    assert drive.is_diagonal
    assert not Transmission(K, np.zeros(3)).is_diagonal


def test_badly_scaled_but_regular():
    assert Transmission(np.diag([1e-9, 1.0]), np.zeros(2)).motor_rate(np.ones(2)) == pytest.approx([1e9, 1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"K": [[1, 1], [1, 1]]}, "K is singular"),
        ({"K": [[0, 0], [0, 1]]}, "K is singular"),
        ({"K": [[1, 2, 3], [4, 5, 6]]}, r"must be a square matrix, but its shape is \(2, 3\)"),
        ({"K": [1, 2]}, "must be a square matrix"),
        ({"K": [[1, 0], [0, np.nan]]}, "K holds a value that is not finite"),
        ({"zero": [0, 0, 0]}, "zero has 3 entries, but K is 2 x 2"),
        ({"zero": [0, np.inf]}, "zero holds a value that is not finite"),
        ({"torque_constants": [1]}, "torque_constants has 1 entries for 2 motors"),
        ({"torque_constants": [1, 0]}, "torque_constants holds a value that is zero"),
        ({"measured": "engine"}, "unknown side of the transmission 'engine'"),
    ],
)
def test_refusals(arguments, message):
    with pytest.raises(ConfigurationError, match=message):
        Transmission(**{"K": np.eye(2), "zero": np.zeros(2), **arguments})


@pytest.mark.parametrize("ratio", [[1, 0], [1, np.inf], [np.nan, 1]])
def test_impossible_ratios(ratio):
    with pytest.raises(ConfigurationError, match="ratio holds a value that is zero, not finite"):
        Transmission.from_ratio(ratio)


def test_restricted_to_what_moves():
    coupled = np.array([[0.1, 0, 0], [0, 0.2, 0.1], [0, 0, 0.3]])
    drive = Transmission(coupled, np.array([1.0, 2.0, 3.0]), Side.MOTOR, np.array([4.0, 5.0, 6.0]))
    part = drive.restricted([1, 2])
    assert part.K == pytest.approx(coupled[1:, 1:], abs=0)
    assert (part.zero.tolist(), part.torque_constants.tolist(), part.measured) == ([2, 3], [5, 6], "motor")
    for keep in ([0, 1], [2]):
        with pytest.raises(ConfigurationError, match="couples joints that move with joints that are locked"):
            drive.restricted(keep)


@pytest.mark.parametrize(("source", "target"), [(Side.JOINT, Side.MOTOR), (Side.MOTOR, Side.JOINT)])
def test_a_missing_torque_is_missing_only_where_it_takes_part(source, target):
    K = np.diag([0.01, 0.02, 0.05])
    K[2, 1] = 0.005
    transmission = Transmission(K, np.zeros(3))
    torque = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, np.nan], [np.nan, 7.0, 8.0]])
    carried = transmission.torque(torque, source, target)
    # By hand: motor torque is K' joint torque, so motors 2 and 3 feel joint 3; the other way joint 2 feels motor 3 as well.
    assert np.isnan(carried).tolist() == [[False] * 3, [False, True, True], [True, False, False]]
    whole = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [9.0, 7.0, 8.0]]) @ (K if target == Side.MOTOR else np.linalg.inv(K))
    there = ~np.isnan(carried)
    np.testing.assert_allclose(carried[there], whole[there], rtol=1e-12)
