"""Selection: which effects the data ask for beside the declared model, one after the other, each re-examined as others join."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...effects.base import Effect
from ...model import Model
from .acceptance import FEW, NEAR, Found, chosen, undecoyed
from .bank import Bank
from .consistent import own_loss
from .evidence import acts_on, occam, surplus, threshold
from .grouped import groups
from .plausible import driven_out_on, implausible, too_small_at_its_best
from .precision import kept, settled, support, unbound
from .search import Hit, Judged
from .stage import Stage, at_least, with_effects, with_noise_beneath

Array = np.ndarray
#: Best hits of a scan whose shapes are refined and which are judged on held-out blocks.
_REFINED = 14
#: And those whose gain is within so much of the best one's (twice a log-likelihood), up to so many in all.
_TIED = 10.0
_MOST_TIED = 30
_MOST_FINDINGS = 6
#: So often may the same thing be accepted: once more than it was dropped.
_CHANCES = 2
#: A value of one parameter alone counts from so many of its standard deviations on, the scatter of blocks of time being in them.
_TOLD = 2.0
#: So often the search goes on where something was dropped in the end.
_AGAIN = 1
#: What something is, and where (see Hit.place).
Place = tuple[str, tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True, eq=False)
class Selection:
    """From the declared model's stage to the last one, with what was found on the way; `trail` tells the steps; `nearest`: the candidates
    that might have been found beside these, the nearest to it first."""

    declared: Stage
    final: Stage
    found: tuple[Found, ...]
    trail: tuple[str, ...] = ()
    nearest: tuple[Judged, ...] = ()


def ranked(
    stage: Stage, also: Sequence[Hit] = (), progress: Callable[[float], None] | None = None, joints: frozenset[str] | None = None
) -> list[Judged]:
    """The best candidates beside a stage's model, refined and judged, the largest surplus first. `also`: further hits; `joints`: of
    candidates on these joints alone."""
    hits = stage.search.scan(progress, joints)
    hits += groups(stage.search, hits, stage.number)
    worth = {id(h): max(h.fit_gain, h.promise) - threshold(h, stage.number) for h in hits}
    hits.sort(key=lambda h: -worth[id(h)])
    # Where many do as well as the best, none of them is left out for its place in the order.
    tied = [h for h in hits[_REFINED:_MOST_TIED] if worth[id(h)] > max(worth[id(hits[0])] - _TIED, 0.0)]
    judged = [stage.search.judge(stage.search.refined(h)) for h in [*also, *hits[:_REFINED], *tied]]
    judged += _as_they_can_be(judged, stage)
    judged.sort(key=lambda j: -surplus(j, stage.number))
    return judged


def _as_they_can_be(judged: Sequence[Judged], stage: Stage) -> list[Judged]:
    """Of candidates that fit best with parameters that cannot be, what they are at their best with such as can."""
    out = []
    for j in judged:
        candidate, shapes = j.hit.candidate, j.hit.effect.shape()
        if j.against and shapes and not candidate.spectral and j.hit.effect.response(stage.search.robot) is None and _counts(j, stage):
            hit = stage.search.possible(candidate)
            out += [] if hit is None else [stage.search.judge(hit)]
    return out


def _counts(judged: Judged, stage: Stage) -> bool:
    return judged.evidence > threshold(judged.hit, stage.number)


def select(
    first: Stage, bank: Bank, note: Callable[[str], None] | None = None, progress: Callable[[float], None] | None = None
) -> Selection:
    """Add what is asked for until nothing is. `progress`: called with the share done."""
    trail: list[str] = []
    say = writing(trail, note)
    forward = _Forward(bank, say, progress)
    begun, stage, found = first, first, list[Found]()
    for turn in range(_AGAIN + 1):
        first, stage, grown = forward.grown(first, stage, found)
        stage, found = settled_together(first, stage, grown, bank, say)
        gone = _places(grown) - _places(found)
        if not gone or turn == _AGAIN or len(found) > FEW:
            break
        # What was dropped stood where something else may belong, which was never looked at without it. (Beside many, it would be one more
        # that draws a part.)
        forward.accepted.update(dict.fromkeys(gone, _CHANCES))
        first, stage = (first, stage) if found else (begun, begun)
    return Selection(first, stage, tuple(found), tuple(trail), tuple(forward.nearest if found else forward.alone))


@dataclass
class _Forward:
    """Steps forward. `accepted`: how often each thing was; `nearest`: what came near to being found in the last round; `alone`: before
    anything was found."""

    bank: Bank
    say: Callable[[str], None]
    progress: Callable[[float], None] | None
    accepted: Counter[Place] = field(default_factory=Counter)
    nearest: list[Judged] = field(default_factory=list)
    alone: list[Judged] = field(default_factory=list)

    def grown(self, first: Stage, stage: Stage, found: Sequence[Found]) -> tuple[Stage, Stage, list[Found]]:
        """The declared model's stage, the last one and its findings, when nothing more is asked for."""
        bank, say, found = self.bank, self.say, list(found)
        begun_with: Found | None = None
        unlooked = list[Found]()  # found before something that was found since, on other rows
        while len(found) < _MOST_FINDINGS:
            # A fit that is merely consistent with its own prediction leaves what another effect would take up.
            stage = at_least(stage)
            new = self._next(stage, found)
            if new is None:
                due, before = [f for f in found if any(f is x for x in unlooked)], _places(found)
                if due:
                    unlooked = []
                    stage, found = _re_examined(first, stage, found, due, bank, say)
                if before == _places(found):
                    break
                continue
            found.append(relabelled(new, stage.problem.model))
            stage = with_effects(first, [f.effect for f in found], stage, bank)
            if len(found) > 1:
                rows = acts_on(found[-1].judged)
                unlooked = [f for f in found[:-1] if not (acts_on(f.judged) & rows).any()]
                due = [f for f in reversed(found[:-1]) if not any(f is x for x in unlooked)]
                stage, found = _re_examined(first, stage, found, [*due, found[-1]], bank, say)
            else:
                # With the strongest effect in the model, what is left tells the noise better than the saturated model did.
                first, stage = with_noise_beneath(first, stage, bank)
                begun_with = found[0]
        # What was found first was judged under the noise before that: told in units of this one, like all the others.
        return first, stage, [_judged_in(first, f) if f is begun_with else f for f in found]

    def _next(self, stage: Stage, found: Sequence[Found]) -> Found | None:
        """What is worth adding beside what was found."""
        all_ranked = ranked(stage, progress=_share_of(self.progress, len(found)))
        for j in all_ranked[:8]:
            self.say(f"    {described(j, stage.number)}")
        able = undecoyed(all_ranked)
        self.nearest = [j for j in able if j.evidence > 0.0]
        if not found:
            self.alone = self.nearest
        # Two that make room for each other would do so for ever.
        new = chosen(stage, [j for j in able if self.accepted[j.hit.place] < _CHANCES], found)
        if new is not None:
            self.accepted[new.judged.hit.place] += 1
            self.say(f"accepted: {new.judged.hit}: evidence {new.judged.evidence:.1f}, weight {new.weight:.3f}")
        return new


def _share_of(progress: Callable[[float], None] | None, count: int) -> Callable[[float], None]:
    """What tells the share done of a round in which so many effects have been found: as nobody knows how many rounds there will be, each
    takes a share of what is left."""
    begun = 1.0 - 0.5**count

    def told(share: float) -> None:
        if progress is not None:
            progress(begun + 0.5 * (1.0 - begun) * share)

    return told


def _places(found: Sequence[Found]) -> set[Place]:
    return {f.judged.hit.place for f in found}


def writing(trail: list[str], note: Callable[[str], None] | None) -> Callable[[str], None]:
    """What adds a line to a trail, and tells it at once to `note`."""

    def say(text: str) -> None:
        trail.append(text)
        if note is not None:
            note(text)

    return say


def described(j: Judged, number: int) -> str:
    """A line about a candidate."""
    against = f"; against it: {j.against}" if j.against else ""
    held = f"{j.score.heldout:.1f} ± {j.score.standard_error:.1f}"
    return f"{j.hit}: held out {held}, fit {j.score.fit_gain:.1f}, surplus {surplus(j, number):.1f}{against}"


def _re_examined(
    first: Stage, stage: Stage, found: list[Found], due: Sequence[Found], bank: Bank, say: Callable[[str], None]
) -> tuple[Stage, list[Found]]:
    """Findings that are `due` anew, in the company of the others: dropped, replaced by a better rival, the shape sought again. The newest
    one only if its company has changed."""
    newest, changed = found[-1], False
    for one in due:
        if one is newest and not changed:
            break
        others = [f for f in found if f is not one]
        without = at_least(with_effects(first, [f.effect for f in others], stage, bank))
        own = _hit_in(without, one)
        # What sits on other joints cannot stand in its place, unless it came near to it before.
        near = [one.judged, *(j for j in one.rivals if j.evidence > NEAR * one.judged.evidence)]
        at = frozenset(np.array(stage.problem.model.robot.joint_names)[np.any([acts_on(j) for j in near], axis=0)].tolist())
        also = () if own is None else (own,)
        new = chosen(without, undecoyed(ranked(without, also, joints=at)), others)
        if new is not None and _another(new, one):
            # It drew what the others explain now; what is left of it may sit on any joint.
            new = chosen(without, undecoyed(ranked(without, also)), others) or new
        if new is None:
            say(f"dropped: {one.judged.hit}")
            found, stage, changed = others, without, True
            continue
        other = _another(new, one)
        new = relabelled(new, without.problem.model)
        with_new = [new if f is one else f for f in found]
        there = with_effects(first, [f.effect for f in with_new], stage, bank)
        if other and (why := _outlasts(one, stage, new, there, without)):
            say(f"kept: {one.judged.hit}: {why} {new.judged.hit}")
            continue
        if other:
            say(f"replaced: {one.judged.hit} by {new.judged.hit}")
            changed = True
        found, stage = with_new, there
    return stage, found


def _another(new: Found, one: Found) -> bool:
    """Whether a finding is another effect than one, or elsewhere."""
    return new.judged.hit.candidate.name != one.judged.hit.candidate.name or new.effect.joints != one.effect.joints


def _outlasts(one: Found, stage: Stage, new: Found, there: Stage, without: Stage) -> str:
    """Why a finding of a `stage` is not to be replaced by another in its own stage (`there`; `without` either); "" if it is.

    What is made of the model's prediction: beside a fit that lacks it, its columns are made of another prediction, and fit as they may; two
    of which either seems to be better where the other is would replace each other for ever. And what was borne out by blocks held out
    beside others, and alone explains clearly more: without those others it may be told so badly by some blocks that they do not bear
    it out any more (two frictions of a joint that turns once)."""
    mine, others = (own_loss(s.problem, s.frame) + occam(f.judged.hit, s.number) for f, s in ((one, stage), (new, there)))
    if one.judged.hit.candidate.dependent and mine < others:
        return "consistent with the prediction that it makes, it fits better than"
    if others - mine > (1.0 - NEAR) * (without.frame.loss - mine) > 0.0:
        return "it accounts for clearly more than"
    return ""


def settled_together(first: Stage, stage: Stage, found: list[Found], bank: Bank, say: Callable[[str], None]) -> tuple[Stage, list[Found]]:
    """Stage and findings at the shapes that fit best together; without those that cannot be what they are called there."""
    robot, among = stage.problem.model.robot, stage.search.candidates

    def rebuilt(own: Sequence[Effect]) -> Stage:
        return with_effects(first, own, stage, bank, among)

    while found:
        best, effects = settled(stage, [f.effect for f in found], rebuilt)
        worst: tuple[float, int, str] | None = None
        for i, (f, (values, std)) in enumerate(zip(found, unbound(best, effects), strict=True)):
            why = implausible(effects[i], values, std, robot, kept(best, effects[i], effects))
            why = why or driven_out_on(first.frame, best.frame, effects[i].joints or ())
            gained = support(best, effects[i])
            why = why or too_small_at_its_best(effects[i], values, gained, robot)
            if not why and gained < threshold(f.judged.hit, best.number):
                why = "in this company nothing is gained by it"
            if not why and not effects[i].shape() and len(values) == 1 and abs(values[0]) < _TOLD * std[0] < np.inf:
                why = f"{values[0]:.3g} ± {std[0]:.2g} is not told from nothing"
            if why and (worst is None or f.judged.evidence < worst[0]):
                worst = (f.judged.evidence, i, why)
        if worst is None:
            hits = [replace(f.judged.hit, effect=e, columns=best.search.whitened(e)) for f, e in zip(found, effects, strict=True)]
            best = at_least(best)
            return best, [replace(f, judged=replace(f.judged, hit=hit)) for f, hit in zip(found, hits, strict=True)]
        say(f"dropped in the end: {found[worst[1]].judged.hit}: {worst[2]}")
        found = [f for i, f in enumerate(found) if i != worst[1]]
        stage = with_effects(first, [f.effect for f in found], stage, bank)
    return stage, found


def _hit_in(stage: Stage, found: Found) -> Hit | None:
    """A finding as a hit of another stage."""
    for candidate in (*stage.search.candidates, found.judged.hit.candidate):
        variant = candidate.variants[0]
        if type(variant) is type(found.effect) and variant.joints == found.effect.joints:
            shape = {p.name: getattr(found.effect, p.name) for p in variant.shape()}
            effect = variant.with_shape(**shape) if shape else variant
            return stage.search.hit(candidate, effect)
    return None


def _judged_in(stage: Stage, found: Found) -> Found:
    """A finding and its rivals judged once more under the noise of a stage: what others gain there is compared with it."""

    def again(judged: Judged) -> Judged:
        # The columns of what is abrupt are not to be had without the search that found them.
        return judged if judged.hit.effect.abrupt else stage.search.judge_again(judged.hit)

    return replace(found, judged=again(found.judged), rivals=tuple(again(r) for r in found.rivals))


def relabelled(found: Found, model: Model) -> Found:
    """A finding whose effect goes without the label of candidates."""
    hit = found.judged.hit
    return replace(found, judged=replace(found.judged, hit=replace(hit, effect=labelled(hit.effect, model))))


def labelled(effect: Effect, model: Model, beside: Sequence[Effect] = ()) -> Effect:
    """A candidate's effect without the label of candidates, if its parameters' names are free in a model with others beside it."""
    taken = set(model.names) | {p.name for other in beside for p in other.parameters(model.robot)}
    for label in ("", *(f"{i}" for i in range(2, 20))):
        plain = dataclasses.replace(effect, label=label)
        if not taken & {p.name for p in plain.parameters(model.robot)}:
            return plain
    return effect
