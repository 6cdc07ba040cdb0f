"""The logs of the fit itself: with them, what the model never had is distinguished from what is new."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..problem.problem import Problem
from .frame import noise_of
from .stages.analysis import without_reversals
from .stages.evidence import FALSE_ALARM
from .stages.frame import raw_columns
from .stages.motions import Motions
from .stages.stage import Stage

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .stages.whitening import Whitener

Array = np.ndarray
#: Laws are never exact: the same effect may come out so differently from one motion to another.
_INEXACT = 0.2


class MonitoredFit:
    """The logs of the fit itself: whether they show an effect, too."""

    def __init__(self, estimate: Estimate, signals: Signals) -> None:
        own = without_reversals(signals.without_turning(estimate.sticking))
        self.problem = Problem(estimate.model, own, reference=estimate.all_values)
        self.raw, self.white = raw_columns(self.problem), noise_of(estimate, own)
        self.motions = Motions(self.problem)

    def shows(self, effect: Effect, stage: Stage) -> bool:
        """Whether an effect of the new logs is as large in the old ones, within the doubt of both and some inexactness."""
        from scipy.stats import chi2

        new, new_covariance = _free_fit(stage.frame.white, stage.problem, raw_columns(stage.problem), stage.motions.columns(effect))
        old, old_covariance = _free_fit(self.white, self.problem, self.raw, self.motions.columns(effect))
        doubt = new_covariance + old_covariance + _INEXACT**2 * (np.outer(new, new) + np.outer(old, old))
        difference = new - old
        apart = float(difference @ np.linalg.pinv(doubt, hermitian=True) @ difference)
        there = float(old @ np.linalg.pinv(old_covariance, hermitian=True) @ old)
        k = len(new)
        return there > float(chi2.isf(FALSE_ALARM, k)) and apart < float(chi2.isf(FALSE_ALARM, k))


def _free_fit(white: Whitener, problem: Problem, raw: Array, columns: Array) -> tuple[Array, Array]:
    """An effect's coefficients (k,) and covariance beside the freely refitted model."""
    n, k = raw.shape[1], columns.shape[2]
    valid = problem.signals.valid
    every = np.concatenate([raw, columns], axis=2)
    X = np.stack([white(np.where(valid[:, j, None], every[:, j], 0.0), j) for j in range(n)]).reshape(-1, every.shape[2])
    y = np.stack([white(np.where(valid[:, j], problem.signals.tau[:, j], 0.0), j) for j in range(n)]).reshape(-1)
    size = np.linalg.norm(X, axis=0)
    scale = np.where(size > 0, size, 1.0)
    inverse = np.linalg.pinv((X / scale).T @ (X / scale), rcond=1e-10, hermitian=True)
    values = inverse @ ((X / scale).T @ y) / scale
    return values[-k:], (inverse / scale[:, None] / scale)[-k:, -k:]
