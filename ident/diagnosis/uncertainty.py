"""Values and standard deviations of accepted effects, shapes among them, from the instrumental fit."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import pinv
from ..instruments.fit import Fit
from ..instruments.solved import SINGULAR, deviations
from .inference.scores import blocks
from .inference.slopes import Slope, extended, slopes
from .result import FoundParameter

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..instruments.solved import Solved

Array = np.ndarray


def found_parameters(fit: Fit, frame: Solved) -> dict[Effect, tuple[FoundParameter, ...]]:
    """Parameters of each accepted effect: the linear ones, then shapes. Shapes enter by their slopes at the fit, as further columns."""
    robot = fit.robot
    found = slopes(fit, frame)
    free = [s for s in found if not s.told]
    std = _deviations(fit, frame, free, ())
    shape_std = {s.key: float(std[frame.X.shape[2] + i]) for i, s in enumerate(free)}
    if told := [s for s in found if s.told]:
        shape_std |= {s.key: float(x) for s, x in zip(told, _deviations(fit, frame, free, told)[-len(told) :], strict=True)}
    shape_std = {(e, name): float(np.hypot(x, _between_rows(fit, e, name))) for (e, name), x in shape_std.items()}
    out: dict[Effect, tuple[FoundParameter, ...]] = {}
    for effect, own in zip(fit.effects, fit.slices, strict=True):
        linear = [
            FoundParameter(p.name.replace("+", ""), float(value), float(deviation), p.unit)
            for p, value, deviation in zip(effect.parameters(robot), frame.theta[own], std[own], strict=True)
        ]
        # A shape that was not sought is no finding, and one that is zero is told by its value alone.
        shapes = [
            FoundParameter(p.name, at, shape_std.get((effect, p.name), np.nan), effect.shape_unit(p, robot))
            for p in effect.shape()
            if p.points != 1 and not ((at := float(getattr(effect, p.name))) == 0.0 and effect.response(robot) is not None)
        ]
        out[effect] = (*linear, *shapes)
    return out


def _between_rows(fit: Fit, effect: Effect, name: str) -> float:
    """Standard deviation of a moment of which only the rows before and after it tell: it is anywhere between them. Zero of other shapes."""
    if not name.startswith("t_"):
        return 0.0
    at, found = float(getattr(effect, name)), 0.0
    acts = [any(columns.acts_on(m) for columns in fit.columns(effect)[1]) for m in range(fit.robot.n)]
    for run in fit.runs:
        clock = run.instrument.clock[run.use[:, acts].any(axis=1)]
        after = int(np.searchsorted(clock, at))
        if 0 < after < len(clock):
            found = max(found, float(clock[after] - clock[after - 1]))
    return found / np.sqrt(12.0)


def _deviations(fit: Fit, frame: Solved, free: Sequence[Slope], told: Sequence[Slope]) -> Array:
    """Standard deviations of the coefficients, of free shapes, then of those that their effects' values tell: each of the latter is one
    more unknown, and one more equation, that the values go on being what the shape says."""
    x, z = extended(fit, frame, free, told)
    count = z.shape[1]
    scale = np.concatenate([np.linalg.norm(z, axis=0), np.linalg.norm(x[:, count:], axis=0)])
    scale = np.where(scale > 0.0, scale, 1.0)
    ties = np.zeros((len(told), len(scale)))
    for i, s in enumerate(told):
        ties[i, list(s.told)] = 1.0 / len(s.told)
        ties[i, count + i] = -s.rate
    ties /= scale
    if len(ties):
        ties /= np.linalg.norm(ties, axis=1, keepdims=True)
    z = z / scale[:count]
    equations = np.concatenate([z.T @ (x / scale), ties])
    gram = np.zeros((len(scale), len(scale)))
    gram[:count, :count] = z.T @ z
    uneven = _uneven(fit, frame, z[: frame.residual.size].reshape(*frame.residual.shape, count), equations)
    return np.asarray(np.maximum(deviations(equations, gram), uneven) / scale)


def _uneven(fit: Fit, frame: Solved, Z: Array, equations: Array) -> Array:
    """Standard deviations (p,) from the scores of blocks of time: noise that is louder where the instrument is large counts as it is.

    H. White, "A heteroskedasticity-consistent covariance matrix estimator", Econometrica 48(4), 1980, with sums over blocks."""
    cuts = blocks(fit, frame)
    scores = np.add.reduceat(np.einsum("rnp,rn->rp", Z, frame.residual), cuts, axis=0)
    scores = scores - scores.mean(axis=0)
    inverse = pinv(equations, rcond=SINGULAR)[:, : Z.shape[2]]
    count = len(cuts)
    return np.sqrt(np.sum((scores @ inverse.T) ** 2, axis=0) * count / max(count - 1, 1))
