"""The structural lemmas beneath the theorems on base parameters, and the corrected equations of the drives, against Pinocchio's torques.

Frames of the source: {i-1}A_i = Rx(alpha_i) Rz(theta_i), origin of frame i at L_{i-1}, L = [Lx, 0, Lz]."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from structures import JointSpec, parallelogram_robot, random_tree, right_twists, rotation, rotational_robot, sampled_regressor, urdf_text

from ident.effects.motion import Motion
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.regressor.base_parameters import closed_form
from ident.regressor.base_parameters.structural import base_set
from ident.robots import load_robot, nominal_values
from ident.robots.robot import Robot
from ident.robots.transmission import Side, Transmission

Array = np.ndarray
E = np.eye(3)
SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=10, deadline=None)


def body(mass: float = 0.0, moment: Array | tuple[float, ...] = (0, 0, 0), inertia: Array | None = None) -> Array:
    """A link's ten parameters in Pinocchio's order."""
    I = np.zeros((3, 3)) if inertia is None else inertia  # noqa: E741
    return np.array([mass, *moment, I[0, 0], I[0, 1], I[1, 1], I[0, 2], I[1, 2], I[2, 2]])


def moved(mass: float, moment: Array, inertia: Array, turn: Array, at: Array) -> Array:
    """The parameters of a body in the frame before: turned by `turn`, its origin at `at`."""
    R, J = turn @ moment, turn @ inertia @ turn.T
    J = J + 2 * (at @ R) * E - np.outer(at, R) - np.outer(R, at) + mass * ((at @ at) * E - np.outer(at, at))
    return body(mass, R + mass * at, J)


def chain(rng: np.random.Generator, count: int, gravity: Array, slides: tuple[int, ...] = ()) -> tuple[Robot, list[JointSpec]]:
    """An open chain in the source's frames, with any twists."""
    joints = []
    for i in range(count):
        twist = rng.choice([0.0, np.pi / 2, -np.pi / 2, rng.uniform(-3, 3)]) if i else 0.0
        L = np.array([rng.normal(), 0.0, rng.normal()]) * 0.4 if i else np.zeros(3)
        joints.append(JointSpec(i - 1, i in slides, rotation([1, 0, 0], twist), L, np.array([0.0, 0, 1])))
    return Robot.from_urdf(urdf_text(joints), gravity=gravity), joints


def silent(robot: Robot, change: Array) -> bool:
    """Whether a change of all link parameters changes no torque."""
    Y = sampled_regressor(robot, samples=25)
    return bool(np.abs(Y @ change).max() < 1e-9 * np.abs(Y).max() * np.abs(change).max())


@FEW
@given(SEEDS)
def test_a_body_symmetric_about_the_axis_may_be_given_to_the_link_before(seed: int) -> None:
    """The lemma beneath M_i, R_i and J_i: mass, first moment along z and Ixx = Iyy of link i act on link i - 1 alone; nothing else does."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 5))
    robot, joints = chain(rng, count, rng.normal(size=3) * 6)
    i = int(rng.integers(1, count))
    turn, at = joints[i].rotation, joints[i].translation
    z = np.array([0.0, 0, 1])
    for mass, moment, inertia in ((1.0, 0 * z, 0 * E), (0.0, z, 0 * E), (0.0, 0 * z, np.diag([1.0, 1, 0]))):
        change = np.zeros((count, 10))
        change[i] = -body(mass, moment, inertia)
        change[i - 1] = moved(mass, moment, inertia, turn, at)
        assert silent(robot, change.ravel())
    heard = [(0 * z, np.diag([0.0, 0, 1]))]
    if abs(turn[2, 2]) < 0.999:  # between parallel axes the others may be hidden, which is another lemma
        heard += [(np.array([1.0, 0, 0]), 0 * E), (0 * z, np.diag([1.0, -1, 0]))]
    for moment, inertia in heard:
        change = np.zeros((count, 10))
        change[i] = -body(0.0, moment, inertia)
        change[i - 1] = moved(0.0, moment, inertia, turn, at)
        assert not silent(robot, change.ravel())


@FEW
@given(SEEDS)
def test_a_sliding_link_has_its_inertia_on_the_link_before(seed: int) -> None:
    """The lemma beneath J_n of section 2.4: all six moments of inertia about its own origin of a link that slides; its mass is its own."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 5))
    i = int(rng.integers(1, count))
    robot, joints = chain(rng, count, rng.normal(size=3) * 6, slides=(i,))
    A = rng.normal(size=(3, 3))
    change = np.zeros((count, 10))
    change[i] = -body(inertia=A + A.T)
    change[i - 1] = body(inertia=joints[i].rotation @ (A + A.T) @ joints[i].rotation.T)
    assert silent(robot, change.ravel())
    change = np.zeros((count, 10))
    change[i], change[i - 1] = -body(1.0), moved(1.0, np.zeros(3), 0 * E, joints[i].rotation, joints[i].translation)
    assert not silent(robot, change.ravel())


@FEW
@given(SEEDS)
def test_potential_energy_and_its_slope(seed: int) -> None:
    """(2.190), (2.191) corrected: U = -g . sum R and dU/dtheta = gx Ry - gy Rx about z, R and g in the turning frame."""
    rng = np.random.default_rng(seed)
    g, R = rng.normal(size=3), rng.normal(size=3)

    def U(angle: float) -> float:
        return float(-g @ rotation([0, 0, 1], angle) @ R)

    at, h = float(rng.uniform(-3, 3)), 1e-6
    slope = (U(at + h) - U(at - h)) / (2 * h)
    own = rotation([0, 0, 1], at).T @ g
    assert slope == pytest.approx(own[0] * R[1] - own[1] * R[0], abs=1e-7)
    # The torque that holds a link against gravity is that slope.
    robot, _ = chain(rng, 1, g)
    data = robot.model.createData()
    Y = pin.computeJointTorqueRegressor(robot.model, data, np.array([at]), np.zeros(1), np.zeros(1))
    assert float((np.atleast_2d(Y) @ body(1.0, R))[0]) == pytest.approx(slope, abs=1e-7)


@FEW
@given(SEEDS)
def test_the_parallelogram_closes(seed: int) -> None:
    """theta_{xi+1} = theta_zeta - theta_xi - rho - pi and theta_{zeta+1} = theta_xi - theta_zeta, and (2.144): A_rho = Rz(rho + pi)."""
    rng = np.random.default_rng(seed)
    xi, zeta, rho = rng.uniform(-3, 3, 3)
    L_xi, L_zeta = rng.uniform(0.2, 1.0, 2)

    def Rz(angle: float) -> Array:
        return rotation([0, 0, 1], angle)

    xi_next, zeta_next = zeta - xi - rho - np.pi, xi - zeta
    A_rho = Rz(xi + xi_next).T @ Rz(zeta)
    expected = np.array([[-np.cos(rho), np.sin(rho), 0], [-np.sin(rho), -np.cos(rho), 0], [0, 0, 1]])
    assert A_rho == pytest.approx(expected, abs=1e-12)
    printed = expected.copy()
    printed[1, 1] = np.cos(rho)
    assert abs(np.cos(rho)) < 1e-6 or np.abs(printed @ printed.T - E).max() > 1e-12
    x = np.array([1.0, 0, 0])
    by_xi = Rz(xi) @ (L_xi * x) + Rz(xi + xi_next) @ A_rho @ (L_zeta * x)
    by_zeta = Rz(zeta) @ (L_zeta * x) + Rz(zeta + zeta_next) @ (L_xi * x)
    assert by_xi == pytest.approx(by_zeta, abs=1e-12)


@FEW
@given(SEEDS)
def test_the_cut_open_tree_gives_the_torques_of_the_loop(seed: int) -> None:
    """(2.139)-(2.140): tau = W' tau_tree with the closure's W, by the power of any motion."""
    rng = np.random.default_rng(seed)
    robot = parallelogram_robot(rng, int(rng.integers(2, 5)))
    p = rng.normal(size=10 * robot.tree.nb)
    q, dq, ddq = rng.uniform(-2, 2, (3, robot.n))
    data = robot.model.createData()
    state = robot.tree_position(q), robot.tree_rate(dq), robot.tree_rate(ddq)
    tree = pin.computeJointTorqueRegressor(robot.model, data, *state) @ p
    own = robot.loop.W.T @ tree
    assert own @ dq == pytest.approx(tree @ state[1], rel=1e-10, abs=1e-10)


@pytest.mark.parametrize(("lengths", "Q"), [((0.3, 0.2), 1), ((0.0, 0.2), 2), ((0.0, 0.0), 3), ((0.2, 0.0), 1)])
def test_count_with_vertical_axes_is_2Q_not_2(lengths: tuple[float, float], Q: int) -> None:
    """Theorem 2.3.1: the printed -2 is Q = 1, which needs Lx_1 != 0."""
    joints = [JointSpec(i - 1, False, E, np.array([x, 0, 0.1]), np.array([0.0, 0, 1])) for i, x in enumerate((0.0, *lengths))]
    robot = Robot.from_urdf(urdf_text(joints), gravity=(0, 0, -9.81))
    rank = int(np.linalg.matrix_rank(sampled_regressor(robot), tol=1e-9))
    assert rank == closed_form.rotational(robot).count == 7 * 3 - 4 * 3 - 2 * Q
    assert (rank == 7 * 3 - 4 * 3 - 2) == (Q == 1)


@pytest.mark.parametrize("sense", [1.0, -1.0])
@pytest.mark.parametrize("first", [True, False])
def test_a_sliding_axis_against_z_counts_like_one_along_it(sense: float, first: bool) -> None:
    """After (2.108): A33 = +-1, not +1 alone."""
    z = np.array([0.0, 0, 1])
    turn = E if sense > 0 else rotation([1, 0, 0], np.pi)
    slide = JointSpec(0, True, turn, np.array([0.2, 0, 0.1]), z)
    last = JointSpec(1, False, turn.T @ (E if first else rotation([1, 0, 0], np.pi / 2)), np.array([0.3, 0, 0]), z)
    robot = Robot.from_urdf(urdf_text([JointSpec(-1, False, E, np.zeros(3), z), slide, last]), gravity=(1.0, 2.0, -9.0))
    along = Robot.from_urdf(
        urdf_text([JointSpec(-1, False, E, np.zeros(3), z), JointSpec(0, True, E, slide.translation, z),
                   JointSpec(1, False, E if first else rotation([1, 0, 0], np.pi / 2), last.translation, z)]),
        gravity=(1.0, 2.0, -9.0),
    )  # fmt: skip
    counts = [closed_form.mixed(r).count for r in (robot, along)]
    assert counts[0] == counts[1] == int(np.linalg.matrix_rank(sampled_regressor(robot), tol=1e-9))


@FEW
@given(SEEDS)
def test_exactly_the_rotors_of_the_first_axes_of_two_clusters_merge(seed: int) -> None:
    """Section 3.2: with diagonal gears h_1 and h_{alpha_2} are no parameters of their own; all others are."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 6))
    robot = rotational_robot(rng, count, right_twists(rng))
    form = closed_form.rotational(robot)
    beta = int(form.count_formula.split("- 4*")[1].split()[0])
    rank = int(np.linalg.matrix_rank(_scaled(sampled_regressor(robot, rotors=True)), tol=1e-9))
    assert rank == form.count + count - (2 if beta < count else 1)


def _scaled(Y: Array) -> Array:
    size = np.linalg.norm(Y, axis=0)
    R = np.linalg.qr(Y / np.where(size > 1e-9 * size.max(), size, np.inf), mode="r")
    return np.asarray(R / max(np.abs(R).max(), 1e-300))


@FEW
@given(SEEDS)
def test_any_tree_has_the_rank_of_its_structure(seed: int) -> None:
    """Beyond the source: the null directions above, propagated through any tree, leave as many parameters as a sampled regressor shows."""
    robot = Robot.from_urdf(urdf_text(random_tree(np.random.default_rng(seed), 4)), gravity=(0.3, -0.5, -9.7))
    assert base_set(robot).count == int(np.linalg.matrix_rank(_scaled(sampled_regressor(robot)), tol=1e-9))


# --- the drives, section 3.2 to 3.4 -----------------------------------------------------------------------------------


def puma(gravity: tuple[float, float, float] = (0, 0, 0), friction: bool = False):
    robot = load_robot("puma560").with_gravity(gravity)
    model = robot.rigid_body() + RotorInertia()
    if friction:
        model = model + Viscous() + Coulomb()
    return robot, model, nominal_values(model)


def motor_torque(model, robot: Robot, values: Array, q: Array, dq_m: Array, ddq_m: Array) -> Array:
    K = robot.transmission.K
    return model.torque(Motion.of(robot, q[None], (K @ dq_m)[None], (K @ ddq_m)[None], np.zeros(1)), values)[0]


@FEW
@given(SEEDS)
def test_corrected_equations_of_the_wrist(seed: int) -> None:
    """(3.14), (3.15): motors 5 and 6 of the PUMA 560, other joints at rest, the torque of gravity left out."""
    rng = np.random.default_rng(seed)
    robot, model, values = puma()
    K = robot.transmission.K
    k5, k6, k65 = K[4, 4], K[5, 5], K[5, 4]
    link = values[50:60]
    h5, h6 = (values[60 + j] for j in (4, 5))
    J6x_y, J6xy, J6xz, J6yz, J6z = link[4] - link[6], link[5], link[7], link[8], link[9]
    J5z = values[49] + link[6]
    q, s_rate, gain = rng.uniform(-2, 2, 6), rng.normal() * 50, rng.normal(size=2) * 100
    s, c = np.sin(q[5]), np.cos(q[5])
    still = np.zeros(6)

    # (3.14): joint 6 held, so that motor 6 turns with motor 5.
    ddq_m = still.copy()
    ddq_m[4], ddq_m[5] = gain[0], -k65 / k6 * gain[0]
    tau = motor_torque(model, robot, values, q, still, ddq_m)
    left = (k5**2 * J5z + h5 + (k65 / k6) ** 2 * h6 + k5**2 * (J6x_y * s**2 + 2 * J6xy * s * c)) * gain[0]
    assert left == pytest.approx(tau[4] - k65 / k6 * tau[5], rel=1e-9, abs=1e-9)
    printed = (k5**2 * J5z + h5 + h5**2 / k6**2 * h6 + k5**2 * (J6x_y * s**2 + 2 * J6xy * s * c)) * gain[0]
    assert printed != pytest.approx(-tau[4] - k65 / k6 * tau[5], rel=1e-3)

    # (3.15): motors 5 and 6 move.
    dq_m, ddq_m = still.copy(), still.copy()
    dq_m[4], dq_m[5] = s_rate, rng.normal() * 50
    ddq_m[4:] = gain
    tau = motor_torque(model, robot, values, q, dq_m, ddq_m)
    left = (
        k6 * (k5 * (J6xz * s + J6yz * c) + k65 * J6z) * gain[0]
        + (k6**2 * J6z + h6) * gain[1]
        - k6 * k5**2 * (J6x_y * s * c + J6xy * (2 * c**2 - 1)) * s_rate**2
    )
    assert left == pytest.approx(tau[5], rel=1e-9, abs=1e-9)


@FEW
@given(SEEDS)
def test_static_and_constant_velocity_tests_separate_friction_for_any_gears(seed: int) -> None:
    """3.4.1: (tau+ + tau-) / 2 holds the posture; 3.4.2: [tau(+w) - tau(-w)] / 2 = b w + c, with the coupling of the gears in it."""
    rng = np.random.default_rng(seed)
    robot, model, values = puma((0, 0, -9.81), friction=True)
    q, j, w = rng.uniform(-2, 2, 6), int(rng.integers(6)), float(rng.uniform(1, 200))
    rest, speed = np.zeros(6), np.zeros(6)
    speed[j] = w
    up, down = (motor_torque(model, robot, values, q, sign * speed, rest) for sign in (1, -1))
    viscous, coulomb = values[66 + j], values[72 + j]
    assert 0.5 * (up[j] - down[j]) == pytest.approx(viscous * w + coulomb, rel=1e-9)
    creeping = [motor_torque(model, robot, values, q, sign * 1e-6 * speed, rest) for sign in (1, -1)]
    bare = motor_torque(model, robot, np.where(np.arange(len(values)) < 66, values, 0.0), q, rest, rest)
    assert 0.5 * (creeping[0][j] + creeping[1][j]) == pytest.approx(bare[j], rel=1e-9, abs=1e-12)


@FEW
@given(SEEDS)
def test_motion_equation_with_rotors(seed: int) -> None:
    """(3.35) corrected: (H + K^-T R K^-1) ddtheta = K^-T tau_m at rest without gravity, K any invertible matrix."""
    rng = np.random.default_rng(seed)
    plain = load_robot("puma560").with_gravity((0, 0, 0))
    K = plain.transmission.K + 1e-3 * rng.normal(size=(6, 6))
    robot = plain.with_transmission(Transmission(K, plain.transmission.zero, Side.MOTOR))
    model = robot.rigid_body() + RotorInertia()
    values = np.concatenate([robot.nominal, rng.uniform(1e-5, 1e-3, 6)])
    q, ddq = rng.uniform(-2, 2, 6), rng.normal(size=6)
    tau = model.torque(Motion.of(robot, q[None], np.zeros((1, 6)), ddq[None], np.zeros(1)), values)[0]
    H = _inertia(robot, q)
    inverse = np.linalg.inv(K)
    assert (H + inverse.T @ np.diag(values[60:]) @ inverse) @ ddq == pytest.approx(inverse.T @ tau, rel=1e-8, abs=1e-8)
    printed = (H + np.diag(values[60:]) @ inverse) @ ddq
    assert np.abs(printed - inverse.T @ tau).max() > 1e-3


def _inertia(robot: Robot, q: Array) -> Array:
    data = robot.model.createData()
    zero = np.zeros(6)
    columns = [pin.computeJointTorqueRegressor(robot.model, data, q, zero, e) @ robot.nominal for e in np.eye(6)]
    return np.stack(columns, axis=1)
