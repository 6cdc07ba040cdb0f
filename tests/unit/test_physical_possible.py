"""Judging whether base parameters are possible: published sets, grids, certificates, distance from the border."""

from __future__ import annotations

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest
from physical_models import puma_table, puma_truth, random_structure

from ident.errors import ConfigurationError
from ident.physical import GridTest, judge, judge_on_grid, judge_possible, published_subject
from ident.physical.certificate import certify
from ident.physical.grid import first_failure
from ident.physical.search import minimise_eigenvalue, random_positions, typical_diagonal
from ident.robots import load_robot, published_tables

Array = np.ndarray
#: Verdicts of an independent search: smallest eigenvalue in kg m^2, worst theta_2 .. theta_6 in degrees.
PUBLISHED = {
    "1": (0.08683, (97, -161, 31, 120, 140), {"link6", "link5"}),
    "2": (-1.23461, (179, -85, 125, 104, -31), {"link3", "link4", "link5", "link6"}),
    "3": (0.16950, (-118, 108, 175, -169, 130), {"link4", "link6"}),
}


@pytest.mark.parametrize("number", ["1", "2", "3"])
def test_published_tables(number: str) -> None:
    """The verified verdicts, with K as printed."""
    wanted, degrees, links = PUBLISHED[number]
    subject = puma_table(number)
    found = judge(subject)
    assert found.possible.possible == (wanted > 0)
    assert found.possible.certified
    assert found.possible.min_eigenvalue == pytest.approx(wanted, abs=1.1e-5)
    assert found.consistent is not None
    assert not found.consistent.consistent
    assert set(found.consistent.violated_links) == links
    # The published worst configuration is one: nearly as low, and no lower than the minimum found.
    q = np.concatenate([[0.0], np.radians(degrees)])[None]
    there = np.linalg.eigvalsh(subject.structure.inertia_matrix(subject.values, q)[0])[0]
    assert found.possible.min_eigenvalue <= there + 1e-9
    assert there == pytest.approx(wanted, rel=0.02)
    assert "joint1" not in found.possible.worst_configuration
    body = json.loads(json.dumps(found.to_dict()))
    assert body["certified"]
    assert body["possible"] == (wanted > 0)
    assert "link6" in body["violated_links"]
    assert body["worst_configuration"].keys() == {f"joint{i}" for i in range(2, 7)}
    assert "link6" in found.text()


def test_time_for_six_joints() -> None:
    """Processor time: the machine may be shared."""
    import time

    subject = puma_table("1")
    judge_possible(subject.structure, subject.values)
    start = time.process_time()
    judge_possible(subject.structure, subject.values)
    assert time.process_time() - start < 1.0


def test_bound_is_tight_for_possible_tables() -> None:
    for number in ("1", "3"):
        subject = puma_table(number)
        found = judge_possible(subject.structure, subject.values)
        assert 0.998 * found.min_eigenvalue < found.lower_bound <= found.min_eigenvalue + 1e-9


def test_grid_judgements() -> None:
    subject = puma_table("2")
    minors = judge_on_grid(subject.structure, subject.values, points=4)
    pivots = judge_on_grid(subject.structure, subject.values, test=GridTest.PIVOTS, points=4)
    assert not minors.possible
    assert not pivots.possible
    assert minors.certified
    assert pivots.evaluations < minors.evaluations
    assert 0 < minors.share <= 1
    good = puma_table("1")
    assert judge_on_grid(good.structure, good.values, points=4).possible
    pivots = judge_on_grid(good.structure, good.values, test="pivots", points=4)
    assert pivots.possible
    assert not pivots.certified
    assert pivots.order == 0
    with pytest.raises(ConfigurationError, match="fewer points"):
        judge_on_grid(good.structure, good.values, points=100)
    assert "not possible" in minors.text()
    assert json.dumps(minors.to_dict())


def test_first_failure_is_the_first_minor() -> None:
    A = np.random.default_rng(0).standard_normal((200, 4, 4))
    A = A @ np.swapaxes(A, 1, 2) + 0.5 * A + 0.5 * np.swapaxes(A, 1, 2)
    for H, order in zip(A, first_failure(A), strict=True):
        minors = [np.linalg.det(H[:k, :k]) for k in range(1, 5)]
        assert order == next((k + 1 for k, m in enumerate(minors) if m <= 0), 0)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "kind",
    [
        {},
        {"limits": True, "prismatic": 0.5},
        {"right": False, "coupled": True},
        {"chain": False, "coupled": True},
        {"floating": True, "limits": True},
    ],
)
def test_bound_against_brute_force(kind: dict[str, object], seed: int) -> None:
    """The certified bound is below every eigenvalue of a dense sample, and close to the smallest one found."""
    rng = np.random.default_rng(seed)
    structure, full = random_structure(rng, 4, **kind)  # type: ignore[arg-type]
    values = structure.regroup @ full
    values = values * (1 + 0.15 * rng.standard_normal(structure.b))
    lower, upper, _ = structure.ranges(bool(kind.get("limits")))
    weight = typical_diagonal(structure, values, lower, upper)
    bound = certify(structure, values, lower, upper, weight, splits=False).bound
    q = random_positions(structure, lower, upper, 20_000, rng)
    scale = 1 / np.sqrt(weight)
    brute = np.linalg.eigvalsh(structure.inertia_matrix(values, q) * np.outer(scale, scale))[:, 0].min()
    found = minimise_eigenvalue(structure, values, lower, upper, weight=scale)
    assert bound <= found.eigenvalue + 1e-9
    assert found.eigenvalue <= brute + 1e-6 * abs(brute)
    assert bound > found.eigenvalue - 0.1 * max(abs(found.eigenvalue), 0.1)


def test_branching_tightens_a_bound() -> None:
    """Where one box leaves a gap, halves are bounded on their own; the bound rises, and stays one."""
    rng = np.random.default_rng(11)
    for _ in range(40):
        structure, full = random_structure(rng, 4, prismatic=0.0)
        lower, upper, _ = structure.ranges(False)
        values = structure.regroup @ full
        values = values * (1 + 0.6 * rng.standard_normal(structure.b))
        weight = typical_diagonal(structure, values, lower, upper)
        whole = certify(structure, values, lower, upper, weight, splits=False)
        low = minimise_eigenvalue(structure, values, lower, upper, weight=1 / np.sqrt(weight)).eigenvalue
        if whole.bound < low - 0.02 and low < 0:
            split = certify(structure, values, lower, upper, weight, time_limit=1.0)
            assert split.pieces > 1
            assert whole.bound + 1e-4 < split.bound <= low + 1e-9
            assert "pieces" in split.reason
            return
    raise AssertionError("no robot with a gap among 40")


def test_limits_can_make_a_set_possible() -> None:
    """A set that fails at some postures only is possible within limits that exclude them."""
    subject = puma_table("1")
    structure, values = subject.structure, subject.values
    C = np.diag((0.05 * np.abs(values)) ** 2)
    first = judge_possible(structure, values)
    row = structure.quadratic_rows(first.worst_position[None], first.worst_vector[None])[0]
    values = values - 1.2 * first.min_eigenvalue * (C @ row) / (row @ C @ row)
    free = judge_possible(structure, values)
    assert not free.possible
    assert free.certified
    q = np.random.default_rng(0).uniform(-3, 3, (5000, 6))
    best = q[np.argmax(np.linalg.eigvalsh(structure.inertia_matrix(values, q))[:, 0])]
    near = replace(structure, lower=best - 0.2, upper=best + 0.2)
    found = judge_possible(near, values, limits=True)
    assert found.possible
    assert found.certified
    assert found.within_limits
    for name, value in found.worst_configuration.items():
        i = structure.joint_names.index(name)
        assert near.lower[i] - 1e-9 <= value <= near.upper[i] + 1e-9


def test_distance_from_the_border() -> None:
    """Along the direction of steepest approach the set meets the border after as many standard deviations as said."""
    subject = puma_table("1")
    structure, values = subject.structure, subject.values
    std = 0.05 * np.abs(values) + 1e-6
    C = np.diag(std**2)
    found = judge_possible(structure, values, covariance=C)
    assert found.margin_std is not None
    assert found.margin_std > 0
    # The half-space that is nearest: step to its face, and a little further the set is not possible.
    row = structure.quadratic_rows(found.worst_position[None], found.worst_vector[None])[0]
    first_order = (row @ values) / np.sqrt(row @ C @ row)
    assert found.margin_std <= first_order + 1e-9
    beyond = values - 1.02 * first_order * (C @ row) / np.sqrt(row @ C @ row)
    assert not judge_possible(structure, beyond).possible
    rng = np.random.default_rng(0)
    for _ in range(2):
        u = rng.standard_normal(len(values))
        inside = values + 0.98 * found.margin_std * std * u / np.linalg.norm(u)
        assert judge_possible(structure, inside).min_eigenvalue > 0
    outside = judge_possible(puma_table("2").structure, puma_table("2").values, covariance=C)
    assert outside.margin_std is not None
    assert outside.margin_std < 0


@pytest.mark.parametrize("table", ["1", "2", "3"])
def test_the_links_alone_are_judged_as_if_nothing_were_known_of_the_rotors(table: str) -> None:
    subject = puma_table(table)
    shared, fresh = judge(subject).alone, judge_possible(subject.matrices["H"], subject.values)
    assert shared is not None
    assert (shared.possible, shared.certified) == (fresh.possible, fresh.certified)
    assert shared.min_eigenvalue == pytest.approx(fresh.min_eigenvalue, rel=1e-3)


def test_rotors_that_weigh_nothing_leave_one_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    subject = puma_table("1")
    structure = subject.structure
    light = replace(subject, values=np.where(np.any(structure.lift[structure.drive] != 0, axis=0), 0.0, subject.values))
    found, called = judge_possible, []
    monkeypatch.setattr("ident.physical.judgement.judge_possible", lambda *a, **k: (called.append(1), found(*a, **k))[1])
    judged = judge(light)
    assert len(called) == 1
    assert judged.alone is not None
    assert (
        judged.alone.min_eigenvalue
        == judged.possible.min_eigenvalue
        == pytest.approx(found(subject.matrices["H"], light.values).min_eigenvalue, rel=1e-3)
    )


def test_without_the_solver_a_verdict_is_not_certified(monkeypatch: pytest.MonkeyPatch) -> None:
    import ident.physical.conic as conic

    monkeypatch.setattr(conic, "solver_available", lambda: False)
    monkeypatch.setattr("ident.physical.certificate.solver_available", lambda: False)
    monkeypatch.setattr("ident.physical.judgement.solver_available", lambda: False)
    found = judge(puma_table("1"))
    assert found.possible.possible
    assert not found.possible.certified
    assert any("ident[sdp]" in note for note in found.possible.notes)
    assert found.consistent is None
    assert "ident[sdp]" in found.text()
    # What is not possible is proven by a configuration, solver or not.
    assert judge(puma_table("2")).possible.certified


def test_one_joint_and_parallel_branches() -> None:
    rng = np.random.default_rng(2)
    structure, full = random_structure(rng, 1)
    found = judge_possible(structure, structure.regroup @ full)
    assert found.possible
    assert found.certified
    assert found.worst_configuration == {}
    pairs = itertools.product((True, False), (0.0, 0.5))
    for chain, prismatic in pairs:
        structure, full = random_structure(rng, 3, chain=chain, prismatic=prismatic)
        assert judge_possible(structure, structure.regroup @ full).certified


def test_singular_set_lies_on_the_border() -> None:
    structure, values, _ = puma_truth()
    found = judge_possible(structure, np.zeros_like(values))
    assert not found.possible
    assert found.min_eigenvalue == pytest.approx(0, abs=1e-12)
    assert any("border" in note for note in found.notes)


def test_published_names_are_checked() -> None:
    robot, table = load_robot("puma560"), dict(published_tables("puma560")["1"].values)
    with pytest.raises(ConfigurationError, match="J9z"):
        published_subject(robot, table | {"J9z": 1.0})
    table.pop("h6")
    with pytest.raises(ConfigurationError, match="Ia_joint6"):
        published_subject(robot, table)


@pytest.mark.parametrize("seed", range(4))
def test_of_positions_half_a_turn_apart_the_nearest_to_zero_is_named(seed: int) -> None:
    subject = puma_table("1")
    structure = subject.structure
    turn = np.full(structure.n, np.pi)
    found = minimise_eigenvalue(structure, subject.values, -turn, turn, seed=seed)
    for i in np.flatnonzero(structure.relevant & (np.abs(found.q) > np.pi / 2)):
        image = found.q.copy()
        image[i] -= np.copysign(np.pi, image[i])
        there = np.linalg.eigvalsh(structure.inertia_matrix(subject.values, image[None])[0])[0]
        assert there > found.eigenvalue + 1e-5 * abs(found.eigenvalue)
