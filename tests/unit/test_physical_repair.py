"""Repairs: every one passes its own judgement, and the nearest is nearer than the dissertation's."""

from __future__ import annotations

import json

import numpy as np
import pytest
from physical_models import puma_model, puma_table, puma_truth, random_structure

from ident.effects.motion import Motion
from ident.errors import ConfigurationError, UnsupportedError
from ident.physical import Bounds, InfeasibleError, Repair, RepairMethod, SolverError, judge_possible, repair
from ident.physical.cuts import _least_distance, nearest_by_cuts
from ident.physical.search import typical_diagonal
from ident.physical.stepwise import entering_parameters, repair_stepwise
from ident.physical.target import covariance_root, mahalanobis
from ident.problem.information import Information

Array = np.ndarray
#: A seed whose set is not possible, and whose nearest possible one misses its own judgement by rounding.
_OUTSIDE = 8


def information(values: Array, samples: int, noise: float, seed: int) -> Information:
    """Rows of the PUMA model along smooth random motion, over its base columns."""
    model = puma_model()
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2, 2, (samples, 6))
    motion = Motion.of(model.robot, q, 1.5 * rng.standard_normal((samples, 6)), 5 * rng.standard_normal((samples, 6)))
    columns = model.columns(motion)[:, :, model.base.independent]
    tau = columns @ values + noise * rng.standard_normal((samples, 6))
    return Information.empty(6, model.base.names).with_rows(columns, tau)


@pytest.fixture(scope="module")
def metric() -> Array:
    """Covariance of a least-squares fit over little motion: correlated, of unlike size."""
    R, _, _ = information(puma_table("2").values, 400, 0.02, 0).combined(np.full(6, 1 / 0.02**2))
    return np.linalg.inv(R.T @ R)


@pytest.fixture(scope="module", params=["relative", "fitted"])
def repairs(request: pytest.FixtureRequest, metric: Array) -> dict[str, Repair]:
    """All repairs of table 2 in two metrics: 10 % of each value, and a fit's covariance."""
    subject = puma_table("2")
    covariance = np.diag((0.1 * subject.values) ** 2) if request.param == "relative" else metric
    return {m: repair(subject.structure, subject.values, covariance, m) for m in ("stepwise", "possible", "consistent")}


@pytest.mark.parametrize("method", ["stepwise", "possible"])
def test_a_margin_too_small_to_pass_is_enlarged_and_told(method: str) -> None:
    """A target next to the feasibility boundary may miss it by the rounding of the search: the next one is farther inside."""
    structure, full = random_structure(np.random.default_rng(3), 2, prismatic=0.0)
    values = structure.regroup @ full
    std = 0.8 * np.abs(values)
    values = values + std * np.random.default_rng(_OUTSIDE).standard_normal(structure.b)
    assert not judge_possible(structure, values).possible
    found = repair(structure, values, np.diag(std**2), method, margin=1e-15)
    assert found.possible.possible
    assert "with a margin of 0.001" in found.how
    assert "with a margin" in found.text()
    assert "with a margin" not in repair(structure, values, np.diag(std**2), method).how


def test_repairs_of_table_2(repairs: dict[str, Repair]) -> None:
    for name, found in repairs.items():
        assert found.possible.possible, name
        assert found.possible.certified, name
        assert found.distance > 1
        assert np.all(np.isfinite(found.values))
        assert json.dumps(found.to_dict())
        assert name in found.text()
    assert repairs["consistent"].consistent is not None
    assert repairs["consistent"].consistent.consistent
    # The nearest possible set costs no more than the stepwise one, nor than the nearest consistent one (which is possible, too).
    assert repairs["possible"].distance <= repairs["stepwise"].distance * 1.001
    assert repairs["possible"].distance <= repairs["consistent"].distance * 1.05


def test_possible_is_nearest(metric: Array) -> None:
    """A lower bound from the half-spaces: the distance returned is not above that of any possible set on the way to the truth."""
    subject = puma_table("2")
    found = repair(subject.structure, subject.values, metric, "possible")
    root = covariance_root(metric)
    _, truth, _ = puma_truth()
    assert found.distance < mahalanobis(root, truth - subject.values)
    nearer = subject.values + 0.97 * (found.values - subject.values)
    assert not judge_possible(subject.structure, nearer).possible
    border = judge_possible(subject.structure, subject.values, covariance=metric).margin_std
    assert border is not None
    assert -border <= found.distance * 1.001


def test_what_is_possible_is_not_changed() -> None:
    subject = puma_table("1")
    for method in ("possible", "stepwise"):
        found = repair(subject.structure, subject.values, None, method, margin=1e-3)
        assert found.distance == 0
        assert np.array_equal(found.values, subject.values)
    assert any("10 %" in note for note in found.notes)


def test_stepwise_goes_from_the_tip() -> None:
    """Each step changes only what enters with its joint; the blocks behind it stay as they were."""
    subject = puma_table("2")
    structure, values = subject.structure, subject.values
    lower, upper, _ = structure.ranges(False)
    entering = entering_parameters(structure, lower, upper)
    assert "Izz_joint6" in {structure.base_names[i] for i in entering[5]}
    assert sum(len(e) for e in entering) == len(set(np.concatenate(entering).tolist()))
    weight = typical_diagonal(structure, values, lower, upper)
    repaired, steps = repair_stepwise(structure, values, 0.1 * np.abs(values), weight=weight, margin=1e-2, lower=lower, upper=upper)
    assert [s.joint for s in steps] == [f"joint{i}" for i in (6, 5, 4, 3, 2, 1)]
    for i, step in zip((5, 4, 3, 2, 1, 0), steps, strict=True):
        assert set(step.changes) <= {structure.base_names[k] for k in entering[i]}
        assert step.eigenvalue >= 0.9e-2
    q = np.random.default_rng(0).uniform(-3, 3, (2000, 6))
    assert np.linalg.eigvalsh(structure.inertia_matrix(repaired, q)).min() > 0


def test_constrained_fit_from_information() -> None:
    """The direct fit is consistent, costs no more than the repair in the same metric, and its errors are reported on both data sets."""
    _, truth, _ = puma_truth()
    structure = puma_table("1").structure
    fitted, held = information(truth, 60, 0.5, 1), information(truth, 400, 0.5, 2)
    R, z, _ = fitted.combined(np.full(6, 1 / 0.5**2))
    values, covariance = np.linalg.solve(R, z), np.linalg.inv(R.T @ R)
    found = repair(structure, values, covariance, "fit", triangle=(R, z), data={"fitted": fitted, "held out": held})
    assert found.consistent is not None
    assert found.consistent.consistent
    assert found.standard is not None
    assert np.allclose(structure.regroup @ found.standard, found.values, rtol=1e-9, atol=1e-9)
    other = repair(structure, values, covariance, "consistent")
    # What each gives away for links that make sense: one squared standard deviation, one hundredth.
    assert other.distance**2 <= 1.01 * (found.distance**2 + 1e-3)
    assert found.distance**2 <= other.distance**2 + 1.01
    assert found.binding is not None
    assert found.binding.distance <= other.distance * (1 + 1e-4)
    errors = found.errors["held out"]
    assert errors["after"]["relative_all"] <= errors["before"]["relative_all"] * 1.01
    assert found.errors["fitted"]["after"]["relative_all"] >= found.errors["fitted"]["before"]["relative_all"] - 1e-12
    # With the right constraints the estimate is nearer to the truth.
    std = np.sqrt(np.diag(covariance))
    assert np.linalg.norm((found.values - truth) / std) < np.linalg.norm((values - truth) / std)
    assert "held out" in found.text()


def test_unseen_directions_are_free() -> None:
    """A parameter the log did not show is chosen, not held at zero: the repair is not blamed for it."""
    _, truth, _ = puma_truth()
    structure = puma_table("1").structure
    gone = structure.base_names.index("Ia_joint4")
    values = truth.copy()
    values[gone] = 0.0
    std = 0.05 * np.abs(truth)
    std[gone] = 0.0
    unseen = np.eye(structure.b)[:, [gone]]
    found = repair(structure, values, np.diag(std**2), "consistent", unseen=unseen)
    assert found.values[gone] > 0
    assert found.distance < 0.1
    with pytest.raises(InfeasibleError, match="Ia_joint4"):
        repair(structure, values, np.diag(std**2), "consistent")


def test_bounds_reach_the_repair() -> None:
    subject = puma_table("2")
    found = repair(subject.structure, subject.values, None, "consistent", bounds=Bounds(total_mass=(None, 30.0)))
    assert found.standard is not None
    assert found.standard[subject.structure.inertial[::10]].sum() <= 30 + 1e-6
    with pytest.raises(UnsupportedError, match="neither bounds nor a prior"):
        repair(subject.structure, subject.values, None, "possible", bounds=Bounds())


def test_wrong_requests() -> None:
    subject = puma_table("2")
    with pytest.raises(ConfigurationError, match="consistent"):
        repair(subject.structure, subject.values, None, "consistant")
    with pytest.raises(ConfigurationError, match="triangle"):
        repair(subject.structure, subject.values, None, RepairMethod.FIT)
    with pytest.raises(ConfigurationError, match="shape"):
        repair(subject.structure, subject.values, np.eye(3), "possible")
    with pytest.raises(InfeasibleError, match="no change"):
        repair(subject.structure, subject.values, np.zeros((52, 52)), "possible")


def test_what_fails_its_own_judgement_is_not_returned(monkeypatch: pytest.MonkeyPatch) -> None:
    subject = puma_table("2")
    monkeypatch.setattr("ident.physical.repairs._possible", lambda structure, values, *_: (values, "nothing at all"))
    with pytest.raises(SolverError, match="does not pass its own judgement"):
        repair(subject.structure, subject.values, None, "possible")


def test_time_is_limited(metric: Array) -> None:
    subject = puma_table("2")
    lower, upper, _ = subject.structure.ranges(False)
    weight = typical_diagonal(subject.structure, subject.values, lower, upper)
    with pytest.raises(SolverError, match="Allow more time"):
        nearest_by_cuts(
            subject.structure, subject.values, covariance_root(metric), weight=weight, margin=1e-2, lower=lower, upper=upper, time_limit=0.0
        )


def test_least_distance() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        G, h = rng.standard_normal((6, 4)), rng.standard_normal(6)
        try:
            x = _least_distance(G, h)
        except InfeasibleError:
            from scipy.optimize import linprog

            assert linprog(np.zeros(4), -G, -h, bounds=[(None, None)] * 4).status == 2
            continue
        assert np.all(G @ x >= h - 1e-9)
        for _ in range(50):
            y = x + 0.1 * rng.standard_normal(4)
            assert not np.all(G @ y >= h) or np.linalg.norm(y) >= np.linalg.norm(x) - 1e-9
