"""Friction and the simple torques of the catalogue against their formulas, written out by hand."""

from __future__ import annotations

import time
from itertools import pairwise

import numpy as np
import pytest
from effect_robots import ROBOTS, motion_of
from scipy.integrate import solve_ivp

from ident.effects.motion import Motion
from ident.effects.registry import make_effect
from ident.errors import ConfigurationError
from ident.friction import Coulomb, Presliding
from ident.friction.presliding import deflection
from ident.model import Model

Array = np.ndarray


@pytest.fixture(scope="module")
def wrist() -> tuple:
    robot = ROBOTS["wrist"]()
    motion = motion_of(robot)
    T = robot.transmission
    w = motion.joint.dq @ np.linalg.inv(T.K).T
    phi = motion.joint.q @ np.linalg.inv(T.K).T
    return robot, motion, np.sign(w), w, phi


@pytest.mark.parametrize(
    ("name", "shape", "formula"),
    [
        ("viscous", {}, lambda s, w, phi, q, t: [w]),
        ("coulomb", {}, lambda s, w, phi, q, t: [s]),
        ("asymmetric_coulomb", {}, lambda s, w, phi, q, t: [s * s]),
        ("asymmetric_viscous", {}, lambda s, w, phi, q, t: [abs(w)]),
        ("stribeck", {"v_s": 20.0}, lambda s, w, phi, q, t: [s * np.exp(-((w / 20.0) ** 2))]),
        ("nonlinear_viscous", {"a": 0.6}, lambda s, w, phi, q, t: [s * abs(w) ** 0.6]),
        ("position_dependent_friction", {"order": 2.0}, lambda s, w, phi, q, t: [s * np.sin(2 * q), s * np.cos(2 * q)]),
        (
            "position_dependent_friction",
            {"order": 0.1, "angle": "motor"},
            lambda s, w, phi, q, t: [s * np.sin(0.1 * phi), s * np.cos(0.1 * phi)],
        ),
        ("temperature_drift_viscous", {"T": 0.7}, lambda s, w, phi, q, t: [np.exp(-t / 0.7) * w]),
        ("temperature_drift_coulomb", {"T": 0.7}, lambda s, w, phi, q, t: [np.exp(-t / 0.7) * s]),
        ("offset", {}, lambda s, w, phi, q, t: [w**0]),
        ("offset_drift", {}, lambda s, w, phi, q, t: [t * w**0]),
        ("offset_step", {"t_0": 0.9975}, lambda s, w, phi, q, t: [(t >= 0.9975) * w**0]),
        ("cogging", {"order": 6.0}, lambda s, w, phi, q, t: [np.sin(6 * phi), np.cos(6 * phi)]),
        ("cogging", {"order": 6.0, "angle": "joint"}, lambda s, w, phi, q, t: [np.sin(6 * q), np.cos(6 * q)]),
    ],
)
def test_motor_side_forms(wrist: tuple, name: str, shape: dict, formula: object) -> None:
    robot, motion, s, w, phi = wrist
    columns = make_effect(name, **shape).columns(motion, robot)
    expected = formula(s, w, phi, motion.joint.q, motion.t[:, None])
    width = len(expected)
    for j in range(robot.n):
        for i, values in enumerate(expected):
            np.testing.assert_allclose(columns[:, j, width * j + i], values[:, j], atol=1e-12)
            assert not np.delete(columns[:, :, width * j + i], j, axis=1).any()


@pytest.mark.parametrize(
    ("name", "shape", "formula"),
    [
        ("joint_side_friction", {}, lambda q, dq: [np.sign(dq), dq]),
        ("linear_spring", {}, lambda q, dq: [q, q**0]),
        ("nonlinear_spring", {}, lambda q, dq: [q**0, q, q**2, q**3]),
    ],
)
def test_joint_side_forms(wrist: tuple, name: str, shape: dict, formula: object) -> None:
    robot, motion, *_ = wrist
    columns = make_effect(name, joints="j2", **shape).columns(motion, robot)
    expected = np.stack(formula(motion.joint.q[:, 1], motion.joint.dq[:, 1]), axis=1)
    np.testing.assert_allclose(columns[:, 1], expected)
    assert not columns[:, [0, 2]].any()


def test_load_dependent_friction_is_a_share_of_the_torque_through_the_gear(wrist: tuple) -> None:
    robot, motion, s, *_ = wrist
    model = motion.reference.model
    links = model.effects[0].columns(motion, robot) @ motion.reference.values[:30]
    expected = s * np.abs(links @ robot.transmission.K)
    columns = make_effect("load_dependent_friction").columns(motion, robot)
    np.testing.assert_allclose(np.einsum("Njj->Nj", columns), expected, atol=1e-12)
    # A prediction that holds the rotor of joint 1 as if it were the link's: the shape takes it out again.
    rotor = 0.03
    held = motion.with_load(motion.load + rotor * np.outer(motion.motor.ddq[:, 0], np.linalg.inv(robot.transmission.K)[0]))
    again = make_effect("load_dependent_friction", joints="j1", rotor=rotor).columns(held, robot)
    np.testing.assert_allclose(again[:, 0, 0], expected[:, 0], atol=1e-12)


def test_counterbalance_is_the_slope_of_the_energy_of_its_spring() -> None:
    robot = ROBOTS["pendulum"]()
    a, r, k, l0, q0 = 0.3, 0.12, 900.0, 0.15, 0.4
    q = np.linspace(-2, 2, 101)[:, None]

    def energy(q: Array) -> Array:
        length = np.sqrt(a * a + r * r - 2 * a * r * np.cos(q - q0))
        return 0.5 * k * (length - l0) ** 2

    h = 1e-5
    slope = (energy(q + h) - energy(q - h)) / (2 * h)
    effect = make_effect("counterbalance", angle=q0, ratio=r / a)
    torque = effect.torque(Motion.of(robot, q, 0 * q, 0 * q), robot, np.array([k * a * r, k * r * l0]))
    np.testing.assert_allclose(torque, slope, atol=1e-6)


def test_counterbalance_needs_a_joint_that_turns() -> None:
    robot = ROBOTS["scara"]()
    assert {p.joint for p in make_effect("counterbalance").parameters(robot)} == {"j1", "j2", "j4"}
    with pytest.raises(ConfigurationError, match="prismatic"):
        make_effect("counterbalance", joints="j3").parameters(robot)


def path(samples: int, seed: int = 0) -> tuple[Array, Array]:
    """t and a position with reversals of every size, and a rest."""
    t = np.arange(samples) / 1000.0
    q = 0.02 * np.sin(9 * t) + 0.004 * np.sin(47 * t + seed)
    q[samples // 2 : samples // 2 + 50] = q[samples // 2]
    return t, q


def test_presliding_follows_dahl() -> None:
    t = np.arange(3000) / 1000.0
    f = lambda s: 0.02 * np.sin(9 * s) + 0.004 * np.sin(47 * s)  # noqa: E731
    df = lambda s: 0.18 * np.cos(9 * s) + 0.188 * np.cos(47 * s)  # noqa: E731
    z_s = 0.003
    exact = solve_ivp(lambda s, z: [(df(s) - abs(df(s)) * z[0]) / z_s], (0, t[-1]), [0.0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=1e-3)
    np.testing.assert_allclose(deflection(f(t), z_s), exact.y[0], atol=2e-3)


def test_presliding_does_not_depend_on_how_finely_a_path_is_sampled() -> None:
    corners = np.array([0.0, 0.01, 0.004, 0.02, 0.02, -0.01])
    fine = np.concatenate([np.linspace(a, b, 20, endpoint=False) for a, b in pairwise(corners)] + [corners[-1:]])
    np.testing.assert_allclose(deflection(fine, 0.003)[::20], deflection(corners, 0.003), atol=1e-13)
    assert np.abs(deflection(fine, 0.003)).max() <= 1.0


def test_presliding_of_all_coulomb_friction_is_passive() -> None:
    """Fc s + Fp (z − s) with Fp = Fc never gives back more than it took."""
    _, q = path(5000)
    work = np.cumsum(0.5 * (deflection(q, 0.002)[1:] + deflection(q, 0.002)[:-1]) * np.diff(q))
    assert work.min() > -1e-6
    assert work[-1] > 0.1


def test_presliding_beside_coulomb_is_the_deflection() -> None:
    robot = ROBOTS["pendulum"]()
    t, q = path(500)
    q = q[:, None]
    dq = np.gradient(q, t, axis=0)
    model = Model(robot, (Coulomb(), Presliding(z_s=0.002)))
    torque = model.torque(Motion.of(robot, q, dq, 0 * q, t), np.array([3.0, 3.0]))
    np.testing.assert_allclose(torque[:, 0], 3.0 * deflection(q[:, 0], 0.002), atol=1e-12)


@pytest.mark.parametrize("z_s", [1e-7, 1e-3, 10.0])
def test_deflection_of_odd_paths(z_s: float) -> None:
    for q in (np.zeros(0), np.zeros(1), np.zeros(9), np.array([0.0, 0, 1, 1, 1, 0.5, 0.5]), np.random.default_rng(0).normal(size=300)):
        z = deflection(q, z_s)
        assert z.shape == q.shape
        assert np.all(np.abs(z) <= 1.0)
        # One step at a time, as the law says.
        slow = [0.0] if len(q) else []
        for step in np.diff(q):
            s = np.sign(step)
            slow.append(s + (slow[-1] - s) * np.exp(-abs(step) / z_s) if step else slow[-1])
        np.testing.assert_allclose(z, slow, atol=1e-12)


def test_effects_with_memory_keep_up_with_long_runs() -> None:
    robot = ROBOTS["wrist"]()
    motion = motion_of(robot, samples=100_000, rate=1000.0)
    for name, limit in (("presliding", 1.0), ("filter_lag", 2.0), ("joint_elasticity", 5.0), ("backlash", 5.0)):
        start = time.process_time()
        columns = make_effect(name, joints="j2").columns(motion, robot)
        assert time.process_time() - start < limit
        assert np.isfinite(columns).all()
