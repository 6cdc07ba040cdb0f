"""Random robots: real links are never doubted, and no set with an indefinite configuration passes."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from physical_models import random_structure

from ident.physical import InertiaStructure, Target, judge_consistent, judge_possible, repair
from ident.physical.constrained import fit_consistent
from ident.physical.pseudo_inertia import pseudo_inertia, smallest_eigenvalues
from ident.physical.search import random_positions

Array = np.ndarray


@st.composite
def robots(draw: st.DrawFn) -> tuple[InertiaStructure, Array, bool, np.random.Generator]:
    """A robot, all its parameters, whether it keeps to joint limits, and a generator."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    limits = draw(st.booleans())
    structure, full = random_structure(
        rng,
        draw(st.integers(1, 5)),
        chain=draw(st.booleans()),
        prismatic=draw(st.sampled_from([0.0, 0.4])),
        right=draw(st.booleans()),
        floating=draw(st.integers(0, 5)) == 0,
        rotors=draw(st.booleans()),
        coupled=draw(st.booleans()),
        limits=limits,
    )
    return structure, full, limits, rng


@settings(max_examples=25, deadline=None)
@given(robots())
def test_real_links_pass_both_judgements(case: tuple[InertiaStructure, Array, bool, np.random.Generator]) -> None:
    structure, full, limits, _ = case
    values = structure.regroup @ full
    found = judge_consistent(structure, values)
    assert found.consistent
    assert found.standard is not None
    assert np.all(smallest_eigenvalues(found.standard[structure.inertial]) > 0)
    possible = judge_possible(structure, values, limits=limits)
    assert possible.possible
    assert possible.certified
    assert possible.lower_bound <= possible.min_eigenvalue * (1 + 1e-9)


@settings(max_examples=25, deadline=None)
@given(robots(), st.sampled_from([0.1, 0.3, 0.8, 1.6]))
def test_nothing_indefinite_passes(case: tuple[InertiaStructure, Array, bool, np.random.Generator], change: float) -> None:
    structure, full, limits, rng = case
    values = structure.regroup @ full
    values = values * (1 + change * rng.standard_normal(structure.b))
    lower, upper, _ = structure.ranges(limits)
    brute = np.linalg.eigvalsh(structure.inertia_matrix(values, random_positions(structure, lower, upper, 3000, rng)))[:, 0].min()
    found = judge_possible(structure, values, limits=limits, time_limit=20)
    assert found.min_eigenvalue <= brute + 1e-4 * abs(brute)
    if brute < 0:
        assert not found.possible
        assert found.certified
    if not found.possible:
        assert not judge_consistent(structure, values).consistent
    q = found.worst_position[None]
    assert np.all(q >= lower - 1e-9)
    assert np.all(q <= upper + 1e-9)
    H = structure.inertia_matrix(values, q)[0]
    assert np.isclose(found.worst_vector @ H @ found.worst_vector, found.min_eigenvalue, rtol=1e-6, atol=1e-9)


@settings(max_examples=10, deadline=None)
@given(robots(), st.sampled_from([0.2, 0.8]))
def test_repairs_pass_their_own_judgement(case: tuple[InertiaStructure, Array, bool, np.random.Generator], change: float) -> None:
    """Possible costs no more than stepwise, and the consistent fit is real."""
    structure, full, _, rng = case
    values = structure.regroup @ full
    std = change * np.abs(values) + 1e-6
    values = values + std * rng.standard_normal(structure.b)
    covariance = np.diag(std**2)
    stepwise = repair(structure, values, covariance, "stepwise")
    possible = repair(structure, values, covariance, "possible")
    assert possible.distance <= stepwise.distance * 1.001 + 1e-9
    fit = fit_consistent(structure, Target.from_covariance(values, covariance))
    J = pseudo_inertia(fit.standard[structure.inertial].reshape(-1, 10))
    assert np.all(np.linalg.eigvalsh(J) > 0)
    assert np.allclose(structure.regroup @ fit.standard, fit.values, rtol=1e-8, atol=1e-8)
    truth = structure.regroup @ full
    # The truth is consistent, so the nearest consistent set is no farther than it.
    assert fit.cost <= np.sum(((truth - values) / std) ** 2) * (1 + 1e-4) + 1e-3
