"""What monitoring found."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from ..diagnosis.findings import AMBIGUOUS, Imitator
from ..results import result
from ..torque_error import TorqueError, number

if TYPE_CHECKING:
    from ..effect import Effect
    from ..estimate import Estimate
    from ..signals import Signals

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
class ChangedParameter:
    """A parameter's change `value` with its std; `before`: its value in the fit (None where the fit has none of its own). The std is
    infinite where the log cannot tell."""

    name: str
    value: float
    std: float
    unit: str
    before: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        after = None if self.before is None else self.before + self.value
        return {"name": self.name, "value": self.value, "std": number(self.std), "unit": self.unit, "before": self.before, "after": after}

    def __str__(self) -> str:
        doubt = f" ± {self.std:.2g}" if np.isfinite(self.std) else " (not determined)"
        return f"{self.name} = {self.value:.4g}{doubt} {self.unit}"


@dataclass(frozen=True, eq=False)
class Change:
    """One thing that changed. `heldout_gain`: share of the error that it removes on blocks of the new logs that its fit did not see;
    `evidence`: the same as twice a log-likelihood; `confidence` that it is this and none of its `imitators`."""

    effect: Effect
    how: How
    joints: tuple[str, ...]
    parameters: tuple[ChangedParameter, ...]
    heldout_gain: float
    evidence: float
    confidence: float
    imitators: tuple[Imitator, ...]

    @property
    def name(self) -> str:
        return self.effect.name

    @property
    def ambiguous(self) -> bool:
        """Whether its rivals account for the same about as well."""
        return sum(i.confidence for i in self.imitators) >= AMBIGUOUS

    def __str__(self) -> str:
        where = f" on {', '.join(self.joints)}" if self.joints else ""
        first = self.parameters[0]
        if self.how == How.CHANGED and len(self.parameters) == 1 and first.before is not None:
            verb = "grew" if first.value * first.before > 0 else "fell"
            share = f" ({100 * abs(first.value / first.before):.0f} %)" if first.before else ""
            size = f"{abs(first.value):.4g} ± {first.std:.2g} {first.unit}{share}"
            return f"{self.effect.title}{where} {verb} by {size}, from {first.before:.4g} to {first.before + first.value:.4g}"
        shown = [p for p in self.parameters if np.isfinite(p.std) and abs(p.value) > 2 * p.std][:_NAMED] or list(self.parameters[:1])
        more = "" if len(shown) == len(self.parameters) else " …"
        return f"{self.effect.title}{where} {self.how.value}: {', '.join(map(str, shown))}{more}"

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "effect": self.name,
            "how": self.how.value,
            "joints": list(self.joints),
            "parameters": [p.to_dict() for p in self.parameters],
            "heldout_gain": self.heldout_gain,
            "evidence": self.evidence,
            "confidence": self.confidence,
            "imitators": [i.to_dict() for i in self.imitators],
            "text": str(self),
        }


@dataclass(frozen=True)
class Drift:
    """Parameters that moved together, and no single change tells why: on which joints' torque it shows, and how strongly."""

    joint: str
    evidence: str

    def to_dict(self) -> dict[str, str]:
        """JSON form."""
        return {"joint": self.joint, "signature": "parameters as a whole", "evidence": self.evidence}


@dataclass(frozen=True, eq=False)
class Monitoring:
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
        from ..summary import error_table

        lines = [f"verdict: {said(self)}"]
        for i, change in enumerate(self.changes, 1):
            lines.append(f"{i}. {change}; confidence {change.confidence:.2f}")
            if change.imitators:
                rivals = (f"{m.effect}{' on ' + ', '.join(m.joints) if m.joints else ''} ({m.confidence:.2f})" for m in change.imitators)
                lines.append(f"     could also be: {'; '.join(rivals)}")
        lines += [f"left: {u.evidence}" for u in self.unexplained]
        lines += [f"no change, in the logs of the fit too: {name}" for name in self.known]
        errors = {"fit": self.estimate.fit_error, "new logs": self.error}
        if self.changes:
            errors["with the changes"] = self.corrected
        return "\n".join([*lines, "", error_table(self.estimate, errors), *(f"warning: {w}" for w in self.warnings)])


def said(found: Monitoring) -> str:
    """The verdict in words."""
    return {
        "unchanged": "unchanged: the fit predicts the new logs as well as its own uncertainty lets expect",
        "changed": "changed: " + "; ".join(map(str, found.changes)),
        "ambiguous": "ambiguous: something changed, and two or more things account for it equally well",
        "unexplained": "unexplained: the fit does not predict the new logs, and no single change tells why",
    }[found.verdict]
