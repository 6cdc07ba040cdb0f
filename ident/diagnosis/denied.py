"""Findings that are denied by what is left: something that would not be there if they were what they are called."""

from __future__ import annotations

from ..effects.places import on, place_of
from .findings import Unexplained
from .selection import Selection

#: What denies a finding gains so much (twice a log-likelihood, on all blocks and on those held out), and at least this share of what the
#: finding itself gains: no law is exact.
_LEAST = 30.0
_SHARE = 0.003


def denied(selection: Selection) -> tuple[Unexplained, ...]:
    """What is to be said of such findings, the model being complete in other respects."""
    final, found = selection.final, []
    for one in selection.found:
        other = one.effect.denied_by()
        if other is None:
            continue
        score = final.frame.score(final.search.whitened(other))
        gain = min(score.fit_gain, score.heldout)
        if gain < max(_LEAST, _SHARE * one.judged.evidence):
            continue
        joints = one.judged.hit.candidate.joints
        place = on(place_of(one.effect, joints))
        said = (
            f"{', '.join(joints)}: {one.effect.name}{place} takes up much of what is there, but is not what it is: what"
            f" would be the same then differs (held-out gain {gain:.0f}); something that raises the torque for a while does that, too"
        )
        found.append(Unexplained(joints[0], f"what denies {one.effect.name}", said, gain))
    return tuple(found)
