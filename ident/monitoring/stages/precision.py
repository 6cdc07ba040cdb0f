"""How exactly a finding's parameters and shapes are known: all of them sought together once more, and their standard deviations.

The search finds each shape beside what was known then, to a few steps of a grid. Here the shapes of all findings are moved together
with every linear parameter by Gauss-Newton steps until nothing is gained. Standard deviations are those of the same linearised
problem, each joint's noise being as strong as what is left there, but no less than the noise floor. Where the residual is not what
that promises (structure that nothing explains, a law that is not quite exact), the scatter of its blocks of time is larger, and counts
instead: the jackknife over them (J. MacKinnon, H. White, Journal of Econometrics 29 (1985), by blocks)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...diagnosis.result import FoundParameter
from ...effects.base import Effect
from ...effects.kinds import Need
from ...robots.parameters import ShapeParameter
from .normal import Normal, Slopes

if TYPE_CHECKING:
    from .stage import Stage

Array = np.ndarray
#: Steps over all shapes, and halvings of one that gains nothing.
_STEPS = 6
_HALVINGS = 3
#: A step is not worth taking that promises less than this (twice a log-likelihood).
_LEAST = 0.01
#: Relative step of a difference quotient over a shape.
_DIFFERENCE = 1e-3
#: Slopes over a shape that are smaller than this beside the noise (root sum of squares over the whole log), or of whose square less
#: than this share is not in the model's own columns, tell nothing of it.
_FELT = 1e-6
#: A deviation on the logarithmic scale from which on a shape is as good as unknown.
_UNKNOWN = 20.0
#: A moment is moved so much farther at a time, up to so many seconds.
_WIDER = 1.3
_LONGEST = 10.0
_NOTHING = 1e-250
#: Least share of what is known of any direction that the blocks other than one are taken to hold.
_OTHERS = 0.2
_SHOWN = 1e-9
#: Part (squared) that a parameter may have in a direction of which nothing is known.
_TOUCHED = 1e-6


def settled(stage: Stage, effects: Sequence[Effect], rebuilt: Callable[[Sequence[Effect]], Stage]) -> tuple[Stage, tuple[Effect, ...]]:
    """The stage, and its effects, at the shapes that fit best together. `rebuilt`: makes the stage of the same model with effects."""
    best, own = stage, tuple(effects)
    for _ in range(_STEPS):
        slopes = _slopes(best, own)
        if not slopes.place:
            break
        step, promised = _step(best, own, slopes)
        if promised < _LEAST:
            break
        before = _bound_loss(best, own)
        for halving in range(_HALVINGS):
            moved = _moved(best, own, slopes, 0.5**halving * step)
            tried = rebuilt(moved)
            gained = before - _bound_loss(tried, moved)
            if gained > 0.0 and all(_possible(e, stage) for e in moved):
                break
        else:
            break
        best, own = tried, moved
        if gained < _LEAST:
            break
    return best, own


def _possible(effect: Effect, stage: Stage) -> bool:
    """Whether nothing speaks against an effect's shape, whatever its parameters are."""
    robot = stage.problem.model.robot
    k = len(effect.parameters(robot))
    return not effect.implausible(robot, np.ones(k), np.full(k, np.inf))


def found_parameters(stage: Stage, effects: Sequence[Effect]) -> list[tuple[FoundParameter, ...]]:
    """Of each effect of a stage its values with standard deviations, linear ones first."""
    robot, names = stage.problem.model.robot, list(stage.problem.model.names)
    values, used = stage.problem.base.expand(stage.frame.transform @ _bound_fit(stage, effects)), stage.problem.reference
    slopes = _slopes(stage, effects)
    std, shape_std = _deviations(stage, effects, slopes)
    out = []
    for i, effect in enumerate(effects):
        linear = []
        for p in effect.parameters(robot):
            k = names.index(p.name)
            # Where the fit did not become consistent with its own prediction, it is known no better than the two agree.
            apart = 0.0 if used is None else float(values[k] - used[k])
            linear.append(FoundParameter(p.name, float(values[k]), float(np.hypot(std.get(p.name, np.nan), apart)), p.unit))
        shapes = []
        for shape in effect.shape():
            value = float(getattr(effect, shape.name))
            s = _on_its_own_scale(shape, value, shape_std.get((i, shape.name), np.nan))
            if shape.unit == "s" and Need.TIME in effect.needs:
                own = np.array([p.value for p in linear])
                s = max(s, 0.5 * _anywhere_within(stage, effect, own, shape.name))
            shapes.append(FoundParameter(shape.name, value, s, effect.shape_unit(shape, robot)))
        out.append((*linear, *shapes))
    return out


def _on_its_own_scale(shape: ShapeParameter, value: float, deviation: float) -> float:
    """Standard deviation of a shape of this value from that on its natural scale. Of an interval that is even on a logarithmic scale the
    longer side: the truth is as likely there as on the shorter."""
    if shape.log and not np.isnan(deviation):
        deviation = value * float(np.expm1(deviation)) if deviation < _UNKNOWN else float("inf")
    return float(np.hypot(deviation, shape.idealised * value))


def kept(stage: Stage, effect: Effect, effects: Sequence[Effect]) -> float:
    """The share of an effect's gain in a stage that is left when parameters which shapes of its `effects` bind are at what they must be."""
    own = support(stage, effect)
    return 1.0 if not np.isfinite(own) else 1.0 - (_bound_loss(stage, effects) - stage.frame.loss) / max(own, 1e-300)


def unbound(stage: Stage, effects: Sequence[Effect]) -> list[tuple[Array, Array]]:
    """Of each effect of a stage the values (k,) of its parameters, and their standard deviations, if its shapes bind none of them: inf for
    those that the data tell nothing of, or only together with others."""
    robot, names = stage.problem.model.robot, list(stage.problem.model.names)
    base = stage.problem.base
    values = base.expand(stage.frame.base_values)
    std, _ = _deviations(stage, (), _slopes(stage, effects))
    alone = dict(zip(base.names, np.count_nonzero(base.regroup, axis=1) == 1, strict=True))
    own = [[p.name for p in effect.parameters(robot)] for effect in effects]
    known = [np.array([std[name] if alone.get(name, False) else np.inf for name in every]) for every in own]
    return [(values[[names.index(name) for name in every]], s) for every, s in zip(own, known, strict=True)]


def _anywhere_within(stage: Stage, effect: Effect, values: Array, name: str) -> float:
    """How far (s) a moment may be moved, on the side where it may be moved farther, before it shows (by two standard deviations): at
    least part of a sampling period; up to the next row where rows had to be left out."""
    residual, at = stage.frame.residual, float(getattr(effect, name))
    here, least = stage.search.whitened(effect) @ values, float(np.sum(residual**2))
    farthest = 0.0
    for side in (1.0, -1.0):
        reach = 0.5 / stage.problem.signals.rate
        while reach < _LONGEST:
            there = stage.search.whitened(effect.with_shape(**{name: max(0.0, at + side * reach)})) @ values
            if float(np.sum((residual + here - there) ** 2)) > least + 4.0:
                break
            reach *= _WIDER
        farthest = max(farthest, reach)
    return farthest


def support(stage: Stage, effect: Effect) -> float:
    """What the loss of a stage would rise by without one of its effects, the rest refitted (inf where its parameters are tied)."""
    problem, frame = stage.problem, stage.frame
    base = list(problem.base.names)
    names = [p.name for p in effect.parameters(problem.model.robot)]
    if any(name not in base for name in names):
        return float("inf")
    T = frame.transform[[base.index(name) for name in names]]
    values = T @ frame.coefficients
    return float(values @ _pinv(T @ frame.inverse_gram @ T.T) @ values)


def _bound_fit(stage: Stage, effects: Sequence[Effect]) -> Array:
    """Coefficients (b,) of a stage's columns, parameters that its effects' shapes bind being at what they must be."""
    nothing = Slopes(np.zeros((*stage.frame.residual.shape, 0)), ())
    return Normal.of(stage, effects, nothing).solved()[0]


def _bound_loss(stage: Stage, effects: Sequence[Effect]) -> float:
    """The loss of that fit."""
    return float(np.sum((stage.frame.torque - stage.frame.columns @ _bound_fit(stage, effects)) ** 2))


def _slopes(stage: Stage, effects: Sequence[Effect]) -> Slopes:
    """Slopes over the shapes of effects."""
    names, robot = list(stage.problem.model.names), stage.problem.model.robot
    values = stage.problem.base.expand(stage.frame.base_values)
    columns, place = [], []
    for i, effect in enumerate(effects):
        bound = effect.response(robot)
        own = values[[names.index(p.name) for p in effect.parameters(robot)]] if bound is None else bound
        for p in effect.shape():
            columns.append(_slope(stage, effect, own, p.name))
            place.append((i, p.name))
    n, M = stage.frame.residual.shape
    return Slopes(np.concatenate(columns, axis=2) if columns else np.zeros((n, M, 0)), tuple(place))


def _slope(stage: Stage, effect: Effect, values: Array, name: str) -> Array:
    """Derivative (n, M, 1) of an effect's whitened torque with respect to a shape (its logarithm where that is natural)."""
    at = float(getattr(effect, name))
    p = next(p for p in effect.shape() if p.name == name)
    ends = []
    for step in (_DIFFERENCE, -_DIFFERENCE):
        x = at * np.exp(step) if p.log else at + step * (abs(at) + 1e-6)
        x = float(np.clip(x, p.lower, p.upper))
        columns = stage.search.whitened(effect.with_shape(**{name: x}))
        ends.append((columns @ values, np.log(x) if p.log else x))
    width = ends[0][1] - ends[1][1]
    return np.asarray(((ends[0][0] - ends[1][0]) / width)[:, :, None] if width else np.zeros((*ends[0][0].shape, 1)))


def _step(stage: Stage, effects: Sequence[Effect], slopes: Slopes) -> tuple[Array, float]:
    """Gauss-Newton step (s,) over the shapes beside all linear parameters, and what it promises to gain."""
    normal = Normal.of(stage, effects, slopes)
    found, still = normal.solved()[0], normal.fixed()
    return found[normal.coefficients :], normal.gain(found) - still.gain(still.solved()[0])


def _moved(stage: Stage, effects: Sequence[Effect], slopes: Slopes, step: Array) -> tuple[Effect, ...]:
    """The effects with their shapes moved, within what is worth searching."""
    out = list(effects)
    ranges = [stage.motions.search_range(effect) for effect in effects]
    for (i, name), move in zip(slopes.place, step, strict=True):
        p = next(p for p in out[i].shape() if p.name == name)
        at = float(getattr(out[i], name))
        x = at * float(np.exp(np.clip(move, -1.0, 1.0))) if p.log else at + float(move)
        low, high = ranges[i][name]
        out[i] = out[i].with_shape(**{name: float(np.clip(x, min(low, at), max(high, at)))})
    return tuple(out)


def _deviations(stage: Stage, effects: Sequence[Effect], slopes: Slopes) -> tuple[dict[str, float], dict[tuple[int, str], float]]:
    """Standard deviations of base parameters by name, and of shapes by place."""
    frame = stage.frame
    normal = Normal.of(stage, effects, slopes)
    whole = normal.solved()[1]
    residual = frame.torque - frame.columns @ normal.fixed().solved()[0]
    base, width = frame.transform.shape
    shapes = len(slopes.place)
    outputs = np.block([[frame.transform, np.zeros((base, shapes))], [np.zeros((shapes, width)), np.eye(shapes)]])
    D = np.concatenate([frame.columns, slopes.columns], axis=2)
    level = whole @ _at_what_is_left(D, residual, stage.problem.signals.valid.sum(axis=0), whole) @ whole
    plain = np.einsum("ij,jk,ik->i", outputs, level, outputs)
    scatter = np.zeros(len(plain))
    root = _root(whole)
    for rows in frame.block_rows:
        own_columns = D[:, rows].reshape(-1, D.shape[2]) @ root
        # What a block itself has pulled the fit by is missing in its residual: without it, the residual is that of a fit to the others.
        share, axes = np.linalg.eigh(own_columns.T @ own_columns)
        pulled = axes @ ((axes.T @ (own_columns.T @ residual[:, rows].reshape(-1))) / np.maximum(1.0 - share, _OTHERS))
        scatter += (outputs @ (root @ pulled)) ** 2
    variance = np.maximum(plain, scatter)
    std = np.sqrt(np.maximum(variance, 0.0))
    std[:base][~_shown(frame.transform)] = np.inf
    # A shape that makes no difference, or none that linear parameters do not make as well, is not known at all.
    size = np.sqrt(np.maximum(np.diag(normal.matrix)[width:], 1e-300))
    known = np.diag(whole)[width:]
    shown = (known > 0.0) & (1.0 > _SHOWN * size**2 * known)
    std[base:][~shown | (size < _FELT)] = np.inf
    return dict(zip(stage.problem.base.names, std[:base].tolist(), strict=True)), dict(zip(slopes.place, std[base:].tolist(), strict=True))


def _shown(transform: Array) -> Array:
    """Which base parameters (k,) the columns of a frame tell of, each by itself: one that has a part in no direction that they lack."""
    size = np.linalg.norm(transform, axis=1)
    there = size > 0.0
    axes = np.linalg.qr(transform[there] / size[there, None])[0]
    out = np.zeros(len(size), bool)
    out[there] = np.sum(axes**2, axis=1) > 1.0 - _TOUCHED
    return out


def _at_what_is_left(columns: Array, residual: Array, rows: Array, covariance: Array) -> Array:
    """Cross-products (c, c) of columns (n, M, c), those of each joint as many times as the square of what is left on its `rows` (n,) is
    more than noise: structure that nothing explains pulls as noise does, and blocks of time that all hold it alike do not tell."""
    out = np.zeros_like(covariance)
    for own, left, count in zip(columns, residual, rows, strict=True):
        products = own.T @ own
        free = max(float(count) - float(np.sum(covariance * products)), 1.0)
        out += max(1.0, float(left @ left) / free) * products
    return out


def _root(A: Array) -> Array:
    """L with L Lᵀ = A, symmetric positive semidefinite, of any scale in its rows."""
    scale = np.sqrt(np.maximum(np.diag(A), _NOTHING))
    values, axes = np.linalg.eigh(A / scale[:, None] / scale)
    return np.asarray(scale[:, None] * axes * np.sqrt(np.maximum(values, 0.0)))


def _pinv(A: Array) -> Array:
    """Inverse of a symmetric positive semidefinite matrix, scaled; directions below 1e-10, or of nothing at all, are left at
    zero."""
    if not len(A):
        return A
    size = np.diag(A)
    scale = np.where(size > _NOTHING, 1.0 / np.sqrt(np.maximum(size, _NOTHING)), 0.0)
    return np.asarray(np.linalg.pinv(A * scale[:, None] * scale, rcond=1e-10, hermitian=True) * scale[:, None] * scale)
