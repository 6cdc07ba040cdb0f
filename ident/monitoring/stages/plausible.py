"""What cannot be: parameters beyond their physical bounds, a candidate's own or, for its sake, those of the declared model."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect
from ...robots.parameters import Parameter
from .frame import Frame
from .refit import Refit

if TYPE_CHECKING:
    from ...robots.robot import Robot

Array = np.ndarray
#: Parameters may lie beyond a bound by this many of their standard deviations before a candidate is dropped for it; those of the declared
#: model by this share of what they were, too.
BEYOND = 3.0
_OF_ITSELF = 1.0
#: Share of a gain on several joints that one thing on all of them must have.
_AS_ONE = 0.6
#: At the best of all its shapes more of a response may be asked for by this share, or so many of its standard deviations there (one in
#: twenty is beyond).
_OFF = 0.15
_OFTEN = 1.645


def implausible(effect: Effect, values: Array, std: Array, robot: Robot, kept: float = 0.0) -> str:
    """Why parameters found (k,) with these standard deviations cannot be: beyond their physical bounds by more than chance. `kept`: the
    share of the gain that is left with parameters at what they must be. Where it is most of it, that one joint of several would rather
    have it otherwise says more of what else is there than of this."""
    bound = effect.response(robot)
    if bound is not None and len(bound) > 1 and kept > _AS_ONE:
        return ""
    parameters = effect.parameters(robot)
    for p, value, s in zip(parameters, values, std, strict=True):
        if value < p.lower - BEYOND * s or value > p.upper + BEYOND * s:
            return f"{p.name} = {value:.4g} {p.unit} is beyond its bound"
        if p.lower == 0.0 and value <= 0.0 and len(parameters) == 1:
            return f"{p.name} = {value:.4g} {p.unit} must be positive"
    return effect.implausible(robot, values, std)


def too_small_at_its_best(effect: Effect, values: Array, support: float, robot: Robot) -> str:
    """Why an effect whose shapes were settled with its response at what it must be is no such thing: the data would have more of it, and no
    shape gives that. Noise of the motion, which is in the columns and in what is left, draws a spring so, with a rotor, a stiffness or a
    damping at the edge of what can be. (Less of it says little: what follows its own prediction is drawn less well by the first one.
    Nor is it held against knocks, whose law is less exact than that.) `values` (k,): the responses if they were free; `support`: what the
    loss would rise by without the effect."""
    right = effect.response(robot)
    if right is None or len(right) != 1 or right[0] == 0.0 or effect.abrupt or not np.isfinite(support):
        return ""
    response = float(values[0] / right[0])
    std = abs(response) / np.sqrt(max(support, 1e-300))
    if response - 1.0 <= max(_OFF, _OFTEN * std):
        return ""
    return f"at its best shape the response is {response:.3g} times what {effect.title} would give"


def driven_out(frame: Frame, refit: Refit) -> str:
    """Which parameter of the declared model, that has a physical bound and keeps it without the candidate, is beyond it beside the
    candidate: one that needs negative friction on a joint to be there is not there."""
    bounded = _bounded(frame)
    T, b = frame.transform[bounded], frame.transform.shape[1]
    out = _out(T @ frame.coefficients, T @ refit.model, T, refit.covariance[:b, :b])
    return _said(frame, bounded, T @ refit.model, out)


def driven_out_on(declared: Frame, final: Frame, joints: tuple[str, ...]) -> str:
    """The same of all findings together: which parameter of the declared model on some joints is beyond its bound in the final one."""
    names = list(final.problem.base.names)
    bounded = [i for i in _bounded(declared) if _parameter(declared, i).joint in joints and _parameter(declared, i).name in names]
    there = [names.index(_parameter(declared, i).name) for i in bounded]
    T = final.transform[there]
    out = _out(declared.transform[bounded] @ declared.coefficients, T @ final.coefficients, T, final.inverse_gram)
    return _said(declared, bounded, T @ final.coefficients, out)


def _bounded(frame: Frame) -> list[int]:
    """Base parameters that are a single parameter bounded below by zero."""
    base = frame.problem.base
    alone = np.count_nonzero(base.regroup, axis=1) == 1
    lower = np.array([base.parameters[i].lower for i in base.independent])
    return np.flatnonzero(alone & (lower == 0.0)).tolist()


def _out(before: Array, after: Array, T: Array, covariance: Array) -> list[int]:
    """Places at which values are beyond zero, surely and by their own size, that were not; the surest first."""
    std = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", T, covariance, T), 0.0))
    out = np.flatnonzero((before >= 0.0) & (after < -BEYOND * std - _OF_ITSELF * before))
    return sorted(out.tolist(), key=lambda i: after[i] / max(std[i], 1e-300))


def _said(frame: Frame, bounded: list[int], values: Array, out: list[int]) -> str:
    if not out:
        return ""
    p = _parameter(frame, bounded[out[0]])
    return f"with it {p.name} = {values[out[0]]:.4g} {p.unit} would be beyond its bound"


def _parameter(frame: Frame, i: int) -> Parameter:
    base = frame.problem.base
    return base.parameters[base.independent[i]]
