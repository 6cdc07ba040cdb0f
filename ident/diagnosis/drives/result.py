"""What a diagnosis of logs without torque finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..._utils.json import jsonable, result
from ..._utils.text import wrapped
from ...drives.combinations import SHARE
from ...drives.residual import FORETOLD
from ...drives.result import DriveFit
from ..verdict import Verdict

Array = np.ndarray
#: Findings of what is declared without a number.
LINKS, VELOCITY_COMMAND, RAMP, STAIRCASE = "links", "velocity_command", "command_ramp", "command_staircase"
#: What is said of them beside their numbers.
_SAID = {
    LINKS: " are not the URDF's, as under a load, with another tool, or on a base that leans",
    VELOCITY_COMMAND: 'the derivative of the position command is sent beside it, and not logged: set velocity_command = "derivative"',
    RAMP: 'commands go straight from one row to the next: set command = "ramp"',
    STAIRCASE: 'commands are held from one row to the next: set command = "staircase"',
}


@dataclass(frozen=True)
class DriveRival:
    """Something else that explains as much as a finding, with its probability."""

    effect: str
    joints: tuple[str, ...]
    confidence: float


@dataclass(frozen=True)
class DriveFinding:
    """One thing that is missing, or not as declared.

    `values`: (name, value, standard deviation, unit), of which an infinite one says that there is no size to tell, and `no_size` why;
    `declared`: the numbers that the law gave on these joints, None for what it did not have; `gain`: share of the squared error that it
    takes off readings for which it was not adjusted; `least`: the smallest possible number of each value."""

    effect: str
    joints: tuple[str, ...]
    values: tuple[tuple[str, float, float, str], ...]
    declared: tuple[float, ...] | None
    gain: float
    confidence: float
    rivals: tuple[DriveRival, ...]
    no_size: tuple[str, ...] = ()
    least: tuple[float, ...] = ()

    @property
    def intervals(self) -> tuple[tuple[float, float], ...]:
        """Ends of each value's 95 % interval, within what is physically possible."""
        least = self.least or (-np.inf,) * len(self.values)
        return tuple((max(v - 1.96 * s, low), v + 1.96 * s) for (_, v, s, _), low in zip(self.values, least, strict=True))

    def text(self) -> str:
        """One paragraph for people."""
        numbers = ", ".join(_told(*value, ends) for value, ends in zip(self.values, self.intervals, strict=True))
        told = f"{self.effect} on {', '.join(self.joints)}: {numbers}{_SAID.get(self.effect, '')}"
        if self.declared is not None:
            told += f" (declared: {', '.join(f'{number:.4g}' for number in _different(self.declared))})"
        told += f"; lowers the squared error of held-out readings by {self.gain:.0%}"
        if self.no_size:
            told += "; " + "; ".join(self.no_size)
        if self.rivals:
            told += "; equally well explained by " + ", ".join(f"{r.effect} ({r.confidence:.0%})" for r in self.rivals)
        return told


@dataclass(frozen=True, eq=False)
class DriveDiagnosis:
    """Verdict, findings, the fit as declared and with the findings; `left`: share of the last residual that its own past predicts, `rest`
    the same without what the stretches show that count the less; `warnings`: whose scale unknown gains have, and those stretches."""

    verdict: Verdict
    findings: tuple[DriveFinding, ...]
    left: float
    before: DriveFit
    after: DriveFit
    warnings: tuple[str, ...] = ()
    rest: float = 0.0

    def summary(self) -> str:
        """Verdict, findings, error before and after."""
        lines = [f"{self.verdict}: " + _MEANS[self.verdict]]
        lines += [wrapped(f"- {finding.text()}") for finding in self.findings]
        if self.left > FORETOLD >= self.rest:
            lines.append("unexplained: the stretches that are named below, and nothing else")
        elif self.verdict == Verdict.UNEXPLAINED and self.left > FORETOLD:
            lines.append(
                wrapped(
                    f"unexplained: {self.left:.0%} of the squared error is predictable from earlier samples, and no candidate explains it"
                    + ("; a cause that is none of the candidates can look like what is found" if self.findings else "")
                )
            )
        pairs = [("fit", self.before.fit_rms, self.after.fit_rms)]
        if self.before.heldout_rms is not None and self.after.heldout_rms is not None:
            pairs.append(("held out", self.before.heldout_rms, self.after.heldout_rms))
        lines += [wrapped(f"warning: {text}") for text in self.warnings]
        lines += [f"error of simulated position, {what}: {_rms(a):.3g} before, {_rms(b):.3g} after (rms, rad or m)" for what, a, b in pairs]
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.summary()

    def to_dict(self) -> dict[str, Any]:
        """As `ident diagnose --json` prints it; `before` and `after` hold errors of simulated position instead of torque."""
        findings = [
            {
                "effect": f.effect,
                "joints": list(f.joints),
                "parameters": [_parameter(*value, ends) for value, ends in zip(f.values, f.intervals, strict=True)],
                "declared": _plain(f.declared),
                "heldout_gain": f.gain,
                "confidence": f.confidence,
                "no_size": list(f.no_size),
                "imitators": [{"effect": r.effect, "joints": list(r.joints), "confidence": r.confidence} for r in f.rivals],
            }
            for f in self.findings
        ]
        body = {
            "verdict": str(self.verdict),
            "findings": findings,
            "unexplained": [] if self.verdict != Verdict.UNEXPLAINED else [{"signature": "follows from the past", "share": self.left}],
            "before": _errors(self.before),
            "after": _errors(self.after),
            "warnings": list(self.warnings),
        }
        return result("ident.drive_diagnosis/1", jsonable(body), inputs=self.before.inputs)


_MEANS = {
    Verdict.CLEAN: "nothing beyond the declared model and law is supported",
    Verdict.EXPLAINED: "what is missing or not as declared accounts for the residual",
    Verdict.AMBIGUOUS: "something is missing, and several candidates account for it equally well",
    Verdict.UNEXPLAINED: "a significant residual remains that no candidate accounts for",
}


def _told(name: str, value: float, std: float, unit: str, ends: tuple[float, float]) -> str:
    if std <= SHARE * abs(value):
        return f"{name} {value:.4g} ± {std:.2g} {unit}"
    if not np.isfinite(std):
        return f"{name} not determined"
    return f"{name} not determined ({ends[0]:.2g} to {ends[1]:.2g} {unit})"


def _parameter(name: str, value: float, std: float, unit: str, ends: tuple[float, float]) -> dict[str, Any]:
    entry: dict[str, Any] = {"name": name, "unit": unit}
    if np.isfinite(std):
        entry["interval"] = list(ends)
    return {**entry, "value": value, "std": std} if std <= SHARE * abs(value) else entry


def _different(numbers: tuple[float, ...]) -> tuple[float, ...]:
    """All of them, or one where all are the same."""
    return numbers if len(set(numbers)) > 1 else numbers[:1]


def _plain(numbers: tuple[float, ...] | None) -> float | list[float] | None:
    if numbers is None:
        return None
    different = _different(numbers)
    return list(different) if len(different) > 1 else different[0]


def _rms(by_joint: Array) -> float:
    return float(np.sqrt(np.mean(by_joint**2)))


def _errors(fit: DriveFit) -> dict[str, Any]:
    held = [] if fit.heldout_rms is None else fit.heldout_rms.tolist()
    return {"replay": {"fit": {"rms": fit.fit_rms}, "heldout": {"rms": held}}}
