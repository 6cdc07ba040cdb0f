"""Diagnosis: what the declared model lacks, where, how large and how surely; and the model that has it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.json import result
from ..effects.places import on
from ..errors import ConfigurationError
from ..statistics.torque_error import number
from .advice import advice_for, advice_to_confirm, advice_unconfirmed, advice_without_period
from .analysis import analysis_signals, stretches, thinned, without_reversals
from .bank import Bank
from .both_parts import SAID, confirmed_by_half, halved, together, unconfirmed
from .carried import without_carried
from .change import SURELY
from .confirmed import LastWord, last_word, undecided
from .denied import denied
from .estimates import Estimates
from .findings import Finding, Unexplained, assess
from .hidden import Hidden, hidden
from .in_plain_sight import ELSEWHERE, above_floor, apart, hinted, jumps, lost
from .leftover import leftovers
from .low_speed import away_from_reversals, with_low_speed
from .selection import Selection, select
from .simpler import simplified
from .spectral import period_unseen
from .stage import start
from .withdrawn import withdrawal, withdrawn, without_guesses

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..estimate.estimate import Estimate
    from ..estimators import Estimator
    from ..evaluation.comparison import Comparison
    from ..model import Model
    from ..robots.robot import Robot
    from ..signals.signals import Signals

Array = np.ndarray
#: Share of their confidence that findings keep which sit where the model does not hold, or that held-out data do not show; and of those
#: that held-out data show, or the fitted ones by themselves, no more clearly than chance might; and of periodic ones without a period.
_UNHELPFUL = 0.3
_FAINTLY = 0.6
_PERIODLESS = 0.5


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The answer. `verdict`: "clean", "explained", "ambiguous" or "unexplained".

    `before`: the declared model fitted to the analysis signals; `after`: the same with the findings; `signals`, `held`: those
    signals. `trail`: the steps of the selection; `selection`: everything that was looked at.
    `held` is None too where both parts were searched together; `beyond`: joints on which the error on data held out is larger than on
    those fitted.

    See `ident.diagnose`.

    Examples
    --------
    >>> import ident
    >>> ident.Diagnosis.__name__
    'Diagnosis'
    """

    verdict: str
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    before: Estimate
    after: Estimate
    signals: Signals
    held: Signals | None
    selection: Selection = field(repr=False)
    warnings: tuple[str, ...] = ()
    beyond: tuple[Unexplained, ...] = ()

    @property
    def model(self) -> Model:
        """The declared model with the findings."""
        return self.after.model

    @property
    def trail(self) -> tuple[str, ...]:
        """What was tried and accepted, step by step."""
        return self.selection.trail

    def refit(self) -> Estimate:
        """The estimate of the model with the findings."""
        return self.after

    @cached_property
    def comparison(self) -> Comparison:
        """Before and after on the data held out (on the fitted ones if nothing was)."""
        from ..evaluation.comparison import compare

        return compare(self.before, self.after, self.signals if self.held is None else self.held)

    @cached_property
    def every_row(self) -> tuple[float, float]:
        """Relative torque error over all joints, before and after, on rows near reversals as well, which the comparison may leave out."""
        data = self.signals if self.held is None else self.held
        before, after = (replace(e, sticking=()).torque_error(data).relative_all for e in (self.before, self.after))
        return before, after

    @cached_property
    def hidden(self) -> tuple[Hidden, ...]:
        """What could be there beside the findings without being seen, because this motion does not tell it from what the model has."""
        return hidden(self.selection.final)

    def to_dict(self) -> dict[str, Any]:
        """The `ident.diagnosis/1` result, with the comparison and the warnings beside it."""
        from ..evaluation.comparison import compare

        sides = self.comparison.to_dict()
        fitted = self.comparison if self.held is None else compare(self.before, self.after, self.signals)
        sides["before"]["fit"], sides["after"]["fit"] = fitted.error_before.to_dict(), fitted.error_after.to_dict()
        if self.held is None:
            nothing = {"rms": None, "relative": None, "relative_all": None}
            sides["before"]["heldout"] = sides["after"]["heldout"] = nothing
        for side, error in zip(("before", "after"), self.every_row, strict=True):
            sides[side]["relative_every_row"] = number(error)
        body = {
            "verdict": self.verdict,
            "findings": [f.to_dict() for f in self.findings],
            "unexplained": [u.to_dict() for u in self.unexplained],
            "hidden": [h.to_dict() for h in self.hidden],
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

    @property
    def noise_floor(self) -> Array:
        """Standard deviation (n,) of the noise of the rows, when all that any candidate can take up is taken up."""
        return self.selection.declared.white.std

    def __str__(self) -> str:
        from .text import diagnosis_text

        return diagnosis_text(self)


def diagnose(
    before: Estimate,
    held: Signals | None = None,
    *,
    fit: Signals | None = None,
    estimator: Estimator | None = None,
    progress: Callable[[float], None] | None = None,
    note: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Find what a declared model lacks.

    `before`: its estimate; `fit`: the signals it was fitted to (taken from the estimate within a session); `held`: signals that
    no fit saw, looked at once, at the end. `estimator`: for the refits (the one that made the estimate, with its
    usual settings). Where the logs are at hand and the cut-off was chosen from the data, both are prepared anew with the band
    that a diagnosis needs. `progress`: called with the share done; `note`: with lines of text.
    Raises ConfigurationError without signals, DataError where they are too few.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> diagnosis = ident.diagnose(estimate, ident.ZeroPhase()(test, ident.load_robot("puma560")))  # doctest: +SKIP
    >>> print(diagnosis.verdict)  # doctest: +SKIP
    clean
    """
    signals = fit if fit is not None else before.problem.signals if before.problem is not None else None
    if signals is None:
        raise ConfigurationError(
            "a saved estimate does not hold the signals it was fitted to; give them: diagnose(estimate, held, fit=signals)."
        )
    estimator = estimator or estimator_of(before)
    tell = progress or (lambda _: None)
    tell(0.0)
    wide, held = analysis_signals(signals, held)

    def diagnosed(fitted: Signals, kept: Signals | None) -> Diagnosis:
        return _diagnosed(before, fitted, kept, estimator, tell, note)

    found = diagnosed(wide, held)
    if held is None or not found.beyond or jumps(held) or _open_in_the_data_fitted(found):
        return found
    return _of_both_parts(found, wide, held, diagnosed, note)


def _open_in_the_data_fitted(found: Diagnosis) -> bool:
    """Whether what stays unexplained is no matter of the part held out."""
    elsewhere = [u.signature == ELSEWHERE for u in found.unexplained]
    return not all(elsewhere) and (bool(found.findings) or not any(elsewhere))


def _of_both_parts(
    found: Diagnosis,
    wide: Signals,
    held: Signals,
    diagnosed: Callable[[Signals, Signals | None], Diagnosis],
    note: Callable[[str], None] | None,
) -> Diagnosis:
    """A diagnosis of fitted and held-out signals as one, where they tell what sits in the latter alone, or mostly; else the one `found`.
    What was found in the fitted part alone gives way to nothing that no data are left to confirm."""
    if (both := together(wide, held)) is None:
        return found
    if note is not None:
        note("the error on the data held out is larger: both parts are searched together")
    again = diagnosed(both, None)
    if not again.findings or again.verdict == "unexplained" or apart(again.after, wide, held) or _names(again) == _names(found):
        return found
    if again.verdict == "explained" and (parts := halved(wide, held)) is not None:
        if note is not None:
            note("every other block of the data held out is searched with those fitted, and the blocks between are asked")
        half = diagnosed(*parts)
        if _names(half) == _names(again) and half.comparison.gain > SURELY * half.comparison.gain_std:
            return replace(again, warnings=(*again.warnings, confirmed_by_half(half.comparison)))
    if found.findings:
        return replace(found, warnings=(*found.warnings, unconfirmed(found.beyond, [f"{f.name}{on(f.place)}" for f in again.findings])))
    findings = tuple(f if f.ambiguous else replace(f, advice=advice_unconfirmed(f)) for f in again.findings)
    return replace(again, verdict="ambiguous", findings=findings, warnings=(*again.warnings, SAID))


def _names(found: Diagnosis) -> set[tuple[str, str]]:
    """Effect and place of each finding."""
    return {(f.name, f.place) for f in found.findings}


def _diagnosed(
    before: Estimate,
    wide: Signals,
    held: Signals | None,
    estimator: Estimator,
    tell: Callable[[float], None],
    note: Callable[[str], None] | None,
) -> Diagnosis:
    """`diagnose` on analysis signals."""
    estimates = Estimates(before, wide, estimator)
    declared = estimates.declared
    tell(0.05)
    bank = Bank()
    every = thinned(without_reversals(wide))
    seen = stretches(every)
    stage = start(before.model, seen, declared.all_values, bank, lambda share: tell(0.05 + 0.35 * share))
    looked = select(stage, bank, note, lambda share: tell(0.4 + 0.5 * share))
    tell(0.9)
    selection = simplified(without_carried(with_low_speed(looked, stretches(thinned(wide)), bank, note), bank, note), bank)

    estimates = estimates.without_stuck(selection.final)
    declared = estimates.declared
    last = last_word(selection, bank, declared, held, estimates.of)
    selection, after = last.selection, last.after
    left = leftovers(away_from_reversals(selection, looked, bank), selection.found)
    verdict, findings, unexplained = assess(selection, left)
    if last.unexplained:
        verdict = "ambiguous" if not findings and undecided(last.refused, left) else "unexplained"
        unexplained = (*unexplained, *last.unexplained)
    in_knocks = last.fell_beyond_chance and any(f.effect.abrupt for f in findings)
    if withdrawn(verdict, findings, last.shown or in_knocks):
        selection, after = without_guesses(selection, bank, declared, held, lambda final: estimates.of(final, ()))
        nothing = withdrawal(findings, selection)
        stage = away_from_reversals(selection, looked, bank) if selection.found else looked.declared
        _, findings, unexplained = assess(selection, leftovers(stage, selection.found))
        unexplained = (*unexplained, *last.unexplained, nothing)
    elif verdict == "unexplained" and findings and not last.fell_beyond_chance and not last.unexplained:
        verdict = "ambiguous"  # the data fitted have a name for what is there, those held out do not bear it out
    if held is not None:
        declared, after = (e.with_heldout(e.torque_error(held)) for e in (declared, after))
    elsewhere = apart(after, wide, held) if held is not None else ()
    if held is not None and not elsewhere and verdict in ("clean", "explained"):
        elsewhere = above_floor(after, wide, held, selection.declared.white.std)
    if plain := (*jumps(wide), *elsewhere, *denied(selection)):
        verdict, unexplained = "unexplained", (*unexplained, *plain)
    slow = tuple(f.effect for f in selection.found if period_unseen(f.effect, selection.final.frame, selection.final.motions))
    if verdict == "explained" and (last.unseen or last.faint or last.owed or slow):  # the name may be right; no other data say so
        verdict = "ambiguous"
    if (blind := lost(wide)) and verdict in ("clean", "explained"):  # anything of the catalogue may be on joints that cannot be looked at
        verdict = "ambiguous"
    unexplained = (*unexplained, *blind)
    bad = {u.joint for u in (*plain, *blind)}
    findings = tuple(replace(f, confidence=_share(f, last, bad, slow) * f.confidence) for f in findings)
    findings = tuple(replace(f, advice=_advice(f, last, before.model.robot, verdict, slow)) for f in findings)
    tell(1.0)
    said = list(last.said)
    if seen is not every:
        rows = f"{len(seen.tau)} of {len(every.tau)} rows, in {len(seen.runs)} stretches spread over the logs"
        said.append(f"the search for what the model lacks looked at {rows}; the errors and the refit are of all rows.")
    warnings = tuple(dict.fromkeys((*_of_the_declared(before, findings), *wide.report.warnings, *said, *estimates.said(after))))
    # What was found in the data fitted and taken back is no matter of those held out alone.
    beyond = hinted(after, wide, held) if held is not None and bool(looked.found) == bool(findings) else ()
    return Diagnosis(verdict, findings, unexplained, declared, after, wide, held, selection, warnings, beyond)


def _of_the_declared(before: Estimate, findings: Sequence[Finding]) -> list[str]:
    """Warnings of the declared model's fit; beside findings it is said that they are of the fit without them, but for those of the data."""
    of_data = before.problem.signals.report.warnings if before.problem is not None else before.warnings
    return [f"of the fit of the declared model: {w}" if findings and w not in of_data else w for w in before.warnings]


def _share(finding: Finding, last: LastWord, bad: set[str], slow: Sequence[Effect]) -> float:
    """Share of its confidence that a finding keeps. `bad`: joints on which the model does not hold whatever is found; `slow`: periodic
    effects of whose period next to nothing was seen."""
    if (bad and (not finding.joints or bad & set(finding.joints))) or finding.effect in last.unseen:
        return _UNHELPFUL
    return (_FAINTLY if finding.effect in (*last.faint, *last.owed) else 1.0) * (_PERIODLESS if finding.effect in slow else 1.0)


def _advice(finding: Finding, last: LastWord, robot: Robot, verdict: str, slow: Sequence[Effect]) -> str:
    if finding.effect in slow and not finding.ambiguous:
        return advice_without_period(finding)
    where = "held out" if finding.effect in (*last.unseen, *last.faint) else "fitted" if finding.effect in last.owed else ""
    return advice_to_confirm(finding, where) if where and not finding.ambiguous else advice_for(finding, robot, verdict)


def estimator_of(estimate: Estimate) -> Estimator:
    """The estimator that an estimate came from, with its usual settings; weighted least squares for one that is not known."""
    from ..estimators import estimator_types, make_estimator

    return make_estimator(estimate.method if estimate.method in estimator_types() else "wls")
