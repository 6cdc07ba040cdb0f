"""What an effect carries on: a reversal is in the rows behind it for as long as a filter's memory, or a delay, lasts.

Rows near reversals are not looked at, because what happens there is not what the model foretells. A low-pass or a delay in the reading
brings it into other rows, late; a time constant fitted to those is that of the contact as well (on a UR5 of the test bed 0.036 s
for 0.040 s)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .acceptance import Found, once_consistent
from .analysis import without_reversals
from .bank import Bank
from .evidence import occam
from .selection import Selection, settled_together, writing
from .stage import Stage, on_rows, with_effects
from .weights import weights

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..robots.robot import Robot

Array = np.ndarray
#: Rivals are weighed again from this weight on.
_LIKELY = 1e-3


def without_carried(selection: Selection, bank: Bank, note: Callable[[str], None] | None = None) -> Selection:
    """The selection with its shapes settled on rows that hold no reversal, not even by the memory of what was found; the same
    where nothing found has a memory, or too few rows would be left to find it in."""
    final, trail = selection.final, list(selection.trail)
    looked, white = final.problem.signals, final.white
    memory = _memory([f.effect for f in selection.found], looked.robot)
    if not memory.any():
        return selection
    rows = without_reversals(looked, final.turning, memory)
    if np.array_equal(rows.valid, looked.valid):
        return selection
    say = writing(trail, note)
    say(f"settled without rows that a reversal is carried into: {int((looked.valid & ~rows.valid).sum())} left out")
    first, stage = (on_rows(s, rows, white, bank, final.turning) for s in (selection.declared, final))
    stage, found = settled_together(first, stage, list(selection.found), bank, say)
    if len(found) < len(selection.found):
        return selection
    found = [_weighed_again(f, [o for o in found if o is not f], first, stage, bank) for f in found]
    return replace(selection, declared=first, final=stage, found=tuple(found), trail=tuple(trail))


def _weighed_again(one: Found, others: Sequence[Found], first: Stage, stage: Stage, bank: Bank) -> Found:
    """A finding with a memory and those of its rivals that are made of the prediction, too, weighed by a stage's rows: a filter's lag and
    a delay carry a reversal on differently, and so does the contact that holds there, which neither of them is."""
    if not _memory([one.effect], stage.problem.model.robot).any():
        return one
    every = (one.judged, *one.rivals)
    own = [k for k, j in enumerate(every) if j.hit.candidate.dependent and one.weights[k] >= _LIKELY]
    if len(own) < 2 or own[0] != 0:
        return one
    without = with_effects(first, [f.effect for f in others], stage, bank, stage.search.candidates)
    hits = [every[k].hit for k in own]
    judged = [without.search.judge(without.search.refined(without.search.hit(h.candidate, h.effect))) for h in hits]
    again = weights(judged, [occam(j.hit, without.number) for j in judged], once_consistent(judged, without))
    new = one.weights.copy()
    new[own] = new[own].sum() * again
    return replace(one, weights=new)


def _memory(effects: Sequence[Effect], robot: Robot) -> Array:
    """Seconds (n,) for which the rows of each joint hold what was, of all effects the longest; negative: what will be."""
    longest, measured = np.zeros(robot.n), robot.transmission.measured
    for effect in effects:
        own = effect.memory(robot)
        touches = np.abs(robot.transmission.torque_map(effect.side, measured)) > 0
        there = touches * own
        most = there[np.arange(robot.n), np.argmax(np.abs(there), axis=1)]
        longest = np.where(np.abs(most) > np.abs(longest), most, longest)
    return longest
