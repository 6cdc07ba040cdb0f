"""Which effect joins next: the one that accounts best for what is left, by refits at one noise."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...effects.kinds import Nature
from ...instruments.columns import is_order
from ...instruments.fit import depends
from ...instruments.thresholds import BOUND
from ..design.catalogue import Catalogue
from ..design.places import search_range
from ..thresholds import COMPETES, CONTAINED
from .refinement import PASSES, agreed, anywhere, refined, settled, sharpened
from .scores import Scores

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ...effects.base import Effect
    from ...instruments.fit import Fit
    from ...instruments.solved import Solved
    from ...robots.robot import Robot
    from ..design.catalogue import Group
    from .search import EffectSearch, Placed

#: Candidates that are compared by a refit, at most.
_TRIED = 12
#: Simpler ones inside the best that are tried beside them, at most.
_SIMPLER = 4
#: Times that the limit of a drive is sought over its whole range again.
_ANEW = 2

Array = np.ndarray
Kind = tuple[str, tuple[str, ...]]


@dataclass(frozen=True)
class Trial:
    """A candidate after a refit with it: `rank`: how much it asks for; `cost` of what it leaves, in units of a log-likelihood."""

    effect: Effect
    joints: tuple[str, ...]
    rank: tuple[int, int, bool]
    fit: Fit
    frame: Solved
    cost: float = 0.0

    def lean(self) -> Trial:
        """Without the rows, which are made again where scores beside it are asked for: a dozen trials' fill the memory."""
        self.fit.forget_motions()
        none = np.zeros((0, *self.frame.X.shape[1:]))
        return dataclasses.replace(self, frame=dataclasses.replace(self.frame, X=none, Z=none))


def best(state: EffectSearch, refused: set[Kind]) -> Placed | None:
    """The effect that accounts best for what is left: of those whose scores come near the largest, by a refit with each.

    Scores are taken at the noise of a model that lacks something, and so are compressed: what a refit leaves tells more."""
    demanded = [t for g in _readings(state, refused) if _stands(state, t := tried(state, g, anew=_ANEW))]
    trials = [*(t.lean() for t in demanded), *(tried(state, g).lean() for g in _candidates(state, refused))]
    if not trials:
        return None
    return _simplest(state, _chosen(state, trials), trials, refused)


def _simplest(state: EffectSearch, chosen: Trial, trials: list[Trial], refused: set[Kind]) -> Placed:
    """The chosen effect, or a simpler one inside it beside which nothing is left: by scores along the instrument, because what a refit
    leaves falls by feedback, too."""
    inner = _inside(state, state.scores, chosen.effect, chosen.joints)
    known = {(t.effect.name, t.joints): t for t in trials}
    pool = [known[g.kind] if g.kind in known else tried(state, g) for g in inner if g.kind not in refused]
    found = _sufficient(state, pool, chosen.frame.gains) or chosen
    return found.effect, found.joints


def simpler(state: EffectSearch, i: int) -> Placed | None:
    """A simpler effect inside the i-th accepted one that does in its place, beside the others that were accepted after it; None where there
    is none. While those were missing, more parameters took a part of what they account for."""
    effect, joints = state.accepted[i]
    # Whether there is any is seen without a refit.
    if not _inside(state, state.without(i), effect, joints):
        return None
    others = state.apart_from(i)
    taken = {(e.name, at) for e, at in others.accepted}
    trials = [tried(others, g) for g in _inside(others, others.scores, effect, joints) if g.kind not in taken]
    found = _sufficient(others, trials, state.frame.gains)
    return None if found is None else (found.effect, found.joints)


def _sufficient(state: EffectSearch, trials: list[Trial], gains: Sequence[Array]) -> Trial | None:
    """Of the trials beside which nothing is left at a given noise, the one that asks for least."""
    return min((t for t in trials if _left_beside(state, t, gains) <= state.critical), key=lambda t: t.rank, default=None)


def _chosen(state: EffectSearch, trials: list[Trial]) -> Trial:
    """Of those beside which nothing is left (of all, where something is beside each) and that account for the residual as well as any of
    them, the one that asks for least.

    What is left along the instrument comes first, and the residual counts in the instrument's band alone: beyond it, it holds what feedback
    and the noise of the measured motion make, of which an effect that smooths leaves less."""
    if len(trials) < 2:
        return trials[0]
    gains = state.fit.in_band([t.frame for t in trials])
    # Schwarz's criterion: what a parameter must gain grows with the logarithm of the rows.
    each = np.log(max(state.frame.rows, 2)) / 2.0
    trials = [dataclasses.replace(t, cost=t.fit.energy(t.frame, gains) / 2.0 + each * t.rank[0]) for t in trials]
    # What a likelihood gains by chance, or by less than what is material, does not decide.
    margin = state.critical**2 / 2.0
    trials = sorted(trials, key=lambda t: t.cost)
    enough: list[Trial] = []
    for t in trials:
        if enough and t.cost > enough[0].cost + margin:
            break
        if _left_beside(state, t, trials[0].frame.gains) <= state.critical:
            enough.append(t)
    level = enough or [t for t in trials if t.cost <= trials[0].cost + margin]
    return min(level, key=lambda t: (*t.rank, t.cost))


def _inside(state: EffectSearch, scores: Scores, effect: Effect, joints: tuple[str, ...]) -> list[Group]:
    """Simpler effects that a candidate contains, the largest scores first: of a spring that a constant torque explains, the constant; of a
    delay on all joints that on one."""
    own = [k for k in range(len(scores.kept)) if scores.group(k).kind == (effect.name, joints)]
    if not own:
        return []
    k = max(own, key=lambda i: float(scores.z[i]))
    energy, whole = scores.beside(scores.slice_of(k))[1], rank(scores.group(k))
    found: dict[Kind, Group] = {}
    for i in np.argsort(-scores.z).tolist():
        g = scores.group(i)
        if scores.z[i] <= state.critical or len(found) >= _SIMPLER:
            break
        here = g.joints == joints or set(joints) > set(g.joints) > set()
        if g.named and here and rank(g) < whole and energy[i] < CONTAINED and state.possible(scores, i):
            found.setdefault(g.kind, g)
    return list(found.values())


def rank(group: Group) -> tuple[int, int, bool]:
    """How much an effect asks for: parameters and sought shapes, what it needs to know, friction (it acts only where something moves)."""
    effect = group.effect
    assert effect is not None
    return len(group.columns) + _sought(effect), len(effect.needs), effect.nature == Nature.FRICTION


def parameters(effect: Effect, robot: Robot) -> int:
    """How many parameters an effect has, sought shapes among them."""
    return len(effect.parameters(robot)) + _sought(effect)


def _sought(effect: Effect) -> int:
    return sum(p.points != 1 for p in effect.shape())


def _candidates(state: EffectSearch, refused: set[Kind]) -> list[Group]:
    """Named groups beyond the critical value that come near the largest score: those beside which the least is left, and each kind of
    effect on the joint that shows most, else where it scores best: scores of what is loud hardly differ between the joints."""
    scores, found, top = state.scores, {}, 0.0
    for k in np.argsort(-scores.z).tolist():
        g = scores.group(k)
        if scores.z[k] <= state.critical or scores.plain[k] < COMPETES * top:
            break
        if g.named and g.kind not in refused and g.kind not in found and state.possible(scores, k):
            found[g.kind] = k
            top = max(top, float(scores.plain[k]))
    every = list(found.values())
    if len(every) <= _TRIED:
        return [scores.group(k) for k in every]
    loudest = scores.group(int(np.argmax(scores.z))).joints
    of_name: dict[str, int] = {}
    for k in sorted(every, key=lambda k: scores.group(k).joints != loudest):
        of_name.setdefault(scores.group(k).name, k)
    left = {k: float(scores.beside(scores.slice_of(k))[0].max(initial=0.0)) for k in every[: 2 * _TRIED]}
    # Of those alike, those that ask for less come first.
    ranked = sorted(left, key=lambda k: (round(left[k], 1), rank(scores.group(k))))
    chosen = dict.fromkeys([*ranked[: _TRIED // 3], *list(of_name.values()), *ranked])
    return [scores.group(k) for k in list(chosen)[:_TRIED]]


def _readings(state: EffectSearch, refused: set[Kind]) -> list[Group]:
    """Effects of the reading itself, each where it scores best, that score at least as much as anything that is left."""
    scores = Scores.of(state.fit, state.frame, Catalogue.of_readings(state.fit))
    least = max(state.critical, COMPETES * float(state.scores.z.max(initial=0.0)))
    found: dict[Kind, Group] = {}
    for k in np.argsort(-scores.plain).tolist():
        g = scores.group(k)
        if scores.plain[k] > least and g.kind not in refused and state.possible(scores, k):
            found.setdefault(g.kind, g)
    return list(found.values())


def _stands(state: EffectSearch, trial: Trial) -> bool:
    """Whether an effect of the reading is there and is what it says, beside itself: its value is beyond what chance and immaterial error
    explain, its shape lies where it can for a model that has it, and what would deny it is not there: not beyond chance, or not beyond
    the share of it that its law is exact to."""
    effect, fit = trial.effect, trial.fit
    value, std = float(trial.frame.theta[-1]), float(trial.frame.std[-1])
    own = abs(value) / std
    if not own > state.critical:
        return False
    response = effect.response(fit.robot)
    # The excess of a noisy reading goes with its own noise, by some share: to be told from that, what must be 1 must be known to be.
    if response is not None and not (std <= effect.tolerance and abs(value - response[-1]) <= max(effect.tolerance, BOUND * std)):
        return False
    ranges = search_range(effect, fit.declared, fit.motions(instrument=False))
    if not all(low <= getattr(effect, name) <= high for name, (low, high) in ranges.items()):
        return False
    denial = effect.denied_by()
    if denial is None:
        return True
    against = Scores.of(fit, trial.frame, Catalogue.of_effects(fit, [(denial, trial.joints)])).plain.max(initial=0.0)
    return bool(against**2 <= max(state.critical, effect.tolerance**0.5 * own) ** 2)


def tried(state: EffectSearch, group: Group, anew: int = 0) -> Trial:
    """A refit with a group's effect, its shape sought first at the noise before, and with one weight for all frequencies, because what is
    missing passes for noise; then at the noise after it. `anew`: times that it is sought over its whole range again, where what it accounts
    for drowns all else."""
    assert group.effect is not None
    joints, others = group.joints, tuple(e for e, _ in state.accepted)
    passes = PASSES if depends(group.effect) else 1

    def solved(effect: Effect) -> tuple[Fit, Solved]:
        fit = state.fit.with_effects((*others, effect))
        return fit, fit.solved(passes)

    one_noise = is_order(group.effect) or not group.effect.shape()
    frames = (state.frame,) if one_noise else (state.frame, state.flat)
    along = [refined(group.effect, joints, state.fit, each) for each in frames]
    shapes = dict.fromkeys([*along, *(anywhere(e, joints, state.fit, each) for e, each in zip(along, frames, strict=True))])
    begun = [(e, *solved(e)) for e in map(state.labelled, shapes)]
    effect, fit, frame = max(begun, key=lambda x: x[1].likelihood(x[2])) if len(begun) > 1 else begun[0]
    likelier = anywhere(effect, joints, state.fit, state.fit.behind(frame.gains))
    if likelier != effect:
        effect, fit, frame = max((effect, fit, frame), (likelier, *solved(likelier)), key=lambda x: x[1].likelihood(x[2]))
    for _ in range(anew):
        wider = refined(effect, joints, state.fit, state.fit.behind(frame.gains))
        if wider != effect:
            effect = wider
            fit, frame = solved(effect)
    sharper = sharpened(effect, joints, others, state.fit, frame.gains)
    if sharper != effect:
        effect = sharper
        fit, frame = solved(effect)
    told = agreed(effect, others, state.fit)
    if told != effect:
        effect = told
        fit, frame = solved(effect)
    if anew:
        effect = settled(effect, others, state.fit)
        fit, frame = solved(effect)
    return Trial(effect, joints, rank(group), fit, frame)


def _left_beside(state: EffectSearch, trial: Trial, gains: Sequence[Array]) -> float:
    """The largest score beside a candidate, at a given noise."""
    frame = trial.fit.behind(tuple(gains))
    return float(state.scored(trial.fit, frame).z.max(initial=0.0))
