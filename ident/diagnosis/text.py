"""A diagnosis for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..places import on

if TYPE_CHECKING:
    from .diagnosis import Diagnosis

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
        lines.append(f"{i}. {f.name}{on(f.place)}: {f.effect.title}; confidence {f.confidence:.2f}, evidence {f.evidence:.0f}")
        for p in f.parameters:
            doubt = f" ± {p.std:.2g}" if np.isfinite(p.std) else ""
            lines.append(f"     {p.name} = {p.value:.4g}{doubt} {p.unit}")
        if f.configuration:
            lines.append("     " + ", ".join(f"{name}: {value}" for name, value in f.configuration.items()))
        if f.imitators:
            named = "; ".join(f"{m.effect}{on(m.place)} ({m.confidence:.2f})" for m in f.imitators)
            lines.append(f"     could also be: {named}")
        lines.append(f"     {f.advice}")
    lines += [f"left: {u.evidence}" for u in d.unexplained]
    data = "held out" if d.held is not None else "fitted"
    lines += ["", f"error on {data} data, noise floor {_numbers(d.noise_floor)}:", str(d.comparison)]
    return "\n".join(lines)


def _numbers(x: np.ndarray) -> str:
    return " ".join(f"{v:.3g}" for v in x)
