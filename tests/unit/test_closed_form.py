"""Closed forms: published counts and names, frames however the URDF puts them, and refusals that say why."""

from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import shared_data
from structures import JointSpec, compare_row_spaces, mixed_robot, random_tree, rotation, sampled_regressor, urdf_text

from ident.errors import UnsupportedError
from ident.regressor.base_parameters.closed_form import mixed, oblique, parallelogram, rotational
from ident.robots import load_robot, published_tables
from ident.robots.robot import Robot

HALF = np.pi / 2


def joint(parent: int, angle: float = 0.0, at: tuple[float, float, float] = (0, 0, 0), prismatic: bool = False) -> JointSpec:
    return JointSpec(parent, prismatic, rotation([1, 0, 0], angle), np.array(at, float), np.array([0.0, 0.0, 1.0]))


def chain(*joints: tuple[float, tuple[float, float, float], bool], gravity: tuple[float, float, float] = (0, 0, -9.81)) -> Robot:
    specs = [joint(i - 1, angle, at, prismatic) for i, (angle, at, prismatic) in enumerate(joints)]
    return Robot.from_urdf(urdf_text(specs), gravity=gravity)


def test_puma_has_the_published_36_parameters_by_name() -> None:
    form = rotational(load_robot("puma560"))
    assert form.count == 36
    assert form.count_formula == "7N - 4 beta_1 - 2Q = 7*6 - 4*1 - 2*1 = 36"
    assert set(form.names) == {name for name in published_tables("puma560")["1"].values if name[0] in "JR"}


def test_puma_links_give_the_known_base_values() -> None:
    """Links and base values of the same consistent robot, worked out independently of this code, term by term."""
    known = json.loads((shared_data() / "puma560" / "consistent_near_table1.json").read_text())
    robot = load_robot("puma560")
    form = rotational(robot)
    values = dict(zip(form.names, form.values(robot.nominal), strict=True))
    reflected = {f"J{i}z": known[f"h{i}"] / robot.transmission.K[i - 1, i - 1] ** 2 for i in (1, 2)}
    for name, value in values.items():
        assert value + reflected.get(name, 0.0) == pytest.approx(known["base_and_drive"][name], abs=1e-9), name


def test_turning_axes_round_changes_nothing() -> None:
    """-90 deg, 180 deg and reversed axes are the same structure in other frames."""
    one = chain((0, (0, 0, 0.3), False), (HALF, (0.1, 0, 0), False), (0, (0.4, 0, 0), False), (HALF, (0, 0, 0.2), False))
    other = chain((0, (0, 0, 0.3), False), (-HALF, (0.1, 0, 0), False), (np.pi, (0.4, 0, 0), False), (-HALF, (0, 0, 0.2), False))
    assert rotational(one).count == rotational(other).count == 7 * 4 - 4 - 2
    for robot in (one, other):
        form = rotational(robot)
        found = compare_row_spaces(form.matrix, sampled_regressor(robot))
        assert found.rank == form.count
        assert max(found.form_outside, found.sampled_outside) < 1e-9


@pytest.mark.parametrize(
    ("lengths", "hidden"),
    [((0.3, 0.2), 1), ((0.0, 0.2), 2), ((0.0, 0.0), 3)],
    ids=["offset at once", "first axes coincide", "all coincide"],
)
def test_hidden_moments_of_vertical_axes(lengths: tuple[float, float], hidden: int) -> None:
    """Vertical axes: R_x, R_y stay hidden up to the first horizontal offset, of all links if there is none."""
    robot = chain((0, (0, 0, 0), False), (0, (lengths[0], 0, 0), False), (0, (lengths[1], 0, 0), False))
    form = rotational(robot)
    assert form.count == 7 * 3 - 4 * 3 - 2 * hidden
    assert compare_row_spaces(form.matrix, sampled_regressor(robot)).rank == form.count


def test_scara_and_cartesian() -> None:
    assert mixed(load_robot("scara")).count == 8
    cartesian = chain((0, (0, 0, 0), True), (HALF, (0, 0, 0.1), True), (1.0, (0, 0.2, 0), True))
    form = mixed(cartesian)
    assert form.names == ("M0,1", "M0,2", "M0,3")
    assert form.expressions[0] == "m_joint1 + m_joint2 + m_joint3"


def test_mixed_equals_rotational_without_prismatic_joints() -> None:
    robot = load_robot("puma560")
    one, other = rotational(robot), mixed(robot)
    assert set(one.names) == set(other.names)
    rows = dict(zip(other.names, other.matrix, strict=True))
    assert all(np.allclose(row, rows[name], atol=1e-12) for name, row in zip(one.names, one.matrix, strict=True))


def five_bar(vertical: bool, tail: int = 0) -> Robot:
    """Planar parallelogram of two cranks on one axis; `tail` more joints make an arm of it."""
    turn = 0.0 if vertical else HALF
    specs = [joint(-1)] if tail else []
    base = len(specs) - 1
    specs += [joint(base, turn if not tail else HALF), joint(base + 1, 0, (0.5, 0, 0))]
    for k in range(tail):
        specs.append(joint(len(specs) - 1, HALF if k % 2 == 0 else -HALF, (0.1, 0, 0.05)))
    crank = len(specs)
    specs += [joint(base, turn if not tail else HALF, (0, 0, 0)), joint(crank, 0, (0, -0.3, 0))]
    first, second, third, fourth = (f"joint{i + 1}" for i in (base + 1, base + 2, crank, crank + 1))
    loop = {second: {third: 1.0, first: -1.0, "offset": 0.4}, fourth: {first: 1.0, third: -1.0}}
    return Robot.from_urdf(urdf_text(specs), loop=loop)


@pytest.mark.parametrize(("vertical", "count"), [(False, 8), (True, 4)])
def test_planar_five_bar(vertical: bool, count: int) -> None:
    robot = five_bar(vertical)
    form = parallelogram(robot)
    found = compare_row_spaces(form.matrix, sampled_regressor(robot))
    assert form.count == found.rank == count
    assert max(found.form_outside, found.sampled_outside) < 1e-9


def test_industrial_arm_with_parallelogram_has_39() -> None:
    robot = five_bar(vertical=False, tail=3)
    assert robot.n == 6
    form = parallelogram(robot)
    assert form.count == 39
    assert compare_row_spaces(form.matrix, sampled_regressor(robot)).rank == 39


def test_palletiser() -> None:
    robot = load_robot("palletiser")
    form = parallelogram(robot)
    found = compare_row_spaces(form.matrix, sampled_regressor(robot))
    assert form.count == found.rank == 32
    assert max(found.form_outside, found.sampled_outside) < 1e-9


def test_independent_joints_may_be_any_two_of_the_parallelogram() -> None:
    """The same arm declared with the forearm's own joint driven instead of the crank: the same base parameters."""
    robot = load_robot("palletiser")
    urdf = robot.source["urdf"]
    other = Robot.from_urdf(urdf, loop={"joint2": {"joint3": 1.0, "elbow": 1.0}, "rod": {"elbow": -1.0}})
    one, two = parallelogram(robot), parallelogram(other)
    assert np.allclose(one.matrix, two.matrix, atol=1e-12)


REFUSED = {
    "rotational: prismatic": (rotational, lambda: load_robot("scara"), "joint3.*prismatic.*mixed"),
    "rotational: oblique": (
        rotational,
        lambda: chain((0, (0, 0, 0), False), (0.5, (0.1, 0, 0), False)),
        "joint1.*joint2.*28.6479 deg.*oblique",
    ),
    "rotational: loop": (rotational, lambda: load_robot("palletiser"), "dependent joints.*parallelogram"),
    "mixed: oblique": (mixed, lambda: chain((0, (0, 0, 0), False), (0.5, (0.1, 0, 0), False)), "neither parallel nor perpendicular"),
    "no gravity": (rotational, lambda: chain((0, (0, 0, 0), False), gravity=(0, 0, 0)), "no gravity"),
    "floating": (
        rotational,
        lambda: Robot.from_urdf(urdf_text([joint(-1)]), floating_base=True),
        "floats",
    ),
    "branch": (
        mixed,
        lambda: Robot.from_urdf(urdf_text([joint(-1), joint(0), joint(0, HALF)])),
        "joint3.*does not follow.*joint2",
    ),
    "nearly parallel": (oblique, lambda: chain((0, (0, 0, 0), False), (1e-4, (0.1, 0, 0), False)), "1.0e-04 rad from parallel"),
    "parallelogram: open": (parallelogram, lambda: load_robot("puma560"), "no loop is declared.*rotational"),
    "parallelogram: mimic gripper": (
        parallelogram,
        lambda: Robot.from_urdf(urdf_text([joint(-1), joint(0), joint(0, HALF)]), loop={"joint3": {"joint2": 1.0}}),
        "crank",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_say_why_and_what_to_use(case: str) -> None:
    function, build, text = REFUSED[case]
    with pytest.raises(UnsupportedError, match=text) as refusal:
        function(build())
    assert "ident.regressor.base_parameters.structural.base_set" in str(refusal.value)
    assert refusal.value.exit_code == 2


def test_wrong_loop_of_a_parallelogram_is_refused() -> None:
    urdf = load_robot("palletiser").source["urdf"]
    with pytest.raises(UnsupportedError, match="'elbow' does not stay parallel"):
        parallelogram(Robot.from_urdf(urdf, loop={"elbow": {"joint2": 1.0}, "rod": {"joint3": 1.0, "joint2": -1.0}}))


def test_parallelogram_with_cranks_apart_is_refused() -> None:
    specs = [joint(-1, HALF), joint(0, 0, (0.5, 0, 0)), joint(-1, HALF, (0.2, 0, 0)), joint(2, 0, (0.3, 0, 0))]
    loop = {"joint2": {"joint3": 1.0, "joint1": -1.0}, "joint4": {"joint1": 1.0, "joint3": -1.0}}
    with pytest.raises(UnsupportedError, match="do not coincide"):
        parallelogram(Robot.from_urdf(urdf_text(specs), loop=loop))


def test_lift_is_a_right_inverse() -> None:
    form = mixed(mixed_robot(np.random.default_rng(5), 5))
    assert np.allclose(form.matrix @ form.lift[: form.matrix.shape[1]], np.eye(form.count), atol=1e-9)


def test_random_tree_is_refused_or_right() -> None:
    """Whatever the structure: a closed form either refuses it or spans the right space."""
    covered = 0
    for seed in range(40):
        rng = np.random.default_rng(seed)
        robot = Robot.from_urdf(urdf_text(random_tree(rng, int(rng.integers(1, 6)), right=0.9, branch=0.1)))
        for function in (rotational, mixed, oblique, parallelogram):
            try:
                form = function(robot)
            except UnsupportedError:
                continue
            covered += 1
            found = compare_row_spaces(form.matrix, sampled_regressor(robot))
            assert found.rank == form.count, (seed, form.method)
            assert max(found.form_outside, found.sampled_outside) < 1e-9, (seed, form.method)
    assert covered > 20
