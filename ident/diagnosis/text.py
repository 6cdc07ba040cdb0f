"""A diagnosis for people."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from .._utils.text import wrapped
from ..effects.places import on
from .held_out import unconfirmed
from .result import by_effect

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..evaluation.comparison import Comparison
    from ..instruments.prepared import Instrument
    from .described import LeftoverDescription
    from .result import Finding, Hidden, Undetermined, Unexplained
    from .verdict import Verdict


class Told(Protocol):
    """A diagnosis, as far as people are told of it (`ident.diagnosis.Diagnosis` says what each is)."""

    @property
    def verdict(self) -> Verdict: ...

    @property
    def findings(self) -> tuple[Finding, ...]: ...

    @property
    def unexplained(self) -> tuple[Unexplained, ...]: ...

    @property
    def hidden(self) -> tuple[Hidden, ...]: ...

    @property
    def undetermined(self) -> tuple[Undetermined, ...]: ...

    @property
    def instrument(self) -> Instrument: ...

    @property
    def noise_floor(self) -> np.ndarray: ...

    @property
    def held(self) -> object: ...

    @property
    def comparison(self) -> Comparison: ...

    @property
    def every_row(self) -> tuple[float, float]: ...

    @property
    def before(self) -> Estimate: ...

    @property
    def after(self) -> Estimate: ...

    @property
    def description(self) -> LeftoverDescription | None: ...

    @property
    def warnings(self) -> tuple[str, ...]: ...


#: Values of a competing model that are told in its line.
_FEW = 3
_SAID = {
    "clean": "nothing beyond the declared model is supported by the data",
    "explained": "the model lacks the effects listed; with them, no significant residual is left",
    "unexplained": "the residual has structure that no effect of the catalogue accounts for",
}


def undecided(d: Told) -> str:
    """Why a verdict is ambiguous."""
    if any(f.ambiguous for f in d.findings):
        return "something is missing, and two or more effects account for it equally well"
    if any(unconfirmed(f.presence) for f in d.findings):
        return "something is missing in the fitted data, and held-out data do not confirm all that is named"
    if d.findings:
        return "something is missing, and not all of the robot could be examined"
    return f"no conclusion about {', '.join(dict.fromkeys(u.joint for u in d.unexplained))}"


def diagnosis_text(d: Told) -> str:
    """Verdict, findings, alternative explanations, what is left, before and after."""
    lines = [f"verdict: {d.verdict}: {_SAID.get(d.verdict) or undecided(d)}"]
    if d.undetermined:
        times = ", ".join(f"{u.joint} ({u.times:.3g} times the error on fitted data)" for u in d.undetermined)
        lines.append(
            f"no conclusion from held-out data: {times}: uncertain parameters alone let it be so large; the fitted data do not determine"
            " the torque of that motion, and what acts only in it is not seen. Fit data with such motion (`ident excite` designs some)"
        )
    for i, f in enumerate(d.findings, 1):
        lines.append(f"{i}. {f.name}{on(f.place)}: {f.effect.title}; confidence {f.confidence:.2f}, evidence {f.evidence:.0f}")
        for p in f.parameters:
            doubt = f" ± {p.std:.2g}" if np.isfinite(p.std) else ""
            lines.append(f"     {p.name} = {p.value:.4g}{doubt} {p.unit}")
        if f.configuration:
            lines.append("     " + ", ".join(f"{name}: {value}" for name, value in f.configuration.items()))
        if likely := [m for m in f.competing if m.likely]:
            named = "; ".join(f"{m.effect}{on(m.place)} ({m.confidence:.2f})" for m in likely)
            lines.append(f"     alternative explanations: {named}")
        if unlikely := sorted((m for m in f.competing if not m.likely), key=lambda m: -m.share):
            named = "; ".join(f"{m.effect}{on(m.place)}{_with(m.values)} {100 * m.share:.0f} %" for m in unlikely)
            lines.append(f"     in its place would explain, of what it explains: {named}")
        if np.isfinite(f.presence[1]):
            lines.append(f"     {f.presence[0]:.2f} ± {f.presence[1]:.1g} of what it predicts is present in the held-out data")
        lines.append(f"     {f.advice}")
    lines += [f"left: {u.evidence}" for u in d.unexplained]
    if d.description is not None:
        lines += str(d.description).splitlines()
    lines += [
        f"not detectable with this motion: {effect} on {places}: not distinguishable from the model's effects; to see it, {motion}"
        for effect, places, motion in by_effect(d.hidden)
    ]
    lines += [str(d.instrument)]
    data = "held-out" if d.held is not None else "fitted"
    lines += ["", f"error on {data} data, noise floor {_numbers(d.noise_floor)}:", str(d.comparison)]
    if d.before.reversals_left_out or d.after.reversals_left_out:
        before, after = (100.0 * x for x in d.every_row)
        lines.append(f"with rows near velocity reversals, which the table excludes where they do not fit: {before:.2f} -> {after:.2f} %")
    lines += [wrapped(f"warning: {w}") for w in d.warnings if not w.startswith("audit: ")]  # the audit speaks for itself, and first
    return "\n".join(lines)


def _with(values: Sequence[tuple[str, float, str]]) -> str:
    """What a competing model's parameters would be."""
    return f" ({', '.join(f'{value:.3g} {unit}' for _, value, unit in values)})" if 0 < len(values) <= _FEW else ""


def _numbers(x: np.ndarray) -> str:
    return " ".join(f"{v:.3g}" for v in x)
