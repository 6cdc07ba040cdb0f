"""Friction at low speed: what only rows near reversals tell, which a selection does not look at.

There a contact that holds for some milliseconds looks like many a fault: like torque that is too small, or late, or follows the motion
through memory. It never looks like friction that rises towards standstill. So these rows are asked for that alone, and the rest
of the catalogue stands by as its rivals."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..effects.base import Axis, Effect, Nature, Need
from .acceptance import Found, chosen, undecoyed
from .analysis import without_reversals
from .bank import Bank
from .candidates import Candidate
from .evidence import surplus, threshold
from .floor import noise_floor
from .frame import Frame, raw_columns
from .motions import Motions
from .precision import found_parameters
from .search import Hit, Search
from .selection import Selection, ranked, settled_together, writing
from .signatures import signatures
from .stage import Stage, on_rows, with_effects
from .whitening import Whitener

if TYPE_CHECKING:
    from ..signals.signals import Signals

Array = np.ndarray
#: An effect is one of low speed if this share of what it adds lies on rows near reversals.
_THERE = 0.5
#: A shape is another one from so many of its standard deviations and this share of itself on.
_FAR = 3.0
_FAR_SHARE = 0.2
#: What is found there is told from nothing by so many of its standard deviations, the scatter of blocks of time being in them: a few
#: moments in which the sign of the speed is wrong are worth much evidence, and tell of one value here and of another there.
_TOLD = 3.0
#: What follows the motion through memory, or the model's own prediction, is what a contact that holds looks like.
_THROUGH_MEMORY = {Need.HISTORY, Need.REFERENCE, Need.TORQUE}


def with_low_speed(selection: Selection, rows: Signals, bank: Bank, note: Callable[[str], None] | None = None) -> Selection:
    """A selection with the friction at low speed that rows near reversals ask for beside it. `rows`: those that it looked at, and with
    them those near reversals."""
    raw = raw_columns(replace(selection.final.problem, signals=rows))
    joints = [joint for joint in rows.robot.joint_names if _promising(selection.final, rows, joint, raw)]
    if not joints:
        return selection
    trail = list(selection.trail)
    say = writing(trail, note)
    white = _noise(selection.final, rows, joints)
    for joint in joints:
        turning = (*selection.final.turning, joint)
        there = without_reversals(rows, turning)
        first, stage = (on_rows(s, there, white, bank, turning) for s in (selection.declared, selection.final))
        new = _asked_for(stage, joint, near_reversals(rows, joint), selection.found)
        if new is None:
            continue
        say(f"accepted near reversals: {new.judged.hit}: evidence {new.judged.evidence:.1f}, weight {new.weight:.3f}")
        found = [*selection.found, new]
        stage, found = settled_together(first, with_effects(first, [f.effect for f in found], stage, bank), found, bank, say)
        if (moved := _moved(selection, found, joint)) is not None:
            say(f"taken back: with it {moved.judged.hit} comes out at another shape: what is near reversals is no friction of this kind")
        elif (place := _place_of(new, found)) is not None:
            if _told(stage, found, place):
                selection = Selection(first, stage, tuple(found), nearest=selection.nearest)
            else:
                say(f"taken back: {new.judged.hit}: blocks of time do not agree on how much of it there is")
    return replace(selection, trail=tuple(trail))


def _place_of(one: Found, found: Collection[Found]) -> int | None:
    """Where one of a name and place stands among findings; None if it is not there."""
    same = (i for i, f in enumerate(found) if f.effect.name == one.effect.name and f.effect.joints == one.effect.joints)
    return next(same, None)


def _told(stage: Stage, found: Collection[Found], place: int) -> bool:
    """Whether one of the parameters of the finding at a place is told from nothing."""
    shapes = {p.name for f in found for p in f.effect.shape()}
    own = found_parameters(stage, [f.effect for f in found])[place]
    return any(abs(p.value) > _TOLD * p.std for p in own if p.name not in shapes)


def away_from_reversals(selection: Selection, looked: Selection, bank: Bank) -> Stage:
    """The final stage of a selection on the rows that `looked` had, before rows near reversals came to them."""
    if not selection.final.turning:
        return selection.final
    return with_effects(looked.declared, [f.effect for f in selection.found], looked.final, bank)


def near_reversals(rows: Signals, joint: str) -> Array:
    """Rows (M,) bool of a joint that are left out because they lie near a reversal."""
    j = rows.robot.joint_names.index(joint)
    return np.asarray(rows.valid[:, j] & ~without_reversals(rows).valid[:, j])


def _promising(stage: Stage, rows: Signals, joint: str, raw: Array) -> bool:
    """Whether friction at low speed seems to explain a joint's rows near reversals, noise taken for white: a first look for little. `raw`
    (M, n, k_base): the model's columns on all rows."""
    j, near = rows.robot.joint_names.index(joint), near_reversals(rows, joint)
    signals = without_reversals(rows, (joint,))
    white = Whitener((), stage.white.std, tuple([(np.ones(1), float(s) ** 2)] for s in stage.white.std)).on(signals.valid, signals.row_runs)
    problem = replace(stage.problem, signals=signals)
    search = Search(Frame.build(problem, white, raw), Motions(problem), stage.search.candidates)
    return _best_is_there(search, _of_joint(stage, joint), j, near, stage.number)


def _best_is_there(search: Search, mine: Collection[Candidate], j: int, near: Array, number: int) -> bool:
    """Whether what explains most of some candidates can be, and does so on a joint's rows near reversals."""
    hits = [h for h in map(search.first, mine) if h.fit_gain > threshold(h, number)]
    best = max(map(search.judge, hits), key=lambda x: surplus(x, number), default=None)
    return best is not None and not best.against and surplus(best, number) > 0.0 and _is_there(best.hit, j, near)


def _noise(stage: Stage, rows: Signals, joints: Collection[str]) -> Whitener:
    """The noise's whitener from rows of which those near reversals are not cut out: in the pieces between them, colour is hardly told."""
    problem = replace(stage.problem, signals=without_reversals(rows, joints))
    motions = Motions(problem)
    generic = [s.placed(rows.robot.n) for s in signatures(motions)]
    return noise_floor(problem, motions, stage.search.candidates, Bank(), generic).white


def _of_joint(stage: Stage, joint: str) -> list[Candidate]:
    return [c for c in stage.search.candidates if c.joints == (joint,) and _of_low_speed(c.variants[0])]


def _asked_for(stage: Stage, joint: str, near: Array, beside: Collection[Found]) -> Found | None:
    """The friction at low speed on a joint that a stage's rows ask for. `near` (M,): its rows near reversals."""
    j = stage.problem.model.robot.joint_names.index(joint)
    if not _best_is_there(stage.search, _of_joint(stage, joint), j, near, stage.number):
        return None
    new = chosen(stage, undecoyed(ranked(stage, joints=frozenset({joint}))), list(beside))
    if new is None or not _of_low_speed(new.effect) or not _is_there(new.judged.hit, j, near):
        return None
    return new


def _moved(selection: Selection, found: Collection[Found], joint: str) -> Found | None:
    """A finding on a joint, through memory, that rows near reversals would have at other shapes than all the others have: a lag that a
    contact undoes there. `found`: the findings settled with those rows."""
    parameters = found_parameters(selection.final, [f.effect for f in selection.found])
    after = {f.judged.hit.place: f.effect for f in found}
    for one, own in zip(selection.found, parameters, strict=True):
        there = after.get(one.judged.hit.place)
        if there is None or one.judged.hit.candidate.joints != (joint,) or not one.effect.needs & _THROUGH_MEMORY:
            continue
        std = {p.name: p.std for p in own}
        for shape in one.effect.shape():
            value, new = float(getattr(one.effect, shape.name)), float(getattr(there, shape.name))
            if abs(new - value) > max(_FAR * std[shape.name], _FAR_SHARE * abs(value)):
                return one
    return None


def _of_low_speed(effect: Effect) -> bool:
    return effect.nature is Nature.FRICTION and effect.axis is Axis.VELOCITY and not effect.needs & _THROUGH_MEMORY


def _is_there(hit: Hit, j: int, near: Array) -> bool:
    power = np.sum(hit.columns**2, axis=2)
    return float(power[j, near].sum()) > _THERE * float(power.sum())
