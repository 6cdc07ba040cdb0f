"""Ranges for domain randomisation: what the data tie together moves together, bounds hold, several units give their spread."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_actuator_export import as_fitted, leg

import ident
from benchmarks.actuators.commanded import PENDULUM
from ident.drives import DriveFit, DriveLaw
from ident.exporting import Identified, export
from ident.exporting.sampling import bounded_normal, total_covariance
from ident.robots import nominal_values

Array = np.ndarray
INF = np.full(2, np.inf)


def ranges(fit: object, folder: Path, **options: object) -> dict:
    file = folder / "ranges.json"
    export(fit, file, kind="ranges", force=True, **options)
    return json.loads(file.read_text())


def columns(found: dict) -> dict[str, Array]:
    return dict(zip([f["name"] for f in found["fields"]], np.array(found["samples"]).T, strict=True))


def test_without_bounds_samples_are_those_of_the_normal_distribution():
    rng = np.random.default_rng(0)
    A = rng.standard_normal((4, 4))
    covariance, mean = A @ A.T, rng.standard_normal(4)
    x = bounded_normal(mean, covariance, np.full(4, -np.inf), np.full(4, np.inf), 40000, rng)
    assert np.abs(x.mean(axis=0) - mean).max() < 0.05 * np.sqrt(np.diag(covariance).max())
    assert np.cov(x.T) == pytest.approx(covariance, abs=0.05 * np.abs(covariance).max())


def test_within_bounds_samples_are_those_that_rejection_would_keep():
    """Against plain rejection: two strongly correlated numbers that cannot be negative."""
    rng = np.random.default_rng(1)
    mean, covariance = np.array([0.5, 0.3]), np.array([[1.0, -0.9], [-0.9, 1.0]])
    x = bounded_normal(mean, covariance, np.zeros(2), INF, 20000, rng)
    plain = rng.multivariate_normal(mean, covariance, 400000)
    plain = plain[(plain >= 0).all(axis=1)]
    assert x.min() >= 0
    for q in (0.1, 0.5, 0.9):
        assert np.quantile(x, q, axis=0) == pytest.approx(np.quantile(plain, q, axis=0), abs=0.03)
    assert np.corrcoef(x.T)[0, 1] == pytest.approx(np.corrcoef(plain.T)[0, 1], abs=0.03)


def test_a_sum_that_is_known_stays_while_its_parts_fill_their_bounds():
    """kd and Fv, of which a log knows the sum alone: every sample has it, each part runs from nothing to all."""
    along, across = np.array([1.0, -1.0]) / np.sqrt(2), np.array([1.0, 1.0]) / np.sqrt(2)
    covariance = 1e4 * np.outer(along, along) + 1e-6 * np.outer(across, across)
    x = bounded_normal(np.array([0.8, 0.2]), covariance, np.zeros(2), INF, 4000, np.random.default_rng(2))
    assert np.abs(x.sum(axis=1) - 1.0).max() < 0.01
    assert x[:, 0].std() == pytest.approx(1 / np.sqrt(12), rel=0.05)  # even between 0 and 1


def test_a_fit_under_a_law_is_drawn_with_its_covariance(tmp_path):
    fit = leg("stribeck")
    place = {name: i for i, name in enumerate(fit.names)}
    covariance = fit.covariance.copy()
    i, j = place["Ia_hip"], place["Fv_hip"]
    covariance[i, j] = covariance[j, i] = -0.8 * np.sqrt(covariance[i, i] * covariance[j, j])
    found = ranges(replace(fit, covariance=covariance), tmp_path, samples=2000)
    drawn = columns(found)
    assert len(found["samples"]) == 2000
    assert drawn["armature_hip"].mean() == pytest.approx(0.012, rel=0.01)
    assert drawn["armature_hip"].std() == pytest.approx(0.05 * 0.012, rel=0.06)
    assert np.corrcoef(drawn["armature_hip"], drawn["damping_hip"])[0, 1] == pytest.approx(-0.8, abs=0.05)
    assert abs(np.corrcoef(drawn["armature_hip"], drawn["armature_knee"])[0, 1]) < 0.08
    assert np.array_equal(drawn["delay_hip"], drawn["delay_knee"])  # one delay for all
    (armature,) = [f for f in found["fields"] if f["name"] == "armature_hip"]
    assert armature["nominal"] == pytest.approx(0.012)
    assert armature["quantiles"]["0.975"] == pytest.approx(0.012 * (1 + 1.96 * 0.05), rel=0.01)
    assert found["constant"]["kp_hip"] == 25.0  # a known number is none to be drawn
    again = ranges(replace(fit, covariance=covariance), tmp_path, samples=2000)
    assert again["samples"] == found["samples"]


def test_what_is_not_determined_stays_within_what_can_be(tmp_path):
    fit = leg(law={"kd": "identify"})
    place = {name: i for i, name in enumerate(fit.names)}
    covariance = fit.covariance.copy()
    i, j = place["kd_hip"], place["Fv_hip"]
    apart = np.zeros(len(covariance))
    apart[[i, j]] = 1.0, -1.0
    covariance += 1e3 * np.outer(apart, apart)
    found = ranges(replace(fit, covariance=covariance), tmp_path, samples=1000)
    drawn = columns(found)
    both = drawn["kd_hip"] + drawn["damping_hip"]
    assert both.std() < 0.06 * both.mean()
    assert drawn["damping_hip"].min() >= 0
    assert drawn["damping_hip"].max() <= 0.16 + 1e-9  # twice its value
    assert any("not determined" in note and "kd_hip" in note and "kp" not in note for note in found["notes"])


def test_a_delay_without_a_limit_is_drawn_over_its_interval(tmp_path):
    fit = leg()
    i = fit.names.index("delay")
    covariance = fit.covariance.copy()
    covariance[i], covariance[:, i] = 0.0, 0.0
    covariance[i, i] = np.inf
    drawn = columns(ranges(replace(fit, covariance=covariance, delay_ends={"delay": (0.001, 0.009)}), tmp_path, samples=1000))
    assert 0.001 <= drawn["delay_hip"].min() < 0.0012
    assert 0.0088 < drawn["delay_hip"].max() <= 0.009
    open_ended = columns(ranges(replace(fit, covariance=covariance, delay_ends={"delay": (0.0, np.inf)}), tmp_path, samples=1000))
    assert open_ended["delay_hip"].max() <= 0.008 + 1e-9  # twice its value


def test_several_units_give_their_spread(tmp_path):
    """Friction that differs from unit to unit by far more than its intervals; armature by less."""
    rng = np.random.default_rng(0)
    robot = ident.Robot.from_urdf(PENDULUM)
    law = DriveLaw.of(robot, kp=25.0, kd=0.8, delay_s=0.0)

    def unit(dry: float, armature: float) -> DriveFit:
        fit = as_fitted(robot, law, Fc=dry, Ia=armature)
        return replace(fit, covariance=np.diag((0.02 * fit.values) ** 2))

    dry = 0.15 * (1 + 0.3 * rng.standard_normal(8))
    units = [unit(x, 0.012 * (1 + 0.002 * k)) for k, x in enumerate(dry)]
    found = ranges(units[0], tmp_path, units=units[1:], samples=3000)
    drawn = columns(found)
    assert found["units"] == 8
    assert drawn["frictionloss_joint1"].mean() == pytest.approx(dry.mean(), rel=0.03)
    assert drawn["frictionloss_joint1"].std() == pytest.approx(dry.std(ddof=1) * np.sqrt(1 + 1 / 8), rel=0.05)
    assert drawn["armature_joint1"].std() == pytest.approx(0.02 * 0.012, rel=0.1)
    other = as_fitted(robot, law, "stribeck")
    with pytest.raises(ident.ConfigurationError, match="do not have the same parameters"):
        ranges(units[0], tmp_path, units=[other])


def test_spread_of_units_where_they_are_few_keeps_the_uncertainty_elsewhere():
    within = np.diag([1.0, 4.0, 9.0])
    mean, total = total_covariance(np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]]), within)
    assert mean.tolist() == [10.0, 0.0, 0.0]
    assert np.diag(total) == pytest.approx([300.0, 4.0, 9.0])  # 200 of the two, half as much for their mean


def test_an_estimate_is_drawn_with_its_links(tmp_path):
    train, _ = ident.demo_logs()
    estimate = ident.fit(train, "puma560", held=0)
    found = ranges(estimate, tmp_path, samples=200)
    drawn = columns(found)
    place = estimate.index("Fc_joint2")
    ratio = 1.0 / abs(estimate.model.robot.transmission.K[1, 1])
    assert drawn["frictionloss_joint2"].std() == pytest.approx(estimate.std[place] * ratio, rel=0.2)
    assert all(name.split("_")[0] in ("armature", "damping", "frictionloss", *ident.robots.parameters.LINK_SYMBOLS) for name in drawn)
    assert "offset_joint1" not in drawn


def test_ranges_need_a_fit(tmp_path):
    model = ident.load_robot("scara").rigid_body()
    with pytest.raises(ident.ConfigurationError, match="drawn from the covariance of a fit"):
        ranges(Identified(model, nominal_values(model)), tmp_path)
    with pytest.raises(ident.ConfigurationError, match="at least 2"):
        ranges(leg(), tmp_path, samples=1)
