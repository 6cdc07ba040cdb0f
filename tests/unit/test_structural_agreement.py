"""All ways to the base parameters span the same space, and a missing direction is named."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from structures import mixed_robot, parallelogram_robot, random_tree, urdf_text

from ident.problem import agreement as module
from ident.problem.agreement import agreement
from ident.regressor.base_parameters.closed_form import rotational
from ident.robots import load_robot
from ident.robots.robot import Robot


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("puma560", {"structural": 36, "rotational": 36, "mixed": 36, "oblique": 36, "sampled": 36, "qr": 36}),
        ("palletiser", {"structural": 32, "parallelogram": 32, "sampled": 32, "qr": 32}),
        ("scara", {"structural": 8, "mixed": 8, "sampled": 8, "qr": 8}),
    ],
)
def test_built_in_robots_agree(name: str, counts: dict[str, int]) -> None:
    found = agreement(load_robot(name))
    assert found.agreed
    assert found.counts == counts
    assert "the same space" in str(found)
    assert json.loads(json.dumps(found.to_dict()))["agreed"] is True


@pytest.mark.parametrize("tilt", [1e-3, 1e-4, 1e-5, 1e-6])
def test_an_axis_that_is_almost_perpendicular_adds_nothing_twice(tilt: float) -> None:
    """The last axis of a SCARA about y, tilted: as many parameters as for any tilt, though three of their columns are nearly the same."""
    text = load_robot("scara").source["urdf_text"]
    axis = '<axis xyz="0 0 1"/>'
    before, _, after = text.rpartition(axis)
    assert before
    found = agreement(Robot.from_urdf(before + f'<axis xyz="0 1 {tilt}"/>' + after))
    assert found.agreed, str(found)
    assert set(found.counts.values()) == {12}


def test_columns_that_are_hardly_there_are_no_parameters() -> None:
    """A tilt of 1e-5 leaves products of inertia a column of 1e-10: what sets two of them apart is rounding."""
    tool = '<link name="tool"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    joints = (
        '<joint name="j1" type="revolute"><parent link="base"/><child link="a"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>'
        '<limit lower="-2.5" upper="2.5" velocity="3" effort="50"/></joint>'
        '<joint name="j2" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0.4 0 0" rpy="1.5708 0 0"/>'
        '<axis xyz="0 1e5 1"/></joint>'
        '<joint name="j3" type="prismatic"><parent link="b"/><child link="tool"/><origin xyz="0 0 0.2"/><axis xyz="1 0 0"/>'
        '<limit lower="0" upper="0.1" velocity="1" effort="9"/><mimic joint="j2" multiplier="0.5" offset="0.1"/></joint>'
    )
    links = "".join(tool.replace("tool", name) for name in ("a", "b", "tool"))
    found = agreement(Robot.from_urdf(f'<robot name="arm"><link name="base"/>{links}{joints}</robot>'))
    assert found.agreed, str(found)
    assert set(found.counts.values()) == {12}


@pytest.mark.parametrize("seed", range(8))
def test_random_robots_agree_with_rotors(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 7))
    robot = [
        lambda: mixed_robot(rng, size, transmission=rng.uniform(20, 100, size)),
        lambda: parallelogram_robot(rng, size),
        lambda: Robot.from_urdf(urdf_text(random_tree(rng, size)), floating_base=True),
        lambda: Robot.from_urdf(urdf_text(random_tree(rng, size)), gravity=(0, 0, 0)),
    ][seed % 4]()
    found = agreement(robot, rotor_inertia=True)
    assert found.agreed, str(found)


def test_a_missing_direction_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """A theorem that loses R6x and gets J5xy wrong: both are told, in both directions."""

    def broken(robot: Robot):  # type: ignore[no-untyped-def]
        form = rotational(robot)
        keep = [i for i, name in enumerate(form.names) if name != "R6x"]
        matrix = form.matrix[keep].copy()
        matrix[form.names.index("J5xy"), form.parameters.index("Iyy_joint5")] += 0.5
        return replace(form, matrix=matrix, names=tuple(form.names[i] for i in keep))

    monkeypatch.setitem(module._FORMS, "rotational", broken)
    found = agreement(load_robot("puma560"))
    assert not found
    told = {(d.found_by, d.missing_in) for d in found.disagreements}
    assert told == {("rotational", "structural"), ("structural", "rotational")}
    assert any("mx_joint6" in d.direction for d in found.disagreements if d.found_by == "structural")
    assert any("Iyy_joint5" in d.direction for d in found.disagreements if d.found_by == "rotational")
    assert "NOT the same space" in str(found)
    assert found.counts["rotational"] == 35


def test_refused_theorems_carry_their_reason() -> None:
    refused = dict(agreement(load_robot("scara")).refused)
    assert "prismatic" in refused["rotational"]
    assert "no loop" in refused["parallelogram"]
