"""Diagnosis: what the declared model lacks, where, how large and how surely; and the model that has it."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.json import result
from .._utils.threads import with_one_blas_thread
from ..drawing.document import Figure, Section, Text
from ..drawing.shown import Shown
from ..errors import ConfigurationError
from ..evaluation.comparison import Comparison, compare
from ..evaluation.doubts import doubts
from ..instruments.prepared import Instrument
from ..statistics.torque_error import number
from .advice import advice_for
from .analysed import analysed
from .confidence import confidence
from .described import LeftoverDescription, told
from .detectability import undetectable
from .held_out import presence, undetermined
from .judged import against_held_out, beside_held_out, judged
from .pictures import diagnosis_figure, diagnosis_frame, findings_section
from .refits import estimator_of, fitted, fitted_without, plainly_named
from .result import Finding, Hidden, Undetermined, Unexplained
from .text import diagnosis_text
from .uncertainty import found_parameters
from .verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

    from ..effects.described import Described
    from ..estimate.estimate import Estimate
    from ..estimators import Estimator
    from ..model import Model
    from ..robots.robot import Robot
    from ..signals.signals import Signals
    from .inference.decide import Decision

Array = np.ndarray
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Diagnosis(Shown):
    """The answer to what a declared model lacks.

    `before`: the declared model's estimate; `after`: the same with the findings; `signals`: what was fitted and decided on; `held`: data
    that no choice has seen, on which errors before and after are reported. `decision`: what was scored and decided; `instrument`: what
    it rests on; `hidden`: what this motion could not have shown; `undetermined`: joints of which data held out say nothing, because the
    data fitted do not determine the torque of the motion there; `description`: smooth functions of what a leftover follows, where the
    verdict is unexplained and it follows anything.

    See `ident.diagnose`.

    Examples
    --------
    >>> import ident
    >>> ident.Diagnosis.__name__
    'Diagnosis'
    """

    verdict: Verdict
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    before: Estimate
    after: Estimate
    signals: Signals
    held: Signals | None
    decision: Decision = field(repr=False)
    instrument: Instrument = field(repr=False)
    hidden: tuple[Hidden, ...] = field(default=(), repr=False)
    undetermined: tuple[Undetermined, ...] = ()
    warnings: tuple[str, ...] = ()
    description: LeftoverDescription | None = None

    @property
    def model(self) -> Model:
        """The declared model with the findings."""
        return self.after.model

    @property
    def trail(self) -> tuple[str, ...]:
        """What was scored and accepted, step by step."""
        return self.decision.trail

    def refit(self) -> Estimate:
        """The estimate of the model with the findings."""
        return self.after

    @cached_property
    def comparison(self) -> Comparison:
        """Before and after on the data held out (on the fitted ones if nothing was)."""
        return compare(self.before, self.after, self.signals if self.held is None else self.held)

    @cached_property
    def every_row(self) -> tuple[float, float]:
        """Relative torque error over all joints, before and after, on rows near reversals as well, which the comparison may leave out."""
        data = self.signals if self.held is None else self.held
        before, after = (replace(e, reversals_left_out=()).torque_error(data).relative_all for e in (self.before, self.after))
        return before, after

    @property
    def noise_floor(self) -> Array:
        """Standard deviation (n,) of what the model with the findings leaves on the data fitted."""
        return np.sqrt(np.maximum(np.asarray(self.after.noise.variance), 0.0))

    def to_dict(self) -> dict[str, Any]:
        """The `ident.diagnosis/1` result (docs/formats.md), with the comparison and the warnings beside it."""
        sides = self.comparison.to_dict()
        fitted = self.comparison if self.held is None else compare(self.before, self.after, self.signals)
        sides["before"]["fit"], sides["after"]["fit"] = fitted.error_before.to_dict(), fitted.error_after.to_dict()
        if self.held is None:
            nothing = {"rms": None, "relative": None, "relative_all": None}
            sides["before"]["heldout"] = sides["after"]["heldout"] = nothing
        for side, error in zip(("before", "after"), self.every_row, strict=True):
            sides[side]["relative_every_row"] = number(error)
        body = {
            "verdict": self.verdict.value,
            "findings": [f.to_dict() for f in self.findings],
            "unexplained": [u.to_dict() for u in self.unexplained],
            "instruments": self.instrument.to_dict(),
            "described": None if self.description is None else self.description.to_dict(),
            "hidden": [h.to_dict() for h in self.hidden],
            "undetermined": [u.to_dict() for u in self.undetermined],
            "before": sides["before"],
            "after": sides["after"],
            "noise_floor": [number(x) for x in self.noise_floor],
            "heldout_gain": sides["gain"] if self.held is not None else None,
            "heldout_gain_std": sides["gain_std"] if self.held is not None else None,
            "shifts": sides["shifts"],
            "joints": list(self.before.model.robot.joint_names),
            "signals": self.signals.report.to_dict(),
        }
        return result("ident.diagnosis/1", body, inputs=self.before.inputs, warnings=self.warnings)

    def figure(self) -> Figure:
        """Residual before and after against the quantity that reveals each finding; see `plot`."""
        return diagnosis_figure(self)

    def to_frame(self) -> pd.DataFrame:
        """One row for each parameter of each finding; none where nothing was found."""
        return diagnosis_frame(self)

    def sections(self) -> tuple[Section, ...]:
        """Verdict, findings, and what stays unexplained."""
        left = [Text("What stays unexplained", tuple(u.evidence for u in self.unexplained))] if self.unexplained else []
        return (Text(f"Diagnosis: {self.verdict}", ()), *findings_section(self), *left, *self.comparison.sections())

    def __str__(self) -> str:
        return diagnosis_text(self)


@with_one_blas_thread
def diagnose(
    before: Estimate,
    held: Any | None = None,
    *,
    fit: Any | None = None,
    estimator: Estimator | None = None,
    progress: Callable[[float], None] | None = None,
    note: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find what a declared model lacks, by instruments that feedback cannot fool.

    Parameters
    ----------
    before : Estimate
        The declared model's fit.
    held : Signals or logs, optional
        Data that the fit did not see; logs (also a path) are prepared as the fit's were.
        Nothing is decided on them, and the errors before and after are reported on them.
    fit : Signals or logs, optional
        What the model was fitted to; taken from the estimate within a session.
    estimator : Estimator, optional
        For the refit; by default the one that made the estimate, with its usual settings.
    progress, note : callable, optional
        Called with the share done, and with lines of text.

    Returns
    -------
    Diagnosis
        Verdict, findings with competing models, and the model with the findings.

    Raises
    ------
    ConfigurationError
        A saved estimate without signals.
    DataError
        Too few data.

    References
    ----------
    P. Hansen, A. Lunde and J. Nason, "The model confidence set", Econometrica 79(2), 2011. V. Chernozhukov, D. Chetverikov and K. Kato,
    "Gaussian approximations and multiplier bootstrap for maxima of sums of high-dimensional random vectors", Annals of Statistics, 2013.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> diagnosis = ident.diagnose(estimate, test)
    >>> print(diagnosis.verdict)
    clean
    """
    held = None if held is None else before.prepared(held)
    signals = _fitted_signals(before, fit)
    estimator = estimator or estimator_of(before)
    tell = progress or (lambda _: None)
    tell(0.0)
    decision, instrument = analysed(before.model, signals, note, lambda share: tell(0.9 * share), values=before.all_values)
    found = _reported(before, decision, instrument, signals, held, estimator)
    tell(1.0)
    return found


def _fitted_signals(before: Estimate, fit: Any | None) -> Signals:
    """What the declared model was fitted to, as given or within the session. Raises ConfigurationError where neither is."""
    signals = before.prepared(fit) if fit is not None else before.problem.signals if before.problem is not None else None
    if signals is None:
        raise ConfigurationError(
            "a saved estimate does not contain the signals it was fitted to; give them: diagnose(estimate, held, fit=signals)."
        )
    return signals


def _reported(
    before: Estimate, decision: Decision, instrument: Instrument, signals: Signals, held: Signals | None, estimator: Estimator
) -> Diagnosis:
    """What was decided, refitted and judged on the report's data."""
    declared = fitted(before.model, signals, estimator, None, before)
    effects = tuple(x.effect for x in decision.named)
    after = declared if not effects else fitted(plainly_named(before.model, effects), signals, estimator, decision.fit.values, declared)
    if held is not None:
        declared, after = (e.with_heldout(e.torque_error(held)) for e in (declared, after))
    report = signals if held is None else held

    def fewer(which: set[int]) -> Estimate:
        return fitted_without(which, decision, declared, estimator, signals)

    without = tuple(compare(fewer({i}), after, report) for i in range(len(decision.named)))
    shares = [presence(c.before, after, held) if held is not None else (np.nan, np.nan) for c in without]
    verdict, unexplained = judged(decision, signals)
    if held is not None:
        worse = against_held_out(decision.named, shares, fewer, after, signals, held)
        verdict, unexplained = beside_held_out(verdict, shares, worse), (*unexplained, *worse)
    _LOG.info("verdict %s; %s", verdict.value, "; ".join(decision.trail[-3:]))
    findings = _findings(decision, declared.model.robot, without, shares, verdict)
    description = _described(decision.laws, after, report, estimator, signals)
    said = [] if held is not None else ["no data were held out: errors before and after are of the data fitted."]
    warnings = tuple(dict.fromkeys((*_of_the_declared(before, after, findings, verdict), *signals.report.warnings, *said)))
    return Diagnosis(
        verdict, findings, unexplained, declared, after, signals, held, decision, instrument, undetectable(decision),
        () if held is None else undetermined(after, signals, held), warnings, description,
    )  # fmt: skip


def _findings(
    decision: Decision, robot: Robot, without: tuple[Comparison, ...], shares: list[tuple[float, float]], verdict: Verdict
) -> tuple[Finding, ...]:
    """The accepted effects with values, gain on report data (`without`: the model without each against the whole), and confidence
    against competing models."""
    values = found_parameters(decision.fit, decision.frame)
    found = []
    for x, c, share in zip(decision.named, without, shares, strict=True):
        error, final = c.error_before.relative_all, c.error_after.relative_all
        gain = 1.0 - (final / error) ** 2 if error > 0 else 0.0
        own, others = confidence(x, beside=verdict == Verdict.UNEXPLAINED, share=share)
        finding = Finding(x.effect, x.joints, values[x.effect], float(gain), float(x.z**2), own, others, presence=share)
        found.append(replace(finding, advice=advice_for(finding, robot, verdict)))
    return tuple(found)


def _described(
    laws: tuple[Described, ...], after: Estimate, report: Signals, estimator: Estimator, signals: Signals
) -> LeftoverDescription | None:
    """The laws that describe what is left, judged on report data; None where there are none."""
    if not laws:
        return None
    model = after.model
    for law in laws:
        model = model + law
    estimate = fitted(model, signals, estimator, None, after)
    values = dict(zip(model.names, estimate.all_values, strict=True))
    own = [values[p.name] for law in laws for p in law.parameters(model.robot)]
    return LeftoverDescription(told(model.robot, laws, np.array(own)), estimate, compare(after, estimate, report))


def _of_the_declared(before: Estimate, after: Estimate, findings: tuple[Finding, ...], verdict: Verdict) -> list[str]:
    """Warnings of the declared model's fit; beside findings it is said that they are of the fit without them, but for those of the data.

    Where nothing is left beside the findings, doubts about the fit without them are no more: those about the fit with them stand in their
    place."""
    of_data = before.problem.signals.report.warnings if before.problem is not None else before.warnings
    settled = bool(findings) and verdict != Verdict.UNEXPLAINED and before.problem is not None
    gone = doubts(before) if settled else ()
    kept = [f"of the fit of the declared model: {w}" if findings and w not in of_data else w for w in before.warnings if w not in gone]
    return [*kept, *(doubts(after) if gone else ())]
