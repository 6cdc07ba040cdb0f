"""Laws that hold a simpler one as a special case: where the data fitted do not ask for what the general law adds, the simpler one stands.

A general law is asked for beside a model that lacks something else, and draws a part of that, too; once the model is complete its other
terms are next to nothing. Held-out data, asked afterwards, may still bring the general one back: they may hold what shows its terms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .acceptance import FEW, Found
from .bank import Bank
from .consistent import own_loss
from .contest import standing_in
from .evidence import occam
from .search import Judged
from .selection import Selection, labelled
from .stage import Stage, with_effects
from .weights import PRIOR

Array = np.ndarray
#: Columns are combinations of others if so much of them (rms) is left.
_SAME = 1e-6


def simplified(selection: Selection, bank: Bank) -> Selection:
    """The selection with a simpler law in the place of each that holds it and gains no more than its freedom explains; its odds follow
    from the fit of both in the company of all others."""
    found, stage = list(selection.found), selection.final
    for i in range(len(found) if len(found) <= FEW else 0):
        for k, rival in enumerate(found[i].rivals):
            simple_first = _holds(stage, rival, found[i].judged)
            if not simple_first and not _holds(stage, found[i].judged, rival):
                continue
            others = [f.effect for f in found]
            others[i] = labelled(rival.hit.effect, selection.declared.problem.model, others[:i] + others[i + 1 :])
            there = with_effects(selection.declared, others, stage, bank, stage.search.candidates)
            simple, general = (found[i].judged, rival) if simple_first else (rival, found[i].judged)
            simple_stage, general_stage = (stage, there) if simple_first else (there, stage)
            gain = own_loss(simple_stage.problem, simple_stage.frame) - own_loss(general_stage.problem, general_stage.frame)
            due = occam(general.hit, stage.number) - occam(simple.hit, stage.number)
            if gain >= due:
                continue
            weights = _weights(found[i], k + 1, simple_first, 0.5 * (gain - due))
            if simple_first:
                found[i] = replace(found[i], weights=weights)
                continue
            found, _ = standing_in(found, i, k + 1, weights, others, there)
            stage = there
            break
    return replace(selection, found=tuple(found), final=stage)


def _holds(stage: Stage, general: Judged, simple: Judged) -> bool:
    """Whether a law holds another, at the same place, as a special case."""
    if general.hit.effect.joints != simple.hit.effect.joints or general.hit.effect.abrupt or simple.hit.effect.abrupt:
        return False
    if general.hit.columns.shape[2] <= simple.hit.columns.shape[2] or simple.hit.effect.shape():
        return False
    A, B = (stage.search.whitened(j.hit.effect) for j in (general, simple))
    A, B = A.reshape(-1, A.shape[2]), B.reshape(-1, B.shape[2])
    A = A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    left = B - A @ np.linalg.lstsq(A, B, rcond=None)[0]
    return bool(np.linalg.norm(left) <= _SAME * np.linalg.norm(B) > 0.0)


def _weights(found: Found, place: int, simple_first: bool, odds: float) -> Array:
    """Weights (m,) of a finding (place 0) and its rivals, of which one is a simpler law or a general one: what both had together is divided
    by these `odds` (logarithm) for the general one. What was judged twice counts once."""
    everything = (found.judged, *found.rivals)
    names = [j.hit.candidate.name for j in (everything[0], everything[place])]
    simple, general = names if simple_first else names[::-1]
    share = 1.0 / (1.0 + np.exp(odds) * PRIOR.get(general, 1.0) / PRIOR.get(simple, 1.0))
    out = np.array(found.weights, float)
    same = [[k for k, j in enumerate(everything) if j.hit.place == everything[at].hit.place] for at in (0, place)]
    both = float(out[same[0]].sum() + out[same[1]].sum())
    for own in same:
        out[own] = 0.0
    out[0], out[place] = both * (share if simple_first else 1.0 - share), both * (1.0 - share if simple_first else share)
    return out
