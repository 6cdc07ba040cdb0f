"""Laws that hold a simpler one as a special case: where the data fitted do not ask for what the general law adds, the simpler one stands.

A general law is asked for beside a model that lacks something else, and draws a part of that, too; once the model is complete its other
terms are next to nothing. Held-out data, asked afterwards, may still bring the general one back: they may hold what shows its terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..effects.base import Effect
from .acceptance import FEW, Found
from .bank import Bank
from .consistent import own_loss
from .contest import standing_in
from .evidence import acts_on, occam
from .search import Judged
from .selection import Selection, labelled
from .stage import Stage, with_effects
from .weights import PRIOR, weights

Array = np.ndarray
#: Columns are combinations of others if so much of them (rms) is left.
_SAME = 1e-6


def simplified(selection: Selection, bank: Bank) -> Selection:
    """The selection with a simpler law in the place of each that holds it and gains no more than its freedom explains; its odds follow
    from the fit of both in the company of all others."""
    found, stage = list(selection.found), selection.final

    def with_rival(turn: int, rival: Judged) -> tuple[list[Effect], Stage]:
        effects = [f.effect for f in found]
        effects[turn] = labelled(rival.hit.effect, selection.declared.problem.model, effects[:turn] + effects[turn + 1 :])
        return effects, with_effects(selection.declared, effects, stage, bank, stage.search.candidates)

    for i in range(len(found) if len(found) <= FEW else 0):
        for k, rival in enumerate(found[i].rivals):
            simple_first = _holds(stage, rival, found[i].judged)
            if not simple_first and not _holds(stage, found[i].judged, rival):
                continue
            effects, there = with_rival(i, rival)
            simple, general = (found[i].judged, rival) if simple_first else (rival, found[i].judged)
            simple_stage, general_stage = (stage, there) if simple_first else (there, stage)
            gain = own_loss(simple_stage.problem, simple_stage.frame) - own_loss(general_stage.problem, general_stage.frame)
            due = max(occam(general.hit, stage.number) - occam(simple.hit, stage.number), _price_of_more(stage, general, simple))
            if gain >= due:
                continue
            odds = 0.5 * (gain - due)
            if simple_first:
                found[i] = replace(found[i], weights=_shared_with_general(found[i], k + 1, odds))
                continue
            shares = _without_general(found[i], k + 1, odds, stage.number)
            best = int(np.argmax(shares))
            if best not in (0, k + 1):
                effects, there = with_rival(i, found[i].rivals[best - 1])
            found, _ = standing_in(found, i, best or k + 1, shares, effects, there)
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


def _price_of_more(stage: Stage, general: Judged, simple: Judged) -> float:
    """What a general law's further parameters must gain (twice a log-likelihood) on so many rows before they are worth having (G. Schwarz,
    Annals of Statistics 6 (1978))."""
    rows = float(stage.problem.signals.valid[:, acts_on(general)].sum())
    return (general.hit.columns.shape[2] - simple.hit.columns.shape[2]) * float(np.log(max(rows, 2.0)))


def _shared_with_general(found: Found, place: int, odds: float) -> Array:
    """Weights (m,) of a finding and its rivals: what it has together with a general law in this place is divided by `odds` (logarithm)
    for that one. What was judged twice counts once."""
    everything = (found.judged, *found.rivals)
    out = np.array(found.weights, float)
    own, general = (_same_thing(everything, at) for at in (0, place))
    both = float(out[own].sum() + out[general].sum())
    out[own], out[general] = 0.0, 0.0
    share = _share_of_simple(everything[0], everything[place], odds)
    out[0], out[place] = both * share, both * (1.0 - share)
    return out


def _without_general(found: Found, place: int, odds: float, number: int) -> Array:
    """Weights (m,) of all that was judged in the place of a general law, which is worth no more than these `odds` (logarithm) over a simple
    one: what was outdone by its other terms alone is weighed anew."""
    everything = (found.judged, *found.rivals)
    general = _same_thing(everything, 0)
    rest = [k for k in range(len(everything)) if k not in general]
    out = np.zeros(len(everything))
    out[rest] = weights([everything[k] for k in rest], [occam(everything[k].hit, number) for k in rest])
    simple = _same_thing(everything, place)
    both, out[simple] = float(out[simple].sum()), 0.0
    share = _share_of_simple(everything[place], everything[0], odds)
    out[place], out[0] = both, both * (1.0 - share) / share
    return out / out.sum()


def _share_of_simple(simple: Judged, general: Judged, odds: float) -> float:
    """Of a simple law beside a general one, by what the fit gives the latter and how common each is."""
    return float(1.0 / (1.0 + np.exp(odds) * PRIOR.get(general.hit.candidate.name, 1.0) / PRIOR.get(simple.hit.candidate.name, 1.0)))


def _same_thing(everything: Sequence[Judged], at: int) -> list[int]:
    """Indices of all that is the same thing at the same place."""
    return [k for k, j in enumerate(everything) if j.hit.place == everything[at].hit.place]
