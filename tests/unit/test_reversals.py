"""Friction reverses with the speed that it follows: of a motor, or of a joint that other motors move too."""

from __future__ import annotations

import numpy as np
import pytest

from ident import Side, Transmission
from ident.robots.reversals import Reversals

Array = np.ndarray
WRIST = np.array([[0.1, 0.0, 0.0], [0.02, -0.2, 0.0], [0.0, 0.0, 0.5]])


def reversing(drive: Transmission, dq: Array, threshold: Array, moved: float = 1e3) -> Array:
    """Samples at which friction in each measured torque may reverse, where every speed reached `moved` in these samples or before."""
    found = Reversals.of(drive)
    limits = found.limits(threshold)
    return found.reached(found.speeds(dq), limits, np.maximum(found.speeds(dq).max(axis=0), moved))


@pytest.mark.parametrize("side", [Side.MOTOR, Side.JOINT])
def test_without_coupling_only_the_own_speed_counts(side: Side) -> None:
    drive = Transmission.from_ratio([80.0, -50.0], side)
    dq = np.random.default_rng(0).normal(size=(200, 2))
    on_side = dq if side == Side.JOINT else drive.motor_rate(dq)
    threshold = np.array([0.3, 0.4]) * (1.0 if side == Side.JOINT else 60.0)
    assert np.array_equal(reversing(drive, dq, threshold), np.abs(on_side) <= threshold)


def felt(torque: Array) -> Array:
    """Which torques (n,) a friction is in; what the inverse of a coupling leaves of zero, on some processors alone, is rounding."""
    return np.asarray(np.abs(torque) > 1e-9)


@pytest.mark.parametrize("side", [Side.MOTOR, Side.JOINT])
@pytest.mark.parametrize("seed", range(5))
def test_a_row_turns_where_any_friction_in_it_does(side: Side, seed: int) -> None:
    rng = np.random.default_rng(seed)
    K = np.diag(rng.uniform(0.05, 2.0, 4) * rng.choice([-1.0, 1.0], 4))
    K[1, 0], K[3, 2] = rng.uniform(0.01, 0.5, 2)
    drive = Transmission(K, np.zeros(4), side)
    dq, threshold = rng.normal(size=(300, 4)), rng.uniform(0.01, 0.2, 4)
    # One newton metre of friction at each motor and each joint in turn; what sits on the joint behind a gear of its own is as the motor's.
    rate, every = drive.motor_rate(dq), np.eye(4)
    at_joint = threshold if side == Side.JOINT else np.abs(K) @ threshold
    at_motor = np.abs(np.linalg.inv(K)) @ threshold if side == Side.JOINT else threshold
    motors, joints = np.zeros((300, 4), bool), np.zeros((300, 4), bool)
    for i in range(4):
        motors |= (np.abs(rate[:, i]) <= at_motor[i])[:, None] & felt(drive.torque(every[i], Side.MOTOR, side))
    for j in (1, 3):
        joints |= (np.abs(dq[:, j]) <= at_joint[j])[:, None] & felt(drive.torque(every[j], Side.JOINT, side))
    found = reversing(drive, dq, threshold)
    assert np.array_equal(found, motors | joints)
    assert found.any()
    assert not found.all()


def test_a_joint_that_other_motors_move_reverses_apart_from_its_own() -> None:
    drive = Transmission(WRIST, np.zeros(3), Side.MOTOR)
    rate = np.array([[10.0, 1.0, 3.0], [10.0, 0.0, 3.0]])  # joint 2 stands still in the first row, motor 2 in the second
    dq = drive.joint_rate(rate)
    assert dq[0, 1] == pytest.approx(0.0)
    # What holds joint 2 is in the torques of motors 1 and 2; what holds motor 2 in its own alone.
    assert reversing(drive, dq, np.full(3, 0.01)).tolist() == [[True, True, False], [False, True, False]]


def test_a_coupled_joint_that_never_moves_reverses_nowhere() -> None:
    """Its motor follows the others' to hold it: what it rubs, if anything, does not change its sign."""
    drive = Transmission(WRIST, np.zeros(3), Side.MOTOR)
    dq = np.random.default_rng(3).normal(size=(500, 3)) * np.array([1.0, 0.0, 1.0])
    rate, threshold = np.abs(drive.motor_rate(dq)), np.full(3, 0.05)
    assert (rate[:, 1] > 0.05).any()
    assert np.array_equal(reversing(drive, dq, threshold, moved=0.0), rate <= threshold)
    assert reversing(drive, dq, threshold)[:, :2].all(), "had it moved elsewhere, all of these samples would be at standstill"


def test_rounding_of_an_inverse_couples_nothing() -> None:
    K = np.array([[1 / 76.0, 0.0, 0.0], [1 / 72.0, 1 / 71.0, 0.0], [0.01, 0.02, 0.013]])
    found = Reversals.of(Transmission(K, np.zeros(3), Side.MOTOR))
    assert np.array_equal(found.measured[:3] != 0.0, np.eye(3, dtype=bool))
