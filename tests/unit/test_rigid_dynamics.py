"""Rigid-body dynamics against Pinocchio, by every kernel there is; refusals."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from rigid_models import difference, kernels, oracle, parameters, random_model, states, tree_of, using

import ident
from ident.errors import ConfigurationError, DataError
from ident.regressor import rigid
from ident.robots.robot import Robot

TIGHT = 1e-12


@pytest.fixture(scope="module")
def puma():
    return ident.load_robot("puma560")


@pytest.mark.parametrize("name", kernels())
@pytest.mark.parametrize("floating", [False, True])
def test_equals_pinocchio(name, floating):
    rng = np.random.default_rng(3)
    model = random_model(rng, 9, floating)
    tree, inertia = tree_of(model), parameters(model)
    q, dq, ddq = states(model, rng, 37)  # no multiple of any number of lanes
    wanted = oracle(model, q, dq, ddq)
    zero = np.zeros((model.nv, model.nv))
    with using(name) as kernel:
        assert difference(kernel.dynamics.regressor(tree, q, dq, ddq), wanted["regressor"]) < TIGHT
        assert difference(kernel.dynamics.inverse_dynamics(tree, inertia, q, dq, ddq), wanted["inverse"]) < TIGHT
        assert difference(kernel.dynamics.bias_torque(tree, inertia, q, dq), wanted["bias"]) < TIGHT
        assert difference(kernel.dynamics.mass_matrix(tree, inertia, q), wanted["mass"]) < TIGHT
        found = kernel.dynamics.forward_dynamics(tree, inertia, q, dq, wanted["inverse"], zero)
    assert difference(found, ddq) < 1e-14 * np.linalg.cond(wanted["mass"]).max()


@pytest.mark.parametrize("name", kernels())
def test_robots_of_example_robot_data(name):
    """One URDF arm of each make that the package ships, if it is there."""
    root = _example_robot_data()
    paths = ["panda_description/urdf/panda.urdf", "ur_description/urdf/ur5_robot.urdf", "talos_data/robots/talos_reduced.urdf"]
    for path in paths:
        model = pin.buildModelFromUrdf(str(root / path))
        _compare(name, model)


@pytest.mark.slow
@pytest.mark.parametrize("floating", [False, True], ids=["fixed", "floating"])
@pytest.mark.parametrize("name", kernels())
def test_every_urdf_of_example_robot_data(name, floating):
    """All robots that the package ships, arms, grippers, legs and humanoids, on a fixed base and on a free-flyer."""
    root = _example_robot_data()
    names, refused = [], []
    for path in sorted(root.rglob("*.urdf")):
        try:
            robot = Robot.from_urdf(path, floating_base=floating)
        except ConfigurationError as error:  # drones without a joint, and a file that only includes others
            refused.append(str(error))
            continue
        names.append(path.name)
        _compare(name, robot.model, robot.tree)
    assert len(names) > 40, names
    assert all("no moving joint" in text or "there is no <link>" in text for text in refused), refused


def _example_robot_data():
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        files = distribution("example-robot-data").files or []
    except PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")
    found = [f for f in files if str(f).endswith("panda_description/urdf/panda.urdf")]
    if not found:
        pytest.skip("example-robot-data holds no panda.urdf")
    return found[0].locate().resolve().parents[2]


def _compare(name, model, tree=None):
    rng = np.random.default_rng(5)
    model = _bounded(model) if tree is None else model
    q, dq, ddq = states(model, rng, 5)
    wanted = oracle(model, q, dq, ddq)
    inertia = parameters(model)
    with using(name) as kernel:
        tree = tree_of(model) if tree is None else tree
        assert difference(kernel.dynamics.regressor(tree, q, dq, ddq), wanted["regressor"]) < TIGHT
        assert difference(kernel.dynamics.inverse_dynamics(tree, inertia, q, dq, ddq), wanted["inverse"]) < TIGHT
        assert difference(kernel.dynamics.mass_matrix(tree, inertia, q), wanted["mass"]) < TIGHT


def _bounded(model):
    """Continuous joints locked: their two coordinates are not this kernel's."""
    locked = [i for i in range(1, model.njoints) if model.joints[i].nq != 1]
    model = pin.buildReducedModel(model, locked, pin.neutral(model)) if locked else model
    model.armature[:] = 0.0
    return model


@pytest.mark.parametrize("name", kernels())
def test_branches_in_any_order(name):
    """Parents before children is all that is asked: the mass matrix by inverse dynamics is the oracle (Pinocchio wants depth first)."""
    rng = np.random.default_rng(8)
    model = pin.Model()
    ids = [0]
    for k in range(7):
        ids.append(model.addJoint(ids[rng.integers(len(ids))], pin.JointModelRX(), pin.SE3.Random(), f"j{k}"))
    tree, inertia = tree_of(model), rng.normal(size=70)
    q = rng.normal(size=(3, 7))
    zero = np.zeros_like(q)
    with using(name) as kernel:
        bias = kernel.dynamics.bias_torque(tree, inertia, q, zero)
        columns = [kernel.dynamics.inverse_dynamics(tree, inertia, q, zero, np.tile(e, (3, 1))) - bias for e in np.eye(7)]
        assert difference(kernel.dynamics.mass_matrix(tree, inertia, q), np.stack(columns, axis=2)) < TIGHT


@pytest.mark.parametrize("name", kernels())
def test_parameters_need_not_be_physical(name, puma):
    """Base values expanded to all parameters have first moments without mass; the torque is linear all the same."""
    rng = np.random.default_rng(1)
    tree = puma.tree
    inertia = rng.normal(size=60) * (rng.random(60) < 0.7)
    inertia[0::10] = 0.0
    q, dq, ddq = states(puma.model, rng, 20)
    with using(name) as kernel:
        tau = kernel.dynamics.inverse_dynamics(tree, inertia, q, dq, ddq)
        assert difference(tau, kernel.dynamics.regressor(tree, q, dq, ddq) @ inertia) < TIGHT
        mass = kernel.dynamics.mass_matrix(tree, inertia, q)
        assert np.array_equal(mass, np.swapaxes(mass, 1, 2))
        acceleration = kernel.dynamics.forward_dynamics(tree, inertia, q, dq, tau, np.zeros((6, 6)))  # indefinite: LU with pivoting
    assert np.abs(acceleration - ddq).max() < 1e-13 * np.linalg.cond(mass).max() * np.abs(ddq).max()


@pytest.mark.parametrize("name", kernels())
def test_added_inertia(name, puma):
    rng = np.random.default_rng(2)
    tree, inertia = puma.tree, puma.nominal
    K_inverse = puma.transmission.K_inverse
    added = K_inverse.T @ np.diag(rng.uniform(1e-4, 3e-4, 6)) @ K_inverse
    q, dq, tau = rng.normal(size=(3, 50, 6))
    with using(name) as kernel:
        ddq = kernel.dynamics.forward_dynamics(tree, inertia, q, dq, tau, added)
        back = kernel.dynamics.inverse_dynamics(tree, inertia, q, dq, ddq) + ddq @ added
    assert np.abs(back - tau).max() < 1e-11


@pytest.mark.parametrize("name", kernels())
def test_fixed_dynamics_for_integrators(name, puma):
    rng = np.random.default_rng(2)
    added = np.diag(rng.uniform(0.1, 1, 6))
    q, dq, tau = rng.normal(size=(3, 9, 6))
    with using(name) as kernel:
        wanted = kernel.dynamics.forward_dynamics(puma.tree, puma.nominal, q, dq, tau, added)
        fixed = kernel.dynamics.fixed_dynamics(puma.tree, puma.nominal, added)
        assert difference(fixed.forward(q, dq, tau), wanted) < 1e-13
        single = fixed.forward(q[4], dq[4], tau[4])
        assert single.shape == (6,)
        assert difference(single, wanted[4]) < 1e-13
        assert difference(fixed.forward(q[4], dq[4].astype(np.float32).astype(float), tau[::1][4]), single) < 1e-6
        assert np.array_equal(fixed.forward(np.asfortranarray(q)[:, :], dq, tau), fixed.forward(q, dq, tau))
        for some in (slice(None), 3):
            mass, bias = fixed.terms(q[some], dq[some])
            assert difference(mass, kernel.dynamics.mass_matrix(puma.tree, puma.nominal, q)[some]) < 1e-14
            assert difference(bias, kernel.dynamics.bias_torque(puma.tree, puma.nominal, q, dq)[some]) < 1e-13
        with pytest.raises(DataError, match="not finite"):
            fixed.forward(np.full(6, np.nan), dq[0], tau[0])
        with pytest.raises(ConfigurationError, match="expected shape"):
            fixed.forward(q[0, :5], dq[0], tau[0])


@pytest.mark.parametrize("name", kernels())
def test_large_angles(name):
    """Sine and cosine stay exact far from zero, where the argument's reduction matters, and beyond it."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "j")
    tree = tree_of(model)
    q = np.concatenate([np.linspace(-20, 20, 4001), np.arange(-400, 400) * np.pi / 4, 10.0 ** np.arange(-12, 13), [1e5, -99999.9, 1e300]])[
        :, None
    ]
    inertia = np.zeros(10)
    inertia[2:4] = 1.0, 0.5
    with using(name) as kernel:
        tau = kernel.dynamics.inverse_dynamics(tree, inertia, q, 0 * q, 0 * q)[:, 0]
    assert np.abs(tau - 9.81 * (np.cos(q) - 0.5 * np.sin(q))[:, 0]).max() < 9.81 * 4e-16


@pytest.mark.parametrize("name", kernels())
def test_few_samples(name, puma):
    with using(name) as kernel:
        for n in (0, 1, 2, 7, 8, 9):
            q = np.random.default_rng(n).normal(size=(n, 6))
            assert kernel.dynamics.regressor(puma.tree, q, q, q).shape == (n, 6, 60)
            assert kernel.dynamics.mass_matrix(puma.tree, puma.nominal, q).shape == (n, 6, 6)
            assert kernel.dynamics.forward_dynamics(puma.tree, puma.nominal, q, q, q, np.eye(6)).shape == (n, 6)


@pytest.mark.parametrize("name", kernels())
def test_singular_mass_matrix_is_named(name):
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "j")
    q = np.zeros((5, 1))
    with using(name) as kernel, pytest.raises(DataError, match="singular at sample 0"):
        kernel.dynamics.forward_dynamics(tree_of(model), np.zeros(10), q, q, q, np.zeros((1, 1)))


def test_input_that_is_not_finite_is_refused(puma):
    q = np.zeros((4, 6))
    bad = q.copy()
    bad[2, 3] = np.inf
    with pytest.raises(DataError, match=r"dq: 1 value\(s\) are not finite, the first at \[2, 3\]"):
        rigid.regressor(puma.tree, q, bad, q)
    with pytest.raises(DataError, match="q: 1"):
        rigid.mass_matrix(puma.tree, puma.nominal, bad)
    with pytest.raises(DataError, match="tau"):
        rigid.forward_dynamics(puma.tree, puma.nominal, q, q, bad)
    with pytest.raises(DataError, match="inertia"):
        rigid.bias_torque(puma.tree, np.full(60, np.nan), q, q)


def test_wrong_shapes_say_expected_and_given(puma):
    q = np.zeros((4, 6))
    with pytest.raises(ConfigurationError, match=r"q: expected shape \(N, 6\).*\(4, 5\)"):
        rigid.regressor(puma.tree, q[:, :5], q, q)
    with pytest.raises(ConfigurationError, match=r"ddq: expected shape \(4, 6\).*\(3, 6\)"):
        rigid.regressor(puma.tree, q, q, q[:3])
    with pytest.raises(ConfigurationError, match=r"inertia: expected shape \(60,\)"):
        rigid.mass_matrix(puma.tree, np.zeros(50), q)
    with pytest.raises(ConfigurationError, match=r"added: expected shape \(6, 6\)"):
        rigid.forward_dynamics(puma.tree, puma.nominal, q, q, q, np.zeros(6))
    with pytest.raises(ConfigurationError, match="symmetric"):
        rigid.forward_dynamics(puma.tree, puma.nominal, q, q, q, np.triu(np.ones((6, 6))))


def test_lists_integers_and_strides_are_taken(puma):
    rng = np.random.default_rng(0)
    wide = rng.normal(size=(5, 12))
    q = wide[:, ::2]
    wanted = rigid.regressor(puma.tree, q.copy(), q.copy(), q.copy())
    assert np.array_equal(rigid.regressor(puma.tree, q, q, q.tolist()), wanted)
    whole = np.ones((2, 6), int)
    assert np.array_equal(rigid.regressor(puma.tree, whole, whole, whole), rigid.regressor(puma.tree, *(np.ones((2, 6)),) * 3))


def test_quaternion_must_be_one(puma):
    rng = np.random.default_rng(0)
    model = random_model(rng, 2, True)
    q, dq, ddq = states(model, rng, 3)
    q[1, 3:7] *= 2
    with pytest.raises(DataError, match=r"quaternion.*sample 1 has length 2"):
        rigid.regressor(tree_of(model), q, dq, ddq)
