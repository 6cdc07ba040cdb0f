"""The last word: held-out data, which nothing was chosen on. What does harm there is taken back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ..places import on, place_of
from .analysis import without_reversals
from .contest import contested
from .evidence import WEAK, touched
from .findings import Unexplained
from .search import Bank
from .selection import Found, Selection
from .stage import Stage, with_effects

if TYPE_CHECKING:
    from ..effect import Effect
    from ..estimate import Estimate
    from ..signals import Signals

Array = np.ndarray
#: Blocks of a run; a joint's squared error grows if it does so by so many standard errors over them, and by this share: what little an
#: effect that was found elsewhere moves is the price of refitting all parameters with it.
_BLOCKS = 20
_SURELY = 2.0
_SHARE = 0.4


@dataclass(frozen=True, eq=False)
class LastWord:
    """What is left of a selection, the estimate of its model, what was taken back, and what is to be said about it. `doubted`: findings
    that stay, though held-out data do not show them."""

    selection: Selection
    after: Estimate
    unexplained: tuple[Unexplained, ...] = ()
    doubted: tuple[Effect, ...] = ()
    said: tuple[str, ...] = ()


def last_word(
    selection: Selection, bank: Bank, declared: Estimate, held: Signals | None, refit: Callable[[Stage, tuple[str, ...]], Estimate]
) -> LastWord:
    """Held-out data on a selection: they decide between rivals that the data fitted cannot tell apart, and have what does harm taken
    back. `refit`: see `confirmed`."""
    if not selection.found:
        return LastWord(selection, declared)
    if held is None:
        return LastWord(selection, refit(selection.final, ()))
    rows = without_reversals(held)
    contest = contested(selection, bank, rows, lambda stage: refit(stage, ()))
    kept = confirmed(contest.selection, bank, declared, contest.after, rows, refit)
    unexplained, warning = refusals(kept)
    names = kept.after.model.robot.joint_names
    unexplained += tuple(_unseen(f, names) for f in kept.unseen)
    said = (*contest.said, *([warning] if warning else []))
    return LastWord(kept.selection, kept.after, unexplained, tuple(f.effect for f in kept.unseen), said)


@dataclass(frozen=True, eq=False)
class Confirmed:
    """The selection without what does harm, the estimate of its model, what was refused, and what was kept but gains nothing."""

    selection: Selection
    after: Estimate
    refused: tuple[Found, ...] = ()
    unseen: tuple[Found, ...] = ()


def confirmed(
    selection: Selection,
    bank: Bank,
    declared: Estimate,
    after: Estimate,
    rows: Signals,
    refit: Callable[[Stage, tuple[str, ...]], Estimate],
) -> Confirmed:
    """Take back findings until the error on held-out data grows on no joint, and on all together, by more than chance.

    `after`: the estimate of the selection's model; `rows`: of the held-out data. `refit`: the estimate of a stage's model on all rows
    but those near reversals of some joints. First on all rows; if that does harm, without those near reversals of the joints of the
    findings, which were not looked at when the findings were chosen either. A strong finding on whose joints nothing is gained, nor lost,
    stays: the held-out data may not hold what shows it."""
    found, stage, refused = list(selection.found), selection.final, list[Found]()
    names = np.array(declared.model.robot.joint_names)
    while found:
        at = [touched(f.judged.hit.columns) for f in found]
        if refused:
            after = refit(stage, ())
        change = Change.of(declared, after, rows)
        if change.harms(found) and (not refused or len(found) == 1):
            after = refit(stage, tuple(names[np.any(at, axis=0)].tolist()))
            change = Change.of(declared, after, rows)
        harmful, unseen = change.harms(found), list[Found]()
        for f in () if harmful else sorted(change.idle(found), key=lambda f: f.judged.evidence):
            # What is gained elsewhere, by parameters that are free of a bias now, counts as well: compared with the model without it.
            others = [g.effect for g in found if g is not f]
            without = refit(with_effects(selection.declared, others, stage, bank), ()) if others else declared
            grown, error = Change.of(without, after, rows).on(np.ones(len(names), bool))
            if grown >= 0.0 and (grown > error or f.judged.evidence < WEAK):
                harmful = [f]
                break
            if grown >= 0.0:
                unseen.append(f)
        if not harmful:
            return Confirmed(replace(selection, final=stage, found=tuple(found)), after, tuple(refused), tuple(unseen))
        worst = min(harmful, key=lambda f: f.judged.evidence)
        refused.append(worst)
        found = [f for f in found if f is not worst]
        stage = with_effects(selection.declared, [f.effect for f in found], stage, bank) if found else selection.declared
    return Confirmed(replace(selection, final=stage, found=()), declared, tuple(refused))


@dataclass(frozen=True, eq=False)
class Change:
    """By what squared errors grow from one estimate to another: `grows` (blocks of time, n); `before` (n,): what they were in sum;
    `noise` (n,): the later one's rms on its own data."""

    grows: Array
    before: Array
    noise: Array

    @classmethod
    def of(cls, before: Estimate, after: Estimate, signals: Signals) -> Change:
        first, second = (e.residual(signals) for e in (before, after))
        common = np.isfinite(first) & np.isfinite(second)
        squares = [np.where(common, r, 0.0) ** 2 for r in (first, second)]
        parts = [p for run in signals.row_runs for p in np.array_split(np.arange(run.start, run.stop), _BLOCKS) if len(p)]
        grows = np.array([(squares[1][p] - squares[0][p]).sum(axis=0) for p in parts])
        return cls(grows, squares[0].sum(axis=0), after.fit_error.rms)

    def on(self, joints: Array) -> tuple[float, float]:
        """Growth over some joints (n,) bool, each weighted by its noise, and its standard error."""
        # A joint without rows has no noise that anyone knows, and no share.
        weight = np.where(joints & (self.noise > 0.0), 1.0 / np.where(self.noise > 0.0, self.noise, 1.0) ** 2, 0.0)
        blocks = self.grows @ weight
        return float(blocks.sum()), float(np.sqrt(np.sum(blocks**2)))

    def harms(self, found: Sequence[Found]) -> list[Found]:
        """Findings that are to blame: on joints whose error grows beyond chance; else, if the plain sum over all joints grows by more than
        its standard error, on those that make up most of it."""
        total, scatter = self.grows.sum(axis=0), np.sqrt((self.grows**2).sum(axis=0))
        worse = (total > _SURELY * scatter) & (total > _SHARE * self.before)
        whole = self.grows.sum(axis=1)
        if not worse.any() and whole.sum() > np.sqrt(np.sum(whole**2)):
            worse = total >= 0.5 * total.max()
        return [f for f in found if (touched(f.judged.hit.columns) & worse).any()]

    def idle(self, found: Sequence[Found]) -> list[Found]:
        """Findings on whose own joints nothing is gained."""
        return [f for f in found if self.on(touched(f.judged.hit.columns))[0] >= 0.0]


def _unseen(one: Found, names: Sequence[str]) -> Unexplained:
    joints = [names[j] for j in touched(one.judged.hit.columns).nonzero()[0].tolist()]
    said = (
        f"{', '.join(joints)}: the held-out data do not show {one.effect.name} (evidence {one.judged.evidence:.0f} in those fitted): the"
        " error there is no lower with it; log another motion before it is relied on"
    )
    return Unexplained(joints[0], "held-out data", said, one.judged.evidence)


def refusals(confirmed: Confirmed) -> tuple[tuple[Unexplained, ...], str]:
    """What was refused: structure that stays unexplained, or, if all of it is a weak sign of something, a warning."""
    refused, robot = confirmed.refused, confirmed.after.model.robot
    if not refused:
        return (), ""
    names = ", ".join(f"{f.effect.name}{on(place_of(f.effect, f.judged.hit.candidate.joints))}" for f in refused)
    if sum(f.judged.evidence for f in refused) < WEAK:
        return (), f"a weak sign of {names} was dropped: it does not lower the error on held-out data."
    out = []
    for f in refused:
        joints = [robot.joint_names[j] for j in touched(f.judged.hit.columns).nonzero()[0]]
        said = (
            f"{', '.join(joints)}: {f.effect.name} lowers the error on the data fitted (evidence {f.judged.evidence:.0f}), but not on"
            " held-out data, and was taken back: what is there is something else, or does not last; a longer log would tell"
        )
        out.append(Unexplained(joints[0], "held-out data", said, f.judged.evidence))
    return tuple(out), f"taken back, because the error on held-out data is no lower with it: {names}."
