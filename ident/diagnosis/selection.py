"""Selection: which effects the data ask for beside the declared model, one after the other, each re-examined as others join."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..effect import Effect
from ..model import Model
from ..problem import Problem
from .candidates import Candidate, candidates
from .floor import noise_floor
from .frame import Frame, Motions, raw_columns
from .search import Bank, Hit, Judged, Search
from .signatures import Signature, signatures

if TYPE_CHECKING:
    from ..signals import Signals
    from .whitening import Whitener

Array = np.ndarray
#: Probability that chance alone carries any candidate of the whole catalogue over the threshold.
FALSE_ALARM = 2e-3
#: Best hits of a scan whose shapes are refined and which are judged on held-out blocks.
_REFINED = 14
_MOST_FINDINGS = 12
#: Beside an effect that explains G on a joint's rows, another one there must explain this share of G: laws are never exact.
_COMPANION = 0.01


@dataclass(frozen=True, eq=False)
class Stage:
    """The model as it stands: declared plus accepted effects, on the analysis signals, with everything that scores candidates."""

    problem: Problem
    white: Whitener
    frame: Frame
    motions: Motions
    search: Search
    accepted: tuple[Judged, ...] = ()


@dataclass(frozen=True, eq=False)
class Selection:
    """Stage by stage to the last one; `signatures`: generic structure, for what is left."""

    declared: Stage
    final: Stage
    trail: tuple[str, ...] = ()


def start(model: Model, signals: Signals, reference: Array, bank: Bank) -> Stage:
    """The declared model with its noise floor."""
    problem = Problem(model, signals, reference=reference)
    motions = Motions(problem)
    found = candidates(model, motions.parts[0][1])
    generic = [s.placed(model.robot.n) for s in signatures(motions)]
    white = noise_floor(problem, motions, found, bank, generic).white
    return stage(problem, white, (), found, bank)


def stage(problem: Problem, white: Whitener, accepted: tuple[Judged, ...], found: tuple[Candidate, ...] | None, bank: Bank) -> Stage:
    """A frame for a problem, its columns taken at the values that it yields itself."""
    raw = raw_columns(problem)
    frame = Frame.build(problem, white, raw)
    # What depends on the prediction is taken at the fit's own prediction.
    for _ in range(4):
        values = problem.base.expand(frame.base_values)
        shift = problem.reference is None or _moved(values, problem.reference, problem.model)
        problem = problem.with_reference(values)
        if not any(e.needs & _PREDICTION for e in problem.model.effects):
            frame = replace(frame, problem=problem)
            break
        frame = Frame.build(problem, white, raw_columns(problem))
        if not shift:
            break
    motions = Motions(problem)
    if found is None:
        found = candidates(problem.model, motions.parts[0][1])
    return Stage(problem, white, frame, motions, Search(frame, motions, found, bank), accepted)


def threshold(hit: Hit, number: int) -> float:
    """Evidence that chance reaches with probability FALSE_ALARM over `number` candidates, for this one's parameters and shapes."""
    from scipy.stats import chi2

    k = hit.columns.shape[2]
    shapes = len(hit.effect.shape())
    # Independent shapes that a search looks at: few along a smooth one, many along an order.
    trials = 1.0 if not shapes else 4.0 * shapes
    if hit.candidate.spectral:
        trials = 400.0
    return float(chi2.isf(FALSE_ALARM / (number * trials), k)) + 2.0 * shapes


def surplus(judged: Judged, number: int) -> float:
    """Evidence above the threshold."""
    return judged.evidence - threshold(judged.hit, number)


def best_of(stage: Stage, progress: Callable[[float], None] | None = None) -> list[Judged]:
    """The best candidates beside a stage's model, refined and judged, the largest surplus first."""
    hits = stage.search.scan(progress)
    number = len(stage.search.candidates)
    hits.sort(key=lambda h: -(h.fit_gain - threshold(h, number)))
    judged = [stage.search.judge(stage.search.refined(h)) for h in hits[:_REFINED]]
    judged.sort(key=lambda j: -surplus(j, number))
    return judged


def extended(stage: Stage, judged: Judged, bank: Bank) -> Stage:
    """The stage with a finding accepted."""
    effect = labelled(judged.hit.effect, stage.problem.model)
    model = stage.problem.model + effect
    reference = _extended_reference(stage, judged)
    problem = Problem(model, stage.problem.signals, reference=reference)
    found = dataclasses.replace(judged, hit=replace(judged.hit, effect=effect))
    return globals()["stage"](problem, stage.white, (*stage.accepted, found), None, bank)


def labelled(effect: Effect, model: Model) -> Effect:
    """The effect without the label of candidates, if its parameters' names are free."""
    plain = dataclasses.replace(effect, label="")
    taken = set(model.names)
    for label in ("", *(f"'{'' if i == 0 else i + 1}" for i in range(20))):
        plain = dataclasses.replace(effect, label=label)
        if not taken & {p.name for p in plain.parameters(model.robot)}:
            return plain
    return effect


def select(first: Stage, bank: Bank, note: Callable[[str], None] | None = None) -> Selection:
    """Add what is asked for until nothing is."""
    stage = first
    trail: list[str] = []

    def say(text: str) -> None:
        trail.append(text)
        if note is not None:
            note(text)

    for _ in range(_MOST_FINDINGS):
        number = len(stage.search.candidates)
        ranked = best_of(stage)
        for j in ranked[:8]:
            say(f"    {j.hit}: held out {j.score.heldout:.1f} ± {j.score.standard_error:.1f}, fit {j.score.fit_gain:.1f}, surplus {surplus(j, number):.1f} {j.against}")
        chosen = next((j for j in ranked if not j.against and surplus(j, number) > 0 and _worth(stage, j)), None)
        if chosen is None:
            break
        say(f"accepted: {chosen.hit}: evidence {chosen.evidence:.1f}")
        stage = extended(stage, chosen, bank)
    return Selection(first, stage, tuple(trail))


def _worth(stage: Stage, judged: Judged) -> bool:
    """Whether a finding is more than the inexactness of those accepted on the same rows."""
    rows = _rows(judged.hit.columns)
    beside = sum(other.evidence for other in stage.accepted if (_rows(other.hit.columns) & rows).any())
    return judged.evidence > _COMPANION * beside


def _rows(columns: Array) -> Array:
    power = np.sum(columns**2, axis=(1, 2))
    return power > 0.05 * power.max(initial=0.0)


def _extended_reference(stage: Stage, judged: Judged) -> Array:
    base = stage.problem.base
    values = base.expand(stage.frame.transform @ judged.score.model)
    return np.concatenate([values, judged.score.values])


def _moved(new: Array, old: Array, model: Model) -> bool:
    scale = np.abs(new) + np.abs(old) + 1e-12
    return bool(np.any(np.abs(new - old) > 1e-3 * scale))


from ..effect import Need  # noqa: E402

_PREDICTION = frozenset({Need.LOAD, Need.REFERENCE})


__all__ = ["Selection", "Signature", "Stage", "best_of", "extended", "field", "select", "start", "surplus", "threshold"]
