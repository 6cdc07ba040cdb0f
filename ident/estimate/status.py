"""What became of an estimation: a code for programs and a text that says what happened and what to do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class StatusCode(StrEnum):
    """Outcome of an estimation, from good to bad.

    Examples
    --------
    >>> import ident
    >>> ident.StatusCode("ok") is ident.StatusCode.OK
    True
    """

    OK = "ok"
    POOR_FIT = "poor_fit"
    POORLY_EXCITED = "poorly_excited"
    RANK_DEFICIENT = "rank_deficient"
    AT_BOUND = "at_bound"
    NOT_CONVERGED = "not_converged"
    FEW_SAMPLES = "few_samples"
    INVALID_INSTRUMENTS = "invalid_instruments"


_ADVICE = {
    StatusCode.OK: ("the data determine every parameter (full rank); the standard deviations say how well."),
    StatusCode.POOR_FIT: (
        "the model does not explain the torque of some joints that move; do not rely on their parameters. Check the audit"
        " (units, signs, missing or saturated torque, noisy positions), then for a missing effect (`ident diagnose`)."
    ),
    StatusCode.POORLY_EXCITED: (
        "some parameters are known to no better than their own size; the torque they cause in this log is lost in the "
        "noise. Use them for prediction of similar motion only; excite the joints named below more."
    ),
    StatusCode.RANK_DEFICIENT: (
        "this log cannot separate some parameters; they were grouped further, or left out, as listed. Record motion "
        "that moves the joints named below."
    ),
    StatusCode.AT_BOUND: (
        "some parameters ended at their physical bound: the data favour an impossible value. Look for a missing effect"
        " or a wrong sign or unit."
    ),
    StatusCode.NOT_CONVERGED: (
        "the iteration stopped before it converged. Start closer (a better first fit), allow more iterations, or use more data."
    ),
    StatusCode.FEW_SAMPLES: ("there are hardly more independent samples than parameters; do not trust the intervals. Record a longer log."),
    StatusCode.INVALID_INSTRUMENTS: (
        "the instruments correlate with the noise. Use instruments simulated from the reference, not from measured "
        "torque inside a feedback loop."
    ),
}


@dataclass(frozen=True)
class Status:
    """A code and its text. `details` are sentences that name what it is about.

    Examples
    --------
    >>> import ident
    >>> ident.Status(ident.StatusCode.OK).code.value
    'ok'
    """

    code: StatusCode
    details: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        return " ".join((f"{self.code.value}: {_ADVICE[self.code]}", *self.details))

    def to_dict(self) -> dict[str, str]:
        return {"code": self.code.value, "text": self.text}
