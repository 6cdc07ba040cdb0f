"""Effects that correct the prediction, against Pinocchio's rnea evaluated at the perturbed robot, position or time."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from effect_robots import ROBOTS, declared, smooth
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ident.effects.flexing import responses
from ident.effects.motion import Motion
from ident.effects.reference import Reference
from ident.effects.registry import make_effect
from ident.effects.timing import derivative, low_pass
from ident.errors import ConfigurationError
from ident.friction import Coulomb
from ident.regressor.base_parameters.structural import base_set
from ident.robots.robot import Robot
from ident.robots.transmission import Side

Array = np.ndarray
FIXED = ["pendulum", "seven", "scara", "wrist"]


def reading(robot: Robot, q: Array, dq: Array, ddq: Array, values: Array, **other: object) -> Array:
    """Torque on the measured side, sample by sample: rnea, and the drive by hand. `other`: K, gravity, model, direction."""
    n, T = robot.n, robot.transmission
    K, model = other.get("K", T.K), other.get("model", robot.model).copy()
    model.gravity.linear[:] = other.get("gravity", robot.model.gravity.linear)
    for i, inertia in enumerate(np.reshape(values[: 10 * n], (n, 10))):
        model.inertias[i + 1] = pin.Inertia.FromDynamicParameters(inertia)
    data = model.createData()
    links = np.array([pin.rnea(model, data, *row) for row in zip(q, dq, ddq, strict=True)])
    Ia, Fv, Fc, offset = np.reshape(values[10 * n :], (4, n))
    w, dw = np.linalg.solve(K, dq.T).T, np.linalg.solve(K, ddq.T).T
    drive = Ia * dw + Fv * w + Fc * other.get("direction", np.sign(w)) + offset
    return links @ K + drive if T.measured == Side.MOTOR else links + np.linalg.solve(K.T, drive.T).T


def case(robot_name: str, samples: int = 60) -> tuple[Robot, Array, tuple[Array, Array, Array], Motion]:
    robot = ROBOTS[robot_name]()
    t, *state = smooth(robot, samples, rate=50.0, seed=4)
    model, values = declared(robot)
    motion = Motion.of(robot, *state, t, rate=50.0).with_reference(Reference(model, values))
    return robot, values, tuple(state), motion


def column(effect: object, motion: Motion, robot: Robot, k: int = 0) -> Array:
    """Column on the measured side."""
    T = robot.transmission
    return T.torque(effect.columns(motion, robot)[:, :, k], effect.side, T.measured)


def close(a: Array, b: Array, relative: float = 1e-6) -> None:
    np.testing.assert_allclose(a, b, rtol=0, atol=relative * max(np.abs(b).max(), 1e-9))


@pytest.mark.parametrize("robot_name", list(ROBOTS))
def test_the_prediction_is_that_of_rnea(robot_name: str) -> None:
    robot, values, state, motion = case(robot_name)
    close(motion.predicted, reading(robot, *state, values), 1e-12)


@pytest.mark.parametrize("encoder", list(Side))
@pytest.mark.parametrize("sensor", list(Side))
@pytest.mark.parametrize("robot_name", ["seven", "scara", "wrist"])
def test_gear_coupling_is_the_slope_over_the_entry(robot_name: str, sensor: Side, encoder: Side) -> None:
    robot, values, state, motion = case(robot_name)
    T = robot.transmission
    direction = motion.motor.direction
    effect = make_effect("gear_coupling", encoder=encoder, sensor=sensor, joints=["j1", "j3"], motors=["j2", "j3"])
    if sensor == Side.JOINT and T.measured == Side.MOTOR:
        with pytest.raises(ConfigurationError, match="motor torque"):
            effect.parameters(robot)
        return
    assert [p.name for p in effect.parameters(robot)] == ["K_j1_j2", "K_j1_j3", "K_j3_j2", "K_j3_j3"]
    for k, (i, j) in enumerate([(0, 1), (0, 2), (2, 1), (2, 2)]):
        h = 1e-6 * abs(T.K[i, i])

        def at(step: float, i: int = i, j: int = j) -> Array:
            K = T.K.copy()
            K[i, j] += step
            m = motion.motor
            there = state if encoder == Side.JOINT else (m.q @ K.T + T.zero, m.dq @ K.T, m.ddq @ K.T)
            torque = reading(robot, *there, values, K=K, direction=direction)
            # Motor torque that the log's writer converted with the K that he knew.
            converted = sensor == Side.MOTOR and T.measured == Side.JOINT
            return torque @ K @ np.linalg.inv(T.K) if converted else torque

        close(column(effect, motion, robot, k), (at(h) - at(-h)) / (2 * h), 2e-6)


def test_a_coupling_left_out_of_K_is_found_by_applying_the_finding() -> None:
    robot, values, state, _ = case("wrist", 200)
    true_K = robot.transmission.K.copy()
    true_K[2, 0] += 0.004
    measured = reading(robot, *state, values, K=true_K)
    model, _ = declared(robot)
    effect = make_effect("gear_coupling", joints="j3", motors="j1", sensor=robot.transmission.measured)
    for _ in range(4):
        motion = Motion.of(robot, *state).with_reference(Reference(type(model)(robot, model.effects), values))
        slope = column(effect, motion, robot).ravel()
        found = slope @ (measured - motion.predicted).ravel() / (slope @ slope)
        robot = effect.applied(robot, np.array([found]))
    np.testing.assert_allclose(robot.transmission.K, true_K, atol=1e-9)


@pytest.mark.parametrize("robot_name", list(ROBOTS))
def test_base_tilt_and_gravity_are_slopes_over_the_field(robot_name: str) -> None:
    robot, values, state, motion = case(robot_name)
    g = robot.model.gravity.linear.copy()
    up = -g / np.linalg.norm(g)
    tilt = make_effect("base_tilt")
    assert [p.name for p in tilt.parameters(robot)][:2] == ["tiltx", "tilty"]
    h = 1e-5
    for k in range(2):
        # The applied robot tells the axis; that it is square to gravity and of the right sense is checked here.
        turned = tilt.applied(robot, np.eye(2)[k] * 0.1).model.gravity.linear
        axis = -np.cross(g, turned) / np.linalg.norm(np.cross(g, turned))
        assert abs(axis @ up) < 1e-12
        np.testing.assert_allclose(turned, Rotation.from_rotvec(-0.1 * axis).apply(g), atol=1e-12)
        if np.allclose(up, [0, 0, 1]):
            np.testing.assert_allclose(axis, np.eye(3)[k], atol=1e-12)
        ends = [reading(robot, *state, values, gravity=Rotation.from_rotvec(-s * axis).apply(g)) for s in (h, -h)]
        close(column(tilt, motion, robot, k), (ends[0] - ends[1]) / (2 * h))
    ends = [reading(robot, *state, values, gravity=g - s * up) for s in (h, -h)]
    close(column(make_effect("gravity_magnitude"), motion, robot), (ends[0] - ends[1]) / (2 * h))
    stronger = make_effect("gravity_magnitude").applied(robot, np.array([0.3])).model.gravity.linear
    np.testing.assert_allclose(stronger, g - 0.3 * up, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "configuration", "size", "relative"),
    [
        ("base_tilt", {}, [0.25, -0.2], 1e-6),
        ("gravity_magnitude", {}, [1.5], 1e-9),
        ("link_length", {"joints": "j4"}, [0.1], 1e-6),
        ("gear_coupling", {"joints": "j2", "motors": "j1", "encoder": "joint", "sensor": "joint"}, [0.2], 1e-2),
        ("gear_coupling", {"joints": "j2", "motors": "j1", "encoder": "motor", "sensor": "joint"}, [0.2], 1e-2),
    ],
)
def test_a_large_correction_is_whole_where_the_reference_holds_it(
    name: str, configuration: dict[str, str], size: list[float], relative: float
) -> None:
    """A slope at zero would be off by far more: tilts by a tenth, couplings by half."""
    robot, values, state, motion = case("seven")
    effect = make_effect(name, **configuration)
    found = np.zeros(len(effect.parameters(robot)))
    found[: len(size)] = size
    if name == "gear_coupling":
        found *= abs(robot.transmission.K[1, 1])
    model, _ = declared(robot)
    itself = motion.with_reference(Reference(model + effect, np.append(values, found)))
    other = effect.applied(robot, found)
    if configuration.get("encoder") == "motor":
        m, K = motion.motor, other.transmission.K
        state = (m.q @ K.T + other.transmission.zero, m.dq @ K.T, m.ddq @ K.T)
    perturbed = {"K": other.transmission.K, "gravity": other.model.gravity.linear, "model": other.model}
    whole = reading(robot, *state, values, direction=motion.motor.direction, **perturbed) - motion.predicted
    T = robot.transmission
    there, at_zero = (T.torque(effect.columns(m, robot) @ found, effect.side, T.measured) for m in (itself, motion))
    close(there, whole, relative)
    if name in ("base_tilt", "gear_coupling"):
        assert np.abs(there - whole).max() < 0.1 * np.abs(at_zero - whole).max()


@pytest.mark.parametrize("robot_name", list(ROBOTS))
def test_a_tilted_base_shows_moments_that_a_level_one_hides(robot_name: str) -> None:
    robot, values, state, motion = case(robot_name)
    base = base_set(robot)
    # What a fit on the level base can know: the same base parameters, nothing of the rest.
    known = values.copy()
    known[: base.matrix.shape[1]] = base.lift[: base.matrix.shape[1]] @ base.values(values[: base.matrix.shape[1]])
    model, _ = declared(robot)
    motion = motion.with_reference(Reference(type(model)(robot, model.effects), known))
    effect = make_effect("base_tilt")
    h = 1e-4
    tilted = effect.applied(robot, np.array([h, -0.7 * h])).model.gravity.linear
    change = reading(robot, *state, values, gravity=tilted) - reading(robot, *state, values)
    columns = np.stack([column(effect, motion, robot, k).ravel() for k in range(len(effect.parameters(robot)))], axis=1)
    found, *_ = np.linalg.lstsq(columns, change.ravel(), rcond=1e-12)
    assert np.abs(columns @ found - change.ravel()).max() < 1e-3 * np.abs(change).max()
    if np.linalg.matrix_rank(columns) == columns.shape[1]:
        np.testing.assert_allclose(found[:2], [h, -0.7 * h], rtol=1e-2)


@pytest.mark.parametrize("robot_name", FIXED)
def test_link_length_is_the_slope_over_the_length(robot_name: str) -> None:
    robot, values, state, motion = case(robot_name)
    effect = make_effect("link_length")
    joints = [p.joint for p in effect.parameters(robot)]
    assert joints == [name for name in robot.joint_names[1:] if np.linalg.norm(robot.tree.translation[robot.joint_index(name)]) > 0]
    assert len(joints) == robot.n - 1
    for k, joint in enumerate(joints):
        h, ends = 1e-4, []
        for step in (h, -h):
            model = robot.model.copy()
            where = model.jointPlacements[model.getJointId(joint)].translation
            where += step * where / np.linalg.norm(where)
            ends.append(reading(robot, *state, values, model=model))
        close(column(effect, motion, robot, k), (ends[0] - ends[1]) / (2 * h), 1e-7)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("robot_name", list(ROBOTS))
def test_encoder_errors_are_slopes_over_the_reading(robot_name: str, side: Side) -> None:
    robot, values, (q, dq, ddq), motion = case(robot_name)
    T = robot.transmission
    own, direction = motion.on(side), motion.motor.direction
    n = 1.0 if side == Side.JOINT else 0.5
    kinds = {
        ("encoder_offset", 0): lambda q, dq, ddq: (q**0, 0 * q, 0 * q),
        ("encoder_scale", 0): lambda q, dq, ddq: (q, dq, ddq),
        ("encoder_eccentricity", 0): lambda q, dq, ddq: (
            np.sin(n * q),
            n * np.cos(n * q) * dq,
            n * np.cos(n * q) * ddq - n * n * np.sin(n * q) * dq**2,
        ),
    }
    for (name, k), error in kinds.items():
        effect = make_effect(name, side=side, **({"order": n} if name.endswith("ity") else {}))
        width = len(effect.parameters(robot)) // robot.n
        for j in range(robot.n):
            carries = np.eye(robot.n)[j] if side == Side.JOINT else T.K[:, j]
            e = [np.multiply.outer(x, carries) for x in error(own.q[:, j], own.dq[:, j], own.ddq[:, j])]
            h = 1e-6 / max(1.0, np.abs(e[0]).max())
            ends = [reading(robot, q - s * e[0], dq - s * e[1], ddq - s * e[2], values, direction=direction) for s in (h, -h)]
            slope = (ends[0] - ends[1]) / (2 * h)
            atol = 1e-6 * max(np.abs(slope).max(), 1e-3 * np.abs(motion.predicted).max())
            np.testing.assert_allclose(column(effect, motion, robot, width * j + k), slope, rtol=0, atol=atol)


@pytest.mark.parametrize("side", list(Side))
@pytest.mark.parametrize("robot_name", ["seven", "scara", "wrist"])
@pytest.mark.parametrize(
    ("name", "size", "shape"), [("encoder_scale", [0.04], {}), ("encoder_eccentricity", [0.02, -0.015], {"order": 2.0})]
)
def test_an_encoder_error_is_whole_where_the_reference_holds_it(
    name: str, size: list[float], shape: dict[str, float], robot_name: str, side: Side
) -> None:
    """The reading is made from the true position; a slope at the reading would miss the square of the error."""
    robot, values, (q, dq, ddq), motion = case(robot_name)
    T, model = robot.transmission, declared(robot)[0]
    effect = make_effect(name, side=side, joints="j2", **shape)
    own, carries = motion.on(side), np.eye(robot.n)[1] if side == Side.JOINT else T.K[:, 1]
    found = np.array(size) * (1.0 if side == Side.JOINT or name == "encoder_scale" else 0.5)
    errors = list(effect.errors(own.q[:, 1], own.dq[:, 1], own.ddq[:, 1]))
    seen = [x + np.outer(sum(v * e[i] for v, e in zip(found, errors, strict=True)), carries) for i, x in enumerate((q, dq, ddq))]
    there = Motion.of(robot, *seen)
    at_zero = there.with_reference(Reference(model, values))
    itself = there.with_reference(Reference(model + effect, np.append(values, found)))
    direction = there.motor.direction
    whole = reading(robot, q, dq, ddq, values, direction=direction) - reading(robot, *seen, values, direction=direction)
    off, off_at_zero = (
        float(np.abs(T.torque(effect.columns(m, robot) @ found, effect.side, T.measured) - whole).max()) for m in (itself, at_zero)
    )
    scale = float(np.abs(whole).max())
    if scale > 1e-9 * float(np.abs(motion.predicted).max()):
        assert off < 2e-3 * scale
        assert off < 0.2 * off_at_zero


def test_eccentricity_has_both_phases() -> None:
    _, _, (q, dq, ddq), _ = case("wrist")
    effect = make_effect("encoder_eccentricity", order=2.0)
    x, v, a = q[:, 0], dq[:, 0], ddq[:, 0]
    (s, ds, dds), (c, dc, ddc) = effect.errors(x, v, a)
    for value, rate, accel, phase in ((s, ds, dds, 0.0), (c, dc, ddc, np.pi / 2)):
        y = 2 * x + phase
        np.testing.assert_allclose(value, np.sin(y), atol=1e-14)
        np.testing.assert_allclose(rate, 2 * v * np.cos(y), atol=1e-13)
        np.testing.assert_allclose(accel, 2 * a * np.cos(y) - 4 * v**2 * np.sin(y), atol=1e-12)


def test_delay_is_minus_the_rate_of_the_torque() -> None:
    robot = ROBOTS["wrist"]()
    rate = 500.0
    t, *state = smooth(robot, 500, rate, seed=4)
    model, values = declared(robot)
    smooth_only = values.copy()
    smooth_only[[model.names.index(p.name) for p in Coulomb().parameters(robot)]] = 0.0
    motion = Motion.of(robot, *state, t, rate=rate).with_reference(Reference(model, smooth_only))
    # The same motion on a finer grid: smooth() is a function of time alone.
    fine = reading(robot, *smooth(robot, 10 * 499 + 1, 10 * rate, seed=4)[1:], smooth_only)
    slope = (fine[11::10] - fine[9:-10:10]) * (10 * rate) / 2.0
    columns = make_effect("delay").columns(motion, robot)
    close(columns.sum(axis=2)[2:-2], -slope[1:-1], 1e-5)
    assert np.count_nonzero(columns.any(axis=0)) == robot.n, "each column has its own row only"
    np.testing.assert_allclose(derivative(np.stack([t**3, t**4], 1), rate)[2:-2], np.stack([3 * t**2, 4 * t**3], 1)[2:-2], atol=1e-8)


def test_filter_lag_is_the_lag_of_a_first_order_low_pass() -> None:
    rate, T = 200.0, 0.05
    t = np.arange(400) / rate
    x = np.sin(7 * t) + 0.3 * np.cos(19 * t)
    tight = {"t_eval": t, "rtol": 1e-10, "atol": 1e-12}
    exact = solve_ivp(lambda s, y: (np.sin(7 * s) + 0.3 * np.cos(19 * s) - y) / T, (0, t[-1]), [x[0]], **tight).y[0]
    np.testing.assert_allclose(low_pass(x[:, None], T, rate)[:, 0], exact, atol=2e-3)
    robot, _, _, motion = case("wrist")
    lag = make_effect("filter_lag", T=0.03)
    close(column(lag, motion, robot) * 0.03, (low_pass(motion.predicted, 0.03, 50.0) - motion.predicted) * np.array([1, 0, 0]), 1e-12)


@pytest.mark.parametrize("side", list(Side))
def test_errors_of_the_torque_reading(side: Side) -> None:
    robot, _, _, motion = case("wrist")
    T = robot.transmission
    tau = T.torque(motion.predicted, T.measured, side)
    phase = motion.motor.q[:, 1] * 3.0
    columns = {
        name: make_effect(name, side=side, joints="j2", **shape).columns(motion, robot)
        for name, shape in {"torque_constant": {}, "torque_nonlinearity": {"power": 2.0}, "torque_ripple": {"order": 3.0}}.items()
    }
    np.testing.assert_allclose(columns["torque_constant"][:, 1, 0], tau[:, 1])
    np.testing.assert_allclose(columns["torque_nonlinearity"][:, 1, 0], tau[:, 1] * np.abs(tau[:, 1]))
    np.testing.assert_allclose(columns["torque_ripple"][:, 1], np.stack([tau[:, 1] * np.sin(phase), tau[:, 1] * np.cos(phase)], 1))
    for found in columns.values():
        assert not found[:, [0, 2]].any()


def test_saturation_of_the_drive_and_of_the_log() -> None:
    robot, _, state, motion = case("wrist")
    limit = float(np.quantile(np.abs(motion.predicted[:, 0]), 0.7))
    clip = lambda x: np.clip(x, -limit, limit)  # noqa: E731
    demand = motion.predicted * 1.3
    logged = Motion.of(robot, *state, torque=demand).with_reference(motion.reference)
    drive = make_effect("saturation", joints="j1", limit=limit).columns(logged, robot)
    np.testing.assert_allclose(clip(demand[:, 0]) + drive[:, 0, 0], demand[:, 0], rtol=1e-12)
    log = make_effect("saturation", joints="j1", limit=limit, clipped="log").columns(logged, robot)
    np.testing.assert_allclose(motion.predicted[:, 0] + log[:, 0, 0], clip(motion.predicted[:, 0]), rtol=1e-12)
    holes = demand.copy()
    holes[3] = np.nan
    with_holes = Motion.of(robot, *state, torque=holes).with_reference(motion.reference)
    assert np.isfinite(make_effect("saturation", limit=limit).columns(with_holes, robot)).all()


def test_a_correction_is_taken_of_the_rest_of_the_model() -> None:
    robot, values, state, _ = case("wrist")
    model, _ = declared(robot, make_effect("torque_constant"))
    motion = Motion.of(robot, *state).with_reference(Reference(model, np.append(values, [0.1, 0.2, 0.3])))
    plain = reading(robot, *state, values)
    close(motion.predicted, plain, 1e-12)
    close(model.torque(motion, np.append(values, [0.1, 0.2, 0.3])), plain * [1.1, 1.2, 1.3], 1e-12)


# Compliance: a link on a spring behind a motor whose motion is given, integrated as it is (no linearisation).


def swinging(stiffness: float, damping: float) -> tuple[Array, Array, Array, Array, Array]:
    """t, motor motion, and the torque that the motor feels of a pendulum m l behind a spring."""
    J, mgl = 0.8, 6.0
    rate, seconds = 1000.0, 3.5
    t = np.arange(int(seconds * rate)) / rate
    d = damping * 2.0 * np.sqrt(stiffness * J)

    def motor(s: Array) -> tuple[Array, Array, Array]:
        w = np.array([3.0, 7.3])[:, None]
        a = np.array([0.9, 0.15])[:, None]
        s = np.atleast_1d(s)
        return (a * np.sin(w * s)).sum(0), (a * w * np.cos(w * s)).sum(0), -(a * w**2 * np.sin(w * s)).sum(0)

    def felt(s: Array, q: Array, dq: Array) -> Array:
        x, v = q - motor(s)[0], dq - motor(s)[1]
        return -(stiffness * x + d * v)

    def rate_of(s: float, y: Array) -> list[float]:
        return [y[1], (float(felt(s, y[0], y[1])[0]) - mgl * np.sin(y[0])) / J]

    start = [0.0, motor(0.0)[1][0]]
    y = solve_ivp(rate_of, (0, t[-1]), start, t_eval=t, rtol=1e-8, atol=1e-10, max_step=2e-3).y
    return (t, *motor(t), felt(t, y[0], y[1]))


def pendulum_fit(name: str, state: tuple[Array, ...], felt: Array, **shape: float) -> tuple[float, Array, Array]:
    """Response, unexplained torque before and after, on the pendulum's reference model."""
    from effect_robots import chain

    robot = Robot.from_urdf(chain("pendulum", [("revolute", "0 0 1", "0 0 0", "0 1 0")]))
    model = robot.rigid_body()
    values = np.zeros(10)
    # About y, hanging: first moment −z with g: torque = mgl sin q; inertia about y.
    values[[0, 3, 6]] = 1.0, -6.0 / 9.81, 0.8
    t, *state = state
    motion = Motion.of(robot, *(x[:, None] for x in state), t, rate=1000.0).with_reference(Reference(model, values))
    columns = make_effect(name, **shape).columns(motion, robot)[:, 0, 0]
    missing = felt - motion.predicted[:, 0]
    keep = t > 0.5
    value = columns[keep] @ missing[keep] / (columns[keep] @ columns[keep])
    return float(value), missing[keep], missing[keep] - columns[keep] * value


def test_elasticity_is_what_a_link_on_a_spring_does() -> None:
    *state, felt = swinging(stiffness=2000.0, damping=0.05)
    value, before, after = pendulum_fit("joint_elasticity", tuple(state), felt, stiffness=2000.0, damping=0.05)
    assert abs(value - 1.0) < 0.03
    assert np.std(after) < 0.1 * np.std(before)


def test_the_spring_step_is_exact() -> None:
    w, z = 40.0, 0.1
    t = np.arange(300) / 200.0
    load = np.interp(t, t[::30], np.random.default_rng(0).normal(size=10) * 50)  # linear between samples
    start = [-load[0] / w**2, 0.0]
    tight = {"t_eval": t, "rtol": 1e-10, "atol": 1e-13, "max_step": 1e-3}
    exact = solve_ivp(lambda s, y: [y[1], -np.interp(s, t, load) - w**2 * y[0] - 2 * z * w * y[1]], (0, t[-1]), start, **tight).y
    found = responses(load, np.full(len(t), w**-2.0), np.ones(1), np.array([z]), 1 / 200.0, float(load[0]))
    x, v, a = (part[:, 0] for part in found)
    np.testing.assert_allclose(x, exact[0], atol=1e-9)
    np.testing.assert_allclose(v, exact[1], atol=1e-7)
    np.testing.assert_allclose(a, -load - w**2 * exact[0] - 2 * z * w * exact[1], atol=1e-5)


def test_springs_followed_together_move_as_each_alone() -> None:
    rng = np.random.default_rng(5)
    t = np.arange(800) / 200.0
    load = 30.0 * np.sin(9.0 * t) + np.cumsum(rng.normal(size=len(t)))
    inertia = 2.0 + 0.5 * np.sin(t)
    stiffness, damping = np.array([900.0, 4000.0, 900.0, 900.0]), np.array([0.1, 0.1, 0.4, 0.1])
    together = responses(load, inertia, stiffness, damping, 1.0 / 200.0, float(load[0]))
    for lane in range(4):
        one = slice(lane, lane + 1)
        alone = responses(load, inertia, stiffness[one], damping[one], 1.0 / 200.0, float(load[0]))
        for a, b in zip(together, alone, strict=True):
            np.testing.assert_allclose(a[:, lane], b[:, 0], rtol=1e-6, atol=1e-6 * np.abs(b).max())
