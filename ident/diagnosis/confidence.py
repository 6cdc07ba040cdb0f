"""How far an accepted effect is to be believed, beside what could stand in its place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .held_out import confirmed, unconfirmed
from .result import CompetingModel

if TYPE_CHECKING:
    from .inference.confidence_set import AcceptedEffect

#: Confidence in a finding without a competing model: beside nothing left; beside something left where data held out confirm all of it; and
#: where they do not, or tell it from what is there.
_SURE, _CONFIRMED, _HINT = 0.99, 0.9, 0.45
#: What a member of the confidence set is worth at least, beside the effect that was accepted.
_LEAST = 0.35
#: And those together that ask for more for nothing.
_NEEDLESS = 0.15


def confidence(
    accepted: AcceptedEffect, *, beside: bool, share: tuple[float, float] = (np.nan, np.nan)
) -> tuple[float, tuple[CompetingModel, ...]]:
    """Confidence in an accepted effect, and its competing models with theirs. `beside`: something is left that nothing accounts for;
    `share` of what it predicts that data held out have, with its standard error."""
    weights = _weights(accepted)
    if unconfirmed(share):
        most = _HINT
    elif beside:
        most = _CONFIRMED if confirmed(share) else _HINT
    else:
        most = _SURE
    own = most / (1.0 + sum(weights))
    ranked = sorted(zip(accepted.competing, weights, strict=True), key=lambda pair: -pair[1])
    return own, tuple(CompetingModel(m.effect.name, m.joints, own * w) for m, w in ranked)


def _weights(accepted: AcceptedEffect) -> list[float]:
    """What each member of an accepted effect's set is worth beside it; those that ask for more for nothing share a part."""
    needless = sum(m.needless for m in accepted.competing)
    return [
        _NEEDLESS / needless if m.needless else 1.0 if m.same else max(float(np.exp(min((m.z**2 - accepted.z**2) / 2.0, 0.0))), _LEAST)
        for m in accepted.competing
    ]
