"""Judging physical consistency, consistent fits with bounds and priors, standard parameters, and the fallback without the solver."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from physical_models import puma_table, puma_truth, random_structure

from ident.errors import ConfigurationError, UnsupportedError
from ident.physical import (
    Bounds,
    InfeasibleError,
    LinkBounds,
    Metric,
    Prior,
    Settling,
    SolverError,
    Target,
    binding_constraints,
    consistent_fit,
    judge_consistent,
    nominal_prior,
    standard_parameters,
)
from ident.physical.conic import ConicProgram, require_solver
from ident.physical.constrained import fit_consistent, prior_distance
from ident.physical.log_cholesky import _Factors, fit_log_cholesky
from ident.physical.pseudo_inertia import from_centre_of_mass, pseudo_inertia, smallest_eigenvalues
from ident.physical.target import covariance_root, mahalanobis
from ident.robots import load_robot

Array = np.ndarray


def ten_percent(values: Array) -> Array:
    return np.diag((0.1 * np.abs(values) + 1e-9) ** 2)


def test_truth_is_consistent_and_comes_with_links() -> None:
    structure, values, _ = puma_truth()
    found = judge_consistent(structure, values)
    assert found.consistent
    assert found.standard is not None
    assert found.margin > 0
    assert np.allclose(structure.regroup @ found.standard, values, rtol=1e-9, atol=1e-12)
    assert np.all(smallest_eigenvalues(found.standard[structure.inertial]) > 0)
    assert np.all(found.standard[structure.drive] >= 0)
    assert json.dumps(found.to_dict())
    assert "consistent" in found.text()


@pytest.mark.parametrize("kind", [{}, {"right": False}, {"chain": False, "coupled": True}, {"floating": True}, {"rotors": False}])
def test_real_links_are_never_doubted(kind: dict[str, object]) -> None:
    for seed in range(4):
        structure, full = random_structure(np.random.default_rng(seed), 4, **kind)  # type: ignore[arg-type]
        assert judge_consistent(structure, structure.regroup @ full).consistent


def test_the_last_link_is_named() -> None:
    """An impossible last link (J6z^2 < J6(x-y)^2 + 4 J6xy^2) is named, alone."""
    structure, values, _ = puma_truth()
    bad = values.copy()
    bad[structure.base_names.index("Ixy_joint6")] = 0.06
    found = judge_consistent(structure, bad)
    assert not found.consistent
    assert found.violated_links == ("link6",)
    assert found.standard is None
    assert "link6" in found.text()
    assert found.shortfall["link6"] > 0


def test_signs_of_drive_parameters() -> None:
    structure, values, _ = puma_truth()
    bad = values.copy()
    for name in ("Ia_joint4", "Fv_joint2", "Fc_joint6"):
        bad[structure.base_names.index(name)] *= -1
    found = judge_consistent(structure, bad)
    assert not found.consistent
    assert set(found.violated_parameters) == {"Ia_joint4", "Fv_joint2", "Fc_joint6"}
    assert not found.violated_links


def test_fit_is_the_nearest_consistent_set() -> None:
    """No consistent set is nearer (checked along segments to other consistent sets: the problem is convex), and it lies on the border."""
    subject = puma_table("2")
    structure, values = subject.structure, subject.values
    C = ten_percent(values)
    target = Target.from_covariance(values, C)
    fit = fit_consistent(structure, target)
    assert judge_consistent(structure, fit.values).consistent
    distance = mahalanobis(covariance_root(C), fit.values - values)
    assert distance == pytest.approx(np.sqrt(fit.cost), rel=1e-6)
    _, truth, _ = puma_truth()
    inverse = np.linalg.inv(C)
    # First-order condition of the nearest point of a convex set: no consistent set lies on the estimate's side.
    for other in (truth, 0.5 * truth + 0.5 * fit.values):
        assert (fit.values - values) @ inverse @ (other - fit.values) > -1e-3 * distance**2
    toward = fit.values + 0.02 * (values - fit.values)
    assert not judge_consistent(structure, toward).consistent


def test_consistent_target_is_left_alone() -> None:
    structure, values, _ = puma_truth()
    fit = fit_consistent(structure, Target.from_covariance(values, ten_percent(values)))
    assert fit.cost < 1e-4
    assert np.allclose(fit.values, values, rtol=1e-3, atol=1e-6)


def test_information_and_covariance_agree() -> None:
    """From (R, z) and from the covariance (R'R)^-1 the same set comes out; columns that R does not see are free."""
    subject = puma_table("2")
    structure, values = subject.structure, subject.values
    rng = np.random.default_rng(0)
    R = np.linalg.qr(rng.standard_normal((200, len(values))) * 20 / np.abs(values), mode="r")
    first = fit_consistent(structure, Target.from_information(R, R @ values))
    second = fit_consistent(structure, Target.from_covariance(values, np.linalg.inv(R.T @ R)))
    assert first.cost == pytest.approx(second.cost, rel=1e-3)
    blind = R.copy()
    blind[:, structure.base_names.index("Fc_joint3")] = 0.0
    free = fit_consistent(structure, Target.from_information(blind, blind @ values))
    there = float(np.sum((blind @ (first.values - values)) ** 2))
    assert free.cost <= there * (1 + 1e-5)
    assert judge_consistent(structure, free.values).consistent


def test_bounds_hold() -> None:
    subject = puma_table("2")
    structure, values = subject.structure, subject.values
    corners = [[x, y, z] for x in (-0.1, 0.2) for y in (-0.1, 0.1) for z in (0.0, 0.3)]
    bounds = Bounds(
        total_mass=(20.0, 40.0),
        links=(
            LinkBounds("link6", mass=(1.0, 2.0), com_box=([-0.05] * 3, [0.15] * 3)),
            LinkBounds("link5", com_hull=corners),
            LinkBounds("link3", ellipsoid=([0.0, 0.0, 0.1], [0.1, 0.1, 0.2])),
        ),
    )
    fit = fit_consistent(structure, Target.from_covariance(values, ten_percent(values)), bounds=bounds)
    links = fit.standard[structure.inertial].reshape(-1, 10)
    tolerance = 1e-6
    assert 20 - tolerance <= links[:, 0].sum() <= 40 + tolerance
    assert 1 - tolerance <= links[5, 0] <= 2 + tolerance
    com = links[:, 1:4] / links[:, :1]
    assert np.all(com[5] >= -0.05 - tolerance)
    assert np.all(com[5] <= 0.15 + tolerance)
    assert np.all(com[4] >= np.min(corners, 0) - tolerance)
    assert np.all(com[4] <= np.max(corners, 0) + tolerance)
    assert np.linalg.norm((com[2] - [0, 0, 0.1]) / [0.1, 0.1, 0.2]) <= 1 + tolerance
    without = fit_consistent(structure, Target.from_covariance(values, ten_percent(values)))
    assert fit.cost >= without.cost - 0.1


@pytest.mark.parametrize(
    ("bounds", "words"),
    [
        (Bounds(total_mass=(5.0, 1.0)), "above the most"),
        (Bounds(links=(LinkBounds("link7"),)), "link7"),
        (Bounds(links=(LinkBounds("link6", com_box=([0, 0, 0], [0, 0])),)), "three finite numbers"),
        (Bounds(links=(LinkBounds("link6", com_box=([1, 0, 0], [0, 0, 0])),)), "lower corner"),
        (Bounds(links=(LinkBounds("link6", com_hull=[[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]),)), "no volume"),
        (Bounds(links=(LinkBounds("link6", ellipsoid=([0, 0, 0], [1, 0, 1])),)), "semi-axes"),
    ],
)
def test_bad_bounds_are_refused(bounds: Bounds, words: str) -> None:
    structure, values, _ = puma_truth()
    with pytest.raises(ConfigurationError, match=words):
        fit_consistent(structure, Target.from_covariance(values, ten_percent(values)), bounds=bounds)


def test_infeasible_bounds_are_said() -> None:
    structure, values, _ = puma_truth()
    bounds = Bounds(total_mass=(1.0, 10.0), links=(LinkBounds("link6", mass=(40.0, None)),))
    with pytest.raises(InfeasibleError, match="loosen the bounds"):
        fit_consistent(structure, Target.from_covariance(values, ten_percent(values)), bounds=bounds)


@pytest.mark.parametrize("metric", list(Metric))
def test_priors_minimise_their_metric(metric: Metric) -> None:
    """Standard parameters nearest to other links: none nearby with the same base values are nearer; at home it is zero."""
    structure, values, links = puma_truth()
    home = standard_parameters(structure, values, prior=Prior(links, metric))
    assert home.distance == pytest.approx(0, abs=1e-8)
    assert home.error < 1e-9
    rng = np.random.default_rng(0)
    other = links.reshape(-1, 10) * rng.uniform(0.6, 1.6, (6, 1))
    prior = Prior(other.reshape(-1), metric)
    found = standard_parameters(structure, values, prior=prior)
    assert found.metric == metric.value
    assert found.distance is not None
    assert np.allclose(structure.regroup @ found.values, values, rtol=1e-9, atol=1e-10)
    assert np.all(smallest_eigenvalues(found.inertial) > 0)
    for _ in range(20):
        step = structure.null_space @ rng.standard_normal(structure.null_space.shape[1])
        trial = found.values + 1e-3 * step
        if np.all(smallest_eigenvalues(trial[structure.inertial]) > 0) and np.all(trial[structure.drive] >= 0):
            assert prior_distance(structure, prior, trial) >= found.distance * (1 - 1e-6)
    assert json.dumps(found.to_dict())
    assert "link6" in found.text()


def test_metrics_agree_to_second_order() -> None:
    structure, _, links = puma_truth()
    rng = np.random.default_rng(1)
    full = np.zeros(structure.k)
    full[structure.inertial] = (links.reshape(-1, 10) * (1 + 1e-3 * rng.standard_normal((6, 1)))).reshape(-1)
    distances = [prior_distance(structure, Prior(links, m), full) for m in Metric]
    assert distances == pytest.approx([distances[0]] * 3, rel=5e-3)


@pytest.mark.parametrize("metric", list(Metric))
def test_prior_trades_fit_against_distance(metric: Metric) -> None:
    subject = puma_table("2")
    _, _, links = puma_truth()
    target = Target.from_covariance(subject.values, ten_percent(subject.values))
    costs, distances = [], []
    for spread in (3.0, 0.3):
        prior = Prior(links, metric, spread)
        fit = fit_consistent(subject.structure, target, prior=prior)
        costs.append(fit.cost)
        distances.append(prior_distance(subject.structure, prior, fit.standard))
    assert costs[0] < costs[1]
    assert distances[0] > distances[1]


def test_prior_errors_and_gaps() -> None:
    structure, values, links = puma_truth()
    broken = links.copy()
    broken[14] = -1.0
    with pytest.raises(ConfigurationError, match="link2"):
        standard_parameters(structure, values, prior=Prior(broken))
    with pytest.raises(ConfigurationError, match="ten each"):
        standard_parameters(structure, values, prior=Prior(links[:-1]))
    with pytest.raises(ConfigurationError, match="positive"):
        Prior(links, spread=0.0)
    partial = links.copy()
    partial[50:] = 0.0
    found = standard_parameters(structure, values, prior=Prior(partial, "entropic"))
    assert any("link6" in note for note in found.notes)
    prior, notes = nominal_prior(load_robot("puma560"))
    assert prior is not None
    assert not notes


def test_standard_parameters_of_an_inconsistent_set_are_refused() -> None:
    subject = puma_table("1")
    with pytest.raises(InfeasibleError, match="Repair them first"):
        standard_parameters(subject.structure, subject.values)


def test_binding_constraints_name_what_costs() -> None:
    structure, values, _ = puma_truth()
    bad = values.copy()
    bad[structure.base_names.index("Ixy_joint6")] = 0.06
    bad[structure.base_names.index("Fv_joint2")] *= -1
    found = binding_constraints(structure, Target.from_covariance(bad, ten_percent(bad)))
    assert {"link6", "Fv_joint2"} <= set(found.costs)
    assert "Fv_joint3" not in found.costs
    assert found.costs["Fv_joint2"] == pytest.approx(100, rel=0.01)
    assert found.costs["link6"] > 10
    # The sign does not touch the links: what it does not cost, they do.
    assert found.distance**2 > 100 + found.costs["link6"] - 0.1
    assert found.significant
    assert "ident diagnose" in found.sentences()[0]
    assert json.dumps(found.to_dict())


def test_binding_within_noise() -> None:
    """Estimates of a robot on the border: the distance is what noise gives, and is called that."""
    subject = puma_table("2")
    structure = subject.structure
    C = ten_percent(subject.values)
    border = fit_consistent(structure, Target.from_covariance(subject.values, C)).values
    rng = np.random.default_rng(5)
    chances = []
    for _ in range(6):
        noisy = border + covariance_root(C) @ rng.standard_normal(structure.b)
        found = binding_constraints(structure, Target.from_covariance(noisy, C))
        chances.append(found.chance)
        assert not found.significant
    assert min(chances) > 0.005
    assert max(chances) > 0.2
    inside = binding_constraints(structure, Target.from_covariance(puma_truth()[1], C))
    assert inside.distance < 0.05
    assert not inside.costs


@pytest.mark.parametrize("known", [False, True])
def test_what_the_data_hardly_see_is_settled(known: bool) -> None:
    """Links near the nominal ones, or light ones, at most one standard deviation from the best fit; the best fit's own may be absurd."""
    structure, values, links = puma_truth()
    rng = np.random.default_rng(2)
    C = ten_percent(values)
    target = Target.from_covariance(values + 2.0 * covariance_root(C) @ rng.standard_normal(structure.b), C)
    best = fit_consistent(structure, target)
    near = Prior(links) if known else None
    found = fit_consistent(structure, target, settling=Settling(near))
    assert found.cost <= best.cost + 1.0 + 1e-3
    assert mahalanobis(covariance_root(C), found.values - best.values) <= 1.0 + 1e-2
    assert judge_consistent(structure, found.values).consistent
    assert "barely determine" in found.notes[-1]
    if near is not None:
        far, close = (prior_distance(structure, replace(near, metric=Metric.ENTROPIC), f.standard) for f in (best, found))
        assert close < 0.2 * far
    else:
        total = [f.standard[structure.inertial[::10]].sum() for f in (best, found)]
        assert total[1] < total[0]
    tight = fit_consistent(structure, target, settling=Settling(near, share=0.01))
    assert tight.cost <= 1.01 * best.cost + 1e-3


def test_fallback_without_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    """Log-Cholesky factors reach nearly the same cost, say what they are, and refuse what they cannot do."""
    subject = puma_table("1")
    target = Target.from_covariance(subject.values, ten_percent(subject.values))
    best = fit_consistent(subject.structure, target)
    found = fit_log_cholesky(subject.structure, target)
    assert "fallback" in found.method
    assert "local optimum" in found.notes[0]
    assert best.cost - 1e-6 <= found.cost <= 1.03 * best.cost
    assert judge_consistent(subject.structure, found.values).consistent
    with pytest.raises(UnsupportedError, match="ident\\[sdp\\]"):
        fit_log_cholesky(subject.structure, target, bounds=Bounds(total_mass=(1.0, 2.0)))
    with pytest.raises(UnsupportedError, match="quadratic"):
        fit_log_cholesky(subject.structure, target, prior=Prior(puma_truth()[2], "entropic"))
    monkeypatch.setattr("ident.physical.repairs.solver_available", lambda: False)
    assert "fallback" in consistent_fit(*_small()).method
    with pytest.raises(ConfigurationError, match="method of the consistent fit"):
        consistent_fit(*_small(), method="magic")


def _small() -> tuple[object, Target]:
    structure, full = random_structure(np.random.default_rng(1), 2)
    values = structure.regroup @ full
    return structure, Target.from_covariance(values, ten_percent(values))


def test_log_cholesky_slopes() -> None:
    subject = puma_table("2")
    _, _, links = puma_truth()
    prior = Prior(links)
    fit = _Factors(subject.structure, Target.from_covariance(subject.values, ten_percent(subject.values)), prior)
    x = fit.starts(None, prior)[0] + 0.1 * np.random.default_rng(0).standard_normal(len(fit.lower))
    J, step = fit.jacobian(x), 1e-6
    numeric = np.array([(fit.residual(x + step * d) - fit.residual(x - step * d)) / (2 * step) for d in np.eye(len(x))]).T
    assert np.abs(J - numeric).max() < 1e-8 * np.abs(J).max()


def test_missing_solver_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ident.physical.conic.solver_available", lambda: False)
    with pytest.raises(ConfigurationError, match="pip install 'ident\\[sdp\\]'"):
        require_solver("this")
    structure, values, _ = puma_truth()
    with pytest.raises(ConfigurationError, match="ident\\[sdp\\]"):
        judge_consistent(structure, values)
    with pytest.raises(ConfigurationError, match="ident\\[sdp\\]"):
        fit_consistent(structure, Target.fixed(values))


def test_solver_failures_are_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    """An unbounded program and a result that does not hold when checked are errors, never results."""
    program = ConicProgram()
    x = program.variables(1)
    program.linear(x, np.array([-1.0]))
    program.nonnegative(np.zeros(1), [(x, np.ones((1, 1)))])
    with pytest.raises(SolverError, match="stopped with"):
        program.solve("a test")
    program = ConicProgram()
    x = program.variables(1)
    program.nonnegative(np.array([-1.0, -1.0]), [(x, np.array([[1.0, -1.0]]))])
    with pytest.raises(InfeasibleError, match="a test"):
        program.solve("a test")
    monkeypatch.setattr("ident.physical.constrained._holds", lambda *_: False)
    structure, values, _ = puma_truth()
    with pytest.raises(SolverError, match="not consistent when checked"):
        fit_consistent(structure, Target.from_covariance(values, ten_percent(values)))


def test_bad_covariances_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="negative variance"):
        covariance_root(np.diag([1.0, -1.0]))
    with pytest.raises(ConfigurationError, match="not positive semidefinite"):
        covariance_root(np.array([[1.0, 2.0], [2.0, 1.0]]))
    root = covariance_root(np.diag([4.0, 0.0]))
    assert mahalanobis(root, np.array([2.0, 0.0])) == pytest.approx(1.0)
    assert mahalanobis(root, np.array([0.0, 1.0])) == np.inf
    assert mahalanobis(root, np.array([2.0, 5.0]), np.array([[0.0], [1.0]])) == pytest.approx(1.0)


def test_pseudo_inertia_of_a_ball() -> None:
    ball = from_centre_of_mass(2.0, np.array([0.1, 0, 0]), 2 / 5 * 2.0 * 0.3**2 * np.eye(3))
    J = pseudo_inertia(ball)
    assert np.allclose(np.linalg.eigvalsh(J[:3, :3] - np.outer(J[:3, 3], J[:3, 3]) / J[3, 3]), 2.0 * 0.3**2 / 5)
