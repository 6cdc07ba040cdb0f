"""Values that reproduce themselves: of a fit whose columns depend on the values it yields.

Mostly a repetition or two settle it. Where a large correction acts on parameters that hardly anything else shows (a tilted base under
an arm whose joints stand upright), plain repetition creeps or swings; then the next values are extrapolated from the last few
(D. Anderson, Journal of the ACM 12 (1965))."""

from __future__ import annotations

import numpy as np

from .singular_values import lstsq

Array = np.ndarray
#: Repetitions that are worth the while.
MOST = 16
#: Plain repetitions before values are extrapolated, and past ones that an extrapolation looks at.
_PLAIN = 4
_DEPTH = 4


class Repetition:
    """What was put in (k,) and what came out (k,), repetition by repetition; `weight` (k,): how much each value matters, 1 over its
    unit."""

    def __init__(self, weight: Array) -> None:
        self.weight = weight
        self._put: list[Array] = []
        self._moves: list[Array] = []

    def next(self, put: Array, came: Array) -> Array:
        """The values to put in next."""
        self._put.append(put)
        self._moves.append(came - put)
        if len(self._moves) < _PLAIN:
            return came
        self._put, self._moves = self._put[-_DEPTH - 1 :], self._moves[-_DEPTH - 1 :]
        change = np.stack([self._moves[-1] - m for m in self._moves[:-1]], axis=1)
        path = np.stack([self._put[-1] - p for p in self._put[:-1]], axis=1)
        # Where the move that the last few suggest would be nothing.
        share = lstsq(self.weight[:, None] * change, self.weight * self._moves[-1], rcond=1e-8)
        return np.asarray(came - (path + change) @ share)
