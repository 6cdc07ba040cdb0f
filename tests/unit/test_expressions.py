"""Expressions a person recognises, the report of a robot, and principal base parameters."""

from __future__ import annotations

import json

import numpy as np
import pytest
from structures import random_tree, urdf_text

from ident.errors import ConfigurationError
from ident.problem.base_report import base_report
from ident.regressor.base_parameters.expressions import coefficient_text, expression, link_parameter_names
from ident.regressor.base_parameters.principal import principal_parameters
from ident.robots import load_robot
from ident.robots.robot import Robot

NAMES = (*link_parameter_names(["joint3", "joint4", "joint5"]), "Ia_joint3", "Fv_joint3")


def row(**values: float) -> np.ndarray:
    out = np.zeros(len(NAMES))
    for name, value in values.items():
        out[NAMES.index(name)] = value
    return out


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"Izz_joint3": 1, "Iyy_joint4": 1, "m_joint5": 0.19}, "Izz_joint3 + Iyy_joint4 + 0.19 m_joint5"),
        ({"Ixx_joint3": 1, "Iyy_joint3": -1, "m_joint4": -0.05185}, "Ixx_joint3 - Iyy_joint3 - 0.05185 m_joint4"),
        ({"m_joint4": 2.0, "Izz_joint3": 1, "Ia_joint3": 6400.0}, "Izz_joint3 + 6400 Ia_joint3 + 2 m_joint4"),
        ({"Izz_joint4": 1, "Ia_joint3": 3.0}, "Izz_joint4 + 3 Ia_joint3"),
        ({"mx_joint3": 1, "m_joint4": 1 / 3, "mz_joint4": 1e-13}, "mx_joint3 + 0.333333 m_joint4"),
        ({"mx_joint3": -0.5}, "-0.5 mx_joint3"),
        ({"Fv_joint3": 1}, "Fv_joint3"),
        ({"Izz_joint3": 1, "my_joint5": 0.9999999999999}, "Izz_joint3 + my_joint5"),
        ({}, "0"),
    ],
)
def test_expression(values: dict[str, float], text: str) -> None:
    assert expression(row(**values), NAMES) == text


def test_coefficients_are_short_where_they_are_exact() -> None:
    assert [coefficient_text(x) for x in (0.1 + 0.2, 0.432**2, 11662.1003, 2e-7, 3906.25)] == [
        "0.3",
        "0.186624",
        "11662.1003",
        "2e-07",
        "3906.25",
    ]


def test_puma_reads_as_in_the_literature() -> None:
    report = base_report(load_robot("puma560"))
    expressions = dict(zip(report.base.names, report.base.expressions, strict=True))
    assert expressions["my_joint3"] == "my_joint3 - mz_joint4 - 0.433 m_joint5 - 0.433 m_joint6"
    assert expressions["Izz_joint4"] == "Izz_joint4 + Iyy_joint5"
    assert expressions["Ixx_joint6"] == "Ixx_joint6 - Iyy_joint6"
    hidden = {u.parameter: u for u in report.unidentifiable}
    assert hidden["m_joint1"].why == "no effect on any torque: the origin of its frame never moves"
    assert hidden["Ixx_joint1"].why == "no effect on any torque: the link only ever rotates about one axis"
    assert hidden["mz_joint4"].why == "only in combination, grouped into my_joint3"
    assert hidden["mz_joint4"].grouped_into == ("my_joint3",)
    assert len(hidden) == 60 - 36
    assert set(hidden) | set(report.base.names) == set(report.base.parameters)


def test_report_as_json_has_the_contract() -> None:
    report = base_report(load_robot("puma560"))
    data = json.loads(json.dumps(report.to_dict()))
    assert data["count"] == 36
    assert {"name", "expression"} <= set(data["parameters"][0])
    assert {"parameter", "why"} <= set(data["unidentifiable"][0])
    assert np.array(data["matrix"]).shape == (36, 60)
    assert data["agreement"]["agreed"] is True
    assert data["closed_forms"][0]["parameters"][0]["name"] == "J1z"


@pytest.mark.parametrize(
    ("name", "count", "formula"), [("palletiser", 32, "parallelogram"), ("scara", 8, "mixed"), ("puma560", 36, "rotational")]
)
def test_text_says_what_matters(name: str, count: int, formula: str) -> None:
    text = base_report(load_robot(name)).text()
    assert f"{name}: {count} base parameters of" in text
    assert f"closed form: {formula}" in text
    assert "agree:" in text
    assert "no effect on any torque" in text
    assert max(len(line) for line in text.splitlines()) < 320


def test_report_with_rotors() -> None:
    report = base_report(load_robot("scara"), rotor_inertia=True)
    assert report.count == 11
    assert "Izz_joint1 + 6400 Ia_joint1 + 0.16 m_joint2" in report.base.expressions
    assert "and 3 of the motors" in report.text()
    data = report.to_dict()
    assert np.array(data["matrix"]).shape == (11, 44)
    assert data["columns"][40:] == [f"Ia_joint{j}" for j in range(1, 5)]
    assert {"parameter": "Ia_joint1", "why": "only in combination, grouped into Izz_joint1", "grouped_into": ["Izz_joint1"]} in data[
        "unidentifiable"
    ]


def test_coefficients_stay_small_and_order_is_stable() -> None:
    for seed in range(20):
        robot = Robot.from_urdf(urdf_text(random_tree(np.random.default_rng(seed), 6)))
        report = base_report(robot)
        places = [report.base.parameters.index(name) // 10 for name in report.base.names]
        assert places == sorted(places)
        assert np.abs(report.base.matrix).max() < 200


def test_floating_base_names_its_body() -> None:
    report = base_report(Robot.from_urdf(urdf_text(random_tree(np.random.default_rng(1), 3)), floating_base=True))
    assert report.base.names[:2] == ("Izz_base", "Ixx_base")
    assert "floating base" in report.text()


def test_principal_parameters_rank_directions() -> None:
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    size = np.array([50.0, 2.0, 1e-3])
    found = principal_parameters(np.linalg.qr(rng.normal(size=(40, 3)))[0] @ np.diag(size) @ turn, ("a", "b", "c"), rows=100)
    assert found.sensitivity == pytest.approx(size / 10)
    assert np.allclose(np.abs(found.directions @ turn.T), np.eye(3), atol=1e-9)
    assert found.condition == pytest.approx(5e4)
    base = np.array([1.0, -2.0, 3.0])
    assert found.base_values(found.values(base)) == pytest.approx(base)
    assert "principal base parameters" in str(found)


def test_principal_parameters_with_units_and_missing_rows() -> None:
    found = principal_parameters(np.array([[2.0, 0.0]]), ("a", "b"), scale=[0.5, 10.0])
    assert found.sensitivity == pytest.approx([1.0, 0.0])
    assert found.condition == np.inf
    assert found.expressions[0] == "2 a"
    with pytest.raises(ConfigurationError, match="expected"):
        principal_parameters(np.eye(3), ("a", "b"))
    with pytest.raises(ConfigurationError, match="positive"):
        principal_parameters(np.eye(2), ("a", "b"), scale=[1.0, 0.0])
