"""Stages: a model on the analysis signals, with everything that scores candidates beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..._utils.fixed_point import MOST
from ...problem.problem import Problem
from .bank import Bank
from .candidates import Candidate, candidates
from .consistent import consistent, own_loss
from .floor import noise_floor
from .frame import Frame
from .motions import Motions
from .null import Null
from .search import Search
from .signatures import signatures
from .total import totalled

if TYPE_CHECKING:
    from ...effects.base import Effect
    from ...model import Model
    from ...signals.signals import Signals
    from .whitening import Whitener

Array = np.ndarray
#: A fit agrees with its own prediction if the losses of both differ by less than this (twice a log-likelihood), or this share; descents
#: that are tried where repetition does not bring that about.
_AGREED = 10.0
_AGREED_SHARE = 0.02
_DESCENTS = 3


@dataclass(frozen=True, eq=False)
class Stage:
    """A model on the analysis signals, with everything that scores candidates beside it. `turning`: joints whose rows near reversals are
    among those looked at."""

    problem: Problem
    white: Whitener
    frame: Frame
    motions: Motions
    search: Search
    turning: tuple[str, ...] = ()

    @property
    def number(self) -> int:
        """Candidates that are tried."""
        return len(self.search.candidates)

    @cached_property
    def null(self) -> Null:
        """Logs that hold this model and nothing else."""
        return Null(self.problem, self.white, self.turning)


def start(model: Model, signals: Signals, reference: Array, bank: Bank, progress: Callable[[float], None] | None = None) -> Stage:
    """The declared model with its noise floor. `progress`: called with the share done."""
    problem = Problem(model, signals, reference=reference)
    motions = Motions(problem)
    found = candidates(model, motions)
    generic = [s.placed(model.robot.n) for s in signatures(motions)]
    white = noise_floor(problem, motions, found, bank, generic, progress).white
    return staged(problem, white, bank, motions, found)


def staged(
    problem: Problem,
    white: Whitener,
    bank: Bank,
    like: Motions,
    found: tuple[Candidate, ...] | None = None,
    most: int = MOST,
    turning: tuple[str, ...] = (),
) -> Stage:
    """A frame for a problem, its columns taken at the values that it yields itself; `like`: motions whose columns may serve."""
    problem, frame = consistent(problem, white, most)
    motions = Motions(problem).sharing(like)
    if found is None:
        found = candidates(problem.model, motions)
    stage = Stage(problem, white, frame, motions, Search(frame, motions, found, bank), turning)
    for _ in range(_DESCENTS):
        apart = own_loss(stage.problem, stage.frame) - stage.frame.loss
        if apart <= max(_AGREED, _AGREED_SHARE * stage.frame.loss):
            break
        # Repetition swings about the values that it seeks: a large tilt acts on moments that next to nothing else shows.
        down = at_least(stage)
        if down is stage:
            break
        stage = down
    return stage


def on_rows(stage: Stage, signals: Signals, white: Whitener, bank: Bank, turning: tuple[str, ...]) -> Stage:
    """The same model on other rows of the same samples. `turning`: joints whose rows near reversals are among them."""
    problem, own = replace(stage.problem, signals=signals), white.on(signals.valid, signals.row_runs)
    return staged(problem, own, bank, stage.motions, stage.search.candidates, turning=turning)


def at_least(stage: Stage) -> Stage:
    """The stage at the least of its loss, where effects of its model correct the model's own prediction; else the same."""
    least = totalled(stage)
    if least is stage:
        return stage
    # Total derivatives are no columns of the model: what these hold would seem new beside them.
    among = tuple(c for c in stage.search.candidates if not stage.search.holds(c))
    return replace(least, search=Search(least.frame, least.motions, among, stage.search.bank))


def with_effects(
    first: Stage, effects: Sequence[Effect], like: Stage, bank: Bank, among: tuple[Candidate, ...] | None = None, most: int = MOST
) -> Stage:
    """The declared model with effects, the reference taken over as far as parameters are the same. `among`: its candidates, if known;
    `most`: repetitions in which the fit may become consistent with its own prediction."""
    model = first.problem.model
    for effect in effects:
        model = model + effect
    abrupt = [e for e in effects if e.abrupt and e not in like.problem.model.effects]
    known = like.search.seen_by(abrupt[0]).problem if abrupt else like.problem
    old = dict(zip(known.model.names, known.reference, strict=True)) if known.reference is not None else {}
    reference = np.array([old.get(name, 0.0) for name in model.names])
    return staged(Problem(model, first.problem.signals, reference=reference), first.white, bank, like.motions, among, most, first.turning)


def with_noise_beneath(first: Stage, stage: Stage, bank: Bank) -> tuple[Stage, Stage]:
    """Both stages under the noise floor beneath the second one's model."""
    white = noise_floor(stage.problem, stage.motions, stage.search.candidates, bank, []).white
    again = [staged(s.problem, white, bank, s.motions, s.search.candidates, turning=s.turning) for s in (first, stage)]
    return again[0], again[1]
