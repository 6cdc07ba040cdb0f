"""Rows away from reversals: near them the sign of a speed is wrong by its own error in time, and a contact may hold."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..robots.reversals import Reversals

if TYPE_CHECKING:
    from .signals import Signals

Array = np.ndarray
#: A row is not looked at if more than this share of its filter's weight lies on samples near a reversal.
_SHARE = 0.05
#: Near a reversal: slower than this share of the usual top speed (or than the speed's own noise lets tell).
_SLOW = 0.02


def without_reversals(signals: Signals) -> Signals:
    """The same signals without the rows near a reversal of any motor whose friction is in them, or of a joint that others' motors move
    too: what is left there looks like a fault."""
    report, reversals = signals.report, Reversals.of(signals.robot.transmission)
    speed = reversals.speeds(signals.dq)
    top = np.quantile(speed, 0.95, axis=0) if len(speed) else np.zeros(speed.shape[1])
    limits = np.maximum(reversals.limits(np.array([j.threshold for j in report.joints])), _SLOW * top)
    slow = reversals.reached(speed, limits, top)
    reach = int(np.ceil(0.5 * signals.rate / report.cutoff_hz)) if report.cutoff_hz else 1
    near = np.zeros(signals.dq.shape)
    for run in signals.runs:
        for j in range(signals.robot.n):
            near[run, j] = _dilated(slow[run, j], reach)
    valid = signals.valid.copy()
    for run, rows in zip(signals.runs, signals.row_runs, strict=True):
        if signals.row_filter is None:
            valid[rows] &= near[run] == 0.0
        else:
            valid[rows] &= signals.row_filter.magnitude.apply(near[run]) < _SHARE
    # A joint that hardly moves would lose every row: then its own rows stay.
    kept = valid.sum(axis=0) >= 0.25 * signals.valid.sum(axis=0)
    return replace(signals, valid=np.where(kept, valid, signals.valid))


def _dilated(flag: Array, reach: int) -> Array:
    """Flags (N,) bool, and so many samples before and after each, as 0 and 1."""
    edges = np.zeros(len(flag) + 1, int)
    at = np.flatnonzero(flag)
    np.add.at(edges, np.maximum(at - reach, 0), 1)
    np.add.at(edges, np.minimum(at + reach + 1, len(flag)), -1)
    return np.asarray(np.cumsum(edges[:-1]) > 0, float)
