"""What an audit finds, and how it is told."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from ..drawing.document import Section, Table
from ..drawing.shown import Shown

if TYPE_CHECKING:
    import pandas as pd


class Severity(StrEnum):
    """How bad a finding is: to know, to look at, or in the way of any estimate."""

    INFO = "info"
    WARNING = "warning"
    ERROR = "error"


#: Findings that tell that a joint moves little in a run.
_OF_MOTION = ("constant", "never_moved", "standstill", "noise", "torque_unrelated", "free_motion")
_ORDER = {Severity.ERROR: 0, Severity.WARNING: 1, Severity.INFO: 2}


@dataclass(frozen=True)
class AuditFinding:
    """One finding. `code` names its kind; `where` the joint or column ("" for the whole run); `run` the run, or runs;
    `text` says what it means for the estimate and what to do; `value` is the number behind it, SI (NaN without one)."""

    code: str
    severity: Severity
    text: str
    where: str = ""
    run: str = ""
    value: float = float("nan")

    def to_dict(self) -> dict[str, Any]:
        """For JSON results."""
        value = self.value if self.value == self.value and abs(self.value) != float("inf") else None
        return {"code": self.code, "severity": self.severity.value, "where": self.where, "run": self.run, "text": self.text, "value": value}


@dataclass(frozen=True)
class Audit(Shown):
    """All findings on a set of logs, the worst first."""

    findings: tuple[AuditFinding, ...]
    runs: tuple[str, ...]
    robot: str = ""

    @property
    def ok(self) -> bool:
        """No finding is in the way of an estimate."""
        return not any(f.severity == Severity.ERROR for f in self.findings)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Texts of warnings and errors, for results."""
        return tuple(_line(f) for f in self.findings if f.severity != Severity.INFO)

    def of(self, code: str) -> tuple[AuditFinding, ...]:
        """The findings of one kind."""
        return tuple(f for f in self.findings if f.code == code)

    def to_frame(self) -> pd.DataFrame:
        """One row per finding."""
        import pandas as pd

        return pd.DataFrame([f.to_dict() for f in self.findings], columns=["severity", "code", "where", "run", "text", "value"])

    def sections(self) -> tuple[Section, ...]:
        """The findings as a table."""
        rows = tuple((f.severity.value, f.code, _place(f), f.text) for f in self.findings)
        note = "What each means and what to do: docs/troubleshooting.md." if rows else "Nothing was found."
        return (Table(f"Audit of {', '.join(self.runs[:4])}", ("severity", "code", "where", "finding"), rows, note, left=4),)

    def to_dict(self) -> dict[str, Any]:
        """For JSON results."""
        return {"runs": list(self.runs), "robot": self.robot, "ok": self.ok, "findings": [f.to_dict() for f in self.findings]}

    def __str__(self) -> str:
        names = ", ".join(self.runs[:4]) + (" …" if len(self.runs) > 4 else "")
        counts = [(s, sum(f.severity == s for f in self.findings)) for s in _ORDER]
        told = ", ".join(f"{n} {s.value}{'s' * (n > 1 and s != Severity.INFO)}" for s, n in counts if n) or "nothing found"
        lines = [f"Audit of {len(self.runs)} run{'s' * (len(self.runs) > 1)} ({names}): {told}"]
        shown = _together(self.findings)
        width = max([len(_place(f)) for f in shown], default=0)
        width = min(max(width, 8), 34)
        codes = max([len(f.code) for f in shown], default=0)
        for f in shown:
            head = f"{f.severity.value:<8} {f.code:<{codes}}  {textwrap.shorten(_place(f), width, placeholder='…'):<{width}}  "
            body = textwrap.wrap(f.text, max(40, 130 - len(head))) or [""]
            lines += [head + body[0], *(" " * len(head) + rest for rest in body[1:])]
        if any(f.severity != Severity.INFO for f in self.findings):
            lines.append("Each finding, its causes and remedies: docs/troubleshooting.md")
        return "\n".join(lines)


def _place(f: AuditFinding) -> str:
    return " · ".join(p for p in (f.where, f.run) if p)


def _together(findings: Sequence[AuditFinding]) -> list[AuditFinding]:
    """The same finding on three joints or more in one line, with the text of the worst."""
    groups: dict[tuple[str, str], list[AuditFinding]] = {}
    for f in findings:
        groups.setdefault((f.code, f.severity.value), []).append(f)
    out = []
    for group in groups.values():
        if len(group) < 3:
            out += group
            continue
        worst = max(group, key=lambda f: abs(f.value) if f.value == f.value else -1.0)
        out.append(replace(worst, where=f"{worst.where}, {len(group) - 1} more" if worst.where else worst.where))
    return out


def _line(f: AuditFinding) -> str:
    place = _place(f)
    return f"{place}: {f.text}" if place else f.text


def _at_rest_elsewhere(found: Iterable[AuditFinding]) -> list[AuditFinding]:
    """What is a warning only because a joint moves little in a run, and moves well in another, is told as information.

    Tests of one joint after the other hold the rest still on purpose; what matters is that each moves somewhere."""
    found = list(found)
    looked_at = {f.run for f in found if f.code == "cutoff"}
    poor: dict[str, set[str]] = {}
    for f in found:
        if f.code in _OF_MOTION and f.severity == Severity.WARNING and f.where:
            poor.setdefault(f.where, set()).add(f.run)
    moves = {where for where, own in poor.items() if looked_at - own}
    return [
        replace(f, severity=Severity.INFO, text=f"{f.text} Other runs excite it better.")
        if f.code in _OF_MOTION and f.severity == Severity.WARNING and f.where in moves
        else f
        for f in found
    ]


def merged_findings(findings: Iterable[AuditFinding], runs: int) -> list[AuditFinding]:
    """One finding for each code, place and severity, for the run where its value is largest."""
    groups: dict[tuple[str, str, str], list[AuditFinding]] = {}
    for f in _at_rest_elsewhere(findings):
        groups.setdefault((f.code, f.where, f.severity.value), []).append(f)
    out = [_worst(group, runs) for group in groups.values()]
    return sorted(out, key=lambda f: _ORDER[f.severity])


def _worst(group: Sequence[AuditFinding], runs: int) -> AuditFinding:
    worst = max(group, key=lambda f: abs(f.value) if f.value == f.value else -1.0)
    if runs == 1:
        return replace(worst, run="")
    return worst if len(group) == 1 else replace(worst, run=f"{worst.run} and {len(group) - 1} more")
