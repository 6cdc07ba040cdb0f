"""Acceptance: which of the candidates that were judged beside a model is worth adding, and what could stand in its place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...effects.base import Effect
from ...effects.kinds import Nature, Need
from .consistent import own_loss
from .evidence import WEAK, acts_on, occam, threshold
from .light import too_light
from .search import Judged
from .stage import Stage, with_effects
from .weights import weights

Array = np.ndarray
#: Beside effects that explain G on a joint's rows, another one there must explain this share of G: laws are never exact.
COMPANION = 0.02
#: What follows the model's prediction through time (an elastic joint, a filter) is no more exact than that: there, this share.
FOLLOWING = 0.3
#: What is left counts if it is as large as this beside the noise (rms), and so does an effect of the catalogue, which has a law of its own
#: that is borne out block by block.
LARGE = 1.0
_LARGE_BY_LAW = 0.6
#: Beside laws of mechanics alone (a body that is carried, a force, a tilt), which are exact where those of friction and drives are not, so
#: much does.
_LARGE_BESIDE_EXACT = 0.3
#: A companion on the same rows must reach the threshold so many times over.
_BESIDE = 2.0
#: A finding must lower the loss of the rows it is on by this share: what it adds must matter, not only be there.
_MATTERS = 0.01
#: Held-out gain over its standard error: what is seen in a single block of time has one, what is seen in all has many.
_STRETCHES = 1.5
#: Or so many blocks gain as much as this each.
_SEVERAL = 4
_CLEARLY = 10.0
#: By how much a decoy (a fit that cannot be: a negative stiffness) outdoes a weak candidate.
_DECOY = 1.5
#: Of more findings than this each draws a part of what is there, whatever it is: which of two names is better says nothing then.
FEW = 3
#: So many of the best candidates are compared with what they gain for nothing.
_TRIES = 4
#: A candidate is near the best if it has this share of its evidence.
NEAR = 0.8
#: So many of those are made consistent, in so many passes.
_LOOKED_AT = 2
_PASSES = 4


@dataclass(frozen=True, eq=False)
class Found:
    """An accepted effect, and its rivals: everything that was judged in its place, the same others being in the model."""

    judged: Judged
    rivals: tuple[Judged, ...]
    weights: Array

    @property
    def effect(self) -> Effect:
        return self.judged.hit.effect

    @property
    def weight(self) -> float:
        """Probability that it is this one and none of its rivals."""
        return float(self.weights[0])


def chosen(stage: Stage, plausible: list[Judged], beside: Sequence[Found]) -> Found | None:
    """The most probable of the candidates, with its rivals, if it is worth accepting."""
    often = [j for j in plausible if _often(j)]
    best_evidence = max((j.evidence for j in often if j.evidence > threshold(j.hit, stage.number)), default=np.inf)
    # One that asks for more, since chance has more ways to it, and has as much: a rival all the same.
    rivals = [j for j in often if j.evidence > min(threshold(j.hit, stage.number), NEAR * best_evidence)]
    # Beside others on the same rows: what is explained there is never quite so. What falls short of that is not accepted, but a rival
    # all the same.
    taken = np.any([acts_on(f.judged) for f in beside], axis=0) if beside else np.zeros(stage.problem.model.robot.n, bool)
    times = [1.0 + (_BESIDE - 1.0) * float(share_on_rows(j)[taken].sum()) for j in rivals]
    worth = [j.evidence > x * threshold(j.hit, stage.number) and _worth(j, beside, stage) for j, x in zip(rivals, times, strict=True)]
    more = once_consistent(rivals, stage) if any(worth) else np.zeros(len(rivals))
    for _ in range(_TRIES):
        if not any(worth):
            break
        w = weights(rivals, [occam(j.hit, stage.number) for j in rivals], more)
        best = int(np.argmax(np.where(worth, w, -1.0)))
        if not too_light(stage, rivals[best]) and stage.null.exceeded(rivals[best].hit.candidate, rivals[best].evidence):
            order = [best, *(i for i in np.argsort(-w) if i != best)]
            return Found(rivals[best], tuple(rivals[i] for i in order[1:]), w[order])
        rivals, more = [j for i, j in enumerate(rivals) if i != best], np.delete(more, best)
        worth = [x for i, x in enumerate(worth) if i != best]
    return None


def once_consistent(judged: Sequence[Judged], stage: Stage) -> Array:
    """What each candidate (m,) gains beyond what it seems to gain beside the present fit, when the fit is made consistent with it.

    Columns that depend on the prediction were made of one that lacks the candidate; with it in the model they are others. Looked at
    where such a candidate is not far from the best."""
    out = np.zeros(len(judged))
    if len(judged) < 2:
        return out
    best = max(j.evidence for j in judged)
    near = [i for i, j in enumerate(judged) if j.hit.candidate.dependent and j.evidence > NEAR * best]
    for i in sorted(near, key=lambda i: -judged[i].evidence)[:_LOOKED_AT]:
        hit = judged[i].hit
        there = with_effects(stage, [hit.effect], stage, stage.search.bank, stage.search.candidates, _PASSES)
        out[i] = max(0.0, stage.frame.loss - own_loss(there.problem, there.frame) - hit.fit_gain)
    return out


def undecoyed(found: Sequence[Judged]) -> list[Judged]:
    """The plausible ones, without weak ones that something impossible on the same rows clearly outdoes: what is there is neither."""
    decoys = [(acts_on(j), j.evidence) for j in found if j.against]

    def outdone(judged: Judged) -> bool:
        rows = acts_on(judged)
        return judged.evidence < WEAK and any((rows & other).any() and more > _DECOY * judged.evidence for other, more in decoys)

    return [j for j in found if not j.against and not outdone(j)]


def _often(judged: Judged) -> bool:
    """Whether a candidate gains in more than a stretch or two of the log; what happens seldom, but several times, does."""
    several = int(np.sum(judged.score.gain > _CLEARLY)) >= _SEVERAL
    return judged.score.heldout > 0.0 and (several or judged.score.heldout > _STRETCHES * judged.score.standard_error)


def _worth(judged: Judged, beside: Sequence[Found], stage: Stage) -> bool:
    """Whether a candidate matters on its rows, and is more than the inexactness of those accepted there."""
    rows = acts_on(judged)
    # A candidate on several joints is measured by what was explained on each of them in the share in which it acts there itself.
    share = share_on_rows(judged)
    explained = sum(float(share[acts_on(f.judged)].sum()) * f.judged.evidence * _inexactness(f.effect) for f in beside)
    # As much as the noise itself is no inexactness, however much was explained before.
    exact = all(_of_mechanics(f.effect) for f in beside if (acts_on(f.judged) & rows).any())
    large = _LARGE_BESIDE_EXACT if exact else _LARGE_BY_LAW
    inexact = min(explained, large**2 * float(stage.problem.signals.valid[:, rows].sum()))
    loss = float(share @ np.sum(stage.frame.residual**2, axis=1))
    return judged.evidence > max(inexact, _MATTERS * loss)


def elsewhere(judged: Judged, beside: Sequence[Found]) -> bool:
    """Whether a candidate acts on rows that no finding acts on, nor what came near to being found in its place: it is not what is left
    there of one that its law tells inexactly, not even if what little that explains on these rows is in error by its share."""
    rows = acts_on(judged)
    for f in beside:
        near = [r for r in f.rivals if r.evidence > NEAR * f.judged.evidence]
        if any((acts_on(j) & rows).any() for j in (f.judged, *near)):
            return False
    inexact = sum(float(share_on_rows(f.judged)[rows].sum()) * f.judged.evidence * _inexactness(f.effect) for f in beside)
    return judged.evidence > inexact


def share_on_rows(judged: Judged) -> Array:
    """The share (n,) of what a candidate adds that is on each joint's rows."""
    power = np.sum((judged.hit.columns @ judged.score.values) ** 2, axis=1)
    return np.asarray(power / max(float(power.sum()), 1e-300))


def _of_mechanics(effect: Effect) -> bool:
    """Whether an effect is one of the whole robot's rigid bodies and what they carry."""
    return effect.joints is None and effect.nature is not Nature.SENSOR


def _inexactness(effect: Effect) -> float:
    """Share of what an effect explains that its law may fail by."""
    return FOLLOWING if {Need.REFERENCE, Need.HISTORY} <= effect.needs else COMPANION
