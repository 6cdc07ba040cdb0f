"""What friction that varies a little along the travel adds to scores: no law of friction is exact, and that is nothing to find."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ...effects.factors import coefficients
from ...effects.kinds import Factor
from ...robots.transmission import Side
from ..thresholds import CONSTANT

if TYPE_CHECKING:
    from ...instruments.fit import Fit

Array = np.ndarray
#: Variance that the waves add to a direction of unit variance, below which they add nothing.
_NOTHING = 1e-3


def dry_levels(fit: Fit) -> Array:
    """Level (n,) of the motors' dry friction as the fit's model has it."""
    level, robot = np.zeros(fit.robot.n), fit.robot
    if fit.values is None:
        return level
    for effect, own in zip(fit.model.effects, fit.model.slices, strict=True):
        found = coefficients(effect, fit.values[own], robot)
        if found is not None:
            level += np.abs(robot.transmission.torque_map(effect.side, Side.MOTOR)) @ np.abs(found[Factor.DIRECTION])
    return level


@dataclass(frozen=True, eq=False)
class Constancy:
    """Scores of c directions in groups, under friction that varies along the travel by waves of a given size.

    `answers` (c, r): what a standard deviation of each wave adds to each score; `root` (c, c): sparse, by it the scores of each group have
    the covariance that noise alone would give them."""

    answers: Array = field(repr=False)
    root: Any = field(repr=False)

    @classmethod
    def of(cls, gram: Array, levels: Array, starts: Array, degrees: Array) -> Constancy | None:
        """From the products `gram` (c, r) of directions with waves of unit size, and the `levels` (r,) of what they vary; None where they
        add nothing."""
        import scipy.sparse as sparse

        answers = CONSTANT * gram * levels
        if not len(answers) or not np.sum(answers**2, axis=1).max() > _NOTHING:
            return None
        blocks, at = np.zeros((int((degrees**2).sum()),)), np.cumsum([0, *degrees**2])
        rows, columns = np.zeros(len(blocks), int), np.zeros(len(blocks), int)
        for d in np.unique(degrees).tolist():
            which = np.flatnonzero(degrees == d)
            ix = starts[which][:, None] + np.arange(d)
            own = answers[ix]
            w, U = np.linalg.eigh(np.eye(d) + own @ own.swapaxes(1, 2))
            place = at[which][:, None] + np.arange(d * d)
            blocks[place] = ((U / np.sqrt(w)[:, None]) @ U.swapaxes(1, 2)).reshape(len(which), -1)
            rows[place], columns[place] = np.repeat(ix, d, axis=1), np.tile(ix, (1, d))
        return cls(answers, sparse.csr_matrix((blocks, (rows, columns)), shape=(len(answers), len(answers))))

    def tempered(self, scores: Array, which: Array | None = None) -> Array:
        """Scores (c, …), or those of whole groups alone, over what noise and the waves together make of them."""
        root = self.root if which is None else self.root[which][:, which]
        return np.asarray(root @ scores.reshape(len(scores), -1)).reshape(scores.shape)
