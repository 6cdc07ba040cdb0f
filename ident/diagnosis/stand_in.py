"""Stand-ins: where a finding does harm on held-out data, a rival of it that helps there may be what it was taken for.

Something is there: the data fitted have shown it. The name that did best on them may still be the wrong one, and its law then fails on
another motion, where that of the right one holds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from .acceptance import Found
from .bank import Bank
from .change import Change
from .contest import Arena, contenders, settled_with, standing_in
from .selection import Selection
from .stage import Stage

if TYPE_CHECKING:
    from ..estimate import Estimate
    from ..signals import Signals

#: So many rivals are tried.
_MOST = 3
#: What one gains on held-out data over its standard error.
_SURELY = 2.0


def stand_in(
    selection: Selection,
    bank: Bank,
    declared: Estimate,
    without: Estimate,
    rows: Signals,
    refit: Callable[[Stage], Estimate],
    stage: Stage,
    found: Sequence[Found],
    turn: int,
) -> tuple[list[Found], Stage, str] | None:
    """Findings with the best of the rivals of the `turn`th in its place that lowers the error on held-out data beyond chance and does no
    harm there, their stage, and what is to be said; None if there is none. `stage`: of the findings as they are; `declared`, `without`:
    estimates of the declared model and of the one without that finding; `rows`: of the held-out data."""
    one = found[turn]
    arena = Arena(selection, bank, rows, refit, stage, tuple(f.effect for f in found), turn, without)
    best: tuple[float, int, list[Found], Stage] | None = None
    for k in contenders(one)[:_MOST]:
        entry = arena.entry(k + 1, one.rivals[k].hit)
        own_stage, own = settled_with(selection, entry.effects, stage, bank)
        weights = np.where(np.arange(len(one.weights)) == 0, 0.0, one.weights)
        own_found, _ = standing_in(found, turn, k + 1, weights / max(float(weights.sum()), 1e-300), own, own_stage)
        estimate = refit(own_stage)
        grown, error = Change.of(without, estimate, rows).on(np.ones(rows.robot.n, bool))
        if Change.of(declared, estimate, rows).harms(own_found) or -grown <= max(_SURELY * error, best[0] if best else 0.0):
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
