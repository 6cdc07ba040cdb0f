"""Robots and their descriptions over random structures: what must hold whatever the numbers."""

from __future__ import annotations

import math
import tomllib

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ident import Robot, Side, Transmission
from ident._utils.toml import to_toml
from ident.effects.motion import Motion
from ident.robots.urdf import exact_angle

finite = st.floats(-1e6, 1e6, allow_nan=False)


@given(multiple=st.integers(-8, 8).filter(bool), decimals=st.integers(3, 17), cut=st.booleans())
def test_written_right_angles_are_found(multiple, decimals, cut):
    exact = multiple * math.pi / 4
    text = f"{exact:.17f}"[: -(17 - decimals) or None] if cut else f"{exact:.{decimals}f}"
    assert exact_angle(text) == exact


@given(st.floats(-7, 7), st.integers(0, 17))
@example(4e-6, 6)
def test_an_angle_moves_by_less_than_its_last_digit(angle, decimals):
    text = f"{angle:.{decimals}f}"
    found = exact_angle(text)
    if found is not None:
        assert abs(found - float(text)) <= max(10.0**-decimals, 1e-6)
        assert abs(found / (math.pi / 4) - round(found / (math.pi / 4))) < 1e-12


@st.composite
def chains(draw):
    """A random tree of 2 to 6 joints as URDF text."""
    n = draw(st.integers(2, 6))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    parts = ['<robot name="r"><link name="l0"/>']
    for i in range(1, n + 1):
        kind = rng.choice(["revolute", "continuous", "prismatic"])
        xyz, rpy, axis, com = (" ".join(map(repr, rng.normal(size=3).tolist())) for _ in range(4))
        root = rng.normal(size=(3, 3))
        spread = root @ root.T + 0.1 * np.eye(3)  # second moments: any such matrix is a body's
        inertia = np.trace(spread) * np.eye(3) - spread
        ixx, ixy, ixz, iyy, iyz, izz = inertia[np.triu_indices(3)].tolist()
        parts.append(
            f'<link name="l{i}"><inertial><mass value="{rng.uniform(0.1, 5)}"/><origin xyz="{com}"/>'
            f'<inertia ixx="{ixx}" ixy="{ixy}" ixz="{ixz}" iyy="{iyy}" iyz="{iyz}" izz="{izz}"/></inertial></link>'
            f'<joint name="j{i}" type="{kind}"><parent link="l{rng.integers(0, i)}"/><child link="l{i}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/></joint>'
        )
    return "".join(parts) + "</robot>"


def torque(robot, q, dq, ddq):
    return robot.rigid_body().torque(Motion.of(robot, q, dq, ddq), robot.nominal)


@settings(max_examples=40, deadline=None)
@given(chains(), st.data())
def test_locking_a_joint_is_holding_it_still(text, data):
    whole = Robot.from_urdf(text)
    held = data.draw(st.sampled_from(whole.joint_names))
    at = data.draw(st.floats(-2, 2))
    part = Robot.from_urdf(text, locked={held: at})
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 3, whole.n))
    i = whole.joint_index(held)
    q[:, i], dq[:, i], ddq[:, i] = at, 0, 0
    keep = [whole.joint_index(name) for name in part.joint_names]
    wanted = torque(whole, q, dq, ddq)[:, keep]
    found = torque(part, q[:, keep], dq[:, keep], ddq[:, keep])
    assert np.abs(found - wanted).max() <= 1e-11 * (1 + np.abs(wanted).max())


@settings(max_examples=40, deadline=None)
@given(chains(), st.data())
def test_a_coupled_joint_is_a_projection(text, data):
    whole = Robot.from_urdf(text)
    follower, master = data.draw(st.permutations(whole.joint_names))[:2]
    factor, offset = data.draw(st.floats(-3, 3)), data.draw(st.floats(-1, 1))
    part = Robot.from_urdf(text, loop={follower: {master: factor, "offset": offset}})
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 3, part.n))
    W = part.loop.W
    wanted = torque(whole, q @ W.T + part.loop.offset, dq @ W.T, ddq @ W.T) @ W
    assert np.abs(torque(part, q, dq, ddq) - wanted).max() <= 1e-11 * (1 + np.abs(wanted).max())
    assert W[whole.joint_index(follower), part.joint_index(master)] == factor


@given(n=st.integers(1, 8), seed=st.integers(0, 2**32 - 1))
def test_transmission_keeps_power_and_goes_back(n, seed):
    rng = np.random.default_rng(seed)
    K = (np.eye(n) + 0.3 / n * rng.normal(size=(n, n))) * 10.0 ** rng.uniform(-4, 0, size=n)
    drive = Transmission(K, rng.normal(size=n))
    q, tau = rng.normal(size=(2, 5, n))
    assert np.allclose(drive.joint_position(drive.motor_position(q)), q, atol=1e-9)
    motor = drive.torque(tau, Side.JOINT, Side.MOTOR)
    power = np.sum(tau * q, axis=1)
    assert np.allclose(np.sum(motor * drive.motor_rate(q), axis=1), power, atol=1e-8 * (1 + np.abs(power).max()))


plain = st.recursive(
    st.booleans() | st.integers(-(2**53), 2**53) | finite | st.text(max_size=12),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(max_size=6), st.dictionaries(st.text(max_size=6), plain, min_size=1, max_size=3), max_size=3))
def test_toml_is_read_as_it_was_written(tables):
    assert tomllib.loads(to_toml(tables)) == tables
