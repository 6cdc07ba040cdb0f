"""Selection: which effects the data ask for beside the declared model, one after the other, each re-examined as others join."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..effect import Effect, Need
from ..model import Model
from ..problem import Problem
from .candidates import Candidate, candidates
from .consistent import consistent
from .floor import noise_floor
from .frame import Frame, Motions
from .null import Null
from .precision import found_parameters, settled, support
from .search import Bank, Hit, Judged, Search, implausible
from .signatures import signatures
from .weights import weights

if TYPE_CHECKING:
    from ..signals import Signals
    from .whitening import Whitener

Array = np.ndarray
#: Probability that chance alone carries any candidate of the whole catalogue over the threshold.
FALSE_ALARM = 2e-3
#: Best hits of a scan whose shapes are refined and which are judged on held-out blocks.
_REFINED = 14
_MOST_FINDINGS = 6
#: Beside effects that explain G on a joint's rows, another one there must explain this share of G: laws are never exact.
COMPANION = 0.02
#: Or be as large as this beside the noise (rms).
LARGE = 1.0
#: A companion must reach the threshold so many times over.
_BESIDE = 2.0
#: A finding must lower the loss of the rows it is on by this share: what it adds must matter, not only be there.
_MATTERS = 0.01
#: Held-out gain over its standard error: what is seen in a single block of time has one, what is seen in all has many.
_STRETCHES = 1.5
#: Evidence below which a candidate is weak, and by how much a decoy (a fit that cannot be: a negative stiffness) outdoes it.
WEAK = 100.0
_DECOY = 1.5
#: So many of the best candidates are compared with what they gain for nothing.
_TRIES = 4


@dataclass(frozen=True, eq=False)
class Stage:
    """A model on the analysis signals, with everything that scores candidates beside it."""

    problem: Problem
    white: Whitener
    frame: Frame
    motions: Motions
    search: Search

    @property
    def number(self) -> int:
        """Candidates that are tried."""
        return len(self.search.candidates)

    @cached_property
    def null(self) -> Null:
        """Logs that hold this model and nothing else."""
        return Null(self.problem, self.white)


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


def start(model: Model, signals: Signals, reference: Array, bank: Bank, progress: Callable[[float], None] | None = None) -> Stage:
    """The declared model with its noise floor. `progress`: called with the share done."""
    problem = Problem(model, signals, reference=reference)
    motions = Motions(problem)
    found = candidates(model, motions.parts[0][1])
    generic = [s.placed(model.robot.n) for s in signatures(motions)]
    white = noise_floor(problem, motions, found, bank, generic, progress).white
    return _stage(problem, white, bank, motions, found)


def _stage(problem: Problem, white: Whitener, bank: Bank, like: Motions, found: tuple[Candidate, ...] | None = None) -> Stage:
    """A frame for a problem, its columns taken at the values that it yields itself; `like`: motions whose columns may serve."""
    problem, frame = consistent(problem, white)
    motions = Motions(problem).sharing(like)
    if found is None:
        found = candidates(problem.model, motions.parts[0][1])
    return Stage(problem, white, frame, motions, Search(frame, motions, found, bank))


def threshold(hit: Hit, number: int) -> float:
    """Evidence from which on a candidate counts. Columns made of the measured torque hold its noise, which follows itself: there, weak
    evidence is none."""
    return max(by_chance(hit, number), WEAK if Need.TORQUE in hit.effect.needs else 0.0)


def by_chance(hit: Hit, number: int) -> float:
    """Evidence that chance reaches with probability FALSE_ALARM over `number` candidates, for this one's parameters and shapes."""
    from scipy.stats import chi2

    shapes = len(hit.effect.shape())
    # Independent shapes that a search looks at: a few along a smooth one, many along an order.
    trials = 4000.0 if hit.candidate.spectral else 4.0 * shapes if shapes else 1.0
    return float(chi2.isf(FALSE_ALARM / (number * trials), hit.columns.shape[2])) + 2.0 * shapes


def surplus(judged: Judged, number: int) -> float:
    """Evidence above the threshold."""
    return judged.evidence - threshold(judged.hit, number)


def ranked(
    stage: Stage, also: Sequence[Hit] = (), progress: Callable[[float], None] | None = None, joints: frozenset[str] | None = None
) -> list[Judged]:
    """The best candidates beside a stage's model, refined and judged, the largest surplus first. `also`: further hits; `joints`: of
    candidates on these joints alone."""
    hits = stage.search.scan(progress, joints)
    hits.sort(key=lambda h: -(h.fit_gain - threshold(h, stage.number)))
    judged = [stage.search.judge(stage.search.refined(h)) for h in [*also, *hits[:_REFINED]]]
    judged.sort(key=lambda j: -surplus(j, stage.number))
    return judged


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

    stage, found = first, list[Found]()
    while len(found) < _MOST_FINDINGS:
        begun = 1.0 - 0.5 ** len(found)

        def told(share: float, begun: float = begun) -> None:
            if progress is not None:
                progress(begun + 0.5 * (1.0 - begun) * share)

        all_ranked = ranked(stage, progress=told)
        for j in all_ranked[:8]:
            say(f"    {described(j, stage.number)}")
        new = _chosen(stage, _undecoyed(all_ranked), found)
        if new is None:
            break
        say(f"accepted: {new.judged.hit}: evidence {new.judged.evidence:.1f}, weight {new.weight:.3f}")
        found.append(_labelled(new, stage.problem.model))
        stage = _with(first, [f.effect for f in found], stage, bank)
        if len(found) > 1:
            stage, found = _re_examined(first, stage, found, bank, say)
        else:
            # With the strongest effect in the model, what is left tells the noise better than the saturated model did.
            first, stage = _with_noise(first, stage, bank)
    stage, found = _settled(first, stage, found, bank, say)
    return Selection(first, stage, tuple(found), tuple(trail))


def _with_noise(first: Stage, stage: Stage, bank: Bank) -> tuple[Stage, Stage]:
    """Both stages under the noise floor beneath the second one's model."""
    white = noise_floor(stage.problem, stage.motions, stage.search.candidates, bank, []).white
    again = [_stage(s.problem, white, bank, s.motions, s.search.candidates) for s in (first, stage)]
    return again[0], again[1]


def described(j: Judged, number: int) -> str:
    """A line about a candidate."""
    against = f"; against it: {j.against}" if j.against else ""
    held = f"{j.score.heldout:.1f} ± {j.score.standard_error:.1f}"
    return f"{j.hit}: held out {held}, fit {j.score.fit_gain:.1f}, surplus {surplus(j, number):.1f}{against}"


def _chosen(stage: Stage, plausible: list[Judged], beside: Sequence[Found]) -> Found | None:
    """The most probable of the candidates, with its rivals, if it is worth accepting."""
    # Beside others, chance has had more than one try, and what is explained there is never quite so.
    times = _BESIDE if beside else 1.0
    worth = [j for j in plausible if j.evidence > times * threshold(j.hit, stage.number) and _often(j) and _worth(j, beside, stage)]
    for _ in range(_TRIES):
        if not worth:
            break
        w = weights(worth, [by_chance(j.hit, stage.number) for j in worth])
        best = int(np.argmax(w))
        if stage.null.exceeded(worth[best].hit.candidate, worth[best].evidence):
            order = [best, *(i for i in np.argsort(-w) if i != best)]
            return Found(worth[best], tuple(worth[i] for i in order[1:]), w[order])
        worth = [j for i, j in enumerate(worth) if i != best]
    return None


def _undecoyed(found: Sequence[Judged]) -> list[Judged]:
    """The plausible ones, without weak ones that something impossible on the same rows clearly outdoes: what is there is neither."""
    decoys = [(touched(j.hit.columns), j.evidence) for j in found if j.against]

    def outdone(judged: Judged) -> bool:
        rows = touched(judged.hit.columns)
        return judged.evidence < WEAK and any((rows & other).any() and more > _DECOY * judged.evidence for other, more in decoys)

    return [j for j in found if not j.against and not outdone(j)]


def _often(judged: Judged) -> bool:
    """Whether a candidate gains in more than a stretch or two of the log."""
    return judged.score.heldout > _STRETCHES * judged.score.standard_error


def _re_examined(first: Stage, stage: Stage, found: list[Found], bank: Bank, say: Callable[[str], None]) -> tuple[Stage, list[Found]]:
    """Every finding on the rows of the newest one anew, in the company of the others: dropped, replaced by a better rival, its
    shape sought again. The newest one itself only if its company has changed."""
    newest = found[-1]
    rows = touched(newest.judged.hit.columns)
    older = [f for f in found[:-1] if (touched(f.judged.hit.columns) & rows).any()]
    changed = False
    for one in [*reversed(older), newest]:
        if one is newest and not changed:
            break
        others = [f for f in found if f is not one]
        without = _with(first, [f.effect for f in others], stage, bank)
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
        stage = _with(first, [f.effect for f in found], stage, bank)
    return stage, found


def _settled(first: Stage, stage: Stage, found: list[Found], bank: Bank, say: Callable[[str], None]) -> tuple[Stage, list[Found]]:
    """Stage and findings at the shapes that fit best together; without those that cannot be what they are called there."""
    robot, among = stage.problem.model.robot, stage.search.candidates

    def rebuilt(own: Sequence[Effect]) -> Stage:
        return _with(first, own, stage, bank, among)

    while found:
        best, effects = settled(stage, [f.effect for f in found], rebuilt)
        worst: tuple[float, int, str] | None = None
        for i, (f, parameters) in enumerate(zip(found, found_parameters(best, effects), strict=True)):
            linear = parameters[: len(effects[i].parameters(robot))]
            why = implausible(effects[i], np.array([p.value for p in linear]), np.nan_to_num([p.std for p in linear]), robot)
            if not why and support(best, effects[i]) < threshold(f.judged.hit, best.number):
                why = "in this company nothing is gained by it"
            if why and (worst is None or f.judged.evidence < worst[0]):
                worst = (f.judged.evidence, i, why)
        if worst is None:
            hits = [replace(f.judged.hit, effect=e, columns=best.search.whitened(e)) for f, e in zip(found, effects, strict=True)]
            return best, [replace(f, judged=replace(f.judged, hit=hit)) for f, hit in zip(found, hits, strict=True)]
        say(f"dropped in the end: {found[worst[1]].judged.hit}: {worst[2]}")
        found = [f for i, f in enumerate(found) if i != worst[1]]
        stage = _with(first, [f.effect for f in found], stage, bank)
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


def _with(first: Stage, effects: Sequence[Effect], like: Stage, bank: Bank, among: tuple[Candidate, ...] | None = None) -> Stage:
    """The declared model with effects, the reference taken over as far as parameters are the same. `among`: its candidates, if known."""
    model = first.problem.model
    for effect in effects:
        model = model + effect
    old = dict(zip(like.problem.model.names, like.problem.reference, strict=True)) if like.problem.reference is not None else {}
    reference = np.array([old.get(name, 0.0) for name in model.names])
    return _stage(Problem(model, first.problem.signals, reference=reference), first.white, bank, like.motions, among)


def _labelled(found: Found, model: Model) -> Found:
    """The finding without the label of candidates, if its parameters' names are free."""
    effect, taken = found.effect, set(model.names)
    for label in ("", *(f"{i}" for i in range(2, 20))):
        plain = dataclasses.replace(effect, label=label)
        if not taken & {p.name for p in plain.parameters(model.robot)}:
            hit = replace(found.judged.hit, effect=plain)
            return replace(found, judged=replace(found.judged, hit=hit))
    return found


def _worth(judged: Judged, beside: Sequence[Found], stage: Stage) -> bool:
    """Whether a candidate matters on its rows, and is more than the inexactness of those accepted there."""
    rows = touched(judged.hit.columns)
    explained = sum(f.judged.evidence for f in beside if (touched(f.judged.hit.columns) & rows).any())
    # As much as the noise itself is no inexactness, however much was explained before.
    inexact = min(COMPANION * explained, LARGE**2 * float(stage.problem.signals.valid[:, rows].sum()))
    power = np.sum(judged.hit.columns**2, axis=(1, 2))
    loss = float(power @ np.sum(stage.frame.residual**2, axis=1) / max(float(power.sum()), 1e-300))
    return judged.evidence > max(inexact, _MATTERS * loss)


def touched(columns: Array) -> Array:
    """Joints (n,) bool on whose rows whitened columns (n, M, k) weigh."""
    power = np.sum(columns**2, axis=(1, 2))
    return power > 0.05 * power.max(initial=0.0)
