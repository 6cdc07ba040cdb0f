"""Which samples a regression row must not rest on: joints at standstill, torque at its limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from ..errors import ConfigurationError, unknown_name

Array = np.ndarray
#: Samples that suffice to tell a torque's steps and how long it usually stays the same.
SPEEDS_ENOUGH = 200_000


class NearReversals(StrEnum):
    """Whether a fit uses a joint's rows near its velocity reversals: if they are consistent with its other rows, or in any case.

    They are not if their residual scatters more than chance allows (`ident.estimators.reversals`), as where dry friction is not the
    function of velocity that the model says. Published values are often of fits that keep them."""

    IF_CONSISTENT = "if_consistent"
    KEEP = "keep"

    @classmethod
    def _missing_(cls, value: object) -> None:
        raise unknown_name("use of rows near reversals", str(value), [v.value for v in cls])


@dataclass(frozen=True)
class Standstill:
    """When a joint stands still, where dry friction may take any value up to its breakaway and so says nothing.

    A sample counts as standstill below `fraction` of the joint's top speed on the measured side, or below `speed` (rad/s or
    m/s; one value, or one a joint) if that is given; never below three standard deviations of the speed's noise. A row is
    left out if more than `share` of the row filter's weight lies on such samples. A small share drops every row that a standstill
    or a reversal reaches, and with them the low speeds by which friction that is not linear in speed is told; where friction
    is another there, the estimators see it by the residual and leave these rows out (`NearReversals`). Where reversals follow each
    other so closely, for the length of the row filter, that less than `keep` of a joint's moving rows would be left, its
    share is raised until that many are."""

    fraction: float = 0.01
    speed: float | Sequence[float] | None = None
    share: float = 0.3
    keep: float = 0.5

    def __post_init__(self) -> None:
        if not all(0 <= x < 1 for x in (self.fraction, self.share, self.keep)):
            raise ConfigurationError(
                f"standstill: fraction ({self.fraction}), share ({self.share}) and keep ({self.keep}) must lie in [0, 1)."
            )

    def allowed(self, shares: Array) -> Array:
        """The share (n,) up to which rows are kept, from each row's share of standstill (M, n): `share`, or what keeps enough."""
        out = np.full(shares.shape[1], float(self.share))
        for j in range(shares.shape[1]):
            moving = shares[shares[:, j] <= 0.5, j]
            if self.keep > 0 and len(moving):
                out[j] = max(self.share, float(np.quantile(moving, self.keep, method="higher")))
        return out

    def thresholds(self, top: Array, noise: Array) -> Array:
        """Speeds (n,) below which a joint stands still, from top speeds (n,) and the standard deviation of speed noise (n,)."""
        if self.speed is None:
            wanted = self.fraction * top
        else:
            wanted = np.broadcast_to(np.asarray(self.speed, float), top.shape)
        return np.maximum(wanted, 3 * noise)


@dataclass(frozen=True, eq=False)
class TorqueClipping:
    """Samples (N, n) at which torque stays at its extreme value, and these extremes (n, 2), NaN where none is a limit."""

    flag: Array
    limits: Array


def find_saturation(torque: Array, moving: Array) -> TorqueClipping:
    """Where torque (N, n) is cut off: a plateau at its very extreme, held while the joint moves, on which far more samples lie than just
    below it. `moving` (N, n) bool."""
    flag = np.zeros(torque.shape, bool)
    limits = np.full((torque.shape[1], 2), np.nan)
    for j in range(torque.shape[1]):
        x = torque[:, j]
        finite = x[np.isfinite(x)]
        if len(finite) < 50:
            continue
        span = np.ptp(finite)
        changes = np.abs(np.diff(finite[:SPEEDS_ENOUGH]))
        distinct = changes[changes > 1e-9 * span]
        if span == 0 or not len(distinct):
            continue
        # The finest step seen: a quantisation step, or nothing much for a torque of full resolution.
        step = float(np.percentile(distinct, 1))
        held = longest_usual_hold(finite[:SPEEDS_ENOUGH])
        largest = float(np.abs(finite).max())
        for side, extreme in enumerate((finite.min(), finite.max())):
            if abs(extreme) < 0.3 * largest:
                continue  # a motor that is off, or torque of one sign: no limit of a drive
            at = np.abs(x - extreme) <= 1e-9 * span
            runs = _lengths(at)
            if not len(runs) or runs.max() < max(5, 4 * held) or np.mean(moving[at, j]) < 0.5:
                continue
            near = (np.abs(x - extreme) <= max(3.5 * step, 0.01 * span)) & ~at
            if at.sum() >= 3 * near.sum():
                flag[:, j] |= at
                limits[j, side] = extreme
    return TorqueClipping(flag, limits)


def _lengths(flag: Array) -> Array:
    """Lengths of the runs of set flags."""
    edges = np.flatnonzero(np.diff(np.r_[False, flag, False]))
    return edges[1::2] - edges[::2]


def longest_usual_hold(x: Array) -> float:
    """Samples for which a value usually stays the same (a log may repeat a slower torque signal)."""
    changes = np.flatnonzero(np.diff(x) != 0)
    return float(np.percentile(np.diff(changes), 90)) if len(changes) > 10 else 1.0
