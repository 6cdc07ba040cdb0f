"""What cannot be: parameters beyond their physical bounds, a candidate's own or, for its sake, those of the declared model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..effect import Effect
from .frame import Frame
from .refit import Refit

if TYPE_CHECKING:
    from ..robot import Robot

Array = np.ndarray
#: Parameters may lie beyond a bound by this many of their standard deviations before a candidate is dropped for it; those of the declared
#: model by this share of what they were, too.
_BEYOND = 3.0
_OF_ITSELF = 1.0
#: Share of a gain on several joints that one thing on all of them must have.
_AS_ONE = 0.6


def implausible(effect: Effect, values: Array, std: Array, robot: Robot, kept: float = 0.0) -> str:
    """Why parameters found (k,) with these standard deviations cannot be: beyond their physical bounds by more than chance. `kept`: the
    share of the gain that is left with parameters at what they must be. Where it is most of it, that one joint of several would rather
    have it otherwise says more of what else is there than of this."""
    bound = effect.response(robot)
    if bound is not None and len(bound) > 1 and kept > _AS_ONE:
        return ""
    parameters = effect.parameters(robot)
    for p, value, s in zip(parameters, values, std, strict=True):
        if value < p.lower - _BEYOND * s or value > p.upper + _BEYOND * s:
            return f"{p.name} = {value:.4g} {p.unit} is beyond its bound"
        if p.lower == 0.0 and value <= 0.0 and len(parameters) == 1:
            return f"{p.name} = {value:.4g} {p.unit} must be positive"
    return effect.implausible(robot, values, std)


def driven_out(frame: Frame, refit: Refit) -> str:
    """Which parameter of the declared model, that has a physical bound and keeps it without the candidate, is beyond it beside the
    candidate: one that needs negative friction on a joint to be there is not there."""
    base = frame.problem.base
    alone = np.count_nonzero(base.regroup, axis=1) == 1
    lower = np.array([base.parameters[i].lower for i in base.independent])
    bounded = np.flatnonzero(alone & (lower == 0.0))
    if not len(bounded):
        return ""
    T, b = frame.transform[bounded], frame.transform.shape[1]
    before, after = T @ frame.coefficients, T @ refit.model
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", T, refit.covariance[:b, :b], T), 0.0))
    out = (before >= 0.0) & (after < -_BEYOND * std - _OF_ITSELF * before)
    if not out.any():
        return ""
    i = int(np.argmax(np.where(out, -after / np.maximum(std, 1e-300), 0.0)))
    p = base.parameters[base.independent[bounded[i]]]
    return f"with it {p.name} = {after[i]:.4g} {p.unit} would be beyond its bound"
