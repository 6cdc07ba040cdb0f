"""The null: what a candidate seems to gain on logs that hold nothing but the model, its noise, and what preparing them does.

Noise of the positions makes the regressor's accelerations noisy, filters attenuate, quick reversals smear: all of that leaves
residuals that follow the motion, and some candidate will fit them: its own columns hold the same noise. So the model's
prediction along the measured motion is taken for the truth, noise like that of the log is put on positions and torque, and the
log so made is prepared and scored like the real one. What a candidate gains there, it gains for nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...errors import IdentError
from ...logs.log import Log, LogSet
from ...problem.problem import Problem
from ...signals.preparation import make_preparation
from .analysis import thinned, without_reversals
from .bank import Bank
from .frame import Frame, raw_columns
from .motion_noise import less_noise
from .motion_spectrum import position_noise
from .motions import Motions
from .search import Search
from .whitening import unwhitened_rows

if TYPE_CHECKING:
    from ...signals.signals import Signals
    from .candidates import Candidate
    from .whitening import Whitener

Array = np.ndarray
#: Logs that are made, and how far above the most that a candidate gained there its evidence must lie.
_DRAWS = 3
_CLEAR = 2.0


@dataclass(frozen=True, eq=False)
class Null:
    """Logs made from `problem`'s model at its reference values, with the noise that `white` tells of. `turning`: joints whose rows near
    reversals are looked at."""

    problem: Problem
    white: Whitener
    turning: tuple[str, ...] = ()

    def exceeded(self, candidate: Candidate, evidence: float) -> bool:
        """Whether a candidate's evidence is clearly more than it gains where there is nothing to gain."""
        return evidence > _CLEAR * max((self._gain(search, candidate) for search in self.searches), default=0.0)

    @cached_property
    def searches(self) -> tuple[Search, ...]:
        """One for each log that is made; none where the signals cannot be prepared anew."""
        found = (self._search(seed) for seed in range(_DRAWS))
        return tuple(search for search in found if search is not None)

    def _gain(self, search: Search, candidate: Candidate) -> float:
        hit = search.first(candidate)
        return 0.0 if hit is None else search.judge(search.refined(hit)).evidence

    def _search(self, seed: int) -> Search | None:
        signals = self.problem.signals
        cutoffs = {"cutoff_hz": signals.report.cutoff_hz, "row_cutoff_hz": signals.report.row_cutoff_hz}
        config = {**signals.report.config, **{key: value for key, value in cutoffs.items() if value is not None}}
        try:
            again = make_preparation(**config)(self._logs(np.random.default_rng([seed, 17])), signals.robot)
            # What happens at a time happens at that time of the real log, of which the made one lacks the beginning.
            again = replace(again, origins=tuple(signals.origins[int(name)] for name in again.run_names))
            made = thinned(without_reversals(less_noise(again), self.turning))
            white = self.white.on(made.valid, made.row_runs)
            problem = Problem(self.problem.model, _noisy(made, white, seed), reference=self.problem.reference)
            frame = Frame.build(problem, white, raw_columns(problem))
        except IdentError:
            return None
        return Search(frame, Motions(problem), (), Bank())

    def _logs(self, rng: np.random.Generator) -> LogSet:
        problem, signals = self.problem, self.problem.signals
        side = signals.robot.transmission.measured.value
        logs = []
        for i, block in enumerate(signals.blocks(None)):
            motion, part = problem.motion(block.samples), block.samples
            tau = np.where(np.isfinite(signals.torque[part]), problem.model.torque(motion, _values(problem)), np.nan)
            q = signals.q[part] + position_noise(signals) * rng.normal(size=tau.shape)
            logs.append(Log(f"{i}", signals.t[part], q=q, dq=signals.dq[part], ddq=signals.ddq[part], tau={side: tau}))
        return LogSet(tuple(logs), robot=signals.robot)


def _noisy(signals: Signals, white: Whitener, seed: int) -> Signals:
    """Rows with noise of the level and the colour that a whitener tells of."""
    rng = np.random.default_rng([seed, 18])
    M, n = signals.tau.shape
    noise = [unwhitened_rows(white, np.where(signals.valid[:, j], rng.normal(size=M), 0.0), j, signals.valid[:, j]) for j in range(n)]
    return replace(signals, tau=signals.tau + np.stack(noise, axis=1))


def _values(problem: Problem) -> Array:
    """The values (k,) that the prediction is made of."""
    return np.zeros(len(problem.model.names)) if problem.reference is None else problem.reference
