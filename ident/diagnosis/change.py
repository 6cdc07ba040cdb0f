"""By how much the error changes from one estimate to another on data that neither was fitted to, and what is to blame."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from .evidence import WEAK, acts_on

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .acceptance import Found

Array = np.ndarray
#: Blocks of time of a run; twelve pairs of neighbours have 4096 patterns of signs, which are tried all.
_BLOCKS = 24
#: A joint's squared error grows if it does so by so many standard errors over the blocks, and by this share: what little an effect that was
#: found elsewhere moves is the price of refitting all parameters with it.
SURELY = 2.0
_SHARE = 0.4
#: What falls beyond chance: by more than this, which chance reaches once in a thousand for one parameter, and so that blocks which fall or
#: grow alike would reach it twice in 4096 at most; or by six times as much, and so that they would reach it ten times in 4096 at
#: most: what stands here has passed the test of the whole catalogue on the data fitted; or by fifteen times as much, which no colour of
#: the noise explains.
_CLEAR = 10.8
_CHANCE = 0.0005
_LARGE = 6.0 * _CLEAR
_LARGE_CHANCE = 0.0025
_SURE = 15.0 * _CLEAR
#: Of several hypotheses by six times as much, and so that the best of them would reach it five times in a thousand at most.
_FEW_CHANCE = 0.005
#: What is hinted at: much less surely, but so much that no small inexactness of the model does it alone.
_HINT = 5.0 * _CLEAR
_SOME_CHANCE = 0.02
#: Signs are tried all, or so many.
_ALL = 12
_MANY = 20_000


def squared_errors(one: Array, other: Array, signals: Signals) -> tuple[Array, Array]:
    """Sums of squares (blocks of time, n) of the residuals (M, n) that two models leave, on the rows that both use."""
    common = np.isfinite(one) & np.isfinite(other)
    squares = [np.where(common, r, 0.0) ** 2 for r in (one, other)]
    parts = [p for run in signals.row_runs for p in np.array_split(np.arange(run.start, run.stop), _BLOCKS) if len(p)]
    first, second = (np.array([s[p].sum(axis=0) for p in parts]) for s in squares)
    return first, second


@dataclass(frozen=True, eq=False)
class Change:
    """By what squared errors grow from one estimate to another: `grows` (blocks of time, n); `before` (n,): what they were in sum;
    `noise` (n,): the later one's rms on its own data."""

    grows: Array
    before: Array
    noise: Array

    @classmethod
    def of(cls, before: Estimate, after: Estimate, signals: Signals) -> Change:
        first, second = squared_errors(before.residual(signals), after.residual(signals), signals)
        return cls(second - first, first.sum(axis=0), after.fit_error.rms)

    def on(self, joints: Array) -> tuple[float, float]:
        """Growth over some joints (n,) bool, each weighted by its noise, and its standard error."""
        blocks = self.grows @ np.where(joints, inverse_squares(self.noise), 0.0)
        return float(blocks.sum()), float(np.sqrt(np.sum(blocks**2)))

    @property
    def shown(self) -> bool:
        """Whether the sum over all joints falls beyond chance."""
        gain, chance = self._fall
        return gain > _SURE or (gain > _LARGE and chance <= _LARGE_CHANCE) or (gain > _CLEAR and chance <= _CHANCE)

    def shown_of(self, number: int) -> bool:
        """Whether the sum falls beyond what chance gives the best of so many hypotheses, each of which was named beforehand."""
        gain, chance = self._fall
        return gain > _LARGE and number * chance <= _FEW_CHANCE

    @property
    def hinted(self) -> bool:
        """Whether it falls by more than chance mostly gives: enough not to drop what there is some evidence for besides."""
        gain, chance = self._fall
        return self.shown or (gain > _HINT and chance <= _SOME_CHANCE)

    @property
    def _fall(self) -> tuple[float, float]:
        """By how much the sum falls, and the probability that chance gives as much."""
        # Of two neighbours each, which are the less alike, however the noise is coloured.
        falls = -np.add.reduceat(self.grows @ inverse_squares(self.noise), np.arange(0, len(self.grows), 2))
        return float(falls.sum()), by_signs(falls)

    @property
    def shares(self) -> float:
        """Growth as a share of what there was, summed over the joints: whatever the noise is taken for."""
        return float(np.sum(self.grows.sum(axis=0) / np.maximum(self.before, 1e-300), where=self.before > 0.0))

    def harms(self, found: Sequence[Found]) -> list[Found]:
        """Findings that are to blame: on joints whose error grows beyond chance; else, if the sum over all joints, each over its noise,
        grows by more than its standard error, on those that make up most of it."""
        total, scatter = self.grows.sum(axis=0), np.sqrt((self.grows**2).sum(axis=0))
        worse = (total > SURELY * scatter) & (total > _SHARE * self.before)
        # Joints in newton metres and joints in newtons are compared over their noise.
        weighed = self.grows * inverse_squares(self.noise)
        whole, total = weighed.sum(axis=1), weighed.sum(axis=0)
        if not worse.any() and whole.sum() > np.sqrt(np.sum(whole**2)):
            worse = total >= 0.5 * total.max()
        return [f for f in found if (acts_on(f.judged) & worse).any()]

    def doubtful(self, found: Sequence[Found]) -> list[Found]:
        """Findings on whose own joints nothing is gained, and weak ones."""
        return [f for f in found if f.judged.evidence < WEAK or self.on(acts_on(f.judged))[0] >= 0.0]


def inverse_squares(noise: Array) -> Array:
    """Weights (n,): a joint without rows has no noise that anyone knows, and no share."""
    known = np.isfinite(noise) & (noise > 0.0)
    return np.where(known, 1.0 / np.where(known, noise, 1.0) ** 2, 0.0)


def by_signs(gains: Array) -> float:
    """The probability that gains (blocks,) of either sign alike come to as much in sum: an exact test, which asks nothing of how they are
    spread (R. A. Fisher, The Design of Experiments, 1935)."""
    if len(gains) <= _ALL:
        signs = np.array(list(itertools.product((1.0, -1.0), repeat=len(gains))))
    else:
        signs = np.random.default_rng(0).choice((1.0, -1.0), (_MANY, len(gains)))
    return float(np.mean(signs @ gains >= gains.sum() * (1.0 - 1e-12)))
