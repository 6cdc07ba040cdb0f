"""Rivals on held-out data: what the data fitted cannot tell apart, other motion may.

Each finding is set against the rivals that do nearly as well in its place. Where one foretells the held-out data clearly better than
the other, the odds between them move with it; where a rival wins, it takes the place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Effect
from .acceptance import FEW, NEAR, Found
from .bank import Bank
from .change import inverse_squares, squared_errors
from .evidence import acts_on
from .foretelling import Foretelling
from .precision import settled
from .search import Hit, Judged
from .selection import Place, Selection, labelled
from .stage import Stage, with_effects

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray
#: Rivals that are looked at: of at least this weight, or near in evidence; so many of one finding, and more where those left out would
#: weigh more than this together.
_LIKELY = 1e-3
_MOST = 6
_LEFT_OUT = 0.02
_UTMOST = 24
#: A shape is hardly told where one drawn evenly from its range fits as well but for so much (twice a log-likelihood); so many are tried.
_LOOSE = 4.0
_SHAPES = 3
#: Grids of no more points are looked through for shapes that do as well in a part of their range.
_COARSE = 24
#: No law is so exact that this share of the squared error says which of two it is.
_SHARE = 0.01
#: One is said to be clearly better from odds of twenty to one on (logarithm).
_CLEARLY = 3.0
#: Odds move by no more than this (logarithm).
_FARTHEST = 30.0


@dataclass(frozen=True, eq=False)
class Contest:
    """The selection with the winners in it, its estimate, and lines that say what was decided."""

    selection: Selection
    after: Estimate
    said: tuple[str, ...]


def contested(selection: Selection, bank: Bank, held: Signals, refit: Callable[[Stage, tuple[str, ...]], Estimate]) -> Contest:
    """Every finding against its rivals on held-out data (without rows near reversals). `refit`: the estimate of a stage's model on all
    rows but those near reversals of some joints."""
    found, stage, said = list(selection.found), selection.final, list[str]()
    for i in range(len(found) if len(found) <= FEW else 0):
        one, others = found[i], contenders(found[i])
        if not others:
            continue
        # At the values that they have where they were found: what the law of either says of reversals may hold no better than the other's.
        turning = _turning_joints(selection, [one.judged, *(one.rivals[k] for k in others)])
        arena = Arena(selection, bank, held, refit, stage, tuple(f.effect for f in found), i, refit(stage, turning), turning)
        entries = [arena.entry(0, one.judged.hit), *(arena.entry(k + 1, one.rivals[k].hit) for k in others)]
        winner, logs, lines = _decided(one, entries)
        said += lines
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        if not winner.place:
            found[i] = replace(one, weights=weights)
            if winner.effects != arena.effects:
                stage = with_effects(selection.declared, winner.effects, stage, bank, stage.search.candidates)
                found, new = standing_in(found, i, 0, weights, winner.effects, stage)
                name = new.judged.hit.candidate
                said.append(f"{name}: the data fitted hardly tell its shape; taken is the one that foretells those held out best")
            continue
        stage, own = settled_with(selection, winner.effects, stage, bank)
        found, new = standing_in(found, i, winner.place, weights, own, stage)
        said.append(
            f"{new.judged.hit.candidate} takes the place of {one.judged.hit.candidate}: the data fitted hardly tell them apart, those"
            " held out do. So the error on these is that of the better of two, not of one chosen without them."
        )
    return Contest(replace(selection, final=stage, found=tuple(found)), refit(stage, ()), tuple(said))


def _turning_joints(selection: Selection, judged: Sequence[Judged]) -> tuple[str, ...]:
    """Joints on which any of these acts and whose rows near reversals had no part in the selection."""
    at = np.any([acts_on(j) for j in judged], axis=0)
    names = np.array(selection.final.problem.model.robot.joint_names)[at].tolist()
    return tuple(name for name in names if name not in selection.final.turning)


@dataclass(frozen=True, eq=False)
class Entry:
    """The model with one in the place of a finding: `place` 0 is the finding itself, then its rivals in their order."""

    place: int
    effects: tuple[Effect, ...]
    foretelling: Foretelling


@dataclass(frozen=True, eq=False)
class Arena:
    """Where rivals stand in for one another: the `turn`th of the `effects` of a `stage`; `after`: the estimate of its model, or of that
    without this one. All are refitted on all rows but those near reversals of the joints `turning`."""

    selection: Selection
    bank: Bank
    held: Signals
    refit: Callable[[Stage, tuple[str, ...]], Estimate]
    stage: Stage
    effects: tuple[Effect, ...]
    turn: int
    after: Estimate
    turning: tuple[str, ...] = ()

    def entry(self, place: int, hit: Hit) -> Entry:
        """A hit in this place, at that of its likely shapes which foretells the held-out data best."""
        found = [Entry(0, self.effects, Foretelling(self.after, self.held))] if place == 0 else [self._with(place, hit.effect)]
        found += [self._with(place, effect) for effect in self._as_likely(hit)]
        return min(found, key=self._error) if len(found) > 1 else found[0]

    @property
    def _others(self) -> list[Effect]:
        return [*self.effects[: self.turn], *self.effects[self.turn + 1 :]]

    def _with(self, place: int, effect: Effect) -> Entry:
        others = self._others
        own = labelled(effect, self.selection.declared.problem.model, others)
        effects = (*others[: self.turn], own, *others[self.turn :])
        there = with_effects(self.selection.declared, effects, self.stage, self.bank, self.stage.search.candidates)
        return Entry(place, effects, Foretelling(self.refit(there, self.turning), self.held))

    def _as_likely(self, hit: Hit) -> list[Effect]:
        """Other shapes of a hit's grid that do as well, where the data fitted hardly tell its shape: held-out data may."""
        loose = hit.fit_gain - 2.0 * hit.evenly <= _LOOSE
        if not hit.effect.shape() or (len(hit.candidate.variants) > _COARSE and not loose):
            return []
        beside = with_effects(self.selection.declared, self._others, self.stage, self.bank, self.stage.search.candidates)
        own = [h for h in (beside.search.hit(hit.candidate, e) for e in hit.candidate.variants) if h.fit_gain > hit.fit_gain - _LOOSE]
        # One point of a coarse grid lies next to the best shape; of several that do as well the data fitted do not tell which it is.
        if len(own) < 2 and not loose:
            return []
        return [own[i].effect for i in np.linspace(0, len(own) - 1, min(_SHAPES, len(own))).astype(int).tolist()]

    def _error(self, one: Entry) -> float:
        """Squared error on held-out data, each joint's over its noise."""
        weight = inverse_squares(self.after.fit_error.rms)
        return float((np.nansum(one.foretelling.residual**2, axis=0) @ weight).sum())


def _decided(one: Found, entries: Sequence[Entry]) -> tuple[Entry, Array, list[str]]:
    """Which of the entries of a contest wins, the logarithm of the probability of each of them and of the rivals that did not enter (up to
    a constant), and what is to be said. Each is set against the best so far, in the end all against the winner."""
    logs, lines = np.log(np.maximum(one.weights, 1e-12)), list[str]()
    everything = (one.judged, *one.rivals)
    entered = [e.place for e in entries]
    likely = logs.copy()
    likely[entered] = np.maximum(logs[entered], np.log(_LIKELY))
    best, ahead = entries[0], 0.0
    for entry in entries[1:]:
        better = _odds(best.foretelling, entry.foretelling)
        if better > 0.0 and likely[entry.place] + better > likely[best.place]:
            best, ahead = entry, ahead + better
    moved: dict[Place, float] = {}
    for entry in entries:
        better = _odds(best.foretelling, entry.foretelling) if entry is not best else 0.0
        logs[entry.place] = (likely if better > 0.0 or entry is best else logs)[entry.place] + ahead + better
        moved[everything[entry.place].hit.place] = ahead + better
        if better < -_CLEARLY:
            better_one, other = (everything[e.place].hit.candidate for e in (best, entry))
            lines.append(f"{better_one} foretells the held-out data clearly better than {other}")
    # What was judged twice (as it stood in the model, and of a new scan) entered once: what is said of one is said of the other.
    for k, judged in enumerate(everything):
        if k not in entered:
            logs[k] += moved.get(judged.hit.place, 0.0)
    return best, logs, lines


def contenders(one: Found) -> list[int]:
    """Indices of the rivals worth looking at, the likeliest first; each thing at each place once."""
    seen, out = {one.judged.hit.place}, list[int]()
    for k, (rival, weight) in enumerate(zip(one.rivals, one.weights[1:], strict=True)):
        if rival.hit.place not in seen and (weight >= _LIKELY or rival.evidence >= NEAR * one.judged.evidence):
            seen.add(rival.hit.place)
            out.append(k)
    beyond = np.cumsum(one.weights[1:][out][::-1])[::-1]
    return out[: min(max(_MOST, int(np.sum(beyond > _LEFT_OUT))), _UTMOST)]


def settled_with(selection: Selection, effects: Sequence[Effect], like: Stage, bank: Bank) -> tuple[Stage, tuple[Effect, ...]]:
    """The declared model with effects, at the shapes that fit best together."""
    among = like.search.candidates

    def rebuilt(own: Sequence[Effect]) -> Stage:
        return with_effects(selection.declared, own, like, bank, among)

    return settled(rebuilt(effects), effects, rebuilt)


def standing_in(
    found: Sequence[Found], turn: int, place: int, weights: Array, effects: Sequence[Effect], stage: Stage
) -> tuple[list[Found], Found]:
    """Findings with the `place`th of what was judged in the `turn`th place (0: the finding itself) standing there, and that one. `weights`
    of all that was judged there, in its order; `effects` of all findings, as they are in the `stage`."""
    one = found[turn]
    everything, order = (one.judged, *one.rivals), [place, *(k for k in range(len(weights)) if k != place)]
    new = Found(everything[place], tuple(everything[k] for k in order[1:]), weights[order])
    others = [*found[:turn], new, *found[turn + 1 :]]
    out = [
        replace(f, judged=replace(f.judged, hit=replace(f.judged.hit, effect=e, columns=stage.search.whitened(e))))
        for f, e in zip(others, effects, strict=True)
    ]
    return out, out[turn]


def _odds(one: Foretelling, other: Foretelling) -> float:
    """Logarithm of the odds for the other that held-out data give: half the gain, under white noise, less what no law is exact to. What
    the noise's colour leaves of them is told by how much the gain differs from block to block of time. If this one is there and not the
    other, a gain is to be expected somewhere from zero to as far below it as it is above: one of z standard errors over n blocks is less
    likely then by a factor from (1 + z²/(n − 1))^(n/2) (Student) to the same with 4 z²; taken are 2 z²."""
    scale = np.fmin(one.estimate.fit_error.rms, other.estimate.fit_error.rms)
    weight = inverse_squares(scale)
    (left, price), (others, others_price) = (f.allowing(weight) for f in (one, other))
    first, second = (blocks * weight for blocks in squared_errors(left, others, one.signals))
    better = (first - second).sum(axis=1)
    gain, n = float(better.sum() + price - others_price), len(better)
    # A share of what is left on those joints where the two differ.
    apart = np.abs((first - second).sum(axis=0))
    there = float(np.minimum(first, second).sum(axis=0) @ apart / max(float(apart.sum()), 1e-300))
    beyond = max(abs(gain) - _SHARE * there, 0.0)
    variance = n * float(np.var(better, ddof=1)) if n > 1 else 0.0
    if variance == 0.0:
        return 0.0
    coloured = 0.5 * n * np.log1p(2.0 * beyond**2 / ((n - 1) * variance))
    return float(np.sign(gain) * min(coloured, 0.5 * beyond, _FARTHEST))
