"""Withdrawn: guesses of which none is trusted, and which data held out do not bear out.

Where no effect of the catalogue accounts for what is there, several together draw a part of it. That may be worth a hint, as long as the
error falls with them on data that they were not chosen on. Where it does not, beyond what chance might do, nothing was found. One by
itself is no such drawing: play in a gear that leaves much and knocks seldom is still play in a gear."""

from __future__ import annotations

from collections.abc import Sequence

from ..places import on
from .findings import LIKELY, Finding, Unexplained


def withdrawn(verdict: str, findings: Sequence[Finding], shown: bool) -> Unexplained | None:
    """What is to be said of findings that are to be withdrawn, or None where they stay. `shown`: whether held-out data bear them out."""
    if shown or verdict != "unexplained" or len(findings) < 2 or any(f.confidence >= LIKELY for f in findings):
        return None
    names = ", ".join(f"{f.name}{on(f.place)}" for f in findings)
    joint = next((j for f in findings for j in f.joints), "")
    said = (
        f"{names}: they draw a part of what is there in the data fitted, none of them for sure, and the error on held-out data falls with"
        " them no more than chance might; so none is taken. Log more of the same motion, or mend what the log's audit says"
    )
    return Unexplained(joint, "held-out data", said, float(sum(f.evidence for f in findings)))
