"""The search's state: the fit with accepted effects, its frame, and the scores of the catalogue beside it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np

from ..._utils.singular_values import pinv
from ...effects.kinds import Need
from ...instruments.solved import SINGULAR
from ..design.catalogue import Catalogue
from ..thresholds import LEVEL, STRETCH
from .refinement import agreed, anywhere, at_an_end, can_be, likeliest, refined, settled, within_range
from .scores import Scores
from .significance import parametric
from .slopes import balanced

if TYPE_CHECKING:
    from ...effects.base import Effect
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved

Array = np.ndarray
#: Effects of which a joint may have several: one for each order.
REPEATABLE = frozenset({"cogging", "torque_ripple", "gear_coupling", "position_dependent_friction"})
#: Passes of the first fit, whose values the catalogue's columns are made at: one more than later ones, that begin near their end.
_FIRST = 3
#: States that are remembered: without one of the accepted effects, with it, and as it was before.
_REMEMBERED = 3
#: An effect on its joints (() for the whole robot).
Placed = tuple["Effect", tuple[str, ...]]


@dataclass(eq=False)
class EffectSearch:
    """Fit with accepted effects, its frame, the scores beside it, and the largest score that chance explains.

    `stretch`: share of the log that may not decide alone."""

    fit: Fit
    catalogue: Catalogue
    level: float = LEVEL
    accepted: list[Placed] = field(default_factory=list)
    stretch: float = STRETCH
    frame: Solved = field(init=False)
    scores: Scores = field(init=False)
    chance: float = field(init=False, default=0.0)
    _flat: tuple[Solved, Solved] | None = field(init=False, default=None, repr=False)
    _solved: dict[tuple[Placed, ...], tuple[Fit, Solved, Catalogue, Scores, Array | None]] = field(default_factory=dict, repr=False)

    @classmethod
    def begun(cls, fit: Fit, speeds: Array, level: float = LEVEL) -> EffectSearch:
        """A search with nothing accepted yet. `speeds` (n,): usual speeds of the motors."""
        frame = fit.solved(_FIRST)
        begun = cls(fit, Catalogue.of(fit, speeds), level)
        begun.frame, begun.scores = frame, begun.scored(fit, frame)
        begun._keep()
        return begun

    def solve(self) -> None:
        """Refit with what is accepted, and score everything beside it; a model that was solved among the last is taken as it was."""
        known = self._solved.pop(tuple(self.accepted), None)
        if known is None:
            self.fit = self.fit.with_effects(tuple(e for e, _ in self.accepted))
            self.frame = self.fit.solved(2)
            self.catalogue = self.catalogue.at(self.fit)
            self.scores = self.scored(self.fit, self.frame)
        else:
            self.fit, self.frame, self.catalogue, self.scores, self.fit.values = known
        self._keep()

    def _keep(self) -> None:
        """Keep this state among the last."""
        self._solved[tuple(self.accepted)] = self.fit, self.frame, self.catalogue, self.scores, self.fit.values
        while len(self._solved) > _REMEMBERED:
            del self._solved[next(iter(self._solved))]

    def scored(self, fit: Fit, frame: Solved, catalogue: Catalogue | None = None) -> Scores:
        """Scores of a catalogue (the search's own) beside a frame's model."""
        return Scores.of(fit, frame, self.catalogue if catalogue is None else catalogue, self.stretch)

    def accept(self, placed: Placed) -> None:
        """Take an effect into the model; in the place of another name of changes of the model's own, these."""
        parts = self.fit.known.own_parts(placed[0]) if self.fit.known is not None else []
        there = {(e.name, joints) for e, joints in self.accepted}
        self.accepted += [(self.labelled(e), joints) for e, joints in parts if (e.name, joints) not in there] or [placed]
        self.solve()

    def calibrate(self) -> None:
        """Take the largest score that chance explains, for these scores."""
        self.chance = parametric(self.scores, self.level)

    @property
    def critical(self) -> float:
        """What a score must exceed: chance, and what is not material."""
        return self.chance + self.scores.material

    @property
    def flat(self) -> Solved:
        """The frame with one weight for all frequencies."""
        if self._flat is None or self._flat[0] is not self.frame:
            self._flat = self.frame, self.fit.behind(self.fit.flat(self.frame))
        return self._flat[1]

    def fit_without(self, i: int) -> Fit:
        """The fit with all accepted effects but the i-th."""
        return self.fit.with_effects(tuple(e for k, (e, _) in enumerate(self.accepted) if k != i))

    def apart_from(self, i: int) -> EffectSearch:
        """The search as it is without the i-th accepted effect."""
        others = dataclasses.replace(self, fit=self.fit, accepted=[x for k, x in enumerate(self.accepted) if k != i])
        others.solve()
        others.chance = self.chance
        return others

    def without(self, i: int) -> Scores:
        """Scores beside a model without the i-th accepted effect, at the noise, and with the columns, of the model with it."""
        fit = self.fit_without(i)
        return self.scored(fit, fit.behind(self.frame.gains))

    def reprofile(self) -> None:
        """Shapes of all accepted effects anew, each beside the others, at the noise of the whole model."""
        changed = False
        for i, (effect, joints) in enumerate(list(self.accepted)):
            if not effect.shape():
                continue
            fit = self.fit_without(i)
            if Need.TORQUE in effect.needs:
                better = settled(effect, fit.effects, fit)
                changed |= better != effect
                self.accepted[i] = (better, joints)
                continue
            shapes = [effect] if len(self.accepted) == 1 else [effect, refined(effect, joints, fit, fit.behind(self.frame.gains))]
            wherever = anywhere(effect, joints, fit, fit.behind(self.frame.gains))
            better = likeliest([wherever, *shapes], joints, fit.effects, fit, self.frame)
            better = agreed(better, fit.effects, fit)
            changed |= better != effect
            self.accepted[i] = (better, joints)
        effects = tuple(e for e, _ in self.accepted)
        shaped = any(e.shape() for e in effects)
        found = balanced(effects, self.fit, self.fit.with_effects(effects).solved(1).gains) if shaped else effects
        self.accepted = [(e, joints) for e, (_, joints) in zip(found, self.accepted, strict=True)]
        if changed or found != effects:
            self.solve()

    def labelled(self, effect: Effect) -> Effect:
        """The effect under a label that keeps its parameters apart from those of the accepted ones."""
        taken = {p.name for e, _ in self.accepted for p in e.parameters(self.fit.robot)}
        while any(p.name in taken for p in effect.parameters(self.fit.robot)):
            effect = dataclasses.replace(effect, label=f"{effect.label}+")
        return effect

    def possible(self, scores: Scores, k: int) -> bool:
        """Whether the values that a scored group would have can be those of such an effect, at its shape or at the one that they tell."""
        effect = scores.group(k).effect
        if effect is None:
            return False
        values, std = scores.values(k)
        told = effect.told_by(values)
        return can_be(effect, self.fit, values, std) or (told != effect and within_range(told, self.fit))

    def impossible(self) -> tuple[int, ...]:
        """An accepted effect that beside the others has values which no such effect can have, or two that undo each other; () for none."""
        std = self.frame.std
        own = self.fit.slices
        for i, ((effect, _), at) in enumerate(zip(self.accepted, own, strict=True)):
            if not can_be(effect, self.fit, self.frame.theta[at], std[at]) or at_an_end(effect, self.fit):
                return (i,)
        return next((pair for pair in combinations(range(len(own)), 2) if self._undo([own[i] for i in pair])), ())

    def _undo(self, own: Sequence[slice]) -> bool:
        """Whether two effects, with coefficients at `own`, together do less beside the rest of the model than either does by itself: what
        the one is for, the other has made."""
        frame = self.frame
        value = frame.theta * frame.scale
        both = np.concatenate([np.arange(len(value))[x] for x in own])
        rest = np.setdiff1d(np.arange(len(value)), both)
        G = frame.gram
        S = G[np.ix_(both, both)] - G[np.ix_(both, rest)] @ pinv(G[np.ix_(rest, rest)], rcond=SINGULAR) @ G[np.ix_(rest, both)]
        first = np.arange(len(both)) < own[0].stop - own[0].start
        together, one, other = (float(x @ S @ x) for x in (value[both] * keep for keep in (np.ones_like(first), first, ~first)))
        return together < min(one, other)
