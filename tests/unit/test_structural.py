"""The structural set: rotor inertia through K, loops, floating bases, published sets, near-degenerate geometry, speed."""

from __future__ import annotations

import csv
import json
import re
import time
from importlib.metadata import PackageNotFoundError, distribution

import numpy as np
import pytest
from conftest import shared_data
from structures import JointSpec, compare_row_spaces, random_tree, rotation, rotational_robot, sampled_regressor, urdf_text

from ident.errors import ConfigurationError
from ident.regressor.base_parameters.closed_form import rotational
from ident.regressor.base_parameters.structural import base_set
from ident.robots import load_robot
from ident.robots.robot import Robot

Array = np.ndarray


def agrees(robot: Robot, rotors: bool = False) -> int:
    """Count of the structural set, after comparing its space with a sampled regressor."""
    found = base_set(robot, rotors)
    compared = compare_row_spaces(found.full if rotors else found.matrix, sampled_regressor(robot, rotors))
    assert compared.rank == found.count, compared
    assert max(compared.form_outside, compared.sampled_outside) < 1e-9, compared
    return found.count


def joint(parent: int, turn: Array | None = None, at: tuple[float, ...] = (0, 0, 0), prismatic: bool = False) -> JointSpec:
    return JointSpec(parent, prismatic, np.eye(3) if turn is None else turn, np.array(at, float), np.array([0.0, 0.0, 1.0]))


def test_puma_with_coupled_drive() -> None:
    """36 of the links and 4 of 6 rotor inertias: h1 merges with J1z and h2 with J2z, also behind the coupled wrist."""
    robot = load_robot("puma560")
    assert not robot.transmission.is_diagonal
    assert agrees(robot) == 36
    assert agrees(robot, rotors=True) == 40
    found = base_set(robot, True)
    assert found.names[-4:] == ("Ia_joint3", "Ia_joint4", "Ia_joint5", "Ia_joint6")
    rows = dict(zip(found.names, found.rotor_matrix, strict=True))
    k1, k2 = robot.transmission.K[0, 0], robot.transmission.K[1, 1]
    assert rows["Izz_joint1"][0] == pytest.approx(k1**-2)
    assert rows["Izz_joint2"][1] == pytest.approx(k2**-2)


@pytest.mark.parametrize("seed", range(12))
def test_in_a_revolute_chain_h1_and_h_alpha2_merge(seed: int) -> None:
    """Diagonal gears: exactly the rotors of joint 1 and of the first joint of the second cluster merge with links."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    robot = rotational_robot(rng, count)
    beta = int(re.search(r"4\*(\d+)", rotational(robot).count_formula)[1])
    merged = {1} | ({beta + 1} if beta < count else set())
    found = base_set(robot, True)
    free = {name for name in found.names if name.startswith("Ia_")}
    assert free == {f"Ia_joint{i}" for i in range(1, count + 1) if i not in merged}
    assert agrees(robot, rotors=True) == found.count


def test_rotors_of_some_joints_only() -> None:
    robot = load_robot("puma560")
    found = base_set(robot, ["joint3", "joint1"])
    assert found.count == 37
    assert found.names[-1] == "Ia_joint3"
    assert not found.rotor_matrix[:, [1, 3, 4, 5]].any()
    with pytest.raises(ConfigurationError, match="joint3"):
        base_set(robot, ["joint33"])


def test_tx40_gives_the_published_set() -> None:
    """Row space of the published set (39 rigid and rotor rows, and the inertia of the coupled motor 6 = 40 of its 60)."""
    folder = shared_data() / "tx40"
    turns = np.array(json.loads((folder / "drive.json").read_text())["R"])
    robot = Robot.from_urdf(folder / "tx40.urdf", transmission=np.linalg.inv(turns))
    found = base_set(robot, True)
    per_motor = {f"Ia{i}": turns[i - 1, i - 1] ** 2 for i in range(1, 6)} | {"Iam6": turns[5, 5] ** 2}
    columns = [*(name.replace("_joint_", "") for name in found.parameters), *per_motor]
    rows, others = [], 0
    with (folder / "reference_base_parameters.csv").open() as file:
        for line in csv.DictReader(file):
            row, rigid = np.zeros(len(columns)), True
            for sign, term in re.findall(r"([+-]?)\s*([^\s+-]\S*)", line["base_parameter_expression"]):
                factor, _, name = term.rpartition("*")
                rigid &= name in columns
                if rigid:
                    row[columns.index(name)] += float(sign + (factor or "1")) * per_motor.get(name, 1.0)
            rows += [row] if rigid else []
            others += not rigid
    published = np.array(rows)
    assert (found.count, len(published), others) == (40, 40, 20)
    compared = compare_row_spaces(found.full, published)
    assert compared.rank == 40
    assert max(compared.form_outside, compared.sampled_outside) < 1e-12
    # Not the same space only: row by row the same regrouping.
    direct = base_set(robot)
    for row in direct.matrix:
        assert np.abs(published[:, :60] - row).max(axis=1).min() < 1e-12


def test_gantry_with_a_wrist() -> None:
    specs = [joint(-1, prismatic=True), joint(0, rotation([1, 0, 0], np.pi / 2), prismatic=True), joint(1, rotation([0, 1, 0], 0.7))]
    agrees(Robot.from_urdf(urdf_text(specs)), rotors=True)


def test_fixed_dependent_joint_adds_nothing() -> None:
    """A joint that the loop holds still is a part of the link before."""
    specs = [joint(-1, rotation([1, 0, 0], np.pi / 2)), joint(0, rotation([0, 1, 0], 0.4), (0.3, 0, 0))]
    robot = Robot.from_urdf(urdf_text(specs), loop={"joint2": {"offset": 0.5}})
    assert agrees(robot) == 3


def test_gripper_with_mimicking_fingers() -> None:
    """Two fingers on one motor, and gears that pass on a fraction: functions of one position with different frequencies."""
    specs = [joint(-1, rotation([1, 0, 0], 0.5)), joint(0, rotation([1, 0, 0], np.pi / 2), (0.1, 0, 0)), joint(1, None, (0.05, 0, 0)),
             joint(0, rotation([1, 0, 0], np.pi / 2), (-0.1, 0, 0)), joint(3, None, (0.05, 0, 0))]  # fmt: skip
    loop = {"joint3": {"joint2": 0.45}, "joint4": {"joint2": -1.0}, "joint5": {"joint2": -0.45, "offset": 0.1}}
    agrees(Robot.from_urdf(urdf_text(specs), loop=loop))


@pytest.mark.parametrize("size", [4, 7, 12])
def test_coupling_over_a_long_way(size: int) -> None:
    """First and last joint coupled: everything between belongs to one block, resolved or probed, and says which."""
    specs = random_tree(np.random.default_rng(size), size, prismatic=0.0, branch=0.0, right=0.5)
    robot = Robot.from_urdf(urdf_text(specs), loop={f"joint{size}": {"joint1": 0.5}})
    agrees(robot, rotors=True)
    assert base_set(robot).exact == (size == 4)


def test_axis_nearly_but_not_quite_parallel_is_reported() -> None:
    """A calibrated 1e-4 rad: more parameters on paper, which are reported as hardly to be seen."""

    def arm(angle: float) -> Robot:
        return Robot.from_urdf(urdf_text([joint(-1), joint(0, rotation([1, 0, 0], angle), (0.3, 0, 0.1)), joint(1, None, (0.4, 0, 0))]))

    exact, calibrated = base_set(arm(0.0)), base_set(arm(1e-4))
    assert (exact.count, calibrated.count) == (7, 15)
    assert not exact.notes
    assert any("joint2" in note and "1.0e-04 rad away from parallel to the axis of joint1" in note for note in calibrated.notes)
    assert any("8 of the base parameters show only" in note for note in calibrated.notes)
    assert exact.gap[0] > 0.1
    assert exact.gap[1] < 1e-14


def test_right_angle_written_with_few_digits_does_not_change_the_count() -> None:
    text = urdf_text(
        [joint(-1), joint(0, rotation([1, 0, 0], np.pi / 2)), joint(1, None, (0.4, 0, 0)), joint(2, rotation([1, 0, 0], -np.pi / 2))]
    )
    for digits in ("1.57", "1.5708", "1.570796"):
        rough, changed = re.subn(r"1\.57079632679\d+", digits, text)
        assert changed == 2
        assert base_set(Robot.from_urdf(rough)).count == base_set(Robot.from_urdf(text)).count == 7 * 4 - 4 - 2


def test_rounding_of_zero_lengths_is_no_length() -> None:
    """Coincident vertical axes whose offset is written as 1e-17 m: still coincident, though there is no other length to compare with."""
    robot = Robot.from_urdf(urdf_text([joint(-1), joint(0, rotation([0, 0, 1], 0.3), (1e-17, 0, -2e-17))]))
    assert agrees(robot) == rotational(robot).count == 2


def test_same_result_every_time() -> None:
    robot = load_robot("palletiser")
    one, other = base_set(robot, True), base_set(robot, True)
    assert np.array_equal(one.full, other.full)
    assert one.expressions == other.expressions


def test_thirty_degrees_of_freedom_take_less_than_50_ms() -> None:
    robot = Robot.from_urdf(urdf_text(random_tree(np.random.default_rng(3), 30, prismatic=0.2)))
    robot.tree  # noqa: B018 - loading is not part of it
    base_set(robot)
    times = []
    for _ in range(7):
        start = time.process_time()
        base_set(robot, True)
        times.append(time.process_time() - start)
    assert min(times) < 0.05


def example_arms() -> list[str]:
    """URDF files of example-robot-data, as paths under its folder."""
    try:
        files = distribution("example-robot-data").files or []
    except PackageNotFoundError:
        return []
    return sorted(str(file) for file in files if file.suffix == ".urdf")


def check_example(path: str, floating: bool) -> None:
    try:
        robot = Robot.from_urdf(str(distribution("example-robot-data").locate_file(path)), floating_base=floating)
    except ConfigurationError as error:
        pytest.skip(str(error)[:120])
    if robot.n > 60:
        pytest.skip(f"{robot.n} degrees of freedom")
    agrees(robot)


FEW = ("panda.urdf", "ur5_robot.urdf", "kinova.urdf", "anymal-kinova.urdf", "xarm7.urdf", "talos_left_arm.urdf", "bolt.urdf", "so101.urdf")


@pytest.mark.parametrize("floating", [False, True], ids=["fixed", "floating"])
@pytest.mark.parametrize("path", [p for p in example_arms() if p.endswith(tuple("/" + name for name in FEW))])
def test_some_example_robots(path: str, floating: bool) -> None:
    check_example(path, floating)


@pytest.mark.slow
@pytest.mark.parametrize("floating", [False, True], ids=["fixed", "floating"])
@pytest.mark.parametrize("path", example_arms())
def test_all_example_robots(path: str, floating: bool) -> None:
    check_example(path, floating)
