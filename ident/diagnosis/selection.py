"""Selection: which effects the data ask for beside the declared model, one after the other, each re-examined as others join."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effect import Effect, Need
from ..model import Model
from .bank import Bank
from .consistent import own_loss
from .evidence import WEAK, occam, surplus, threshold, touched
from .light import too_light
from .plausible import driven_out_on, implausible
from .precision import kept, settled, support, unbound
from .search import Hit, Judged
from .stage import Stage, with_effects, with_noise_beneath
from .total import totalled
from .weights import weights

Array = np.ndarray
#: Best hits of a scan whose shapes are refined and which are judged on held-out blocks.
_REFINED = 14
#: And those whose gain is within so much of the best one's (twice a log-likelihood), up to so many in all.
_TIED = 10.0
_MOST_TIED = 30
_MOST_FINDINGS = 6
#: So often may the same thing be accepted: once more than it was dropped.
_CHANCES = 2
#: Beside effects that explain G on a joint's rows, another one there must explain this share of G: laws are never exact.
COMPANION = 0.02
#: What follows the model's prediction through time (an elastic joint, a filter) is no more exact than that: there, this share.
FOLLOWING = 0.3
#: Or be as large as this beside the noise (rms).
LARGE = 1.0
#: A companion on the same rows must reach the threshold so many times over.
_BESIDE = 2.0
#: A finding must lower the loss of the rows it is on by this share: what it adds must matter, not only be there.
_MATTERS = 0.01
#: Held-out gain over its standard error: what is seen in a single block of time has one, what is seen in all has many.
_STRETCHES = 1.5
#: Or so many blocks gain as much as this each.
_SEVERAL = 4
_CLEARLY = 10.0
#: By how much a decoy (a fit that cannot be: a negative stiffness) outdoes a weak candidate.
_DECOY = 1.5
#: So many of the best candidates are compared with what they gain for nothing.
_TRIES = 4
#: A candidate is near the best if it has this share of its evidence.
_NEAR = 0.8
#: So many of those are made consistent, in so many passes.
_LOOKED_AT = 2
_PASSES = 4


@dataclass(frozen=True, eq=False)
class Found:
    """An accepted effect, and its rivals: everything that was judged in its place, the same others being in the model."""

    judged: Judged
    rivals: tuple[Judged, ...]
    weights: Array

    @property
    def effect(self) -> Effect:
        return self.judged.hit.effect

    @property
    def weight(self) -> float:
        """Probability that it is this one and none of its rivals."""
        return float(self.weights[0])


@dataclass(frozen=True, eq=False)
class Selection:
    """From the declared model's stage to the last one, with what was found on the way; `trail` tells the steps."""

    declared: Stage
    final: Stage
    found: tuple[Found, ...]
    trail: tuple[str, ...] = ()


def ranked(
    stage: Stage, also: Sequence[Hit] = (), progress: Callable[[float], None] | None = None, joints: frozenset[str] | None = None
) -> list[Judged]:
    """The best candidates beside a stage's model, refined and judged, the largest surplus first. `also`: further hits; `joints`: of
    candidates on these joints alone."""
    hits = stage.search.scan(progress, joints)
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
    """Add what is asked for until nothing is. `progress`: called with the share done; as nobody knows how many rounds there will
    be, each takes a share of what is left."""
    trail: list[str] = []

    def say(text: str) -> None:
        trail.append(text)
        if note is not None:
            note(text)

    stage, found, accepted = first, list[Found](), Counter[tuple[str, tuple[str, ...], tuple[str, ...]]]()
    unlooked = list[Found]()  # found before something that was found since, on other rows
    while len(found) < _MOST_FINDINGS:
        begun = 1.0 - 0.5 ** len(found)

        def told(share: float, begun: float = begun) -> None:
            if progress is not None:
                progress(begun + 0.5 * (1.0 - begun) * share)

        all_ranked = ranked(stage, progress=told)
        for j in all_ranked[:8]:
            say(f"    {described(j, stage.number)}")
        # Two that make room for each other would do so for ever.
        new = _chosen(stage, [j for j in _undecoyed(all_ranked) if accepted[j.hit.place] < _CHANCES], found)
        if new is None:
            due, before = [f for f in found if any(f is x for x in unlooked)], {f.judged.hit.place for f in found}
            if due:
                unlooked = []
                stage, found = _re_examined(first, stage, found, due, bank, say)
            if before == {f.judged.hit.place for f in found}:
                break
            continue
        accepted[new.judged.hit.place] += 1
        say(f"accepted: {new.judged.hit}: evidence {new.judged.evidence:.1f}, weight {new.weight:.3f}")
        found.append(_labelled(new, stage.problem.model))
        stage = with_effects(first, [f.effect for f in found], stage, bank)
        if len(found) > 1:
            rows = touched(found[-1].judged.hit.columns)
            unlooked = [f for f in found[:-1] if not (touched(f.judged.hit.columns) & rows).any()]
            due = [f for f in reversed(found[:-1]) if not any(f is x for x in unlooked)]
            stage, found = _re_examined(first, stage, found, [*due, found[-1]], bank, say)
        else:
            # With the strongest effect in the model, what is left tells the noise better than the saturated model did.
            first, stage = with_noise_beneath(first, stage, bank)
    stage, found = _settled(first, stage, found, bank, say)
    return Selection(first, stage, tuple(found), tuple(trail))


def described(j: Judged, number: int) -> str:
    """A line about a candidate."""
    against = f"; against it: {j.against}" if j.against else ""
    held = f"{j.score.heldout:.1f} ± {j.score.standard_error:.1f}"
    return f"{j.hit}: held out {held}, fit {j.score.fit_gain:.1f}, surplus {surplus(j, number):.1f}{against}"


def _chosen(stage: Stage, plausible: list[Judged], beside: Sequence[Found]) -> Found | None:
    """The most probable of the candidates, with its rivals, if it is worth accepting."""
    often = [j for j in plausible if _often(j)]
    best_evidence = max((j.evidence for j in often if j.evidence > threshold(j.hit, stage.number)), default=np.inf)
    # One that asks for more, since chance has more ways to it, and has as much: a rival all the same.
    rivals = [j for j in often if j.evidence > min(threshold(j.hit, stage.number), _NEAR * best_evidence)]
    # Beside others on the same rows: what is explained there is never quite so. What falls short of that is not accepted, but a rival
    # all the same.
    taken = np.any([touched(f.judged.hit.columns) for f in beside], axis=0) if beside else np.zeros(stage.problem.model.robot.n, bool)
    times = [1.0 + (_BESIDE - 1.0) * float(_shares(j)[taken].sum()) for j in rivals]
    worth = [j.evidence > x * threshold(j.hit, stage.number) and _worth(j, beside, stage) for j, x in zip(rivals, times, strict=True)]
    more = _once_consistent(rivals, stage) if any(worth) else np.zeros(len(rivals))
    for _ in range(_TRIES):
        if not any(worth):
            break
        w = weights(rivals, [occam(j.hit, stage.number) for j in rivals], more)
        best = int(np.argmax(np.where(worth, w, -1.0)))
        if not too_light(stage, rivals[best]) and stage.null.exceeded(rivals[best].hit.candidate, rivals[best].evidence):
            order = [best, *(i for i in np.argsort(-w) if i != best)]
            return Found(rivals[best], tuple(rivals[i] for i in order[1:]), w[order])
        rivals, more = [j for i, j in enumerate(rivals) if i != best], np.delete(more, best)
        worth = [x for i, x in enumerate(worth) if i != best]
    return None


def _once_consistent(judged: Sequence[Judged], stage: Stage) -> Array:
    """What each candidate (m,) gains beyond what it seems to gain beside the present fit, when the fit is made consistent with it.

    Columns that depend on the prediction were made of one that lacks the candidate; with it in the model they are others. Looked at
    where such a candidate is not far from the best."""
    out = np.zeros(len(judged))
    if len(judged) < 2:
        return out
    best = max(j.evidence for j in judged)
    near = [i for i, j in enumerate(judged) if j.hit.candidate.dependent and j.evidence > _NEAR * best]
    for i in sorted(near, key=lambda i: -judged[i].evidence)[:_LOOKED_AT]:
        hit = judged[i].hit
        there = with_effects(stage, [hit.effect], stage, stage.search.bank, stage.search.candidates, _PASSES)
        out[i] = max(0.0, stage.frame.loss - own_loss(there.problem, there.frame) - hit.fit_gain)
    return out


def _undecoyed(found: Sequence[Judged]) -> list[Judged]:
    """The plausible ones, without weak ones that something impossible on the same rows clearly outdoes: what is there is neither."""
    decoys = [(touched(j.hit.columns), j.evidence) for j in found if j.against]

    def outdone(judged: Judged) -> bool:
        rows = touched(judged.hit.columns)
        return judged.evidence < WEAK and any((rows & other).any() and more > _DECOY * judged.evidence for other, more in decoys)

    return [j for j in found if not j.against and not outdone(j)]


def _often(judged: Judged) -> bool:
    """Whether a candidate gains in more than a stretch or two of the log; what happens seldom, but several times, does."""
    several = int(np.sum(judged.score.gain > _CLEARLY)) >= _SEVERAL
    return judged.score.heldout > 0.0 and (several or judged.score.heldout > _STRETCHES * judged.score.standard_error)


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
        without = with_effects(first, [f.effect for f in others], stage, bank)
        own = _hit_in(without, one)
        # What sits on other joints cannot stand in its place.
        at = frozenset(np.array(stage.problem.model.robot.joint_names)[touched(one.judged.hit.columns)].tolist())
        new = _chosen(without, _undecoyed(ranked(without, () if own is None else (own,), joints=at)), others)
        if new is None:
            say(f"dropped: {one.judged.hit}")
            found, stage, changed = others, without, True
            continue
        if new.judged.hit.candidate.name != one.judged.hit.candidate.name or new.effect.joints != one.effect.joints:
            say(f"replaced: {one.judged.hit} by {new.judged.hit}")
            changed = True
        new = _labelled(new, without.problem.model)
        found = [new if f is one else f for f in found]
        stage = with_effects(first, [f.effect for f in found], stage, bank)
    return stage, found


def _settled(first: Stage, stage: Stage, found: list[Found], bank: Bank, say: Callable[[str], None]) -> tuple[Stage, list[Found]]:
    """Stage and findings at the shapes that fit best together; without those that cannot be what they are called there."""
    robot, among = stage.problem.model.robot, stage.search.candidates

    def rebuilt(own: Sequence[Effect]) -> Stage:
        return with_effects(first, own, stage, bank, among)

    while found:
        best, effects = settled(stage, [f.effect for f in found], rebuilt)
        worst: tuple[float, int, str] | None = None
        for i, (f, (values, std)) in enumerate(zip(found, unbound(best, effects), strict=True)):
            why = implausible(effects[i], values, np.nan_to_num(std), robot, kept(best, effects[i], effects))
            why = why or driven_out_on(first.frame, best.frame, effects[i].joints or ())
            if not why and support(best, effects[i]) < threshold(f.judged.hit, best.number):
                why = "in this company nothing is gained by it"
            if why and (worst is None or f.judged.evidence < worst[0]):
                worst = (f.judged.evidence, i, why)
        if worst is None:
            hits = [replace(f.judged.hit, effect=e, columns=best.search.whitened(e)) for f, e in zip(found, effects, strict=True)]
            best = totalled(best)
            return best, [replace(f, judged=replace(f.judged, hit=hit)) for f, hit in zip(found, hits, strict=True)]
        say(f"dropped in the end: {found[worst[1]].judged.hit}: {worst[2]}")
        found = [f for i, f in enumerate(found) if i != worst[1]]
        stage = with_effects(first, [f.effect for f in found], stage, bank)
    return stage, found


def _hit_in(stage: Stage, found: Found) -> Hit | None:
    """A finding as a hit of another stage."""
    for candidate in stage.search.candidates:
        variant = candidate.variants[0]
        if type(variant) is type(found.effect) and variant.joints == found.effect.joints:
            shape = {p.name: getattr(found.effect, p.name) for p in variant.shape()}
            effect = variant.with_shape(**shape) if shape else variant
            return stage.search.hit(candidate, effect)
    return None


def _labelled(found: Found, model: Model) -> Found:
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


def _worth(judged: Judged, beside: Sequence[Found], stage: Stage) -> bool:
    """Whether a candidate matters on its rows, and is more than the inexactness of those accepted there."""
    rows = touched(judged.hit.columns)
    # A candidate on several joints is measured by what was explained on each of them in the share in which it acts there itself.
    share = _shares(judged)
    explained = sum(float(share[touched(f.judged.hit.columns)].sum()) * f.judged.evidence * _inexactness(f.effect) for f in beside)
    # As much as the noise itself is no inexactness, however much was explained before.
    inexact = min(explained, LARGE**2 * float(stage.problem.signals.valid[:, rows].sum()))
    columns = np.sum(judged.hit.columns**2, axis=(1, 2))
    loss = float(columns @ np.sum(stage.frame.residual**2, axis=1) / max(float(columns.sum()), 1e-300))
    return judged.evidence > max(inexact, _MATTERS * loss)


def _shares(judged: Judged) -> Array:
    """The share (n,) of what a candidate adds that is on each joint's rows."""
    power = np.sum((judged.hit.columns @ judged.score.values) ** 2, axis=1)
    return np.asarray(power / max(float(power.sum()), 1e-300))


def _inexactness(effect: Effect) -> float:
    """Share of what an effect explains that its law may fail by."""
    return FOLLOWING if {Need.REFERENCE, Need.HISTORY} <= effect.needs else COMPANION
