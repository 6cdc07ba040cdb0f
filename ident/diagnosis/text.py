"""A diagnosis for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .diagnosis import Diagnosis
    from .findings import Finding, Imitator

_SAID = {
    "clean": "clean: nothing beyond the declared model is supported by the data",
    "explained": "explained: the model lacks what is listed, and with it nothing significant is left",
    "ambiguous": "ambiguous: something is there, and two or more effects account for it equally well",
    "unexplained": "unexplained: structure is there that no effect of the catalogue accounts for",
}


def diagnosis_text(d: Diagnosis) -> str:
    """Verdict, findings, imitators, what is left, before and after."""
    lines = [f"verdict: {_SAID[d.verdict]}"]
    for i, f in enumerate(d.findings, 1):
        lines.append(f"{i}. {f.name}{joints_of(f)}: {f.effect.title}; confidence {f.confidence:.2f}, evidence {f.evidence:.0f}")
        for p in f.parameters:
            doubt = f" ± {p.std:.2g}" if np.isfinite(p.std) else ""
            lines.append(f"     {p.name} = {p.value:.4g}{doubt} {p.unit}")
        if f.imitators:
            named = "; ".join(f"{m.effect}{joints_of(m)} ({m.confidence:.2f})" for m in f.imitators)
            lines.append(f"     could also be: {named}")
        lines.append(f"     {f.advice}")
    lines += [f"left: {u.evidence}" for u in d.unexplained]
    data = "held out" if d.held is not None else "fitted"
    lines += ["", f"error on {data} data, noise floor {_numbers(d.noise_floor)}:", str(d.comparison)]
    return "\n".join(lines)


def joints_of(found: Finding | Imitator) -> str:
    """ " on joint1, joint2"; nothing where it is of the whole robot."""
    return f" on {', '.join(found.joints)}" if found.joints else ""


def _numbers(x: np.ndarray) -> str:
    return " ".join(f"{v:.3g}" for v in x)
