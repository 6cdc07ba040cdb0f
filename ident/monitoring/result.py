"""What monitoring found."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.json import result
from .._utils.short_repr import ShortRepr
from ..diagnosis.result import Finding, FoundParameter
from ..effects.places import on, place_of
from ..estimate.summary import error_table
from ..statistics.torque_error import TorqueError, number

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray
#: Parameters that a sentence names.
_NAMED = 3


class How(StrEnum):
    """What became of an effect. CHANGED: one of the model's own has other parameters; APPEARED: it was not in the model;
    DISAPPEARED: the contrary of something that can be added (a payload that was put down)."""

    CHANGED = "changed"
    APPEARED = "appeared"
    DISAPPEARED = "disappeared"


@dataclass(frozen=True)
class ChangedParameter(FoundParameter):
    """A parameter's change `value` with its std; `before`: its value in the fit (None where the fit has none of its own). The std is
    infinite where the log cannot tell."""

    before: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        after = None if self.before is None else self.before + self.value
        return {**super().to_dict(), "std": number(self.std), "before": self.before, "after": after}

    def __str__(self) -> str:
        doubt = f" ± {self.std:.2g}" if np.isfinite(self.std) else " (not determined)"
        return f"{self.name} = {self.value:.4g}{doubt} {self.unit}"


@dataclass(frozen=True, eq=False)
class Change(Finding):
    """One thing that changed: a finding of the diagnosis with `how` it came about. `heldout_gain` is of blocks of the new logs that its fit
    did not see; `since`: of several new logs the first that has it ("": there is one, or it is not told)."""

    parameters: tuple[ChangedParameter, ...]
    how: How = How.CHANGED
    since: str = ""

    @property
    def brief(self) -> str:
        """In a few words: what, where, and its first parameter."""
        first = self.parameters[0]
        grown = self._grown(first)
        if grown and first.before:
            return f"{self.effect.title}{self._where} {grown} by {100 * abs(first.value / first.before):.0f} %"
        return f"{self.effect.title}{self._where} {self.how.value}: {first}"

    def __str__(self) -> str:
        first = self.parameters[0]
        grown = self._grown(first)
        if grown and first.before is not None:
            share = f" ({100 * abs(first.value / first.before):.0f} %)" if first.before else ""
            size = f"{abs(first.value):.4g} ± {first.std:.2g} {first.unit}{share}"
            return f"{self.effect.title}{self._where} {grown} by {size}, from {first.before:.4g} to {first.before + first.value:.4g}"
        shown = [p for p in self.parameters if np.isfinite(p.std) and abs(p.value) > 2 * p.std][:_NAMED] or list(self.parameters[:1])
        more = "" if len(shown) == len(self.parameters) else " …"
        return f"{self.effect.title}{self._where} {self.how.value}: {', '.join(map(str, shown))}{more}"

    @property
    def _where(self) -> str:
        return on(place_of(self.effect, self.joints))

    def _grown(self, first: ChangedParameter) -> str:
        """ "grew" or "fell", of a single parameter that was there before; "" else."""
        if self.how != How.CHANGED or len(self.parameters) > 1 or first.before is None:
            return ""
        return "grew" if abs(first.before + first.value) > abs(first.before) else "fell"

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        found = {key: value for key, value in super().to_dict().items() if key != "advice"}
        return {**found, "how": self.how.value, "since": self.since, "text": str(self)}


@dataclass(frozen=True)
class Drift:
    """What no change accounts for: on which joint's torque it shows, what it follows (`signature`: "parameters as a whole", "time" …),
    and how strongly."""

    joint: str
    signature: str
    evidence: str

    def to_dict(self) -> dict[str, str]:
        """JSON form."""
        return {"joint": self.joint, "signature": self.signature, "evidence": self.evidence}


@dataclass(frozen=True, eq=False, repr=False)
class Monitoring(ShortRepr):
    """The answer. `verdict`: "unchanged", "changed", "ambiguous" (something changed, and two or more things account for it equally
    well) or "unexplained" (something changed that no change tried accounts for).

    `error`: of the fit on the new signals, `corrected`: with the changes; `known`: effects that both the fit's own logs and
    the new ones show, which are thus no change."""

    verdict: str
    changes: tuple[Change, ...]
    unexplained: tuple[Drift, ...]
    estimate: Estimate
    signals: Signals
    error: TorqueError
    corrected: TorqueError
    residual: Array = field(repr=False)
    corrected_residual: Array = field(repr=False)
    known: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The `ident.monitor/1` result."""
        body = {
            "verdict": self.verdict,
            "changes": [c.to_dict() for c in self.changes],
            "unexplained": [u.to_dict() for u in self.unexplained],
            "torque_error": {
                "fit": self.estimate.fit_error.to_dict(),
                "new": self.error.to_dict(),
                "corrected": self.corrected.to_dict(),
            },
            "known": list(self.known),
            "joints": list(self.estimate.model.robot.joint_names),
        }
        return result("ident.monitor/1", body, inputs=self.signals.inputs, warnings=self.warnings)

    def __str__(self) -> str:
        lines = [f"verdict: {said(self)}"]
        for i, change in enumerate(self.changes, 1):
            lines.append(f"{i}. {change}; confidence {change.confidence:.2f}")
            if change.competing:
                others = (f"{m.effect}{on(', '.join(m.joints))} ({m.confidence:.2f})" for m in change.competing)
                lines.append(f"     could also be: {'; '.join(others)}")
        lines += [f"left: {u.evidence}" for u in self.unexplained]
        lines += [f"no change, in the logs of the fit too: {name}" for name in self.known]
        errors = {"fit": self.estimate.fit_error, "new logs": self.error}
        if self.changes:
            errors["with the changes"] = self.corrected
        return "\n".join([*lines, "", error_table(self.estimate, errors), *(f"warning: {w}" for w in self.warnings)])


def said(found: Monitoring) -> str:
    """The verdict in words."""
    return {
        "unchanged": "unchanged: the fit predicts the new logs as well as its own uncertainty allows",
        "changed": "changed: " + "; ".join(change.brief for change in found.changes),
        "ambiguous": "ambiguous: something changed, and two or more explanations account for it equally well",
        "unexplained": "unexplained: the fit does not predict the new logs, and no change that was tried accounts for all of it",
    }[found.verdict]
