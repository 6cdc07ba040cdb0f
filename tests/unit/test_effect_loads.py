"""Payload and external force against Pinocchio, and corrections of logged signals against what they undo."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from effect_robots import ROBOTS, motion_of

from ident.effects.correction import Harmonic, SignalCorrection
from ident.effects.registry import make_effect
from ident.errors import ConfigurationError
from ident.robots.transmission import Side


@pytest.mark.parametrize("carrier", [None, "j2"])
@pytest.mark.parametrize("robot_name", ["seven", "scara", "wrist"])
def test_payload_is_a_body_added_to_a_link(robot_name: str, carrier: str | None) -> None:
    robot = ROBOTS[robot_name]()
    motion = motion_of(robot, 40)
    body = pin.Inertia(1.2, np.array([0.02, -0.1, 0.05]), np.diag([0.01, 0.02, 0.025]))
    heavy = robot.model.copy()
    at = heavy.getJointId(carrier or robot.joint_names[-1])
    heavy.inertias[at] = heavy.inertias[at] + body
    effect = make_effect("payload", joints=carrier)
    found = effect.torque(motion, robot, body.toDynamicParameters())
    np.testing.assert_allclose(effect.columns(motion, robot) @ body.toDynamicParameters(), found, atol=1e-10)
    for sample, state in enumerate(zip(motion.joint.q, motion.joint.dq, motion.joint.ddq, strict=True)):
        more = pin.rnea(heavy, heavy.createData(), *state) - pin.rnea(robot.model, robot.model.createData(), *state)
        np.testing.assert_allclose(found[sample], more, atol=1e-9)
    # Half way between two samples: each is clear of the step.
    t_0 = float(motion.t[20]) - 0.5 / motion.rate
    step = make_effect("payload_step", joints=carrier, t_0=t_0)
    np.testing.assert_allclose(step.torque(motion, robot, body.toDynamicParameters()), found * (motion.t >= t_0)[:, None], atol=1e-12)


@pytest.mark.parametrize("robot_name", ["pendulum", "seven", "scara", "wrist"])
def test_external_force_is_minus_the_transposed_jacobian(robot_name: str) -> None:
    robot = ROBOTS[robot_name]()
    motion = motion_of(robot, 30)
    point, force = np.array([0.1, -0.2, 0.3]), np.array([3.0, -5.0, 7.0])
    effect = make_effect("external_force", point=point.tolist())
    found = effect.torque(motion, robot, force)
    model = robot.model.copy()
    last = model.getJointId(robot.joint_names[-1])
    frame = model.addFrame(pin.Frame("tip", last, 0, pin.SE3(np.eye(3), point), pin.FrameType.OP_FRAME))
    data = model.createData()
    for sample, q in enumerate(motion.joint.q):
        J = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)[:3]
        np.testing.assert_allclose(found[sample], -J.T @ force, atol=1e-10)


def test_a_point_has_three_coordinates() -> None:
    with pytest.raises(ConfigurationError, match="point"):
        make_effect("external_force", point=[0.0, 1.0])


@pytest.mark.parametrize("side", list(Side))
def test_true_position_undoes_the_errors_of_an_encoder(side: Side) -> None:
    robot = ROBOTS["wrist"]()
    T = robot.transmission
    q = motion_of(robot).joint.q
    truth = q if side == Side.JOINT else T.motor_position(q)
    offset, scale, sine, cosine = np.random.default_rng(0).normal(size=(4, 3)) * 0.02
    reading = truth + offset + scale * truth + sine * np.sin(2 * truth) + cosine * np.cos(2 * truth)
    fix = SignalCorrection(side, offset=offset, scale=scale, harmonics=(Harmonic(2.0, sine, cosine),))
    given = reading if side == Side.JOINT else T.joint_position(reading)
    np.testing.assert_allclose(fix.true_position(given, T), q, atol=1e-11)
    with pytest.raises(ConfigurationError, match="too large"):
        SignalCorrection(Side.JOINT, harmonics=(Harmonic(50.0, np.ones(3), np.ones(3)),)).true_position(q, T)


def test_true_torque_undoes_delay_lag_gain_and_limit() -> None:
    robot = ROBOTS["wrist"]()
    T = robot.transmission
    t = np.arange(4000) / 1000.0
    w = np.array([3.0, 5.0, 8.0])
    truth = np.sin(np.multiply.outer(t, w))
    delay, lag, gain = np.array([0.004, 0.0, 0.0105]), np.array([0.0, 0.01, 0.02]), np.array([1.0, 1.1, 0.9])
    phase = w * lag
    late = np.sin(np.multiply.outer(t, w) - w * delay - np.arctan(phase)) / np.sqrt(1 + phase**2)
    fix = SignalCorrection(Side.MOTOR, gain=gain, delay=delay, lag=lag)
    np.testing.assert_allclose(fix.true_torque(gain * late, t, T)[20:-20], truth[20:-20], atol=2e-4)
    limit = SignalCorrection(Side.MOTOR, limit=np.array([0.5, np.inf, 0.2]))
    np.testing.assert_allclose(limit.true_torque(truth, t, T), np.clip(truth, [-0.5, -9, -0.2], [0.5, 9, 0.2]))


@pytest.mark.parametrize(
    ("name", "values", "field"),
    [
        ("delay", [0.003], "delay"),
        ("filter_lag", [0.01], "lag"),
        ("torque_constant", [0.1], "gain"),
        ("encoder_offset", [0.02], "offset"),
        ("encoder_scale", [0.01], "scale"),
    ],
)
def test_a_finding_in_the_signals_is_applied_to_its_joint(name: str, values: list[float], field: str) -> None:
    robot = ROBOTS["wrist"]()
    effect = make_effect(name, joints="j2")
    found = getattr(effect.applied(robot, np.array(values)), field)
    expected = np.zeros(3)
    expected[1] = values[0]
    np.testing.assert_allclose(found, expected + (field == "gain"))


def test_saturation_and_eccentricity_are_applied() -> None:
    robot = ROBOTS["wrist"]()
    limit = make_effect("saturation", joints="j3", limit=0.4).applied(robot, np.ones(1)).limit
    np.testing.assert_allclose(limit, [np.inf, np.inf, 0.4])
    assert make_effect("saturation", joints="j3", limit=0.4, clipped="log").applied(robot, np.ones(1)) is None
    (harmonic,) = make_effect("encoder_eccentricity", joints=("j3", "j1")).applied(robot, np.array([1.0, 2.0, 3.0, 4.0])).harmonics
    np.testing.assert_allclose(harmonic.sine, [3.0, 0.0, 1.0])
    np.testing.assert_allclose(harmonic.cosine, [4.0, 0.0, 2.0])
