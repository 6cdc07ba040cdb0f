"""Shapes of an effect, sought where its score is largest."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ...instruments.columns import is_order
from ...instruments.thresholds import BOUND
from ..design.catalogue import Catalogue
from ..design.places import order_spacing, search_range
from ..thresholds import SEEN
from .scores import Scores

if TYPE_CHECKING:
    from ...effects.base import Effect
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved
    from ...robots.parameters import ShapeParameter

Array = np.ndarray
Score = Callable[[list["Effect"], tuple[str, ...], "Fit", "Solved"], Array]
#: Points over the whole range of a lone shape and of each of several, and around the best one.
_WHOLE, _EACH, _FINE = 25, 7, 9
#: Rounds over the whole range, and around a shape found before; each looks at a quarter of the last.
_ROUNDS, _NEAR_ROUNDS = 2, 5
#: Share of an end of its range within which a shape stands there.
_END = 1e-3
#: Part that two shapes of an effect have in common, below which others between them are looked at; times that a step is halved at most,
#: and once it led somewhere.
_ALIKE, _HALVED, _CLOSER = 0.5, 3, 4
#: How far (logarithm) from where it scores best a limit is looked for by what it leaves.
_REACH = 0.15
#: Passes of a refit whose columns follow the values.
PASSES = 3
#: Refits in which a shape comes to agree with its own values, and the share of its standard deviation to which it does.
_AGREE, _AGREES = 8, 0.1
#: Rounds around an order, each at a third of the last.
_ORDER_ROUNDS = 4
#: Share of the range that is looked at around a shape that was found before.
_NEAR = 0.06


def refined(effect: Effect, joints: tuple[str, ...], fit: Fit, frame: Solved, *, near: bool = False, score: Score | None = None) -> Effect:
    """An effect at the shape that scores best beside a frame; `near`: only around the one it has. `score`: `scored` by default."""
    score = score or scored
    if is_order(effect) and not on_a_slide(effect, fit) and _free(effect, fit):
        return _order(effect, joints, fit, frame)
    free = _free(effect, fit)
    if not free:
        return effect
    ranges = search_range(effect, fit.declared, fit.sought(effect))
    axes = [_Axis.of(p, *ranges[p.name]) for p in free]
    points, width = (_FINE, _NEAR) if near else (_WHOLE if len(axes) == 1 else _EACH, 1.0)
    if is_order(effect) and not near:
        points, width = _FINE, 1.0 / 8.0  # whole numbers of periods were looked at: this is between them
    for turn in range(_NEAR_ROUNDS if near else _ROUNDS):
        for axis in axes:
            values = axis.around(float(getattr(effect, axis.name)), width, points)
            if not near and not turn:
                values = _told_apart(effect, axis, values, joints, fit, frame)
            effect = _best([effect, *(effect.with_shape(**{axis.name: v}) for v in values)], joints, fit, frame, score)
        width, points = width * 2.5 / points, _FINE
    return effect


def anywhere(effect: Effect, joints: tuple[str, ...], fit: Fit, frame: Solved) -> Effect:
    """An effect of several shapes at those that score best beside a frame together, sought from every peak of a grid; of one, as it is.

    Along one shape at a time a search stays on the ridge that it began on: a spring of the shortest lever is the same law at two angles,
    half a turn apart, and only the one of them leads on to a longer lever."""
    from scipy.ndimage import maximum_filter

    free = _free(effect, fit)
    if len(free) < 2:
        return effect
    ranges = search_range(effect, fit.declared, fit.sought(effect))
    axes = [_Axis.of(p, *ranges[p.name]) for p in free]
    grid = [axis.around(float(getattr(effect, axis.name)), 1.0, _EACH) for axis in axes]
    options = [effect.with_shape(**{axis.name: v for axis, v in zip(axes, at, strict=True)}) for at in itertools.product(*grid)]
    z = scored(options, joints, fit, frame).reshape([_EACH] * len(axes))
    peaks = [options[k] for k in np.flatnonzero((z > 0) & (z == maximum_filter(z, 3)))]
    for n in range(_ROUNDS):
        width = 2.5 / _EACH * (2.5 / _FINE) ** n
        for axis in axes:
            for i, peak in enumerate(peaks):
                values = axis.around(float(getattr(peak, axis.name)), width, _FINE)
                peaks[i] = _best([peak, *(peak.with_shape(**{axis.name: v}) for v in values)], joints, fit, frame, scored)
    return _best([effect, *peaks], joints, fit, frame, scored)


def _best(options: list[Effect], joints: tuple[str, ...], fit: Fit, frame: Solved, score: Score) -> Effect:
    """The one that scores best, the first of those alike."""
    return options[int(np.argmax(score(options, joints, fit, frame)))]


def sharpened(effect: Effect, joints: tuple[str, ...], others: tuple[Effect, ...], fit: Fit, gains: tuple[Array, ...]) -> Effect:
    """An effect at the shape near its own that scores best beside others, at the noise of a model that has it.

    At such noise a shape that is off by little has values that are off by many deviations, such as no effect can have: whether they can be
    is asked of the best alone, by a refit. Where they cannot, the best is sought among shapes whose values can."""
    frame = fit.behind(gains)
    found = refined(effect, joints, fit, frame, near=True, score=_plain)
    if found == effect:
        return effect
    other = fit.with_effects((*others, found))
    return found if can_be(found, other, *last_values(other, other.behind(gains))) else refined(effect, joints, fit, frame, near=True)


def likeliest(shapes: Sequence[Effect], joints: tuple[str, ...], others: tuple[Effect, ...], fit: Fit, frame: Solved) -> Effect:
    """An accepted effect (in `frame`) at the shape that is likeliest beside others, each at the noise that it leaves, of those whose values
    can be: of some `shapes`, and of those near the last that score best.

    What a wrong shape leaves passes for coloured noise, at which that very shape scores best: the shape is sought with one weight for all
    frequencies, too, and by steps from the likeliest to one that is likelier. And while something else is missing, the right shape may have
    values that cannot be: it stays in the running."""
    effect = shapes[-1]
    weights = (frame.gains, fit.with_effects((*others, effect)).flat(None))
    found = list(dict.fromkeys([*shapes, *(sharpened(effect, joints, others, fit, gains) for gains in weights)]))

    @cache
    def worth(e: Effect) -> tuple[bool, float]:
        other = fit.with_effects((*others, e))
        refit = other.solved(1)
        return can_be(e, other, *last_values(other, refit)), other.likelihood(refit)

    def clearly_above(e: Effect, other: Effect) -> bool:
        """Near its top a likelihood whose noise is told from the same rows is rough, and a score tells the shape better."""
        return worth(e)[0] >= worth(other)[0] and 2.0 * (worth(e)[1] - worth(other)[1]) > SEEN**2

    best = max(found, key=worth)
    higher = best if is_order(best) else _climbed(best, fit, worth)
    if not clearly_above(higher, best):
        return best
    sharper = sharpened(higher, joints, others, fit, fit.with_effects((*others, higher)).solved(1).gains)
    return higher if clearly_above(higher, sharper) else sharper


def _climbed(effect: Effect, fit: Fit, worth: Callable[[Effect], tuple[bool, float]]) -> Effect:
    """An effect at the end of steps along each of its free shapes that make it likelier: ever shorter ones, the last where longer ones led
    somewhere."""
    best = effect
    free = _free(effect, fit)
    ranges = search_range(effect, fit.declared, fit.sought(effect)) if free else {}
    for axis in (_Axis.of(p, *ranges[p.name]) for p in free):
        for halved in range(_HALVED + _CLOSER):
            if halved == _HALVED and best == effect:
                break
            for step in (0.5**halved * _NEAR, -(0.5**halved) * _NEAR):
                while (value := axis.moved(float(getattr(best, axis.name)), step)) is not None:
                    other = best.with_shape(**{axis.name: value})
                    if worth(other) <= worth(best):
                        break
                    best = other
    return best


def _told_apart(effect: Effect, axis: _Axis, values: list[float], joints: tuple[str, ...], fit: Fit, frame: Solved) -> list[float]:
    """Values of a shape, with others between those that the rows tell apart: a step behind slow noise is seen near its own time alone."""
    for _ in range(_HALVED):
        one = [effect.with_shape(**{axis.name: v}) for v in values]
        scores = Scores.of(fit, frame, Catalogue.of_effects(fit, [(e, joints) for e in one]))
        place = {k: i for i, k in enumerate(scores.kept)}
        between = [
            axis.between(values[k], values[k + 1])
            for k in range(len(values) - 1)
            if k in place and k + 1 in place and scores.alike(place[k], place[k + 1]) < _ALIKE
        ]
        if not between:
            break
        values = sorted({*values, *between})
    return values


def _order(effect: Effect, joints: tuple[str, ...], fit: Fit, frame: Solved) -> Effect:
    """An effect at the order that scores best near its own; at a whole one, unless what that leaves would be seen.

    A wheel between motor and joint may have any order; the motor's and the joint's own are whole."""
    (p,) = effect.shape()
    apart = order_spacing(effect, fit.declared, fit.motions(instrument=True))
    if apart is None:
        return effect
    low, high = search_range(effect, fit.declared, fit.sought(effect))[p.name]
    best, reach = float(getattr(effect, p.name)), 0.6 * apart
    for _ in range(_ORDER_ROUNDS):
        values = np.clip(np.linspace(best - reach, best + reach, _FINE), max(low, p.lower), min(high, p.upper)).tolist()
        z = scored([effect.with_shape(**{p.name: v}) for v in values], joints, fit, frame)
        best, reach = values[int(np.argmax(z))], 0.3 * reach
    whole = float(max(round(best), 1))
    z = scored([effect.with_shape(**{p.name: v}) for v in (whole, best)], joints, fit, frame)
    return effect.with_shape(**{p.name: whole if z[1] ** 2 - z[0] ** 2 <= SEEN**2 else best})


def scored(effects: list[Effect], joints: tuple[str, ...], fit: Fit, frame: Solved) -> Array:
    """z of each effect of a list beside a frame; nothing where its values would be those of no such effect.

    A shape thus stays where its effect is possible: friction |ω|^a, a < 1, that resists has a mirror beside viscous friction, a > 1, that
    drives."""
    scores, z = _scores(effects, joints, fit, frame)
    for i, k in enumerate(scores.kept):
        if not can_be(effects[k], fit, *scores.values(i)):
            z[k] = 0.0
    return z


def _plain(effects: list[Effect], joints: tuple[str, ...], fit: Fit, frame: Solved) -> Array:
    """z of each effect of a list beside a frame, whatever its values."""
    return _scores(effects, joints, fit, frame)[1]


def _scores(effects: list[Effect], joints: tuple[str, ...], fit: Fit, frame: Solved) -> tuple[Scores, Array]:
    """Scores of a list of effects, and z of each; nothing where the model absorbs it."""
    scores = Scores.of(fit, frame, Catalogue.of_effects(fit, [(e, joints) for e in effects]))
    z = np.zeros(len(effects))
    z[scores.kept] = scores.plain
    return scores, z


def last_values(fit: Fit, frame: Solved) -> tuple[Array, Array]:
    """Values (k,) of the last effect of a fit, and their standard deviations."""
    own = slice(len(frame.theta) - len(fit.effects[-1].parameters(fit.robot)), None)
    return frame.theta[own], frame.std[own]


def can_be(effect: Effect, fit: Fit, values: Array, std: Array) -> bool:
    """Whether values lie within an effect's bounds as far as their deviations tell, and are those of something that can be."""
    robot = fit.robot
    if fit.known is not None and (told := fit.known.can_be(effect, robot, values, std)) is not None:
        return told
    inside = all(p.lower - BOUND * s <= v <= p.upper + BOUND * s for p, v, s in zip(effect.parameters(robot), values, std, strict=True))
    return inside and not effect.implausible(robot, values, std)


def within_range(effect: Effect, fit: Fit) -> bool:
    """Whether an effect's shapes lie where such an effect can be."""
    ranges = search_range(effect, fit.declared, fit.sought(effect))
    return all(low < getattr(effect, name) < high for name, (low, high) in ranges.items())


def _free(effect: Effect, fit: Fit) -> tuple[ShapeParameter, ...]:
    """Shapes that may be anything between their bounds: no delay taken as a slope."""
    if fit.known is not None and fit.known.holds(effect):
        return ()
    if effect.response(fit.robot) is not None and any(getattr(effect, p.name) == 0.0 for p in effect.shape()):
        return ()
    return tuple(p for p in effect.shape() if p.points != 1)


def settled(effect: Effect, others: tuple[Effect, ...], fit: Fit) -> Effect:
    """An effect at the shape near its own beside which the least is left: where all else is small beside it, a score hardly changes."""
    from scipy.optimize import minimize_scalar

    (p,) = effect.shape()

    def left(log_value: float) -> float:
        other = fit.with_effects((*others, effect.with_shape(**{p.name: float(np.exp(log_value))})))
        return float(np.sum(np.log(np.maximum(other.noise(other.solved(1)), 1e-300))))

    at = float(np.log(getattr(effect, p.name)))
    found = minimize_scalar(left, bounds=(at - _REACH, at + _REACH), method="bounded", options={"xatol": 1e-4, "maxiter": 25})
    return effect.with_shape(**{p.name: float(np.exp(found.x))}) if found.fun < left(at) else effect


def agreed(effect: Effect, others: tuple[Effect, ...], fit: Fit) -> Effect:
    """An effect whose fitted values tell its shape, at the shape that agrees with them beside others; as it is where none does.

    To first order a shape far from its own response may score best: a lag of twice the time constant at half its share."""
    name = effect.told_shape(fit.robot)
    if name is None:
        return effect  # its values tell nothing
    found = effect
    before: tuple[float, float] | None = None
    for _ in range(_AGREE):
        other = fit.with_effects((*others, found))
        values, std = last_values(other, other.solved(PASSES))
        ends = search_range(found, fit.declared, fit.sought(found))[name]
        shapes = (found, found.told_by(values), found.told_by(values + std))
        at, told, more = (float(np.clip(getattr(each, name), *ends)) for each in shapes)
        if abs(told - at) <= _AGREES * abs(more - told):
            return found if can_be(found, other, values, std) else effect
        # What the values tell changes with the shape: where the line through the last two meets the shape itself.
        slope = 0.0 if before is None or at == before[0] else (told - before[1]) / (at - before[0])
        before = at, told
        slope = slope if abs(slope) < 1.0 else 0.0
        found = found.with_shape(**{name: float(np.clip((told - slope * at) / (1.0 - slope), *ends))})
    return effect


def at_an_end(effect: Effect, fit: Fit) -> bool:
    """Whether a distance stands at an end of the range in which such an effect is itself: there it is another law's (friction that takes a
    tenth of the travel to build up is a hose that drags)."""
    shapes = [p for p in _free(effect, fit) if p.unit.startswith("rad (")]
    ranges = search_range(effect, fit.declared, fit.sought(effect)) if shapes else {}
    ends = [(float(getattr(effect, p.name)), *ranges[p.name]) for p in shapes]
    return any(value < (1.0 + _END) * low or value > (1.0 - _END) * high for value, low, high in ends)


def on_a_slide(effect: Effect, fit: Fit) -> bool:
    """An order's positions are those of a slide, where no order is whole."""
    return fit.robot.position_unit(effect.at(fit.robot)[0], getattr(effect, "angle", effect.side)) != "rad"


@dataclasses.dataclass(frozen=True)
class _Axis:
    """One shape's range, in logarithms where it is one of scale."""

    name: str
    low: float
    high: float
    log: bool
    bounds: tuple[float, float]

    @classmethod
    def of(cls, p: ShapeParameter, low: float, high: float) -> _Axis:
        log = bool(p.log and low > 0)
        return cls(p.name, *((float(np.log(low)), float(np.log(high))) if log else (low, high)), log, (p.lower, p.upper))

    def moved(self, value: float, by: float) -> float | None:
        """A value so far from one, as a share of the range; None beyond its ends."""
        at = (float(np.log(value)) if self.log else value) + by * (self.high - self.low)
        return (float(np.exp(at)) if self.log else at) if self.low <= at <= self.high else None

    def around(self, value: float, width: float, points: int) -> list[float]:
        """Values within a share of the range around one."""
        at = float(np.log(value)) if self.log else value
        reach = width * (self.high - self.low)
        ends = (self.low, self.high) if width >= 1.0 else (max(self.low, at - reach), min(self.high, at + reach))
        found = np.linspace(*ends, points)
        return np.clip(np.exp(found) if self.log else found, *self.bounds).tolist()

    def between(self, low: float, high: float) -> float:
        """The value half-way."""
        return float(np.sqrt(low * high)) if self.log else 0.5 * (low + high)
