"""Estimates of the models that a diagnosis compares, all on the same rows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..problem.problem import Problem
from .analysis import without_turning
from .turning import agreeing, left_out, left_out_with_findings, sticking

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..estimators import Estimator
    from ..model import Model
    from ..signals.signals import Signals
    from .stage import Stage

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Estimates:
    """Fits of the declared model of `before`, and of others that hold it, to `signals` by an `estimator`. `stuck`: joints whose rows near
    reversals no fit has: two estimates of different rows differ by more than their models."""

    before: Estimate
    signals: Signals = field(repr=False)
    estimator: Estimator
    stuck: tuple[str, ...] = ()

    def without_stuck(self, final: Stage) -> Estimates:
        """The same without rows near reversals that hold much more than noise beside the model of a selection's `final` stage."""
        stuck = sticking(final, self.signals, self._of(final))
        return replace(self, stuck=stuck) if stuck else self

    @cached_property
    def declared(self) -> Estimate:
        """That of the declared model."""
        return self._fitted(self.before.model, None, self.stuck)

    def of(self, stage: Stage, turning: tuple[str, ...]) -> Estimate:
        """That of a stage's model; `turning`: joints whose rows near reversals are left out as well."""
        effects = stage.problem.model.effects[len(self.before.model.effects) :]
        return agreeing(stage, effects, self.signals, tuple(dict.fromkeys((*turning, *self.stuck))), self._of(stage))

    def said(self, after: Estimate) -> tuple[str, ...]:
        """What is to be said of rows that no fit has, or only the fit with the findings has not (`after`)."""
        of_all = tuple(dict.fromkeys((*self.stuck, *self.declared.sticking)))
        more = tuple(name for name in after.sticking if name not in of_all)
        return (*([left_out(of_all, self.signals)] if of_all else []), *([left_out_with_findings(more, self.signals)] if more else []))

    def _of(self, stage: Stage) -> Callable[[tuple[str, ...]], Estimate]:
        return lambda joints: self._fitted(stage.problem.model, stage.problem.reference, joints)

    def _fitted(self, model: Model, reference: Array | None, joints: tuple[str, ...]) -> Estimate:
        """The estimate of a model without the rows near reversals of some joints."""
        rows = without_turning(self.signals, joints) if joints else self.signals
        estimate = self.estimator.solve(Problem(model, rows, reference=reference))
        left = tuple(dict.fromkeys((*estimate.sticking, *joints)))
        return replace(estimate, sticking=left, inputs=self.before.inputs, signals_config=rows.report.to_dict())
