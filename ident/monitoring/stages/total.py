"""The least of the loss of effects that correct the model's own prediction, and how sharp it is.

A fit with columns made of the prediction, repeated until it is consistent with itself, solves Xᵀ r = 0, X the columns at the values found.
But values act through the columns as well: the torque changes by J = X + Σ vᵢ ∂cᵢ/∂π, cᵢ the columns of a correction and vᵢ its
values. The least loss is where Jᵀ r = 0, and (Jᵀ J)⁻¹ its covariance. For small corrections the two are next to the same; for a base
tilted under an arm whose joints stand upright, where next to nothing but the tilt shows some moments, they are not."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Need
from .consistent import own_loss
from .frame import Frame, raw_columns
from .motions import Motions

if TYPE_CHECKING:
    from ...problem.problem import Problem
    from .stage import Stage

Array = np.ndarray
#: Gauss-Newton steps, and halvings of one that gains nothing.
_STEPS = 5
_HALVINGS = 3
#: A step that gains less than this (twice a log-likelihood) is the last.
_LEAST = 1e-3
#: Once so much is gained, also as a share of the loss, the derivative is taken anew.
_FAR = 3.0
_FAR_SHARE = 0.01
#: Corrections that turn with the prediction by less than this (Σ‖Δ‖², in units of the noise, over displacements of one deviation) leave a
#: fit that is consistent with itself where it is: to find that out, so many displacements are tried.
_SLIGHT = 0.1
_DRAWS = 3
#: A derivative is one where its two sides differ by less than this share of it.
_SMOOTH = 0.2


def totalled(stage: Stage) -> Stage:
    """The stage at the least of its loss, its columns the total derivative of the prediction there; itself where nothing in its model
    corrects the prediction."""
    problem = stage.problem
    dependent = [e for e in problem.model.effects if e.needs & {Need.LOAD, Need.REFERENCE}]
    if not dependent or problem.reference is None:
        return stage
    if _slight(stage, problem, dependent):
        return stage
    through = _through_columns(stage, problem, dependent)
    frame, start = _linearised(stage, problem, through)
    loss, again = float(np.sum((frame.torque - frame.columns @ start) ** 2)), 0.0
    for _ in range(_STEPS):
        step = frame.transform @ (frame.coefficients - start)
        for halving in range(_HALVINGS):
            at = problem.base.base_values(problem.reference) + 0.5**halving * step
            tried = problem.with_reference(np.asarray(problem.base.expand(at)))
            new = own_loss(tried, Frame.build(tried, stage.white, raw_columns(tried)))
            if new < loss:
                break
        else:
            break
        gained, loss, problem = loss - new, new, tried
        again += gained
        if again > max(_FAR, _FAR_SHARE * loss):
            # So far away the derivative is another one; it takes as long as all the rest.
            through, again = _through_columns(stage, problem, dependent), 0.0
        frame, start = _linearised(stage, problem, through)
        if gained < _LEAST:
            break
    return replace(stage, problem=problem, frame=frame, motions=Motions(problem))


def _slight(stage: Stage, problem: Problem, dependent: list[Effect]) -> bool:
    """Whether corrections follow the prediction so little that the least of the loss is where the fit is, and as sharp.

    What there is to gain is |Dᵀ r|², D the derivative of the corrections by coefficients of the frame: about ‖D‖² times the variance of
    r, and ‖D‖² is what random signs along D come to on average. That takes a displacement for each, not one for each parameter."""
    assert problem.reference is not None
    if own_loss(problem, stage.frame) - stage.frame.loss > _SLIGHT:
        return False  # not consistent with itself
    fixed, transform = _own_values(problem, dependent), stage.frame.transform
    along = transform @ np.random.default_rng(0).choice([-1.0, 1.0], (transform.shape[1], _DRAWS))
    here, *there = (sum(_displaced(problem, fixed, by).values()) for by in (np.zeros(len(along)), *along.T))
    turned = np.stack([torque - here for torque in there], axis=2)
    variance = stage.frame.loss / max(int(problem.signals.valid.sum()), 1)
    return float(np.sum(stage.frame.whitened(turned) ** 2)) / _DRAWS * max(variance, 1.0) < _SLIGHT


def _linearised(stage: Stage, problem: Problem, through: Array) -> tuple[Frame, Array]:
    """The frame of a problem linearised at its reference, and the coefficients (b,) of the reference there. `through` (M, n, k_base):
    what base parameters change through columns."""
    assert problem.reference is not None
    raw, values = raw_columns(problem), problem.base.base_values(problem.reference)
    at_reference = raw @ values
    frame = Frame.build(problem, stage.white, raw + through)
    start = np.linalg.pinv(frame.transform) @ values
    left = frame.torque - frame.whitened(at_reference[:, :, None])[:, :, 0]
    return replace(frame, torque=left + frame.columns @ start), start


def _through_columns(stage: Stage, problem: Problem, dependent: list[Effect]) -> Array:
    """What base parameters change through the columns that depend on them, (M, n, k_base)."""
    assert problem.reference is not None
    valid = problem.signals.valid
    size = np.sqrt(np.einsum("ij,jk,ik->i", stage.frame.transform, stage.frame.inverse_gram, stage.frame.transform))
    fixed = _own_values(problem, dependent)
    here = _displaced(problem, fixed, 0.0 * size)
    along = size * np.random.default_rng(0).choice([-1.0, 1.0], len(size))
    there, opposite = (_displaced(problem, fixed, by) for by in (along, -along))
    fixed = {e: v for e, v in fixed.items() if _smooth(here, there, opposite, e)}
    out = np.zeros((*valid.shape, len(size)))
    if not fixed:
        return out
    before = sum(here[e] for e in fixed)
    for k in np.flatnonzero(size > 0.0):
        by = np.zeros(len(size))
        by[k] = size[k]
        out[:, :, k] = np.where(valid, sum(_displaced(problem, fixed, by).values()) - before, 0.0) / size[k]
    return out


def _smooth(here: dict[Effect, Array], there: dict[Effect, Array], opposite: dict[Effect, Array], effect: Effect) -> bool:
    """Whether what an effect does changes in proportion: a gear that knocks at other moments has no derivative."""
    slope, bend = there[effect] - opposite[effect], there[effect] + opposite[effect] - 2.0 * here[effect]
    return bool(np.sum(bend**2) <= _SMOOTH**2 * np.sum(slope**2))


def _own_values(problem: Problem, effects: list[Effect]) -> dict[Effect, Array]:
    """The values (k,) of effects' own parameters at the problem's reference."""
    assert problem.reference is not None
    names, robot = list(problem.model.names), problem.model.robot
    return {e: problem.reference[[names.index(p.name) for p in e.parameters(robot)]] for e in effects}


def _displaced(problem: Problem, values: dict[Effect, Array], by: Array) -> dict[Effect, Array]:
    """Torque (M, n) of effects at `values`, their columns taken where base parameters lie `by` (k_base,) from the problem's reference."""
    assert problem.reference is not None
    at = problem.base.base_values(problem.reference) + by
    motions = Motions(problem.with_reference(np.asarray(problem.base.expand(at))))
    return {e: motions.columns(e) @ v for e, v in values.items()}
