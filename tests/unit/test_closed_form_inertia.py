"""H(q) from base parameters alone, against Pinocchio's composite rigid body algorithm on the full parameters."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from structures import mixed_robot, parallelogram_robot, random_tree, rotational_robot, urdf_text

from ident.errors import ConfigurationError
from ident.regressor.base_parameters.base_form import BaseForm
from ident.regressor.base_parameters.closed_form import inertia_matrix, mixed, oblique, parallelogram, rotational
from ident.regressor.base_parameters.structural import base_set
from ident.robots import load_robot
from ident.robots.robot import Robot

Array = np.ndarray


def crba(robot: Robot, links: Array, rotor: Array, q: Array) -> Array:
    """H of the whole robot at one position, from all parameters."""
    model = robot.model.copy()
    for body in range(robot.tree.nb):
        model.inertias[body + 1] = pin.Inertia.FromDynamicParameters(links[10 * body : 10 * body + 10])
    free = 6 * robot.floating_base
    position = np.r_[[0, 0, 0, 0, 0, 0, 1] if free else [], robot.tree_position(q)]
    H = np.triu(pin.crba(model, model.createData(), position))
    H = H + np.triu(H, 1).T
    W = np.zeros((len(H), free + robot.n))
    W[:free, :free], W[free:, free:] = np.eye(free), robot.loop.W
    H = W.T @ H @ W
    k = robot.transmission.K_inverse
    H[free:, free:] += k.T @ np.diag(rotor) @ k
    return H


def tree(rng: np.random.Generator, size: int, **keywords) -> Robot:
    return Robot.from_urdf(urdf_text(random_tree(rng, size)), transmission=rng.uniform(10, 100, size), **keywords)


CASES: dict[str, tuple[Callable[..., Robot], Callable[[Robot], BaseForm]]] = {
    "rotational": (rotational_robot, rotational),
    "oblique": (rotational_robot, oblique),
    "mixed": (mixed_robot, mixed),
    "parallelogram": (parallelogram_robot, parallelogram),
    "tree with rotors": (tree, lambda robot: base_set(robot, True)),
    "floating base": (lambda rng, size: tree(rng, size, floating_base=True), lambda robot: base_set(robot, True)),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("seed", range(6))
def test_inertia_matrix_equals_crba(case: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    build, find = CASES[case]
    robot = build(rng, int(rng.integers(2, 8)))
    form = find(robot)
    links = np.concatenate([pin.Inertia.Random().toDynamicParameters() for _ in range(robot.tree.nb)])
    rotor = rng.uniform(1e-4, 1e-3, robot.n) * form.rotor_matrix.any()
    q = rng.uniform(-2, 2, (4, robot.n))
    H = inertia_matrix(form, form.values(links, rotor), q)
    expected = np.array([crba(robot, links, rotor, at) for at in q])
    assert np.abs(H - expected).max() < 1e-10 * np.abs(expected).max()


def test_inertia_matrix_of_the_palletiser_with_rotors() -> None:
    robot = load_robot("palletiser")
    form = base_set(robot, True)
    rotor = np.array([0.0016, 0.0014, 0.0016, 0.0003, 0.0002])
    q = np.random.default_rng(0).uniform(-1, 1, (3, robot.n))
    H = inertia_matrix(form, form.values(robot.nominal, rotor), q)
    assert np.abs(H - np.array([crba(robot, robot.nominal, rotor, at) for at in q])).max() < 1e-11 * np.abs(H).max()
    assert np.linalg.eigvalsh(H).min() > 0


def test_inertia_matrix_refuses_wrong_shapes() -> None:
    form = base_set(load_robot("scara"))
    with pytest.raises(ConfigurationError, match="8 base parameters"):
        inertia_matrix(form, np.zeros(7), np.zeros((1, 4)))
    with pytest.raises(ConfigurationError, match="joint1, joint2, joint3, joint4"):
        inertia_matrix(form, np.zeros(8), np.zeros((1, 3)))
