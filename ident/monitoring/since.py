"""Where in the new logs a change is: from which log on, and which share of the residual it predicts on parts that were not fitted."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from .._utils.singular_values import lstsq
from ..diagnosis.inference.scores import BLOCK
from ..diagnosis.thresholds import HALF

if TYPE_CHECKING:
    from ..diagnosis.inference.decide import Decision

Array = np.ndarray
#: Parts of the new logs that are held out in turn.
_FOLDS = 5


def first_log(decision: Decision, names: Sequence[str]) -> int | None:
    """Place of the log from which on all changes are there; None where there is one log, or no change, or no such log."""
    frame, fit = decision.frame, decision.fit
    if len(fit.runs) < 2 or len(fit.runs) != len(names) or not decision.named:
        return None
    there = np.ones(len(fit.runs), bool)
    for part in decision.fit.slices:
        made = frame.Z[:, :, part] @ frame.theta[part]
        own, along = made**2, made * (frame.residual + frame.X[:, :, part] @ frame.theta[part])
        for i, (a, b) in enumerate(pairwise(frame.edges)):
            there[i] &= float(along[a:b].sum()) > HALF * float(own[a:b].sum())
    gone = np.flatnonzero(~there)
    first = int(gone[-1]) + 1 if len(gone) else 0
    return first if first < len(there) else None


def heldout_gains(decision: Decision) -> list[float]:
    """For each change, the share of the squared error, weighted by noise, that it removes on blocks that its fit did not see."""
    frame = decision.frame
    known = decision.fit.known_rows(frame.X.shape[2])
    told = known @ frame.theta + _left_of_known(decision)
    y = frame.residual + frame.X @ frame.theta
    block = np.arange(frame.rows) // max(1, round(BLOCK * decision.fit.runs[0].band.row_rate))

    def loss(columns: Array) -> float:
        total = 0.0
        for fold in range(_FOLDS):
            out = block % _FOLDS == fold
            X, Z = (np.concatenate([a[~out][:, :, columns].reshape(-1, len(columns)), known[:, columns]]) for a in (frame.X, frame.Z))
            scale = np.maximum(np.linalg.norm(Z, axis=0), 1e-300)
            right = (Z / scale).T @ np.concatenate([y[~out].reshape(-1), told])
            theta = lstsq((Z / scale).T @ (X / scale), right, rcond=1e-9) / scale
            total += float(np.sum((y[out] - frame.X[out][:, :, columns] @ theta) ** 2))
        return total

    every = np.arange(frame.X.shape[2])
    whole = loss(every)
    return [float(np.clip(1.0 - whole / max(loss(np.setdiff1d(every, every[part])), 1e-300), 0.0, 1.0)) for part in decision.fit.slices]


def _left_of_known(decision: Decision) -> Array:
    """What the known rows' values differ from what the fit makes of them."""
    known = decision.fit.known
    assert known is not None
    return known.told - known.rows @ decision.frame.theta[: known.rows.shape[1]]
