"""Chapter 4 as written: cones of the minors of the inertia matrix, the judgement by them, and the modification by Steps 1 to 4."""

from __future__ import annotations

import json
from functools import lru_cache

import numpy as np
import pytest
from physical_models import puma_table, random_structure
from scipy.optimize import nnls

from ident.errors import UnsupportedError
from ident.physical import (
    InertiaStructure,
    Judgement,
    MinorOrder,
    SolverError,
    Subject,
    TooManyRaysError,
    judge,
    judge_by_cone,
    judge_on_grid,
    judge_possible,
    modify_by_cone,
    repair,
)
from ident.physical.cone import PolyhedralCone
from ident.physical.cone_judgement import cone_of
from ident.physical.minors import cofactors, minor_of, minor_rows
from ident.physical.trigonometric import Sign, TrigonometricPolynomial, coefficients_on_grid, grid

Array = np.ndarray
#: Smallest eigenvalue of H alone, and with rotors; share of an 8^5 grid where H alone is not positive definite; first joint of the
#: trailing minor of H alone that is outside its cone.
PUBLISHED = {"1": (-0.0605, 0.0868, 0.70, "joint5"), "2": (-2.165, -1.235, 1.00, "joint5"), "3": (-0.0079, 0.1695, 0.42, "joint4")}


def random_set(seed: int, joints: int) -> tuple[InertiaStructure, Array]:
    """A revolute chain with and without rotors, and base values off by up to their own size."""
    rng = np.random.default_rng(seed)
    right, rotors, coupled = rng.random(3) < 0.5
    structure, full = random_structure(rng, joints, prismatic=0.0, right=bool(right), rotors=bool(rotors), coupled=bool(coupled))
    return structure, structure.regroup @ full * (1 + rng.choice([0.3, 0.6, 1.0]) * rng.standard_normal(structure.b))


@lru_cache
def impossible(joints: int) -> tuple[InertiaStructure, Array]:
    """The first random set that is not possible, but not far from it."""
    for seed in range(100):
        structure, values = random_set(seed, joints)
        if not judge_possible(structure, values).possible and repair(structure, values, None, "possible").distance < 5:
            return structure, values
    raise AssertionError("none found")


@lru_cache
def judged(number: str) -> Judgement:
    return judge(puma_table(number))


@pytest.mark.parametrize("number", ["1", "2", "3"])
def test_tables_for_h_alone_and_with_rotors(number: str) -> None:
    alone, rotors, *_ = PUBLISHED[number]
    found = judged(number)
    assert found.matrix == "H + K^-T R K^-1"
    assert found.possible.min_eigenvalue == pytest.approx(rotors, abs=6e-4)
    assert found.alone is not None
    assert found.alone.min_eigenvalue == pytest.approx(alone, abs=6e-4)
    assert found.alone.certified
    assert not found.alone.possible
    body = json.loads(json.dumps(found.to_dict()))
    assert body["alone"]["possible"] is False
    assert body["matrix"] == found.matrix
    # The verdicts differ for tables 1 and 3, and that is said.
    assert ("the verdicts differ" in found.text()) == (number != "2")
    assert "positive definite at every position" in found.text()
    # By independent means: the worst position is one.
    structure = puma_table(number).structure
    h = structure.lift[structure.drive] @ puma_table(number).values
    H = structure.inertia_matrix(puma_table(number).values, found.alone.worst_position[None])[0] - np.tensordot(h, structure.reflected, 1)
    assert np.linalg.eigvalsh(H)[0] == pytest.approx(found.alone.min_eigenvalue, abs=1e-9)


@pytest.mark.parametrize("number", ["1", "2", "3"])
def test_tables_by_the_sources_own_means(number: str) -> None:
    """The grid of leading minors fails for H alone at the known share of positions; so does the cone of a block of the wrist."""
    *_, share, joint = PUBLISHED[number]
    subject = puma_table(number)
    alone = subject.matrices["H"]
    on_grid = judge_on_grid(alone, subject.values, points=8)
    assert on_grid.evaluations == 8**5
    assert on_grid.share == pytest.approx(share, abs=0.006)
    by_cone = judge_by_cone(alone, subject.values, order="trailing")
    assert by_cone.possible is False
    assert by_cone.certified
    assert by_cone.minors[-1].joints[0] == joint
    assert by_cone.minors[-1].inside is False
    assert all(m.inside and m.proven for m in by_cone.minors[:-1])


def test_beyond_the_rays_is_said() -> None:
    """With rotors the wrist is inside its cones; what has too many rays is not judged, and not repaired: with the number."""
    subject = puma_table("1")
    found = judge_by_cone(subject.structure, subject.values, order=MinorOrder.TRAILING, most=200_000)
    assert found.possible is None
    assert not found.certified
    assert [m.inside for m in found.minors] == [True, True, True, None, None, None]
    assert [m.terms for m in found.minors[:3]] == [1, 5, 25]
    assert f"{17**3:,} rays" in found.minors[3].note
    assert f"{25**5:,} rays" in found.text()
    assert "undecided" in found.text()
    assert json.dumps(found.to_dict())
    with pytest.raises(TooManyRaysError, match=f"{25**5:,} rays.*'possible'"):
        repair(subject.structure, subject.values, None, "cone")


def test_terms_of_the_puma() -> None:
    """25 and 311 independent functions in the first two leading minors of H alone: the rank of random sets at random positions."""
    structure = puma_table("1").structure.without_rotors
    rng = np.random.default_rng(0)
    for size, terms in ((1, 25), (2, 311)):
        count = terms + 20
        q = rng.uniform(-np.pi, np.pi, (count, 6))
        samples = np.array([np.linalg.det(structure.inertia_matrix(p, q)[:, :size, :size]) for p in rng.standard_normal((count, 52))])
        S = np.linalg.svd(samples / np.linalg.norm(samples, axis=1, keepdims=True), compute_uv=False)
        assert int(np.sum(S > 1e-10 * S[0])) == terms
    assert minor_of(structure, range(1)).terms == 25


@pytest.mark.parametrize("joints", [2, 3])
@pytest.mark.parametrize("order", list(MinorOrder))
def test_a_minor_is_its_rows_times_its_coordinates(joints: int, order: MinorOrder) -> None:
    structure, values = random_set(3, joints)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (30, joints))
    for rows in minor_rows(structure, order):
        minor = minor_of(structure, rows)
        block = structure.inertia_matrix(values, q)[:, rows.start : rows.stop, rows.start : rows.stop]
        wanted = np.linalg.det(block)
        x, slope = minor.linear(values)
        assert minor.rows(q[:, minor.joints]) @ x == pytest.approx(wanted, rel=1e-9, abs=1e-11 * np.abs(wanted).max())
        assert minor.polynomial(x).both(q[:, minor.joints])[0] == pytest.approx(wanted, rel=1e-9, abs=1e-11 * np.abs(wanted).max())
        # Lengths are root mean squares over all positions.
        assert minor.polynomial(x).rms() == pytest.approx(np.linalg.norm(x))
        step = 1e-6 * np.abs(values).max()
        numeric = np.array(
            [(minor.coordinates(values + step * e) - minor.coordinates(values - step * e)) / (2 * step) for e in np.eye(structure.b)]
        )
        assert slope == pytest.approx(numeric.T, rel=1e-5, abs=1e-6 * np.abs(slope).max())


def test_cofactors() -> None:
    H = np.random.default_rng(0).standard_normal((5, 3, 3))
    assert cofactors(H) == pytest.approx(np.linalg.det(H)[:, None, None] * np.swapaxes(np.linalg.inv(H), 1, 2))


def test_sign_of_a_polynomial() -> None:
    rng = np.random.default_rng(0)
    decided = []
    for _ in range(12):
        frequencies, c = coefficients_on_grid(rng.standard_normal(25), 5, 2)
        low = TrigonometricPolynomial(frequencies, c).both(grid(120, 2))[0].min()
        # Lifted to just above and just below zero.
        for lift in (1.02, 0.98):
            lifted = c + (np.abs(frequencies).sum(axis=1) == 0) * -low * lift
            polynomial = TrigonometricPolynomial(frequencies, lifted)
            sign, lowest, at = polynomial.sign()
            dense = polynomial.both(grid(120, 2))[0].min()
            assert (sign == Sign.POSITIVE) == (dense > 0)
            assert polynomial.both(at[None])[0][0] == pytest.approx(lowest, abs=1e-12)
            decided.append(sign)
    assert set(decided) == {Sign.POSITIVE, Sign.NOT_POSITIVE}
    # A double zero cannot be proven either way short of the position itself: many boxes, and no claim.
    touching = TrigonometricPolynomial(np.array([[0], [1]]), np.array([1.0, np.exp(0.3j)]))
    assert touching.sign()[0] != Sign.POSITIVE


@pytest.mark.parametrize("angles", [0, 1, 2])
def test_coefficients_give_the_values_back(angles: int) -> None:
    values = np.random.default_rng(angles).standard_normal((3, 7**angles))
    frequencies, c = coefficients_on_grid(values, 7, angles)
    for row, coefficients in zip(values, c, strict=True):
        assert TrigonometricPolynomial(frequencies, coefficients).both(grid(7, angles))[0] == pytest.approx(row)


def test_rays_of_a_cyclic_cone() -> None:
    """1, cos, sin, cos 2q, sin 2q at 36 positions: as many rays as the upper bound theorem allows, each on four independent rows."""
    q = grid(36, 1)[:, 0]
    cone = PolyhedralCone(np.stack([np.ones(36), np.cos(q), np.sin(q), np.cos(2 * q), np.sin(2 * q)], axis=1))
    rays = cone.rays()
    assert len(rays) == cone.most_rays == 594
    assert len(cone.extreme_rows) == 36
    at = cone.rows @ rays.T
    assert at.min() > -1e-9
    for column in at.T:
        assert np.linalg.matrix_rank(cone.rows[column < 1e-9]) == 4
    rng = np.random.default_rng(0)
    inside = 0
    for _ in range(200):
        x = rng.standard_normal(5) * [1.0, 0.4, 0.4, 0.4, 0.4]
        x[0] = abs(x[0])
        # Both descriptions of the cone: inside by its rows if and only if a sum of its rays.
        weights, distance = nnls(rays.T, x)
        assert (cone.lowest(x)[0] >= 0) == (distance < 1e-9)
        # And the nearest point is the same.
        assert cone.border(x) == pytest.approx(rays.T @ weights, abs=1e-8)
        inside += distance < 1e-9
    assert 20 < inside < 180
    with pytest.raises(TooManyRaysError, match=r"at most 500 are listed"):
        cone.rays(most=500)


def test_rows_that_others_span_are_no_rays() -> None:
    rows = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 1.0, 0.2], [2.0, 0.0, 0.0]])
    assert PolyhedralCone(rows).extreme_rows.tolist() == [0, 1, 2]
    assert len(PolyhedralCone(rows).rays()) == 3


@pytest.mark.parametrize("joints", [2, 3])
def test_verdict_of_the_cone_is_that_of_the_judge(joints: int) -> None:
    """On the continuum, and proven on either side. `python -m benchmarks physical` counts 500 sets."""
    verdicts = []
    for seed in range(10):
        structure, values = random_set(seed, joints)
        by_judge = judge_possible(structure, values)
        by_cone = judge_by_cone(structure, values, order=list(MinorOrder)[seed % 2])
        assert by_cone.possible == by_judge.possible, seed
        assert by_cone.certified
        verdicts.append(by_judge.possible)
    assert 2 <= sum(verdicts) <= 8


def test_a_grid_alone_can_miss_what_the_continuum_shows() -> None:
    """A set that fails between the positions of a coarse F_i is found all the same."""
    structure, values = impossible(2)
    border = repair(structure, values, None, "possible", margin=1e-6).values
    just = border + 1e-4 * (values - border)
    assert not judge_possible(structure, just).possible
    minor = minor_of(structure, range(2))
    cone, _ = cone_of(minor, 3)
    assert cone.lowest(minor.coordinates(just))[0] > 0
    found = judge_by_cone(structure, just, points=3)
    assert found.possible is False
    assert found.certified


@pytest.mark.parametrize("joints", [2, 3])
def test_steps_1_to_4(joints: int) -> None:
    structure, values = impossible(joints)
    std = 0.1 * np.abs(values) + 1e-6 * np.abs(values).max()
    found = modify_by_cone(structure, values, std)
    assert np.abs((found.values - values) / std).max() <= found.side * (1 + 1e-9)
    after = judge_possible(structure, found.values)
    assert after.possible
    assert after.certified
    assert any(t.outside for t in found.targets)
    straight: list[float] = []
    for target in (t for t in found.targets if t.outside):
        size = np.linalg.norm(target.estimate)
        # Step 1: on the border of the cone over all positions, its difference from the estimate at right angles to it.
        fine = grid(360 if len(target.minor.joints) == 1 else 60, len(target.minor.joints))
        low = target.minor.polynomial(target.border).both(fine)[0].min()
        assert low == pytest.approx(0.0, abs=5e-3 * size)
        assert target.border @ (target.border - target.estimate) == pytest.approx(0.0, abs=1e-8 * size**2)
        # Step 2: inside.
        assert target.cone.lowest(target.inner)[0] > 0
        step, further = target.border - target.estimate, target.inner - target.border
        straight.append(step @ further / np.linalg.norm(step) / np.linalg.norm(further))
        # Step 4: so is what was found.
        assert target.minor.polynomial(target.minor.coordinates(found.values)).both(fine)[0].min() > 0
    # The last minor's line leads inside, so its inner point is on it.
    assert straight[-1] == pytest.approx(1.0)
    # No possible set is nearer than the border.
    border = judge_possible(structure, values, covariance=np.diag(std**2)).margin_std
    assert border is not None
    assert np.linalg.norm((found.values - values) / std) > -border > 0


def test_repair_method_cone() -> None:
    structure, values = impossible(2)
    found = repair(structure, values, None, "cone")
    assert found.possible.possible
    assert "Steps 1 to 4" in found.text()
    assert found.distance > 0
    again = repair(structure, found.values, None, "cone", margin=1e-4)
    assert again.distance == 0
    assert "nothing to change" in again.text()
    with pytest.raises(UnsupportedError, match="whole turns"):
        repair(structure, values, None, "cone", limits=True)
    # What is known for certain stays as it is.
    covariance = np.diag((0.1 * values) ** 2)
    covariance[-1, -1] = 0.0
    assert repair(structure, values, covariance, "cone").values[-1] == values[-1]


def test_a_repair_does_not_fail_for_want_of_another_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the solver gives up on what is only said beside, the repair stands, and says so; where links are asked for, not."""

    def give_up(*_: object, **__: object) -> None:
        raise SolverError("the solver stopped")

    monkeypatch.setattr("ident.physical.repairs.judge_consistent", give_up)
    structure, values = impossible(2)
    found = repair(structure, values, None, "cone")
    assert found.possible.possible
    assert found.consistent is None
    assert "was not decided: the solver stopped" in found.text()
    with pytest.raises(SolverError):
        repair(structure, values, None, "consistent")


@pytest.mark.parametrize(("kind", "words"), [({"prismatic": 1.0}, "prismatic"), ({"floating": True, "prismatic": 0.0}, "floating base")])
def test_other_robots_are_refused(kind: dict[str, object], words: str) -> None:
    structure, full = random_structure(np.random.default_rng(0), 3, **kind)  # type: ignore[arg-type]
    with pytest.raises(UnsupportedError, match=words):
        judge_by_cone(structure, structure.regroup @ full)


def test_without_rotors() -> None:
    """H alone has no reflected inertia but what is merged with a link's; a set without rotors has one matrix only."""
    structure, full = random_structure(np.random.default_rng(2), 3, prismatic=0.0, rotors=False)
    subject = Subject("a set", structure, structure.regroup @ full, None)
    assert list(subject.matrices) == ["H"]
    found = judge(subject)
    assert found.alone is None
    assert found.matrix == "H"
    assert found.to_dict()["alone"] is None
    puma, values = puma_table("1").structure, puma_table("1").values
    assert np.abs(puma.without_rotors.added(values)).max() == 0.0
    assert np.abs(puma.added(values)).max() > 0.1
    # Where the rotor's own parameter stands for the merged pair, it stays: it is the only one there is.
    merged = InertiaStructure.from_arrays(
        structure.tree, np.c_[structure.regroup, structure.regroup[:, 5]], drive=np.array([structure.k]), reflected=np.ones((1, 3, 3))
    )
    assert np.array_equal(merged.without_rotors.reflected, merged.reflected)
