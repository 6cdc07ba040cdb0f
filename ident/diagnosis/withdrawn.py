"""Withdrawn: guesses of which none is trusted, and which data held out do not bear out.

Where no effect of the catalogue accounts for what is there, several together draw a part of it. That may be worth a hint, as long as the
error falls with them on data that they were not chosen on. Where it does not, beyond what chance might do, nothing was found. One by
itself is no such drawing: play in a gear that leaves much and knocks seldom is still play in a gear. Nor is one that makes up nearly
all that several explain, if no error grows by it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..effects.places import on
from .analysis import without_reversals
from .bank import Bank
from .change import Change
from .findings import HELD_OUT, LIKELY, Finding, Unexplained
from .selection import Selection
from .stage import Stage, with_effects

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

#: Share of what all of them explain that makes one of them stand for itself.
_ALMOST_ALL = 0.8


def withdrawn(verdict: str, findings: Sequence[Finding], shown: bool) -> bool:
    """Whether findings are to be withdrawn. `shown`: whether held-out data bear them out."""
    return not (shown or verdict != "unexplained" or len(findings) < 2 or any(f.confidence >= LIKELY for f in findings))


def without_guesses(
    selection: Selection, bank: Bank, declared: Estimate, held: Signals | None, refit: Callable[[Stage], Estimate]
) -> tuple[Selection, Estimate]:
    """What is left of a selection whose findings are withdrawn, and its estimate: the one that explains nearly all that they do, or
    nothing. `declared`: the estimate of the declared model; `refit`: that of a stage's model."""
    total = sum(f.judged.evidence for f in selection.found)
    for one in selection.found:
        if one.judged.evidence > _ALMOST_ALL * total:
            final = with_effects(selection.declared, [one.effect], selection.final, bank)
            after = refit(final)
            rows = None if held is None else without_reversals(held, final.turning)
            if rows is None or Change.of(declared, after, rows).on(np.ones(rows.robot.n, bool))[0] < 0.0:
                return replace(selection, final=final, found=(one,)), after
    return replace(selection, final=selection.declared, found=()), declared


def withdrawal(findings: Sequence[Finding], kept: Selection) -> Unexplained:
    """What is to be said of findings that were withdrawn, but for those `kept`."""
    names = ", ".join(f"{f.name}{on(f.place)}" for f in findings)
    joint = next((j for f in findings for j in f.joints), "")
    taken = " and ".join(f.effect.name for f in kept.found)
    said = (
        f"{names}: they draw a part of what is there in the data fitted, none of them for sure, and the error on held-out data falls with"
        f" them no more than chance might; so {f'only {taken}, which is nearly all of it,' if taken else 'none'} is taken. Log more of the"
        " same motion, or mend what the log's audit says"
    )
    return Unexplained(joint, HELD_OUT, said, float(sum(f.evidence for f in findings)))
