"""Nominated: what the data fitted suggest, though they are too few to say so, and those held out confirm.

A fault may show in one part of a log and hardly in another: a drift at its end, an eccentric encoder where the joint turns far. What
the fitted part gains by it stays below what chance yields over the whole catalogue. On held-out data it need not beat the
catalogue any more: a candidate that was named beforehand, with values fitted beforehand, is one hypothesis. It is asked for a clear gain
there, and for as much evidence as the fitted part lacks: parameters that the fitted part tells little of are off, and by chance a candidate
may make up for that, so the evidence is the ratio of what both models foretell as far as their parameters are known, under the noise's
colour. Of a few such candidates the one with most is taken, and all that came near it are its rivals. Beside findings, only what acts on
other rows than they do is nominated: what falls short on their own is more often the inexactness of their laws."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .acceptance import FEW, Found, elsewhere
from .bank import Bank
from .change import Change
from .contest import settled_with
from .evidence import FALSE_ALARM, WEAK, occam, surplus
from .foretelling import Foretelling
from .in_plain_sight import apart
from .plausible import too_small_at_its_best
from .precision import support, unbound
from .selection import Selection, relabelled
from .stage import Stage, with_effects
from .weights import weights

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .search import Judged

#: So many candidates are nominated, each of which lacks no more than this. (Where the fitted motion tells little of a joint's parameters,
#: the true one may be the fourth: friction that depends on load, behind three that gain nothing on held-out data.)
NOMINATED = 8
_LACKING = 25.0
#: Beside findings no more than this: the motion that shows those would have shown it.
_LACKING_BESIDE = 12.0
#: The gain on held-out data over its standard error, and the least evidence there (twice the logarithm of the ratio of densities). Where
#: nothing is, a ratio of k is reached with a probability of no more than 1 / k (Markov's inequality): the rate of false alarms over all
#: that are nominated is that of the whole catalogue.
_SURELY = 2.0
_CLEARLY = 2.0 * math.log(NOMINATED / FALSE_ALARM)


def nominated(
    selection: Selection, bank: Bank, declared: Estimate, rows: Signals, refit: Callable[[Stage], Estimate]
) -> tuple[Selection, str]:
    """A selection with the candidate that came nearest to being found as its last finding, if held-out data confirm it; and what is to be
    said then. `declared`: the estimate of the declared model; `rows`: of the held-out data; `refit`: the estimate of a stage's model."""
    found, white = selection.found, selection.final.white
    able = [j for j in selection.nearest if elsewhere(j, found)] if len(found) < FEW else []
    most = _LACKING_BESIDE if found else _LACKING
    near = [j for j in able[:NOMINATED] if -surplus(j, selection.final.number) <= most]
    if not near:
        return selection, ""
    best: tuple[float, Selection, str] | None = None
    fewer = refit(selection.final) if found else declared
    without = Foretelling(fewer, rows).surprise(white)
    for judged in near:
        lacking = -surplus(judged, selection.final.number)
        one = _found(judged, able, selection.final)
        stage = with_effects(selection.declared, [*(f.effect for f in found), one.effect], selection.final, bank)
        estimate = refit(stage)
        grown, error = Change.of(fewer, estimate, rows).on(np.ones(rows.robot.n, bool))
        told = without - Foretelling(estimate, rows).surprise(white)
        # What shows in one stretch alone has as large a standard error as it is itself: there, the evidence must not be weak.
        lasting = -grown > _SURELY * error or told > WEAK
        confirmed = lasting and -grown > lacking and told > max(lacking, best[0] if best else _CLEARLY)
        # Where held-out data hold what neither model knows of, the noise is not what the evidence is counted in.
        if confirmed and not apart(estimate, selection.final.problem.signals, rows) and _can_be(selection, one, bank):
            said = (
                f"{judged.hit.candidate} is what the data fitted suggest, with too little evidence to name it ({judged.evidence:.0f};"
                f" {judged.evidence + lacking:.0f} is asked for); the data held out confirm it (the squared error over the noise falls by"
                f" {-grown:.0f} ± {error:.0f}; evidence {told:.0f}). So they had a part in the finding."
            )
            best = told, replace(selection, final=stage, found=(*found, one)), said
    return (best[1], best[2]) if best else (selection, "")


def _can_be(selection: Selection, one: Found, bank: Bank) -> bool:
    """Whether a candidate is what it is called at the best of its shapes: the search looked at a few of them."""
    if one.effect.response(selection.final.problem.model.robot) is None or not one.effect.shape():
        return True
    stage, effects = settled_with(selection, [*(f.effect for f in selection.found), one.effect], selection.final, bank)
    values, _ = unbound(stage, effects)[-1]
    return not too_small_at_its_best(effects[-1], values, support(stage, effects[-1]), stage.problem.model.robot)


def _found(judged: Judged, every: Sequence[Judged], stage: Stage) -> Found:
    """A candidate, and as its rivals all the others, the likeliest first: so little evidence hardly tells them apart."""
    near = [judged, *(j for j in every if j is not judged)]
    weight = weights(near, [occam(j.hit, stage.number) for j in near])
    order = [0, *(int(i) for i in np.argsort(-weight) if i != 0)]
    return relabelled(Found(judged, tuple(near[i] for i in order[1:]), weight[order]), stage.problem.model)
