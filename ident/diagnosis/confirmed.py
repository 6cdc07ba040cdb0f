"""The last word: held-out data, which nothing was chosen on. What does harm there is taken back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..effects.places import on, place_of
from .acceptance import FEW, Found
from .advice import motion_for
from .analysis import without_reversals
from .bank import Bank
from .change import SURELY, Change
from .contest import Arena, Contest, contested
from .evidence import WEAK, acts_on, threshold
from .findings import HELD_OUT, Unexplained
from .leftover import Leftover
from .nominated import NOMINATED, nominated
from .selection import Selection
from .stage import Stage, with_effects
from .stand_in import stand_in

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

    #: The estimate of a stage's model on all rows but those near reversals of some joints.
    Refit = Callable[[Stage, tuple[str, ...]], Estimate]

Array = np.ndarray
#: Evidence of less than so many times the threshold is none where held-out data do not show it either: the noise need only be twice as
#: strong there as it was taken for.
_BARELY = 2.0
#: What is left is slight up to so many times the noise (rms), and if what was taken back drew at least this share of it.
_SLIGHT = 1.5
_DRAWN = 0.5


@dataclass(frozen=True, eq=False)
class LastWord:
    """What is left of a selection, the estimate of its model, what was taken back (`refused`), and what is to be said about it. `unseen`:
    findings that stay, though held-out data do not show them; `faint`: those that they show no more clearly than chance might; `owed`:
    those that were found with their help, and that they bear out no more clearly than chance might the best of all that were asked about.
    `shown`: whether the error on held-out data falls by more than chance might with all that is left; `fell_beyond_chance`: that, or so
    much that it need not be often (with what comes in knocks the error falls by most of it in few blocks: its standard error is large, but
    chance is no explanation)."""

    selection: Selection
    after: Estimate
    refused: tuple[Found, ...] = ()
    unexplained: tuple[Unexplained, ...] = ()
    unseen: tuple[Effect, ...] = ()
    faint: tuple[Effect, ...] = ()
    owed: tuple[Effect, ...] = ()
    said: tuple[str, ...] = ()
    shown: bool = True
    fell_beyond_chance: bool = True


def last_word(selection: Selection, bank: Bank, declared: Estimate, held: Signals | None, refit: Refit) -> LastWord:
    """Held-out data on a selection: they may confirm what came near to being found, they decide between rivals that the data fitted cannot
    tell apart, and have what does harm taken back. `refit`: see `confirmed`."""
    if held is None:
        return LastWord(selection, refit(selection.final, ()) if selection.found else declared)
    rows = without_reversals(held, selection.final.turning)
    contest = contested(selection, bank, rows, refit) if selection.found else Contest(selection, declared, ())
    of_itself = {f.judged.hit.place for f in contest.selection.found}
    with_nominee, confirms = nominated(contest.selection, bank, declared, rows, lambda stage: refit(stage, ()))
    if not with_nominee.found:
        return LastWord(with_nominee, declared)

    def nominee(found: Found) -> bool:
        return bool(confirms) and found.judged.hit.place not in of_itself

    decided = contest.said
    if confirms:
        contest = contested(with_nominee, bank, rows, refit)
        decided = (*decided, *contest.said)
    kept = confirmed(contest.selection, bank, declared, contest.after, rows, refit, nominee)
    unexplained, warning = refusals(kept)
    said = (*([confirms] if confirms else []), *decided, *kept.said, *([warning] if warning else []), *_not_shown(kept))
    unseen, faint = (tuple(f.effect for f in some) for some in (kept.unseen, kept.faint))
    change = Change.of(declared, kept.after, rows)
    # One of so many that were asked about beforehand, with values of the fitted part: one of so many hypotheses.
    owed = tuple(f.effect for f in kept.selection.found if nominee(f) and not kept.borne_out(f, declared, bank, rows, refit))
    grown, error = change.on(np.ones(rows.robot.n, bool))
    shown = -grown > SURELY * error
    return LastWord(kept.selection, kept.after, kept.refused, unexplained, unseen, faint, owed, said, shown, shown or change.shown)


@dataclass(frozen=True, eq=False)
class Confirmed:
    """The selection without what does harm, the estimate of its model, what was refused, what was kept but gains nothing, what gains no
    more than chance might, and what is to be said."""

    selection: Selection
    after: Estimate
    refused: tuple[Found, ...] = ()
    unseen: tuple[Found, ...] = ()
    faint: tuple[Found, ...] = ()
    said: tuple[str, ...] = ()

    def borne_out(self, one: Found, declared: Estimate, bank: Bank, rows: Signals, refit: Refit) -> bool:
        """Whether the error falls with one of the findings by more than chance gives the best of all that were nominated."""
        without = _without(one, self.selection.found, self.selection.declared, self.selection.final, bank, declared, refit)
        return Change.of(without, self.after, rows).shown_of(NOMINATED)


def confirmed(
    selection: Selection,
    bank: Bank,
    declared: Estimate,
    after: Estimate,
    rows: Signals,
    refit: Refit,
    nominee: Callable[[Found], bool] = lambda _: False,
) -> Confirmed:
    """Take back findings until the error on held-out data grows on no joint, and on all together, by more than chance.

    `after`: the estimate of the selection's model; `rows`: of the held-out data. `refit`: the estimate of a stage's model on all rows
    but those near reversals of some joints. `nominee`: whether held-out data have been asked about a finding: it has less evidence on the
    data fitted, and they bore it out.

    First on all rows; if that does harm, without those near reversals of the joints of the findings, which were not looked at when the
    findings were chosen either. A rival that helps takes the place of what does harm, where findings are few: of many each draws a part,
    and none has rivals of its own. A strong finding on whose joints nothing is gained, nor lost, stays: the held-out data may not hold what
    shows it."""
    found, stage, refused, said = list(selection.found), selection.final, list[Found](), list[str]()
    names = np.array(declared.model.robot.joint_names)

    def without(one: Found) -> Estimate:
        return _without(one, found, selection.declared, stage, bank, declared, refit)

    while found:
        at = [acts_on(f.judged) for f in found]
        if refused or said:
            after = refit(stage, ())
        change = Change.of(declared, after, rows)
        if change.harms(found) and (not (refused or said) or len(found) == 1):
            after = refit(stage, tuple(names[np.any(at, axis=0)].tolist()))
            change = Change.of(declared, after, rows)
        harmful, unseen, faint = change.harms(found), list[Found](), list[Found]()
        if not harmful:
            harmful, unseen, faint = _borne_out(found, change.doubtful(found), stage.number, without, after, rows, nominee)
        if not harmful:
            left = replace(selection, final=stage, found=tuple(found))
            return Confirmed(left, after, tuple(refused), tuple(unseen), tuple(faint), tuple(said))
        worst = harmful[0] if len(harmful) == 1 else _to_blame(harmful, without, declared, rows)
        if len(found) <= FEW and len(said) < len(selection.found):
            effects, turn = tuple(f.effect for f in found), found.index(worst)
            arena = Arena(selection, bank, rows, refit, stage, effects, turn, without(worst))
            other = stand_in(arena, declared, found)
            if other is not None:
                found, stage, why = other
                said.append(why)
                continue
        refused.append(worst)
        found = [f for f in found if f is not worst]
        stage = with_effects(selection.declared, [f.effect for f in found], stage, bank) if found else selection.declared
    return Confirmed(replace(selection, final=stage, found=()), declared, tuple(refused), said=tuple(said))


def _without(one: Found, found: Sequence[Found], first: Stage, stage: Stage, bank: Bank, declared: Estimate, refit: Refit) -> Estimate:
    """The estimate of the model with all findings but one. `first`: the declared model's stage; `stage`: that of all findings; `declared`:
    the estimate where no other is left."""
    others = [f.effect for f in found if f is not one]
    return refit(with_effects(first, others, stage, bank), ()) if others else declared


def _borne_out(
    found: Sequence[Found],
    doubtful: Sequence[Found],
    number: int,
    without: Callable[[Found], Estimate],
    after: Estimate,
    rows: Signals,
    nominee: Callable[[Found], bool],
) -> tuple[list[Found], list[Found], list[Found]]:
    """Of findings that harm no joint one that does harm on the whole, or is barely there at all, if any is; those that gain nothing; and
    those that gain no more than chance might. What is gained elsewhere, by parameters that are free of a bias now, counts as well: each is
    compared with the model without it. `number`: of candidates; `without`: the estimate of that model; `after`: that of all;
    `nominee`: see `confirmed`."""
    unseen, faint = list[Found](), list[Found]()
    for f in sorted(found, key=lambda f: f.judged.evidence):
        change = Change.of(without(f), after, rows)
        grown, error = change.on(np.ones(rows.robot.n, bool))
        if f in doubtful and grown >= 0.0:
            if grown > error or f.judged.evidence < WEAK:
                return [f], [], []
            unseen.append(f)
        elif not change.shown:
            if not change.hinted and not nominee(f) and f.judged.evidence < _BARELY * threshold(f.judged.hit, number):
                return [f], [], []
            faint.append(f)
    return [], unseen, faint


def _to_blame(harmful: Sequence[Found], without: Callable[[Found], Estimate], declared: Estimate, rows: Signals) -> Found:
    """Of several that may do harm the one without which least is left of it. `without`: the estimate of the model that lacks one."""
    return min(harmful, key=lambda one: Change.of(declared, without(one), rows).shares)


def _not_shown(confirmed: Confirmed) -> list[str]:
    """What is to be said of findings that held-out data do not show, or hardly."""
    return [
        f"{f.judged.hit.candidate} is in the data fitted (evidence {f.judged.evidence:.0f}), but the data held out {what}; log another"
        " motion before it is relied on."
        for some, what in (
            (confirmed.unseen, "do not show it: the error there is no lower with it"),
            (confirmed.faint, "show it no more clearly than chance might"),
        )
        for f in some
    ]


def refusals(confirmed: Confirmed) -> tuple[tuple[Unexplained, ...], str]:
    """What was refused: structure that stays unexplained, or, if all of it is a weak sign of something, a warning."""
    refused, joints = confirmed.refused, confirmed.after.model.robot.joint_names
    if not refused:
        return (), ""
    names = ", ".join(f"{f.effect.name}{on(place_of(f.effect, f.judged.hit.candidate.joints))}" for f in refused)
    if sum(f.judged.evidence for f in refused) < WEAK:
        return (), f"a weak sign of {names} was dropped: it lowers the error on held-out data no more than chance might, or not at all."
    return (
        tuple(_not_borne_out(f, joints) for f in refused),
        f"taken back, because the error on held-out data is no lower with it: {names}.",
    )


def undecided(refused: Sequence[Found], left: Sequence[Leftover]) -> bool:
    """Whether nobody can say that what was taken back is not there, where nothing else was found: it drew most of what is left on the
    data fitted; and that is slight, so that the data held out may be too few to bear it out, or it was drawn by knocks. A law tells how
    hard these come, but foretells each of them so roughly that it is not denied where the error on other data does not fall."""
    strong = [x for x in left if x.counts]
    most = _DRAWN * sum(x.evidence for x in strong)
    knocks = sum(f.judged.evidence for f in refused if f.effect.abrupt)
    if knocks > 0.0 and knocks >= most:
        return True
    return bool(refused) and all(x.rms <= _SLIGHT for x in strong) and sum(f.judged.evidence for f in refused) >= most


def _not_borne_out(one: Found, names: Sequence[str]) -> Unexplained:
    joints = [names[j] for j in acts_on(one.judged).nonzero()[0].tolist()]
    own = one.effect.joints or ("every joint",)
    why = (
        "its law foretells single knocks only roughly, so it may be there all the same, or it is something else; to tell,"
        f" {motion_for(one.effect, own[0])}"
        if one.effect.abrupt
        else "what is there is something else, or does not last; a longer log would tell"
    )
    said = (
        f"{', '.join(joints)}: {one.effect.name} lowers the error on the data fitted (evidence {one.judged.evidence:.0f}), but not on"
        f" held-out data, and was taken back: {why}"
    )
    return Unexplained(joints[0], HELD_OUT, said, one.judged.evidence)
