"""Monitoring: what has changed since a fit. The rule is the diagnosis' own, beside parameters that are known before with their doubt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.text import counted
from .._utils.threads import with_one_blas_thread
from ..diagnosis.inference.decide import Decision, decide
from ..diagnosis.thresholds import LEVEL, MOST, ROWS_EACH
from ..effects.places import on, place_of
from ..errors import ConfigurationError, DataError
from ..instruments.fit import Fit
from ..instruments.prepared import prepared
from ..problem.problem import error_on
from ..signals.reversing import without_reversals
from .before import Before
from .changes import changes_of, torque_of
from .left import left_of, louder, unknown
from .result import Monitoring
from .since import first_log

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray


@with_one_blas_thread
def monitor(
    estimate: Estimate,
    signals: Any,
    *,
    reference: Any | None = None,
    look: int = 1,
    progress: Callable[[float], None] | None = None,
) -> Monitoring:
    """Compare new logs with a saved fit, and say what has changed.

    Parameters
    ----------
    estimate : Estimate
        The fit.
    signals : Signals or logs
        The new logs, the oldest first; logs (also paths) are prepared as the fit's were (`Estimate.prepared`).
    reference : Signals or logs, optional
        The logs of the fit itself; with them an effect that the model never had is distinguished from a new one.
    look : int
        Number of this look at the robot, counted from the fit (1, 2, …): each has a smaller share of the false alarms, so that all looks
        together, however many, raise one with a probability of 1 % at most.
    progress : callable, optional
        Called with the share done.

    Returns
    -------
    Monitoring
        Parameters that changed, with significance, and what the model does not explain.

    Raises
    ------
    ConfigurationError
        Another robot, or a look below 1.
    DataError
        Too few rows.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> found = ident.monitor(estimate, test)
    >>> found.changes
    ()
    """
    signals = estimate.prepared(signals)
    reference = None if reference is None else estimate.prepared(reference)
    _check(estimate, signals, look)
    tell = progress or (lambda _: None)
    tell(0.0)
    blind = (estimate.fit_error.rows == 0) | ~signals.valid.any(axis=0)
    said: tuple[str, ...] = ()
    try:
        before = Before.of_estimate(estimate) if reference is None else Before.of_logs(estimate, reference, blind)
    except DataError as error:
        said = (
            f"the logs of the fit itself cannot be used, so that an effect may be new, or one that the model has always lacked: {error}",
        )
        reference, before = None, Before.of_estimate(estimate)
    tell(0.1)
    fit, _, speeds = prepared(before.model, signals, before.values, without=blind)
    tell(0.2)
    decision = _decided(before, fit, speeds, look, most=MOST if reference is None else 0)
    if reference is not None and decision.left:
        tell(0.4)
        # What the fit's own logs hold that its model never had is told first: else it passes for a change of what it bends.
        before = Before.of_diagnosis(estimate, reference, blind)
        tell(0.6)
        fit = Fit(fit.runs, before.model, (), before.values)
        decision = _decided(before, fit, speeds, look)
    tell(0.8)
    since = first_log(decision, signals.run_names)
    if since is not None and since > 0:
        # What came later is sought where it is.
        fit = Fit(fit.runs[since:], fit.declared, (), before.values)
        decision = _decided(before, fit, speeds, look)
    tell(0.9)
    found = _result(estimate, signals, before, decision, "" if since is None else signals.run_names[since])
    tell(1.0)
    return replace(found, warnings=(*found.warnings, *said))


def _check(estimate: Estimate, signals: Signals, look: int) -> None:
    if signals.robot.joint_names != estimate.model.robot.joint_names:
        raise ConfigurationError(
            f"the logs are of a robot with the joints {', '.join(signals.robot.joint_names)}; the fit has"
            f" {', '.join(estimate.model.robot.joint_names)}."
        )
    if look < 1:
        raise ConfigurationError(f"look is {look}; the first look at a robot since the fit is 1.")
    rows, parameters = int(signals.valid.sum()), estimate.model.base.count
    if rows < ROWS_EACH * parameters:
        raise DataError(
            f"only {counted(rows, 'usable row')} for {counted(parameters, 'parameter')}: too few to distinguish a change"
            f" from chance; give a longer log."
        )


def level_of(look: int) -> float:
    """Probability of a false alarm at one look of many: those of all looks add up to that of a single one (Σ 1/k² = π²/6)."""
    return float(LEVEL * 6.0 / (np.pi * look) ** 2)


def _decided(before: Before, free: Fit, speeds: Array, look: int, most: int = MOST) -> Decision:
    """What the model lacks or has otherwise on the new logs."""
    fit = Fit(free.runs, before.model, (), before.values, before.known(free))
    return decide(fit, speeds, level=level_of(look), most=most)


def _result(estimate: Estimate, signals: Signals, before: Before, decision: Decision, since: str) -> Monitoring:
    left = left_of(decision, before.left, signals)
    changes = changes_of(estimate, before, decision, since, beside=bool(left))
    residual = estimate.residual(signals)
    corrected = residual - torque_of(estimate, signals, changes)
    by_joint = {x.joint: x for x in left}
    names = estimate.model.robot.joint_names
    if before.noise is None:
        away = np.where(without_reversals(signals).valid, corrected, np.nan)
        loud = louder(names, estimate.fit_error.rms, error_on(signals, away, raw=False).rms, by_joint)
    else:
        loud = louder(names, before.noise, decision.fit.noise(decision.frame), by_joint)
    unexplained = (*unknown(estimate, signals), *left, *loud)
    if loud and not left:
        changes = changes_of(estimate, before, decision, since, beside=True)
    verdict = "unchanged" if not changes else "ambiguous" if any(c.ambiguous for c in changes) else "changed"
    return Monitoring(
        "unexplained" if unexplained else verdict,
        changes,
        unexplained,
        estimate,
        signals,
        error_on(signals, residual, raw=False),
        error_on(signals, corrected, raw=False),
        residual,
        corrected,
        tuple(f"{e.name}{on(place_of(e))}" for e in before.beside),
        signals.report.warnings,
    )
