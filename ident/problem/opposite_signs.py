"""Torques that were recorded with the opposite sign, found by turning them: links that several rows share must agree with all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from .linear_solution import order_of
from .reweighting import reweighted

if TYPE_CHECKING:
    from ..regressor.base_parameters.reduction import BaseReduction
    from .information import Information

Array = np.ndarray
#: Nothing is looked for where every joint's relative error lies below this.
_POOR = 0.05
#: The product of all joints' errors must fall so many times, and to half the worst of them and the joint's own: no torque that has the
#: right sign does that, and another joint's wrong position is not made up for by it.
_FALL, _HALF = 4.0, 0.5
_FEW_ROWS = 30
#: Standard deviations from zero beyond which a sign is told.
_SURELY = 5.0
#: Passes of weighting are enough to compare errors that differ by far.
_PASSES = 4


def negative_share(values: Array, std: Array, low: Array, high: Array) -> tuple[int, int]:
    """Of parameters that physics bounds from below by zero and that the data tell: how many lie below it by more than scatter, and how many
    there are. `values`, `std`, `low`, `high`: (b,)."""
    told = (low == 0.0) & np.isfinite(std) & (np.abs(values) > _SURELY * std) & (high > 0.0)
    return int(np.sum(told & (values < 0.0))), int(np.sum(told))


@dataclass(frozen=True)
class OppositeSign:
    """A joint whose relative torque error falls from `before` to `after` where its torque is taken with the opposite sign."""

    joint: str
    before: float
    after: float

    def __str__(self) -> str:
        return (
            f"torque of {self.joint} seems to have the opposite sign: with the sign flipped, its error falls from"
            f" {100 * self.before:.3g} to"
            f" {100 * self.after:.3g} % of its torque. Check its sign and side in the log ([drive] measured), the sign of"
            f" its ratio, and the joint's axis in the URDF."
        )


def opposite_sign(information: Information, base: BaseReduction, joints: Sequence[str]) -> OppositeSign | None:
    """The joint whose torque explains all the rows far better with the opposite sign, or None. `information`: over all columns of `base`.

    Where a joint shares no link with any other, both signs fit alike: then its own parameters have the wrong sign
    (`ident.evaluation.doubts`)."""
    used = information.counts >= _FEW_ROWS
    order = order_of(base)
    if used.sum() < 2 or information.k != base.count:
        return None
    before = _errors(information, order)
    if not np.any(before[used] > _POOR):
        return None
    best: OppositeSign | None = None
    least = -np.log(_FALL)
    for j in np.flatnonzero(used):
        factors = information.factors.copy()
        factors[j, :, -1] *= -1.0
        after = _errors(replace(information, factors=factors), order)
        fall = float(np.sum(np.log(np.maximum(after[used], 1e-12)) - np.log(np.maximum(before[used], 1e-12))))
        worst = _HALF * before[used].max()
        if fall < least and after[used].max() < worst and after[j] < _HALF * before[j]:
            best, least = OppositeSign(joints[int(j)], float(before[j]), float(after[j])), fall
    return best


def _errors(information: Information, order: list[int]) -> Array:
    """Relative error of each row (n,) after weighted least squares; 1 where there is no torque."""
    solution, _ = reweighted(information, order, iterations=_PASSES)
    values = np.zeros(information.k)
    values[solution.columns] = solution.values
    torque = information.torque_squares()
    return np.sqrt(np.where(torque > 0, information.residual_squares(values) / np.where(torque > 0, torque, 1.0), 1.0))
