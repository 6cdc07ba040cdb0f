"""Robots by name: built-in ones, those of example-robot-data, and what the messages say."""

from __future__ import annotations

import importlib.metadata
from pathlib import Path

import numpy as np
import pytest

import ident
from ident.robots import built_in_names, nominal_values, payloads, published_tables, robot_names
from ident.robots.library import examples
from ident.robots.tables import DriveTable


@pytest.fixture(scope="module")
def _examples_installed():
    try:
        importlib.metadata.distribution("example-robot-data")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("example-robot-data is not installed")


@pytest.mark.parametrize("name", built_in_names())
def test_every_built_in_robot_loads_whole(name):
    robot = ident.load_robot(name)
    assert robot.name == name
    assert robot.source["robot"] == name
    assert robot.nominal is not None
    assert robot.transmission.n == robot.n
    model = robot.rigid_body() + ident.friction.RotorInertia()
    assert nominal_values(model).shape == (len(model.parameters),)
    assert isinstance(published_tables(name), dict)
    assert isinstance(payloads(name), dict)


@pytest.mark.usefixtures("_examples_installed")
def test_every_listed_name_loads():
    names = robot_names()
    assert names[: len(built_in_names())] == built_in_names()
    assert len(names) == len(set(names)) > 50
    for name in names:
        assert ident.load_robot(name).n >= 1, name


@pytest.mark.usefixtures("_examples_installed")
@pytest.mark.parametrize(
    ("name", "joints"),
    [("ur5", 6), ("UR5", 6), ("ur5_robot", 6), ("panda", 8), ("tiago", 48), ("kinova", 6), ("xarm7", 7), ("xarm", 7), ("icub", 32)],
)
def test_sensible_names(name, joints):
    assert ident.load_robot(name).n == joints


@pytest.mark.usefixtures("_examples_installed")
def test_folder_and_stem_settle_an_ambiguity():
    with pytest.raises(
        ident.ConfigurationError, match="'anymal' is ambiguous; take one of: anymal_b_simple/anymal, anymal_c_simple/anymal"
    ):
        ident.load_robot("anymal")
    assert ident.load_robot("anymal_c_simple/anymal").n == 12


@pytest.mark.usefixtures("_examples_installed")
@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("talos", r"'talos' is ambiguous; take one of: talos_full_v2, .*talos_reduced"),
        ("pnda", r"unknown robot 'pnda'; did you mean 'panda'.*robot_names\(\) lists all"),
        ("pumma560", "did you mean 'puma560'"),
        ("cassie", "ships only as SDF"),
        ("hector", "has no moving joint"),
        ("", "unknown robot ''"),
        ("arm.urdf", "'arm.urdf' is a file, not a robot's name"),
        (Path("arm.urdf"), "'arm.urdf' is a file, not a robot's name"),
    ],
)
def test_names_that_do_not_load(name, message):
    with pytest.raises(ident.ConfigurationError, match=message):
        ident.load_robot(name)


def test_without_the_package_the_message_says_what_to_install(monkeypatch):
    def missing(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", missing)
    examples._files.cache_clear()
    examples._by_name.cache_clear()
    try:
        with pytest.raises(ident.ConfigurationError, match=r"unknown robot 'ur5'.*pip install 'ident\[robots\]'"):
            ident.load_robot("ur5")
        assert robot_names() == built_in_names()
        assert ident.load_robot("puma560").n == 6
    finally:
        examples._files.cache_clear()
        examples._by_name.cache_clear()


def test_arguments_replace_what_the_robot_says_of_itself():
    robot = ident.load_robot("puma560", measured="joint", gravity=(0, 9.81, 0))
    assert robot.transmission.measured == "joint"
    assert robot.transmission.K[5, 4] != 0
    assert robot.tree.gravity == pytest.approx([0, 9.81, 0])
    direct = ident.load_robot("puma560", transmission=np.ones(6))
    assert direct.transmission.K == pytest.approx(np.eye(6), abs=0)
    assert direct.transmission.measured == "joint"
    assert ident.load_robot("ur5", transmission=[100] * 6, measured="motor").transmission.measured == "motor"


def test_a_drive_table_completes_or_replaces_the_gearing():
    own = ident.load_robot("puma560").transmission
    kept = ident.load_robot("puma560", drive=DriveTable(zero=(0.1,) * 6)).transmission
    assert kept.K == pytest.approx(own.K, abs=0)
    assert kept.zero == pytest.approx([0.1] * 6)
    assert kept.measured == "motor"
    replaced = ident.load_robot("puma560", drive=DriveTable(ratio=(2.0,) * 6)).transmission
    assert replaced.K == pytest.approx(np.eye(6) / 2)
    with pytest.raises(ident.ConfigurationError, match="not both"):
        ident.load_robot("puma560", drive=DriveTable(), measured="motor")


def test_locked_joints_cut_the_gearing_where_it_is_not_coupled():
    whole = ident.load_robot("puma560").transmission
    arm = ident.load_robot("puma560", joints=["joint1", "joint2", "joint3"])
    assert arm.transmission.K == pytest.approx(whole.K[:3, :3], abs=0)
    wrist = ident.load_robot("puma560", locked={"joint1": 0.0, "joint2": 0.3, "joint3": 0.0})
    assert wrist.transmission.K == pytest.approx(whole.K[3:, 3:], abs=0)
    with pytest.raises(ident.ConfigurationError, match="couples joints that move with joints that are locked"):
        ident.load_robot("puma560", locked={"joint6": 0.0})
    assert ident.load_robot("puma560", locked={"joint6": 0.0}, transmission=np.ones(5)).n == 5
