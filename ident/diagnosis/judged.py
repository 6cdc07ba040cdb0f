"""The verdict of a decision, with what is seen without any model and what data held out say of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from .held_out import contradicted, contradicted_heap, heaps, louder, presence, unconfirmed
from .quality import jumps, lost
from .result import Unexplained
from .verdict import Verdict

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals
    from .inference.confidence_set import AcceptedEffect
    from .inference.decide import Decision


def judged(decision: Decision, signals: Signals) -> tuple[Verdict, tuple[Unexplained, ...]]:
    """The verdict with what is seen without any model: jumps, joints that no row is left of."""
    verdict = Verdict(decision.verdict)
    left: list[Unexplained] = []
    seen: set[tuple[str, ...]] = set()
    for x in sorted(decision.left, key=lambda x: (x.named, -x.z)):
        if x.joints in seen:
            continue
        seen.add(x.joints)
        where = ", ".join(x.joints) or "the whole robot"
        said = f"{where}: the residual depends on {x.name} (z {x.z:.1f}, chance and tolerance explain up to {decision.critical:.1f})"
        left.append(Unexplained(x.joints[0] if x.joints else "", x.name, said, float(x.z**2)))
    plain, blind = jumps(signals), lost(signals)
    if plain:
        verdict = Verdict.UNEXPLAINED
    elif blind and verdict in (Verdict.CLEAN, Verdict.EXPLAINED):
        verdict = Verdict.AMBIGUOUS
    return verdict, (*left, *plain, *blind)


def beside_held_out(verdict: Verdict, shares: list[tuple[float, float]], worse: list[Unexplained]) -> Verdict:
    """The verdict with what data held out say: what contradicts it, and whether they show what is named."""
    if worse:
        return Verdict.UNEXPLAINED
    return Verdict.AMBIGUOUS if verdict == Verdict.EXPLAINED and any(map(unconfirmed, shares)) else verdict


def against_held_out(
    named: Sequence[AcceptedEffect],
    shares: Sequence[tuple[float, float]],
    fewer: Callable[[set[int]], Estimate],
    after: Estimate,
    signals: Signals,
    held: Signals,
) -> list[Unexplained]:
    """What data held out contradict: effects by their `shares`, all of one joint together, and the error itself. `fewer`: the model without
    some of the `named`; `after`: the model with all, fitted to `signals`."""
    worse = [*contradicted(named, shares), *louder(after, signals, held)]
    for own in heaps(named):
        worse += contradicted_heap([named[i] for i in own], presence(fewer(set(own)), after, held))
    return worse
