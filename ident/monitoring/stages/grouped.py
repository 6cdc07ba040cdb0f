"""Groups: what a robot that has it on one joint mostly has on all of them, on those that ask for it at once.

Who declares the rigid body alone leaves friction out of all joints, not of one. Found one after the other, each is judged beside all that
the others leave, which something else may draw better than any of them; and of many joints the last would never be come to."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from ...effects.base import Effect
from .candidates import Candidate
from .evidence import threshold
from .plausible import BEYOND
from .refit import Refit
from .search import Hit, Search

#: Two do as well if their gains (twice a log-likelihood) differ by no more.
_AS_WELL = 6.0


def groups(search: Search, hits: Sequence[Hit], number: int) -> list[Hit]:
    """For each such kind a hit on all joints that ask for it beside one another, where there are several. `hits`: of a scan; `number`:
    candidates that were tried."""
    kinds: dict[tuple[type[Effect], str], list[Hit]] = {}
    for hit in hits:
        effect = hit.effect
        if effect.usual and effect.joints is not None and len(effect.joints) == 1 and hit.fit_gain > threshold(hit, number):
            kinds.setdefault((type(effect), effect.side), []).append(hit)
    found = (_group(search, alone, number) for alone in kinds.values())
    return [hit for hit in found if hit is not None and not (len(hit.effect.joints or ()) == 2 and _as_another(hit, hits))]


def _as_another(group: Hit, hits: Sequence[Hit]) -> bool:
    """Whether on one of a group's joints something else does as well with as few parameters (an asymmetric friction for an offset)."""
    alone = {h.effect.joints: h for h in hits if type(h.effect) is type(group.effect)}
    own = [alone[(name,)] for name in group.effect.joints or ()]
    return any(
        h.candidate.name != mine.candidate.name
        and h.effect.joints == mine.effect.joints
        and h.columns.shape[2] == mine.columns.shape[2]
        and not h.effect.shape()
        and h.fit_gain > mine.fit_gain - _AS_WELL
        for mine in own
        for h in hits
    )


def _group(search: Search, alone: Sequence[Hit], number: int) -> Hit | None:
    """One hit on the joints of several, without those that beside the others ask for no more than chance yields or cannot be."""
    order = [name for name in search.robot.joint_names if name in {h.candidate.joints[0] for h in alone}]
    enough = {h.candidate.joints[0]: threshold(h, number) for h in alone}
    while len(order) > 1:
        effect = dataclasses.replace(alone[0].effect, joints=tuple(order))
        columns = search.whitened(effect)
        fit = Refit.of(search.frame, columns)
        known = np.where(np.isfinite(fit.std) & (fit.std > 0.0), fit.std, np.inf)
        parameters = effect.parameters(search.robot)
        able = np.array(
            [p.lower - BEYOND * s <= v <= p.upper + BEYOND * s for p, v, s in zip(parameters, fit.values, fit.std, strict=True)]
        )
        asked = np.where(able, (fit.values / known) ** 2 - [enough[name] for name in order], -np.inf)
        worst = int(np.argmin(asked))
        if asked[worst] > 0.0:
            candidate = Candidate(effect.name, effect.joints or (), (effect,))
            return Hit(candidate, effect, search.frame.fit_gain(columns), columns)
        del order[worst]
    return None
