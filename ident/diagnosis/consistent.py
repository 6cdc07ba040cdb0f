"""A fit that is consistent with itself: what depends on the model's prediction is taken at the fit's own prediction."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..effect import Need
from ..fixed_point import MOST, Repetition
from .frame import Frame, raw_columns

if TYPE_CHECKING:
    from ..problem import Problem
    from .whitening import Whitener

Array = np.ndarray


def consistent(problem: Problem, white: Whitener) -> tuple[Problem, Frame]:
    """The problem with the reference that its own fit yields, and its frame; of all that were tried the one that fits best."""
    frame = Frame.build(problem, white, raw_columns(problem))
    values = _fitted(problem, frame)
    if not problem.model.needs & {Need.LOAD, Need.REFERENCE}:
        problem = problem.with_reference(values)
        return problem, replace(frame, problem=problem)
    best: tuple[Problem, Frame] | None = None
    repetition = Repetition(_weight(problem, frame))
    for _ in range(MOST):
        settled = problem.reference is not None and not _moved(values, problem.reference)
        problem = problem.with_reference(values if problem.reference is None else repetition.next(problem.reference, values))
        frame = Frame.build(problem, white, raw_columns(problem))
        if best is None or settled or frame.loss < best[1].loss:
            best = problem, frame
        if settled:
            break
        values = _fitted(problem, frame)
    assert best is not None
    return best


def _fitted(problem: Problem, frame: Frame) -> Array:
    """All parameters' values (k,)."""
    return np.asarray(problem.base.expand(frame.base_values))


def _weight(problem: Problem, frame: Frame) -> Array:
    """How much the data show of each parameter (k,), 1 over its unit."""
    out = np.zeros(len(problem.model.names))
    places = {name: i for i, name in enumerate(problem.model.names)}
    shown = np.linalg.norm(np.linalg.pinv(frame.transform), axis=0)
    for name, x in zip(problem.base.names, shown, strict=True):
        if name in places:
            out[places[name]] = x
    return out


def _moved(new: Array, old: Array) -> bool:
    return bool(np.any(np.abs(new - old) > 1e-3 * (np.abs(new) + np.abs(old) + 1e-12)))
