"""The search over the catalogue: every candidate's columns, its best shape, and what it gains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Need
from ...effects.places import motors_of
from .bank import Bank
from .candidates import Candidate
from .evidence import WEAK
from .frame import Frame, Score
from .moments import CLOSE, best_moment
from .motions import Motions
from .plausible import driven_out, implausible
from .refit import Refit
from .spectral import evenly_drawn, order_gains, order_parameter, peaks
from .steady import steady_values

if TYPE_CHECKING:
    from ...robots.robot import Robot

Array = np.ndarray
#: Steps of the search for a shape, per shape parameter.
_STEPS = 14
_MOST_STEPS = 40
#: Shapes of a grid that are whitened and scored at a time.
_AT_ONCE = 64
#: Times that the prediction is mended by which an abrupt effect's columns are made.
_PASSES = 3
#: Independent orders that are found from each one of a grid on.
_BETWEEN = 4.0
#: Starts of a search among possible shapes.
_FEW = 4
#: First steps of a search over several, as a share of their ranges.
_SIMPLEX = 0.1


@dataclass(frozen=True, eq=False)
class Hit:
    """A candidate at a shape: `fit_gain` is the fall of the loss on all blocks; `columns` (n, M, k) whitened; `also`: other shapes of
    the grid from which the best one may be reached; `promise`: what parameters that are held would gain there, were they free;
    `evenly`: logarithm of the likelihood that shapes drawn evenly from the grid have on average (the declared model: 0); `tried`: how
    many independent orders were looked at, of a periodic effect."""

    candidate: Candidate
    effect: Effect
    fit_gain: float
    columns: Array = field(repr=False)
    also: tuple[Effect, ...] = ()
    promise: float = 0.0
    evenly: float = -np.inf
    tried: float = 0.0

    @property
    def place(self) -> tuple[str, tuple[str, ...], tuple[str, ...]]:
        """What it is and where: the same effect there in another configuration (an angle on the other side) is the same thing."""
        return self.candidate.name, self.candidate.joints, motors_of(self.effect)

    def __str__(self) -> str:
        shape = ", ".join(f"{p.name} = {getattr(self.effect, p.name):.4g}" for p in self.effect.shape())
        return f"{self.candidate}{f' ({shape})' if shape else ''}"


def fit_gain(hit: Hit) -> float:
    """What a hit is worth: what it gains."""
    return hit.fit_gain


@dataclass(frozen=True)
class _Scale:
    """A shape parameter's range as 0 to 1, evenly or by its logarithm."""

    low: float
    high: float
    log: bool

    def value(self, share: float) -> float:
        share = min(max(share, 0.0), 1.0)
        return self.low * (self.high / self.low) ** share if self.log else self.low + share * (self.high - self.low)

    def share(self, value: float) -> float:
        if not self.high > self.low:
            return 0.0
        return float(np.log(value / self.low) / np.log(self.high / self.low)) if self.log else (value - self.low) / (self.high - self.low)


class Search:
    """Scores candidates in a frame. Columns at first shapes are kept, in `bank`, between frames of one problem."""

    def __init__(self, frame: Frame, motions: Motions, candidates: tuple[Candidate, ...], bank: Bank | None = None) -> None:
        self.frame, self.motions, self.candidates = frame, motions, candidates
        self.bank = bank if bank is not None else Bank()
        self._seen: dict[tuple[str, ...] | None, Motions] = {}

    @property
    def robot(self) -> Robot:
        return self.frame.problem.model.robot

    def whitened(self, effect: Effect) -> Array:
        """Whitened columns (n, M, k) of an effect."""
        return self.frame.whitened(self.seen_by(effect).columns(effect))

    def seen_by(self, effect: Effect) -> Motions:
        """The motions of which an effect's columns are made: what an abrupt one does is foretold from what it has not bent."""
        return self._seen.get(effect.joints, self._steady) if effect.abrupt else self.motions

    @cached_property
    def _steady(self) -> Motions:
        return Motions(self.frame.problem.with_reference(steady_values(self.frame)))

    def scan(self, progress: Callable[[float], None] | None = None, joints: frozenset[str] | None = None) -> list[Hit]:
        """Every candidate at the best shape of its grid, the largest gain first. `joints`: only what sits on one of these, or on none."""
        hits = []
        chosen = [c for c in self.candidates if joints is None or not c.joints or joints & set(c.joints)]
        self.bank.prepare(self.seen_by, chosen)
        for i, candidate in enumerate(chosen):
            hits.append(self.first(candidate))
            if progress is not None:
                progress((i + 1) / len(chosen))
        hits.sort(key=lambda h: -h.fit_gain)
        return hits

    def first(self, candidate: Candidate) -> Hit:
        """The best shape of a candidate's grid, and of the orders that the residual's spectrum suggests."""
        effect = candidate.variants[0]
        if not effect.abrupt:
            return self._first(candidate)
        # The better it is foretold, the better the rows between its knocks are told from the others, and so on.
        best = self._first(candidate)
        hit, seen = best, self.seen_by(effect)
        for _ in range(_PASSES):
            if hit.promise < WEAK:
                break
            values = steady_values(self.frame, hit.columns)
            self._seen[effect.joints] = Motions(self.frame.problem.with_reference(values))
            hit = self._first(candidate)
            if hit.fit_gain > best.fit_gain:
                best, seen = hit, self.seen_by(effect)
        self._seen[effect.joints] = seen
        return best

    def _first(self, candidate: Candidate) -> Hit:
        from scipy.special import logsumexp

        variants = list(candidate.variants)
        name, found, spectrum = order_parameter(candidate.variants[0]), None, np.zeros(0)
        if name is not None and (found := self.bank.harmonics(self.frame, self.motions, candidate.variants[0])) is not None:
            spectrum = order_gains(found, self.frame, self.motions)
            variants = [candidate.variants[0].with_shape(**{name: n}) for n in peaks(found.orders, spectrum)] or variants
        held = [effect.response(self.robot) for effect in variants]
        every = self.bank.columns(self.seen_by(variants[0]), variants)
        k, parts = every[0].shape[2], list[tuple[Array, Array, Array]]()
        for start in range(0, len(variants), _AT_ONCE):
            own = slice(start, start + _AT_ONCE)
            Z = self.frame.whitened(np.concatenate(every[own], axis=2))
            parts.append((Z, *self.frame.fit_gains(Z, k, held[own])))
        gains, free = (np.concatenate(x) for x in zip(*((g, f) for _, g, f in parts), strict=True))
        top = int(np.argmax(gains))
        columns = parts[top // _AT_ONCE][0][:, :, (top % _AT_ONCE) * k :][:, :, :k]
        best = Hit(candidate, variants[top], float(gains[top]), np.ascontiguousarray(columns))
        if name is not None and found is not None:
            evenly = evenly_drawn(found.orders, spectrum, getattr(best.effect, name), best.fit_gain)
            best = replace(best, evenly=evenly, tried=found.independent)
        else:
            best = replace(best, evenly=float(logsumexp(0.5 * gains) - np.log(len(gains))), tried=_BETWEEN * len(gains) if name else 0.0)
        nearest = int(np.argmax(free))
        if len(best.effect.shape()) < 2:
            return best if held[0] is None and held[-1] is None else replace(best, promise=float(free[nearest]))
        # One for each value of the last shape: what acts alike at one end of it may hide the best at another.
        last = best.effect.shape()[-1].name
        tops: dict[float, tuple[float, Effect]] = {}
        for gain, effect in zip(gains, variants, strict=True):
            tops[getattr(effect, last)] = max(tops.get(getattr(effect, last), (-np.inf, effect)), (gain, effect), key=lambda x: x[0])
        also = [effect for _, effect in tops.values()]
        if all(at is None for at in held):
            return replace(best, also=tuple(effect for effect in also if effect != best.effect))
        # Between the points of a grid a knock comes too early or too late; that it comes at all shows in parameters that are free.
        also = list(dict.fromkeys([*also, variants[nearest]]))
        return replace(best, also=tuple(effect for effect in also if effect != best.effect), promise=float(free[nearest]))

    def hit(self, candidate: Candidate, effect: Effect, Z: Array | None = None) -> Hit:
        """A candidate at a shape. Where its parameters must have certain values, that is what they gain with these: a spring that is
        too soft with half its response is not this spring, and would lead the search for the shape astray."""
        Z = self.whitened(effect) if Z is None else Z
        return Hit(candidate, effect, self.frame.fit_gain(Z, effect.response(self.robot)), Z)

    def refined(self, hit: Hit, worth: Callable[[Hit], float] = fit_gain) -> Hit:
        """The same candidate at the shape that is worth most, sought from a hit on."""
        parameters = hit.effect.shape()
        if not parameters:
            return hit
        ranges = self.seen_by(hit.effect).search_range(hit.effect)
        if len(parameters) > 1:
            own = (hit.effect, *hit.also)
            starts = [hit, *(self.hit(hit.candidate, e) for e in (*hit.also, *(twin for e in own for twin in e.twins())))]
            best = max((self._together(start, ranges, worth) for start in starts), key=worth)
        else:
            p = parameters[0]
            low, high = ranges[p.name]
            best = self._along(hit, p.name, low, high, p.log and low > 0, order_parameter(hit.effect) is not None, worth)
        return replace(best, evenly=hit.evenly, tried=hit.tried)

    def possible(self, candidate: Candidate) -> Hit | None:
        """A candidate at the best shape at which its parameters are what they can be; None if they are at none of its grid.

        A shape that fits better with parameters that cannot be, a spring that pushes where it should pull, may lie far from it."""
        own = [self.hit(candidate, effect) for effect in candidate.variants]
        able = sorted((h for h in own if self._possible_gain(h) > 0.0), key=lambda h: -h.fit_gain)
        if not able:
            return None
        return self.refined(replace(able[0], also=tuple(h.effect for h in able[1:_FEW])), self._possible_gain)

    def holds(self, candidate: Candidate) -> bool:
        """Whether the model's columns hold all of a candidate's, and it has no shape: a payload beside a link whose parameters are free."""
        effect = candidate.variants[0]
        return not effect.shape() and Refit.of(self.frame, self.whitened(effect)).rank == 0

    def _possible_gain(self, hit: Hit) -> float:
        return -np.inf if self._against(hit) else hit.fit_gain

    def _against(self, hit: Hit, kept: float = 0.0) -> str:
        refit = Refit.of(self.frame, hit.columns)
        return implausible(hit.effect, refit.values, refit.std, self.robot, kept) or driven_out(self.frame, refit)

    def _together(self, hit: Hit, ranges: dict[str, tuple[float, float]], worth: Callable[[Hit], float]) -> Hit:
        """Downhill simplex (J. Nelder, R. Mead, 1965) over several shape parameters, each on its natural scale from 0 to 1."""
        from scipy.optimize import minimize

        parameters = hit.effect.shape()
        scales = [_Scale(*ranges[p.name], p.log and ranges[p.name][0] > 0) for p in parameters]
        found: list[Hit] = [hit]

        def loss(x: Array) -> float:
            shape = {p.name: min(max(s.value(float(u)), p.lower), p.upper) for p, s, u in zip(parameters, scales, x, strict=True)}
            found.append(self.hit(hit.candidate, hit.effect.with_shape(**shape)))
            # A simplex cannot go by what is infinite.
            return -max(worth(found[-1]), 0.0)

        start = np.array([s.share(getattr(hit.effect, p.name)) for p, s in zip(parameters, scales, strict=True)])
        # Inwards where the start lies at an end.
        simplex = np.vstack([start, start + np.diag(np.where(start > 0.5, -_SIMPLEX, _SIMPLEX))])
        most = _STEPS * 2 * len(parameters)
        minimize(
            loss, start, method="Nelder-Mead", options={"maxfev": most, "initial_simplex": simplex, "xatol": 1e-4, "fatol": 0.05}
        )  # fmt: skip
        return max(found, key=worth)

    def _along(self, hit: Hit, name: str, low: float, high: float, log: bool, spectral: bool, worth: Callable[[Hit], float]) -> Hit:
        """Golden-section search along one shape parameter between the neighbours of a grid."""
        to, back = (np.log, np.exp) if log else (lambda x: x, lambda x: x)
        at = float(to(getattr(hit.effect, name)))
        bottom, top = float(to(low)), float(to(high))
        if spectral:
            own = hit.effect.at(self.robot)
            phase = max(
                (float(np.ptp(m.on(getattr(hit.effect, "angle", hit.effect.side)).q[:, own], axis=0).max()) for _, m in self.motions.parts),
                default=1.0,
            )
            width = 2.0 / max(phase, 1e-9) / (getattr(hit.effect, name) if log else 1.0)
        else:
            width = (top - bottom) / 5.0
        a, b = max(bottom, at - width), min(top, at + width)
        found = {at: hit}

        def value(x: float) -> float:
            if x not in found:
                effect = hit.effect.with_shape(**{name: float(np.clip(back(x), low, high))})
                found[x] = self.hit(hit.candidate, effect)
            return worth(found[x])

        ratio = 0.5 * (np.sqrt(5.0) - 1.0)
        c, d = b - ratio * (b - a), a + ratio * (b - a)
        # A moment is sought until the sampling lets tell no more.
        moment = Need.TIME in hit.effect.needs and not log
        fine = 0.5 / self.motions.problem.signals.rate if moment else np.inf
        if moment:
            # All of them: one that gains as much as any at another end of the log may lie between two points of the grid.
            at = best_moment(self.frame, self.motions, hit.effect, name, (bottom, top))
            a, b = max(bottom, at - CLOSE), min(top, at + CLOSE)
            c, d = b - ratio * (b - a), a + ratio * (b - a)
        steps = 0
        while steps < _STEPS - 2 or (b - a > fine and steps < _MOST_STEPS):
            steps += 1
            if value(c) > value(d):
                b, d = d, c
                c = b - ratio * (b - a)
            else:
                a, c = c, d
                d = a + ratio * (b - a)
        return max(found.values(), key=worth)

    def judge_again(self, hit: Hit) -> Judged:
        """A hit of another stage, judged in this one."""
        return self.judge(replace(self.hit(hit.candidate, hit.effect), evenly=hit.evenly, tried=hit.tried))

    def judge(self, hit: Hit) -> Judged:
        """Cross-validated score of a hit, and why it is not plausible, if so."""
        score = self.frame.score(hit.columns)
        bound = hit.effect.response(self.robot)
        held = np.inf if bound is None or len(bound) < 2 else hit.fit_gain
        return Judged(hit, score, self._against(hit, hit.fit_gain / max(score.fit_gain, 1e-300)), held)


@dataclass(frozen=True, eq=False)
class Judged:
    """A hit with its score; `against`: why its parameters cannot be those of such a thing ("": nothing against it); `held`: of one thing
    on several joints, what it gains as one."""

    hit: Hit
    score: Score
    against: str
    held: float = np.inf

    @property
    def evidence(self) -> float:
        """What counts: the gain on blocks held out, but no more than the gain on all of them."""
        return min(self.score.heldout, self.score.fit_gain, self.held)
