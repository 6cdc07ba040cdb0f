"""Estimates of the declared model with findings, by the estimator that made the declared one."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import IdentError
from ..estimators import estimator_types, make_estimator
from ..problem.problem import Problem

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..estimators import Estimator
    from ..model import Model
    from ..signals.signals import Signals
    from .inference.decide import Decision

Array = np.ndarray


def plainly_named(declared: Model, effects: tuple[Effect, ...]) -> Model:
    """The declared model with effects whose labels are no longer than it takes to keep parameters apart."""
    model = declared
    for effect in effects:
        taken = set(model.names)
        plain = replace(effect, label="")
        free = not taken & {p.name for p in plain.parameters(declared.robot)}
        model = model + (plain if free else effect)
    return model


def fitted(model: Model, signals: Signals, estimator: Estimator, reference: Array | None, otherwise: Estimate) -> Estimate:
    """The estimate of a model on signals; where the estimator cannot have it, by weighted least squares."""
    problem = Problem(model, signals, reference=reference)
    try:
        found = estimator.solve(problem)
    except IdentError:
        found = make_estimator("wls").solve(problem)
        found = replace(
            found, warnings=(*found.warnings, f"refitted by weighted least squares: method {otherwise.method!r} cannot fit these effects.")
        )
    return replace(found, inputs=otherwise.inputs, signals_config=otherwise.signals_config)


def fitted_without(out: set[int], decision: Decision, declared: Estimate, estimator: Estimator, signals: Signals) -> Estimate:
    """The estimate of the model with all findings but those."""
    others = tuple(y.effect for k, y in enumerate(decision.named) if k not in out)
    if not others:
        return declared
    part = decision.fit.with_effects(others)
    return fitted(part.model, signals, estimator, part.values, declared)


def estimator_of(estimate: Estimate) -> Estimator:
    """The estimator that an estimate came from, with its usual settings; weighted least squares for one that is not known."""
    return make_estimator(estimate.method if estimate.method in estimator_types() else "wls")
