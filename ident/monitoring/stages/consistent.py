"""A fit that is consistent with itself: what depends on the model's prediction is taken at the fit's own prediction."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..._utils.fixed_point import MOST, Repetition
from ...effects.kinds import Need
from .frame import Frame, raw_columns
from .steady import steady_values

if TYPE_CHECKING:
    from ...problem.problem import Problem
    from .whitening import Whitener

Array = np.ndarray
#: A value has settled if it moves by less than this share of itself, or of its standard deviation.
_SHARE = 1e-3
_DEVIATIONS = 0.05
#: Passes in which a fit with an abrupt effect goes by the rows that follow it, until knocks come when they should.
_STEADY = 3


def consistent(problem: Problem, white: Whitener, most: int = MOST) -> tuple[Problem, Frame]:
    """The problem with the reference that its own fit yields, and its frame; of all that were tried (`most` at most) the one whose values
    predict best."""
    frame = Frame.build(problem, white, raw_columns(problem))
    steady = _STEADY if any(e.abrupt for e in problem.model.effects) else 0
    values = steady_values(frame) if steady else _fitted(problem, frame)
    if not problem.model.needs & {Need.LOAD, Need.REFERENCE}:
        problem = problem.with_reference(values)
        return problem, replace(frame, problem=problem)
    best: tuple[float, Problem, Frame] | None = None
    weight = _weight(problem, frame)
    repetition = Repetition(weight)
    for i in range(most):
        settled = problem.reference is not None and not _moved(values, problem.reference, weight)
        problem = problem.with_reference(values if problem.reference is None else repetition.next(problem.reference, values))
        frame = Frame.build(problem, white, raw_columns(problem))
        loss = own_loss(problem, frame)
        if best is None or loss < best[0]:
            best = loss, problem, frame
        if settled:
            break
        values = steady_values(frame) if i + 1 < steady else _fitted(problem, frame)
    assert best is not None
    return best[1], best[2]


def own_loss(problem: Problem, frame: Frame) -> float:
    """The loss of the values that the columns were made with. Others may fit those columns better, but make other columns: a fit that is
    not consistent with its own prediction can seem to explain anything."""
    if problem.reference is None or not problem.model.needs & {Need.LOAD, Need.REFERENCE}:
        return frame.loss
    coefficients = np.linalg.pinv(frame.transform) @ problem.base.base_values(problem.reference)
    return float(np.sum((frame.torque - frame.columns @ coefficients) ** 2))


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


def _moved(new: Array, old: Array, weight: Array) -> bool:
    change = np.abs(new - old)
    return bool(np.any((change > _SHARE * (np.abs(new) + np.abs(old) + 1e-12)) & (change * weight > _DEVIATIONS)))
