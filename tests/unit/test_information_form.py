"""Products or reflections: chosen by the condition of the data, with the same estimate, and told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from command_line import analytic_log, write_csv

import ident
from ident.estimators import WeightedLeastSquares
from ident.friction import Coulomb, RotorInertia, Viscous
from ident.problem.information import GRAM_CONDITION, Accumulation, Form, Information
from ident.robots import nominal_values


def blocks(rng: np.random.Generator, close: float, noise: float, count: int = 5) -> list[tuple[np.ndarray, np.ndarray]]:
    """Blocks of columns (m, 2, 4), two of them `close`, and torques with `noise`; the second row lacks a column."""
    out = []
    for _ in range(count):
        X = rng.normal(size=(300, 2, 4)) * np.array([1e-3, 1.0, 1.0, 1e4])
        X[:, :, 2] = X[:, :, 1] + close * X[:, :, 2]
        X[:, 1, 0] = 0.0
        out.append((X, X @ [300.0, 1.0, -2.0, 1e-4] + noise * rng.normal(size=(300, 2))))
    return out


def accumulated(data: list[tuple[np.ndarray, np.ndarray]], may_square: bool = True) -> Accumulation:
    names = tuple("abcd")
    found = Accumulation(names, 2, may_square)
    for X, tau in data:
        block = Information.empty(2, names).with_rows(X, tau)
        factors = block.factors
        found.add(factors.swapaxes(1, 2) @ factors if found.form == Form.GRAM else factors, block.counts)
    return found


@pytest.mark.parametrize(("close", "noise", "form"), [(1.0, 0.1, "gram"), (1e-5, 0.1, "triangle"), (1.0, 1e-9, "triangle")])
def test_form_follows_the_condition(close: float, noise: float, form: str) -> None:
    """Nearly dependent columns, or torques that are fitted nearly exactly, ask for reflections."""
    data = blocks(np.random.default_rng(0), close, noise)
    found, sure = accumulated(data), accumulated(data, may_square=False)
    assert found.form == form
    assert found.information.form == form
    assert found.sound
    assert sure.information.form == "triangle"
    assert np.array_equal(found.information.counts, sure.information.counts)
    assert not np.tril(found.information.factors, -1).any()
    solved = [np.linalg.solve(*x.information.combined(np.ones(2))[:2]) for x in (found, sure)]
    np.testing.assert_allclose(solved[0], solved[1], rtol=1e-9)
    for a, b in zip(found.information.residual_squares(solved[0]), sure.information.residual_squares(solved[1]), strict=True):
        assert a == pytest.approx(b, rel=1e-8)


def test_later_data_may_ask_for_reflections_after_all() -> None:
    rng = np.random.default_rng(1)
    good, bad = blocks(rng, 1.0, 0.1, 1), blocks(rng, 1.0, 0.1, 4)
    for X, tau in bad:  # a common factor so large that all but one direction of the first block vanishes beside it
        X[:] = 1e6 * rng.normal(size=(300, 2, 1)) * np.array([1e-3, 1.0, 1.0, 1e4])
        tau[:] = X[:, :, 1]
    found = accumulated([*good, *bad])
    assert found.form == "gram"
    assert found.information.condition > GRAM_CONDITION
    assert not found.sound


def test_condition_does_not_depend_on_units() -> None:
    data = blocks(np.random.default_rng(2), 0.1, 0.1)
    one = accumulated(data, may_square=False).information
    scaled = accumulated([(X * [1e3, 1.0, 1e-6, 7.0], tau * 1e-4) for X, tau in data], may_square=False).information
    assert one.condition == pytest.approx(scaled.condition, rel=1e-9)
    assert Information.empty(2, tuple("abcd")).condition == np.inf


def test_a_fit_by_products_is_that_by_reflections(tmp_path, monkeypatch) -> None:
    """The whole way: same values within a millionth of a standard deviation; summary and saved file tell the form."""
    robot = ident.load_robot("puma560")
    model = robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()
    table = analytic_log(model, nominal_values(model), 3, seconds=60.0, rate=200.0, noise=0.05)
    problem = ident.Problem(model, ident.CentralDifference()(ident.read_logs(write_csv(tmp_path / "log.csv", table), robot=robot)))
    estimates = []
    for limit in (GRAM_CONDITION, 0.0):
        monkeypatch.setattr("ident.problem.information.GRAM_CONDITION", limit)
        monkeypatch.setattr("ident.problem.problem._BLOCK_NUMBERS", 100_000)
        estimates.append(WeightedLeastSquares().solve(replace(problem)))
    gram, triangle = estimates
    assert gram.information.form == "gram"
    assert triangle.information.form == "triangle"
    assert np.all(np.abs(gram.values - triangle.values) < 1e-6 * triangle.std)
    np.testing.assert_allclose(gram.covariance, triangle.covariance, rtol=1e-6)
    assert "from Gram matrices" in gram.summary()
    assert "by QR" in triangle.summary()
    gram.save(tmp_path / "estimate.json")
    assert ident.Estimate.load(tmp_path / "estimate.json").information.form == "gram"
