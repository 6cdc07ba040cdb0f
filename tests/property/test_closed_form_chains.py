"""Closed forms on random structures: the same row space as a sampled regressor, and the count of the formula."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from structures import compare_row_spaces, mixed_robot, oblique_twists, parallelogram_robot, rotational_robot, sampled_regressor

from ident.regressor.base_parameters import closed_form
from ident.regressor.base_parameters.structural import base_set
from ident.robots.robot import Robot


def _oblique(rng: np.random.Generator, size: int) -> Robot:
    return rotational_robot(rng, size, np.array([0.0, np.pi, np.pi / 2, *oblique_twists(rng, 3)]))


def _mixed(rng: np.random.Generator, size: int) -> Robot:
    return mixed_robot(rng, size, rng.choice([0.2, 0.4, 0.8]))


def _parallelogram(rng: np.random.Generator, size: int) -> Robot:
    return parallelogram_robot(rng, max(size, 2))


BUILD: dict[str, Callable[[np.random.Generator, int], Robot]] = {
    "rotational": rotational_robot,
    "oblique": _oblique,
    "mixed": _mixed,
    "parallelogram": _parallelogram,
}


def check(theorem: str, seed: int) -> None:
    rng = np.random.default_rng([seed, list(BUILD).index(theorem)])
    robot = BUILD[theorem](rng, int(rng.integers(1, 9)))
    form = getattr(closed_form, theorem)(robot)
    found = compare_row_spaces(form.matrix, sampled_regressor(robot, seed=seed))
    where = f"{theorem} seed {seed}: {form.count_formula}; {found}"
    assert found.rank == form.count, where
    assert form.count_formula.endswith(f"= {form.count}"), where
    assert found.form_outside < 1e-9, where
    assert found.sampled_outside < 1e-9, where
    assert base_set(robot).count == form.count, where
    assert len(set(form.names)) == form.count, where


@pytest.mark.parametrize("theorem", BUILD)
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_closed_form_spans_what_a_sampled_regressor_shows(theorem: str, seed: int) -> None:
    check(theorem, seed)


@pytest.mark.slow
@pytest.mark.parametrize("theorem", BUILD)
def test_closed_form_on_many_structures(theorem: str) -> None:
    for seed in range(600):
        check(theorem, seed)
