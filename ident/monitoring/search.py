"""How changes are scored: the model's own effects keep their shapes, bounds hold for totals, and chance is known no better than the
rows tell."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from .candidates import Place
from .frame import KnownFrame
from .stages.candidates import Candidate
from .stages.evidence import acts_on, threshold
from .stages.search import Hit, Judged, Search, fit_gain
from .stages.stage import Stage

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray
#: A total may lie beyond its bound by this many standard deviations.
_BEYOND = 3.0


class ChangeSearch(Search):
    """A search in which the model's own effects keep their shapes, and bounds hold for totals."""

    frame: KnownFrame

    def __init__(self, stage: Stage, own: dict[Candidate, Place], estimate: Estimate) -> None:
        super().__init__(stage.frame, stage.motions, stage.search.candidates, stage.search.bank)
        self.own, self.estimate = own, estimate

    def refined(self, hit: Hit, worth: Callable[[Hit], float] = fit_gain) -> Hit:
        return hit if hit.candidate in self.own else super().refined(hit, worth)

    def judge(self, hit: Hit) -> Judged:
        if hit.candidate in self.own:
            score = self.frame.score(hit.columns)
            return Judged(hit, score, self._beyond(hit, score.values))
        if absorbed(self.frame, hit.columns):
            # Part of what the model holds anyway: more or less of it are both possible.
            return Judged(hit, self.frame.score(hit.columns), "")
        return super().judge(hit)

    def _beyond(self, hit: Hit, change: Array) -> str:
        for p, by in zip(self.own[hit.candidate].parameters, change, strict=True):
            if p.name in self.estimate.names:
                at = self.estimate.index(p.name)
                total = float(self.estimate.values[at] + by)
                if not p.lower - _BEYOND * self.estimate.std[at] <= total <= p.upper + _BEYOND * self.estimate.std[at]:
                    return f"{p.name} would be {total:.4g} {p.unit}, beyond its bound"
        return ""


def surplus(judged: Judged, stage: Stage) -> float:
    """Evidence above what chance reaches over all that is tried.

    An F test: the noise is as large as what is left beside the change, known no better than the rows tell."""
    from scipy.stats import chi2, f

    frame, rows = stage.frame, acts_on(judged)
    assert isinstance(frame, KnownFrame)
    shapes, k = 2.0 * len(judged.hit.effect.shape()), judged.hit.columns.shape[2]
    tail = float(chi2.sf(threshold(judged.hit, stage.number) - shapes, k))
    left = float(np.sum(frame.residual[rows] ** 2)) - judged.score.fit_gain
    level = max(1.0, left / max(1, int(stage.problem.signals.valid[:, rows].sum())))
    return judged.evidence / level - k * float(f.isf(tail, k, frame.freedom(rows))) - shapes


def absorbed(frame: KnownFrame, Z: Array) -> bool:
    """Whether whitened columns lie in the span of the model's own, if these were free."""
    p = frame.products(Z)
    b = frame.own
    G, C, D = frame.gram[:-1, :b, :b].sum(axis=0), p.cross[:, :, :b].sum(axis=0), p.own.sum(axis=0)
    left = D - C @ np.linalg.pinv(G, rcond=1e-12, hermitian=True) @ C.T
    return bool(np.trace(left) < 1e-6 * np.trace(D))


def determined(frame: KnownFrame) -> Array:
    """Which of the accepted changes' coefficients the rows tell, (k,) bool."""
    G = frame.gram.sum(axis=0)[:-1, :-1]
    scale = np.sqrt(np.maximum(np.diag(G), 1e-300))
    values, vectors = np.linalg.eigh(G / scale[:, None] / scale)
    lost = vectors[:, values < 1e-10 * values[-1]]
    return np.asarray(np.sum(lost**2, axis=1) < 1e-6)[frame.own :]
