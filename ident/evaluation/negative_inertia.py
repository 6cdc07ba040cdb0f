"""Inertia about a joint's own axis that a fit makes negative at some position: no body has it, whatever the motion was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..effects.rigid_body import RigidBody
from ..physical.structure import InertiaStructure

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray

#: Positions looked at, the same in every run. Between them the inertia about an axis varies smoothly.
_POSITIONS, _SEED = 64, 0
#: So many joints are listed.
_LISTED = 4


def negative_inertia(estimate: Estimate, deviations: float) -> str:
    """A sentence on joints whose inertia H_jj(q) is negative by more than `deviations` standard deviations; "" where none is.

    Every base parameter may have either sign where lengths or other links' inertia are grouped into it; H_jj(q), reflected rotor inertia
    included, may not. It is linear in the base parameters, so its standard deviation follows from their covariance. One position within
    the limits is enough to exclude the values."""
    model = estimate.model
    if estimate.covariance is None or not any(isinstance(effect, RigidBody) for effect in model.effects):
        return ""
    structure = InertiaStructure.from_model(model, estimate.base)
    lower, upper, _ = structure.ranges(limits=True)
    q = lower + (upper - lower) * np.random.default_rng(_SEED).random((_POSITIONS, structure.n))
    units = np.eye(structure.nv)[structure.nv - structure.n :]
    rows = structure.quadratic_rows(np.repeat(q, structure.n, axis=0), np.tile(units, (_POSITIONS, 1)))
    value = (rows @ estimate.values).reshape(_POSITIONS, structure.n)
    variance = np.einsum("Nb,bc,Nc->N", rows, estimate.covariance, rows, optimize=True).reshape(value.shape)
    std = np.sqrt(np.maximum(variance, 0.0))
    with np.errstate(invalid="ignore"):  # what the data do not determine has no finite deviation, and says nothing
        below = np.where(np.isfinite(std), value + deviations * std, np.inf)
    worst = np.argmin(below, axis=0)
    found = [(j, int(k)) for j, k in enumerate(worst) if below[k, j] < 0.0]
    if not found:
        return ""
    listed = ", ".join(
        f"{structure.joint_names[j]} {value[k, j]:.3g} ± {std[k, j]:.2g} {'kg' if structure.prismatic[j] else 'kg m²'}"
        for j, k in found[:_LISTED]
    ) + (f" and {len(found) - _LISTED} more" if len(found) > _LISTED else "")
    return (
        f"the inertia about a joint's own axis is negative at a position within its limits: {listed}. No robot has it, and noise does not"
        " explain it. Possible causes: columns of two joints that are swapped, torque with the opposite sign or from the other side of the"
        " drive, a clock that is off, or an effect that the model lacks."
    )
