"""How the torque of accepted effects changes with their shapes, and the shapes at which the residual is uncorrelated with that."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...instruments.columns import effect_columns, is_order
from ...instruments.fit import Fit
from ...instruments.solved import deviations, inverse_of
from ...instruments.spectra import Spectra
from ..design.places import search_range
from .refinement import can_be

if TYPE_CHECKING:
    from ...effects.base import Effect
    from ...instruments.solved import Solved

Array = np.ndarray
#: Share of a shape over which its slope is taken, either way.
_STEP = 1e-3
#: Refits in which shapes are balanced, the share of their standard deviation to which they are, and the most by which one changes at once.
_BALANCED, _TO, _AT_ONCE = 4, 0.1, 0.2


@dataclass(frozen=True)
class Slope:
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


def slopes(fit: Fit, frame: Solved) -> list[Slope]:
    """Slopes of all accepted effects over their shapes, at a fit."""
    robot, found = fit.robot, []
    for effect, own in zip(fit.effects, fit.slices, strict=True):
        tied = effect.response(robot) is not None
        for p in () if is_order(effect) else effect.shape():
            if p.points == 1 or (tied and (p.name != effect.told_shape(robot) or getattr(effect, p.name) == 0.0)):
                continue
            x, z = (_slope(fit, effect, p.name, frame.theta[own], instrument=side) for side in (False, True))
            if any(not each.empty for each in z):
                rate = _rate(effect, p.name, fit) if tied else 0.0
                found.append(Slope(effect, p.name, x, z, tuple(range(own.start, own.stop)) if tied else (), rate))
    return found


def extended(fit: Fit, frame: Solved, free: Sequence[Slope], told: Sequence[Slope] = ()) -> tuple[Array, Array]:
    """Rows (M, p) of a frame's columns with slopes as further ones: of the measured motion, and of the instrument without the `told`. Those
    that do not come from the log are the last."""
    X = np.concatenate([frame.X, *(fit.behind_filters(s.x, frame.gains) for s in (*free, *told))], axis=2)
    Z = np.concatenate([frame.Z, *(fit.behind_filters(s.z, frame.gains) for s in free)], axis=2)
    x, z = (np.concatenate([a.reshape(-1, a.shape[2]), fit.known_rows(a.shape[2])]) for a in (X, Z))
    return x, z


def balanced(effects: tuple[Effect, ...], fit: Fit, gains: tuple[Array, ...]) -> tuple[Effect, ...]:
    """Effects at the shapes at which the residual, behind whitening filters, is uncorrelated with the instrument's slopes over them.

    A score is largest at the shape whose column along the instrument is most like the residual; the instrument's motion is smoother than
    the measured one, so that friction that builds up was found over a distance 5 % too long. The slopes are further columns of the same
    equations, and where their coefficients are zero the shapes are those that the standard deviations are of. No shape goes where its
    effect's values are those of no such effect."""
    best, least = effects, np.inf
    for _ in range(_BALANCED):
        other = fit.with_effects(effects)
        frame = other.behind(gains)
        if effects != best and not _can_all_be(other, frame):
            return best
        free = [s for s in slopes(other, frame) if not s.told]
        if not free:
            return best
        step, std = _steps(other, frame, free)
        off = float(np.max(np.abs(step) / std))
        if not off < least:
            return best
        best, least = effects, off
        if off <= _TO:
            return best
        effects = tuple(_moved(e, fit, {s.name: float(d) for s, d in zip(free, step, strict=True) if s.effect == e}) for e in effects)
    return best


def _can_all_be(fit: Fit, frame: Solved) -> bool:
    """Whether the values of all accepted effects are those of such effects."""
    return all(can_be(e, fit, frame.theta[own], frame.std[own]) for e, own in zip(fit.effects, fit.slices, strict=True))


def _steps(fit: Fit, frame: Solved, free: Sequence[Slope]) -> tuple[Array, Array]:
    """Coefficients of slopes as further columns of a frame, and their standard deviations."""
    x, z = extended(fit, frame, free)
    scale = np.linalg.norm(z, axis=0)
    scale = np.where(scale > 0.0, scale, 1.0)
    equations, gram = (z / scale).T @ (x / scale), (z / scale).T @ (z / scale)
    # The prior's part is in balance with the rest already.
    own, residual = slice(frame.X.shape[2], None), frame.residual.reshape(-1)
    right = np.zeros(len(scale))
    right[own] = residual @ z[: len(residual), own]
    found = inverse_of(equations)[0] @ (right / scale) / scale
    return found[own], np.maximum(deviations(equations, gram) / scale, 1e-300)[own]


def _moved(effect: Effect, fit: Fit, steps: dict[str, float]) -> Effect:
    """An effect with its shapes moved by some steps, not far at once and not out of where it can be."""
    ranges = search_range(effect, fit.declared, fit.sought(effect)) if steps else {}
    to = {}
    for name, step in steps.items():
        at = float(getattr(effect, name))
        low, high = ranges[name]
        to[name] = float(np.clip(at + np.clip(step, -_AT_ONCE * abs(at), _AT_ONCE * abs(at)), low, high))
    return effect.with_shape(**to) if to else effect


def _rate(effect: Effect, name: str, fit: Fit) -> float:
    """Change of what an effect's values are by its law, per unit of one of its shapes."""
    more, less = (effect.with_shape(**{name: x}) for x in _ends(effect, name))
    apart = float(getattr(more, name)) - float(getattr(less, name))
    up, down = (np.mean(np.asarray(each.response(fit.robot), float)) for each in (more, less))
    return float(up - down) / apart


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
