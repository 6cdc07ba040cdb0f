"""Values and standard deviations of accepted effects, shapes among them, from the instrumental fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
    robot = fit.robot
    slopes = _slopes(fit, frame)
    free = [s for s in slopes if not s.told]
    std = _deviations(fit, frame, free, ())
    shape_std = {s.key: float(std[frame.X.shape[2] + i]) for i, s in enumerate(free)}
    if told := [s for s in slopes if s.told]:
        shape_std |= {s.key: float(x) for s, x in zip(told, _deviations(fit, frame, free, told)[-len(told) :], strict=True)}
    out: dict[Effect, tuple[FoundParameter, ...]] = {}
    start = fit.declared.base.count
    for effect in fit.effects:
        linear = [
            FoundParameter(p.name.replace("+", ""), float(frame.theta[start + i]), float(std[start + i]), p.unit)
            for i, p in enumerate(effect.parameters(robot))
        ]
        start += len(linear)
        # A shape that was not sought is no finding, and one that is zero is told by its value alone.
        shapes = [
            FoundParameter(p.name, at, shape_std.get((effect, p.name), np.nan), effect.shape_unit(p, robot))
            for p in effect.shape()
            if p.points != 1 and not ((at := float(getattr(effect, p.name))) == 0.0 and effect.response(robot) is not None)
        ]
        out[effect] = (*linear, *shapes)
    return out


@dataclass(frozen=True)
class _Slope:
    """How an effect's torque changes with one of its shapes, as a column of each run: measured motion, instrument. `told`: coefficients
    whose mean is what the shape says, `rate` by which it says more per unit of the shape; none where the shape is sought by itself."""

    effect: Effect
    name: str
    x: list[Spectra]
    z: list[Spectra]
    told: tuple[int, ...] = ()
    rate: float = 0.0

    @property
    def key(self) -> tuple[Effect, str]:
        return self.effect, self.name


def _slopes(fit: Fit, frame: Solved) -> list[_Slope]:
    robot, found = fit.robot, []
    start = fit.declared.base.count
    for effect in fit.effects:
        own = tuple(range(start, start + len(effect.parameters(robot))))
        start += len(own)
        tied = effect.response(robot) is not None
        for p in () if is_order(effect) else effect.shape():
            if p.points == 1 or (tied and (p.name != effect.told_shape(robot) or getattr(effect, p.name) == 0.0)):
                continue
            x, z = (_slope(fit, effect, p.name, frame.theta[list(own)], instrument=side) for side in (False, True))
            if any(not each.empty for each in z):
                rate = _rate(effect, p.name, fit) if tied else 0.0
                found.append(_Slope(effect, p.name, x, z, own if tied else (), rate))
    return found


def _rate(effect: Effect, name: str, fit: Fit) -> float:
    """Change of what an effect's values are by its law, per unit of one of its shapes."""
    more, less = (effect.with_shape(**{name: x}) for x in _ends(effect, name))
    apart = float(getattr(more, name)) - float(getattr(less, name))
    up, down = (np.mean(np.asarray(each.response(fit.robot), float)) for each in (more, less))
    return float(up - down) / apart


def _deviations(fit: Fit, frame: Solved, free: Sequence[_Slope], told: Sequence[_Slope]) -> Array:
    """Standard deviations of the coefficients, of free shapes, then of those that their effects' values tell: each of the latter is one
    more unknown, and one more equation, that the values go on being what the shape says."""
    both = [*free, *told]
    X = np.concatenate([frame.X, *(fit.behind_filters(s.x, frame.gains) for s in both)], axis=2)
    Z = np.concatenate([frame.Z, *(fit.behind_filters(s.z, frame.gains) for s in free)], axis=2)
    x, z = (np.concatenate([a.reshape(-1, a.shape[2]), fit.known_rows(a.shape[2])]) for a in (X, Z))
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
    uneven = _uneven(fit, frame, Z / scale[:count], equations)
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


def _slope(fit: Fit, effect: Effect, name: str, values: Array, *, instrument: bool) -> list[Spectra]:
    """The slope of an effect's torque over one of its shapes, as a column of each run."""
    ends = _ends(effect, name)
    found = []
    for run, motion in zip(fit.runs, fit.motions(instrument=instrument, effect=effect), strict=True):
        up, down = (effect_columns(effect.with_shape(**{name: x}), motion, fit.robot) @ values for x in ends)
        found.append(Spectra.of(((up - down) / max(ends[0] - ends[1], 1e-300))[:, :, None], run))
    return found


def _ends(effect: Effect, name: str) -> tuple[float, float]:
    """Two values of a shape beside its own."""
    at = float(getattr(effect, name))
    p = next(p for p in effect.shape() if p.name == name)
    h = _STEP * max(abs(at), 1e-6)
    return float(np.clip(at + h, p.lower, p.upper)), float(np.clip(at - h, p.lower, p.upper))
