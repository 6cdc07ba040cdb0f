"""Values and standard deviations of accepted effects, shapes among them, from the instrumental fit."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import pinv
from ..instruments.columns import effect_columns, is_order
from ..instruments.fit import Fit
from ..instruments.solved import SINGULAR, deviations
from ..instruments.spectra import Spectra
from .inference.scores import blocks
from .result import FoundParameter

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..instruments.solved import Solved

Array = np.ndarray
_STEP = 1e-3


def found_parameters(fit: Fit, frame: Solved) -> dict[Effect, tuple[FoundParameter, ...]]:
    """Parameters of each accepted effect: the linear ones, then shapes. Shapes enter by their slopes at the fit, as further columns."""
    robot, b = fit.robot, fit.declared.base.count
    theta = frame.theta[b:]
    slopes: list[tuple[Effect, str, list[Spectra], list[Spectra]]] = []
    start = 0
    for effect in fit.effects:
        k = len(effect.parameters(robot))
        values = theta[start : start + k]
        start += k
        for p in effect.shape():
            if is_order(effect) or p.points == 1 or effect.response(robot) is not None:
                continue
            x, z = (_slope(fit, effect, p.name, values, instrument=side) for side in (False, True))
            if any(not each.empty for each in z):
                slopes.append((effect, p.name, x, z))
    X, Z = frame.X, frame.Z
    if slopes:
        X = np.concatenate([X, *(fit.behind_filters(s[2], frame.gains) for s in slopes)], axis=2)
        Z = np.concatenate([Z, *(fit.behind_filters(s[3], frame.gains) for s in slopes)], axis=2)
    known = fit.known_rows(X.shape[2])
    flat = [np.concatenate([a.reshape(-1, a.shape[2]), known]) for a in (X, Z)]
    scale = np.linalg.norm(flat[1], axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    equations = (flat[1] / scale).T @ (flat[0] / scale)
    white = deviations(equations, (flat[1] / scale).T @ (flat[1] / scale))
    std = np.maximum(white, _uneven(fit, frame, Z / scale, equations)) / scale
    shape_std = {(s[0], s[1]): float(std[frame.X.shape[2] + i]) for i, s in enumerate(slopes)}
    out: dict[Effect, tuple[FoundParameter, ...]] = {}
    start = b
    for effect in fit.effects:
        linear = [
            FoundParameter(p.name.replace("+", ""), float(frame.theta[start + i]), float(std[start + i]), p.unit)
            for i, p in enumerate(effect.parameters(robot))
        ]
        start += len(linear)
        told = _told(effect, linear)
        # A shape that was not sought is no finding, and one that is zero is told by its value alone.
        shapes = [
            FoundParameter(p.name, at, shape_std.get((effect, p.name), told.get(p.name, np.nan)), effect.shape_unit(p, robot))
            for p in effect.shape()
            if p.points != 1 and not ((at := float(getattr(effect, p.name))) == 0.0 and effect.response(robot) is not None)
        ]
        out[effect] = (*linear, *shapes)
    return out


def _told(effect: Effect, linear: list[FoundParameter]) -> dict[str, float]:
    """Standard deviations of the shapes that an effect's values tell, by these values' own."""
    value, std = (np.array([getattr(p, name) for p in linear]) for name in ("value", "std"))
    if not np.isfinite(std).all():
        return {}
    more, less = effect.told_by(value + std), effect.told_by(value - std)
    apart = {p.name: abs(getattr(more, p.name) - getattr(less, p.name)) / 2.0 for p in effect.shape()}
    return {name: x for name, x in apart.items() if x > 0.0}


def _uneven(fit: Fit, frame: Solved, Z: Array, equations: Array) -> Array:
    """Standard deviations (p,) from the scores of blocks of time: noise that is louder where the instrument is large counts as it is.

    H. White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 48(4), 1980, with sums over blocks."""
    cuts = blocks(fit, frame)
    scores = np.add.reduceat(np.einsum("rnp,rn->rp", Z, frame.residual), cuts, axis=0)
    scores = scores - scores.mean(axis=0)
    inverse = pinv(equations, rcond=SINGULAR)
    count = len(cuts)
    return np.sqrt(np.sum((scores @ inverse.T) ** 2, axis=0) * count / max(count - 1, 1))


def _slope(fit: Fit, effect: Effect, name: str, values: Array, *, instrument: bool) -> list[Spectra]:
    """The slope of an effect's torque over one of its shapes, as a column of each run."""
    at = float(getattr(effect, name))
    p = next(p for p in effect.shape() if p.name == name)
    h = _STEP * max(abs(at), 1e-6)
    ends = [float(np.clip(at + s * h, p.lower, p.upper)) for s in (1.0, -1.0)]
    found = []
    for run, motion in zip(fit.runs, fit.motions(instrument=instrument, effect=effect), strict=True):
        up, down = (effect_columns(effect.with_shape(**{name: x}), motion, fit.robot) @ values for x in ends)
        found.append(Spectra.of(((up - down) / max(ends[0] - ends[1], 1e-300))[:, :, None], run))
    return found
