"""Stand-ins: where a finding does harm on held-out data, a rival of it that helps there may be what it was taken for.

Something is there: the data fitted have shown it. The name that did best on them may still be the wrong one, and its law then fails on
another motion, where that of the right one holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .acceptance import Found
from .change import SURELY, Change
from .contest import Arena, contenders, settled_with, standing_in
from .stage import Stage

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

#: So many rivals are tried.
_MOST = 3


def stand_in(arena: Arena, declared: Estimate, found: Sequence[Found]) -> tuple[list[Found], Stage, str] | None:
    """Findings with the best of the rivals of the arena's one in its place that lowers the error on held-out data beyond chance and does no
    harm there, their stage, and what is to be said; None if there is none. `arena`: with the estimate of the model without that finding;
    `declared`: the estimate of the declared model; `found`: the findings as they are."""
    one, without, rows = found[arena.turn], arena.after, arena.held
    best: tuple[float, int, list[Found], Stage] | None = None
    for k in contenders(one)[:_MOST]:
        entry = arena.entry(k + 1, one.rivals[k].hit)
        own_stage, own = settled_with(arena.selection, entry.effects, arena.stage, arena.bank)
        weights = np.where(np.arange(len(one.weights)) == 0, 0.0, one.weights)
        own_found, _ = standing_in(found, arena.turn, k + 1, weights / max(float(weights.sum()), 1e-300), own, own_stage)
        estimate = arena.refit(own_stage, arena.turning)
        grown, error = Change.of(without, estimate, rows).on(np.ones(rows.robot.n, bool))
        if Change.of(declared, estimate, rows).harms(own_found) or -grown <= max(SURELY * error, best[0] if best else 0.0):
            continue
        best = -grown, k, own_found, own_stage
    if best is None:
        return None
    gain, k, own_found, own_stage = best
    said = (
        f"{one.rivals[k].hit.candidate} takes the place of {one.judged.hit.candidate}, which does harm on the data held out, where it gains"
        f" (the squared error over the noise falls by {gain:.0f}). So they had a part in the choice."
    )
    return own_found, own_stage, said
