"""The inertia matrix from base values alone, its slopes, and what counts as inertia in a model."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from physical_models import puma_model, puma_truth, random_structure

from ident import friction as fr
from ident.errors import ConfigurationError
from ident.physical import InertiaStructure
from ident.physical.energy import energy_gradient, energy_rows
from ident.physical.pseudo_inertia import (
    centre_of_mass,
    displaced,
    from_centre_of_mass,
    from_pseudo_inertia,
    pseudo_inertia,
    smallest_eigenvalues,
)
from ident.robots import load_robot, nominal_values
from ident.robots.robot import Robot

Array = np.ndarray


def test_matrix_is_that_of_the_full_model() -> None:
    """H from the base values equals Pinocchio's plus the reflected rotor inertia K^-T R K^-1 of all six motors."""
    model = puma_model()
    structure, values, _ = puma_truth()
    q = np.random.default_rng(0).uniform(-3, 3, (5, 6))
    rotors = nominal_values(model)[60:66]
    inverse = model.robot.transmission.K_inverse
    own = model.robot.model.copy()
    data = own.createData()
    for x, H in zip(q, structure.inertia_matrix(values, q), strict=True):
        upper = np.triu(pin.crba(own, data, x))
        wanted = upper + np.triu(upper, 1).T + inverse.T @ np.diag(rotors) @ inverse
        assert np.allclose(H, wanted, rtol=1e-11, atol=1e-11)
    assert len(values) == 52
    assert structure.names[60] == "Ia_joint1"
    assert structure.body_names == ("link1", "link2", "link3", "link4", "link5", "link6")
    assert not structure.relevant[0]
    assert structure.relevant[1:].all()


@pytest.mark.parametrize("kind", [{}, {"chain": False, "coupled": True}, {"floating": True}, {"right": False, "prismatic": 0.5}])
def test_rows_and_slopes(kind: dict[str, object]) -> None:
    rng = np.random.default_rng(3)
    structure, full = random_structure(rng, 5, **kind)  # type: ignore[arg-type]
    values = structure.regroup @ full
    q = rng.uniform(-0.4, 0.6, (4, structure.n))
    v = rng.standard_normal((4, structure.nv))
    H = structure.inertia_matrix(values, q)
    energy = np.einsum("Ni,Nij,Nj->N", v, H, v)
    assert np.allclose(structure.quadratic_rows(q, v) @ values, energy, rtol=1e-9)
    assert np.allclose(np.tensordot(values, structure.parameter_matrices(q[0]), 1), H[0], rtol=1e-8, atol=1e-8 * np.abs(H[0]).max())
    slope = structure.position_gradient(values, q, v)
    step = 1e-6
    for j in range(structure.n):
        d = np.eye(structure.n)[j] * step
        ends = [np.einsum("Ni,Nij,Nj->N", v, structure.inertia_matrix(values, q + s * d), v) for s in (1, -1)]
        assert np.allclose((ends[0] - ends[1]) / (2 * step), slope[:, j], atol=1e-6 * np.abs(energy).max())


def test_energy_is_linear_in_the_links() -> None:
    structure, _, links = puma_truth()
    rng = np.random.default_rng(1)
    q, v = rng.uniform(-3, 3, (6, 6)), rng.standard_normal((6, 6))
    rows = energy_rows(structure.tree, q, v)
    assert rows.shape == (6, 60)
    from ident.regressor.rigid import mass_matrix

    assert np.allclose(rows @ links, np.einsum("Ni,Nij,Nj->N", v, mass_matrix(structure.tree, links, q), v), rtol=1e-12)
    assert energy_gradient(structure.tree, links, q, v)[:, 0] == pytest.approx(0, abs=1e-12)


def test_loop_closure() -> None:
    """Under a loop H is W' M W, and a dependent joint's parameters count."""
    robot = load_robot("palletiser")
    model = robot.rigid_body() + fr.RotorInertia()
    structure = InertiaStructure.from_model(model, model.base)
    values = nominal_values(model)
    values[10 * len(robot.tree_joints) :] = 1e-4
    q = np.random.default_rng(0).uniform(-0.5, 0.5, (3, robot.n))
    assert structure.has_loop
    wanted = model.joint_inertia(q, values)
    assert np.allclose(structure.inertia_matrix(model.base.base_values(values), q), wanted, rtol=1e-9, atol=1e-10)


def test_steep_regrouping_keeps_digits() -> None:
    """Nearly parallel axes make coefficients of 1e5: the inverse of least size is used, and the null space stays a null space."""
    rng = np.random.default_rng(0)
    regroup = np.concatenate([np.eye(10), np.full((10, 10), 0.0)], axis=1)
    regroup[2, 12] = 3e5
    from ident.robots.tree import RigidBodyTree

    tree = RigidBodyTree(
        np.array([-1, 0]), np.repeat(np.eye(3)[None], 2, 0), rng.uniform(0.1, 0.3, (2, 3)), np.array([[0, 0, 1.0], [1.0, 0, 0]]),
        np.zeros(2, bool), np.array([0, 0, -9.81]), False,
    )  # fmt: skip
    structure = InertiaStructure.from_arrays(tree, regroup)
    assert np.allclose(regroup @ structure.lift, np.eye(10), atol=1e-9)
    assert np.abs(regroup @ structure.null_space).max() < 1e-9
    assert np.abs(structure.lift).max() < 10
    assert structure.lift[0, 0] == 1.0
    assert not structure.null_space[0].any()


def test_effects_that_are_no_constant_inertia_are_left_out() -> None:
    robot = load_robot("puma560")
    model = robot.rigid_body() + fr.RotorInertia() + fr.Viscous() + fr.LoadDependentFriction()
    structure = InertiaStructure.from_model(model, model.base)
    assert len(structure.drive) == 6
    assert {structure.names[i][:2] for i in structure.nonnegative} >= {"Fv"}


def test_errors() -> None:
    structure, values, _ = puma_truth()
    with pytest.raises(ConfigurationError, match="52 finite base parameters"):
        structure.check_values(values[:-1])
    with pytest.raises(ConfigurationError, match="dependent"):
        InertiaStructure.from_arrays(structure.tree, np.ones((2, 60)))
    with pytest.raises(ConfigurationError, match="does not fit"):
        InertiaStructure.from_arrays(structure.tree, structure.regroup, inertial=np.arange(50))
    robot = load_robot("puma560")
    from ident.model import Model

    model = Model(robot, (fr.Viscous(),))
    with pytest.raises(ConfigurationError, match="no rigid body"):
        InertiaStructure.from_model(model, model.base)


def test_prismatic_ranges_are_said() -> None:
    ball = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    urdf = f"""<robot name="p"><link name="w"/><link name="a"><inertial>{ball}
    <link name="b"><inertial><origin xyz="0.1 0 0"/>{ball}
    <joint name="turn" type="continuous"><parent link="w"/><child link="a"/><axis xyz="0 0 1"/></joint>
    <joint name="slide" type="prismatic"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/></joint></robot>"""
    model = Robot.from_urdf(urdf).rigid_body()
    structure = InertiaStructure.from_model(model, model.base)
    lower, upper, notes = structure.ranges(False)
    assert lower[1] == -1
    assert upper[1] == 1
    assert "slide" in notes[0]


def test_pseudo_inertia_maps() -> None:
    rng = np.random.default_rng(5)
    points, masses = rng.standard_normal((20, 3)), rng.uniform(0.1, 1, 20)
    parameters = sum((from_centre_of_mass(m, x, np.zeros((3, 3))) for m, x in zip(masses, points, strict=True)), np.zeros(10))
    homogeneous = np.concatenate([points, np.ones((20, 1))], axis=1)
    assert np.allclose(pseudo_inertia(parameters), np.einsum("k,ki,kj->ij", masses, homogeneous, homogeneous))
    assert np.allclose(from_pseudo_inertia(pseudo_inertia(parameters)), parameters)
    assert smallest_eigenvalues(parameters)[0] > 0
    mass, com, inertia = centre_of_mass(parameters)
    assert np.allclose(from_centre_of_mass(mass, com, inertia), parameters)
    R, p = pin.rpy.rpyToMatrix(0.3, -0.7, 1.1), np.array([0.1, 0.2, -0.3])
    moved = pin.SE3(R, p).act(pin.Inertia.FromDynamicParameters(parameters)).toDynamicParameters()
    assert np.allclose(displaced(parameters, R, p), moved)
    with pytest.raises(ZeroDivisionError):
        centre_of_mass(np.zeros(10))
