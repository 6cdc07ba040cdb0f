"""Doubts about a fit that a glance raises: values that cannot be, data held out of another kind, data that were not held out at all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from .estimate import Estimate

#: A value is beyond its bound by more than scatter where it is so by so many of its standard deviations.
_SURELY = 5.0
#: A joint's error on data held out that is so many times that on the fitted ones, and this share of its torque, is no scatter.
_TIMES = 4.0
_SHARE = 0.1
_FEW_ROWS = 30
#: So many names are listed.
_LISTED = 6


def doubts(estimate: Estimate) -> tuple[str, ...]:
    """Sentences for an estimate's warnings; none where nothing is to be said."""
    return tuple(said for said in (_impossible(estimate), _apart(estimate)) if said)


def fitted_as_well(fitted: Iterable[Mapping[str, Any]], held: Iterable[Mapping[str, Any]]) -> str:
    """A sentence on logs that are both fitted and held out, from their inputs (path and SHA-256); "" where there are none."""
    known = {one["sha256"] for one in fitted if one.get("sha256")}
    again = dict.fromkeys(str(one["path"]) for one in held if one.get("sha256") in known)
    if not again:
        return ""
    return f"{', '.join(again)} is fitted as well as validated on: the error called held out is that of data the fit has seen."


def _impossible(estimate: Estimate) -> str:
    """Parameters of their own (not grouped with others) that lie beyond their bounds by more than scatter."""
    place = {p.name: i for i, p in enumerate(estimate.base.parameters)}
    alone = np.count_nonzero(estimate.base.regroup, axis=1) == 1
    found = []
    for name, value, std, single in zip(estimate.names, estimate.values, estimate.std, alone, strict=True):
        p = estimate.base.parameters[place[name]]
        margin = _SURELY * std if np.isfinite(std) else np.inf
        if single and (value < p.lower - margin or value > p.upper + margin):
            found.append(f"{name} = {value:.3g} ± {std:.2g}")
    if not found:
        return ""
    listed = ", ".join(found[:_LISTED]) + (f" and {len(found) - _LISTED} more" if len(found) > _LISTED else "")
    return (
        f"{listed}: no such thing has that sign, and noise does not explain it. A torque recorded with the opposite sign does that, a wrong"
        " side or ratio of the drive, or something that the model lacks (`ident diagnose`)."
    )


def _apart(estimate: Estimate) -> str:
    """Joints on which the error on held-out data is of another kind than that on the fitted ones."""
    held, fit = estimate.heldout_error, estimate.fit_error
    if held is None:
        return ""
    with np.errstate(invalid="ignore", divide="ignore"):
        times = held.rms / fit.rms
    worst = [
        f"{joint} ({100 * held.relative[j]:.3g} % of its torque, {times[j]:.2g} times that of the fit)"
        for j, joint in enumerate(estimate.model.robot.joint_names)
        if times[j] > _TIMES and held.relative[j] > _SHARE and min(held.rows[j], fit.rows[j]) >= _FEW_ROWS
    ]
    if not worst:
        return ""
    return (
        f"the error on held-out data is of another kind than that on the fitted ones: {', '.join(worst)}. Either those logs differ (signs,"
        " units, a load, motion outside the range), or the fitted ones do not tell the parameters that the others ask for."
    )
