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
    """What is left of a selection, the estimate of its model, what was taken back, and what is to be said about it."""

    selection: Selection
    after: Estimate
    unexplained: tuple[Unexplained, ...] = ()
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
    return LastWord(kept.selection, kept.after, unexplained, (*contest.said, *([warning] if warning else [])))


@dataclass(frozen=True, eq=False)
class Confirmed:
    """The selection without what does harm, the estimate of its model, and what was refused."""

    selection: Selection
    after: Estimate
    refused: tuple[Found, ...] = ()


def confirmed(
    selection: Selection,
    bank: Bank,
    declared: Estimate,
    after: Estimate,
    rows: Signals,
    refit: Callable[[Stage, tuple[str, ...]], Estimate],
) -> Confirmed:
    """Take back findings until the error on held-out data is lower than the declared model's, and on no joint clearly higher.

    `after`: the estimate of the selection's model; `rows`: of the held-out data. `refit`: the estimate of a stage's model on all rows
    but those near reversals of some joints. First on all rows; if that does harm, without those near reversals of the joints of the
    findings, which were not looked at when the findings were chosen either."""
    found, stage, refused = list(selection.found), selection.final, list[Found]()
    names = np.array(declared.model.robot.joint_names)
    while found:
        at = [touched(f.judged.hit.columns) for f in found]
        if refused:
            after = refit(stage, ())
        harmed = _harmed(declared, after, rows, at)
        if harmed.any() and (not refused or len(found) == 1):
            after = refit(stage, tuple(names[np.any(at, axis=0)].tolist()))
            harmed = _harmed(declared, after, rows, at)
        there = [f for f, own in zip(found, at, strict=True) if (own & harmed).any()]
        if not there:
            return Confirmed(replace(selection, final=stage, found=tuple(found)), after, tuple(refused))
        worst = min(there, key=lambda f: f.judged.evidence)
        refused.append(worst)
        found = [f for f in found if f is not worst]
        stage = with_effects(selection.declared, [f.effect for f in found], stage, bank) if found else selection.declared
    return Confirmed(replace(selection, final=stage, found=()), declared, tuple(refused))


def _harmed(before: Estimate, after: Estimate, signals: Signals, at: Sequence[Array]) -> Array:
    """Joints (n,) whose error grows beyond chance; else those on which something was found (`at`, (n,) bool each) that does not lower the
    error there, weighted by noise; else, if the plain sum over all joints grows by more than its standard error, those that make up most
    of it."""
    first, second = (e.residual(signals) for e in (before, after))
    common = np.isfinite(first) & np.isfinite(second)
    squares = [np.where(common, r, 0.0) ** 2 for r in (first, second)]
    parts = [p for run in signals.row_runs for p in np.array_split(np.arange(run.start, run.stop), _BLOCKS) if len(p)]
    grows = np.array([(squares[1][p] - squares[0][p]).sum(axis=0) for p in parts])
    total, scatter = grows.sum(axis=0), np.sqrt((grows**2).sum(axis=0))
    clearly = (total > _SURELY * scatter) & (total > _SHARE * squares[0].sum(axis=0))
    if clearly.any():
        return np.asarray(clearly)
    noise = after.fit_error.rms
    share = np.where(noise > 0.0, total / np.where(noise > 0.0, noise, 1.0) ** 2, 0.0)  # no rows of a joint: nan, and no share
    idle = [own for own in at if share[own].sum() >= 0.0]
    if idle:
        return np.asarray(idle[0])
    if total.sum() > float(np.sqrt(np.sum(grows.sum(axis=1) ** 2))):
        return np.asarray(total >= 0.5 * total.max())
    return np.zeros(len(total), bool)


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
