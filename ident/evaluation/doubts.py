"""Doubts about a fit that a glance raises: values that cannot be, data held out of another kind, data that were not held out at all."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.text import counted
from ..errors import DataError
from ..estimators.least_squares import WeightedLeastSquares
from ..problem.opposite_signs import negative_share, opposite_sign
from .against_nominal import factor_doubt, size_doubt, zero_doubt
from .contrary_stretches import contrary
from .misreadings import beside_the_usual, misassigned, misreading
from .negative_inertia import negative_inertia

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray

#: `use` of a log, beside its path, that was held out from a fit.
HELD_OUT = "held_out"
#: A value is beyond its bound by more than scatter where it is so by so many of its standard deviations.
_SURELY = 5.0
#: A joint's error on data held out that is so many times that on the fitted ones, and this share of its torque, is no scatter.
_TIMES = 4.0
_SHARE = 0.1
_FEW_ROWS = 30
#: Share of what cannot be negative that is so where every torque is turned: coupling leaves the sign of few.
_NEARLY_ALL = 0.8
#: So many rows of a joint must be left to tell its noise: of five, 95 % lie within 2.6 deviations, not 2.
_LEFT = 5.0
#: Coefficients of a sum below this are rounding.
_ROUNDING = 1e-9
#: So many names are listed.
_LISTED = 6


def doubts(estimate: Estimate) -> tuple[str, ...]:
    """Sentences for an estimate's warnings; none where nothing is to be said."""
    every = all_turned(estimate)
    if estimate.information is not None and estimate.information.n != estimate.model.robot.n:  # one row for the whole robot (energy)
        return tuple(said for said in (every or _impossible(estimate), _apart(estimate)) if said)
    wrong = (every,) if every else (_impossible(estimate), _cause(estimate))
    return tuple(said for said in (*wrong, _few(estimate), _apart(estimate)) if said)


def fitted_as_well(fitted: Iterable[Mapping[str, Any]], held: Iterable[Mapping[str, Any]]) -> str:
    """A sentence on logs that are both fitted and held out, from their inputs (path and SHA-256); "" where there are none."""
    known = {one["sha256"] for one in fitted if one.get("sha256")}
    again = dict.fromkeys(str(one["path"]) for one in held if one.get("sha256") in known)
    if not again:
        return ""
    return f"{', '.join(again)} is used for the fit and for validation: the held-out error is computed on data that the fit has seen."


def seen_by(fitted: Iterable[Mapping[str, Any]], logs: Iterable[Mapping[str, Any]]) -> str:
    """A sentence on whole logs (path and SHA-256) among the inputs of a fit that are to judge it; "" where there are none."""
    known = {one["sha256"] for one in fitted if one.get("use") != HELD_OUT and one.get("sha256")}
    again = dict.fromkeys(str(one["path"]) for one in logs if one.get("sha256") in known)
    if not again:
        return ""
    return f"the fit has seen {', '.join(again)}: the error on it is not that of held-out data. Judge the fit by another log."


def counted_twice(fitted: Iterable[Mapping[str, Any]]) -> str:
    """A sentence on fitted logs of the same content under several names, from their inputs; "" where there are none."""
    first: dict[str, str] = {}
    same = []
    for one in fitted:
        known = first.setdefault(one.get("sha256") or str(one["path"]), str(one["path"]))
        if known != str(one["path"]):
            same.append(f"{one['path']} has the same content as {known} holds")
    return (
        f"{', '.join(dict.fromkeys(same))}: its samples count twice, and standard deviations are too small. Leave one out." if same else ""
    )


def all_turned(estimate: Estimate) -> str:
    """A sentence where nearly all that cannot be negative is so: every torque was recorded with the opposite sign; "" otherwise.

    Friction, rotor inertia and inertia about a joint's own axis have a sign that no motion changes. A sound log has all of them positive,
    one joint with the wrong sign its own alone."""
    wrong, told = negative_share(estimate.values, estimate.std, *_bounds(estimate))
    if wrong < 2 or wrong < _NEARLY_ALL * told:
        return ""
    return (
        f"every torque seems to have the opposite sign: {wrong} of {told} friction and inertia parameters that cannot be"
        f" negative are significantly negative. Flip the sign with [drive] torque_sign = -1 in a study file, or check the"
        f" direction of the joints in the URDF; settle this before anything else."
    )


def settled_first(estimate: Estimate) -> str:
    """A sentence on what has to be settled before anything else is looked for in a log: columns that were reversed or exchanged, gravity in
    another direction; "" where there is none."""
    return misassigned(estimate) or _turned(estimate)


def log_doubt(estimate: Estimate) -> str:
    """A sentence on what a log has wrong, whatever the robot carries; "" where there is nothing: every torque turned, a stretch that
    contradicts the rest, columns, units, clocks."""
    return all_turned(estimate) or _of_the_log(estimate)


def _impossible(estimate: Estimate) -> str:
    """Parameters, and sums of them, that lie beyond their bounds by more than scatter."""
    margin = np.where(np.isfinite(estimate.std), _SURELY * estimate.std, np.inf)
    low, high = _bounds(estimate)
    beyond = (estimate.values < low - margin) | (estimate.values > high + margin)
    found = [f"{estimate.names[i]} = {estimate.values[i]:.3g} ± {estimate.std[i]:.2g}" for i in np.flatnonzero(beyond)]
    if not found:
        return negative_inertia(estimate, _SURELY)
    listed = ", ".join(found[:_LISTED]) + (f" and {len(found) - _LISTED} more" if len(found) > _LISTED else "")
    return (
        f"{listed}: a physically impossible sign that noise does not explain. Possible causes: torque recorded with the"
        f" opposite sign, a wrong side or ratio of the drive, or an effect that the model lacks (`ident diagnose`)."
    )


def _turned(estimate: Estimate) -> str:
    """A joint whose torque fits far better with the opposite sign."""
    if estimate.information is None:
        return ""
    found = opposite_sign(estimate.information, estimate.base, estimate.model.robot.joint_names)
    return "" if found is None else str(found)


def _cause(estimate: Estimate) -> str:
    """What the log has wrong, the surest first: what follows from one cause is not blamed on the next."""
    return _of_the_log(estimate) or _of_the_urdf(estimate)


def _of_the_urdf(estimate: Estimate) -> str:
    """What sets the fit apart from the URDF, unless what drives usually do accounts for it: a constant torque turns a link as a zero does.

    It is the question that every mistake of a log is asked (`misreadings`), and that the findings of a diagnosis settle."""
    said = _against_nominal(estimate)
    problem = beside_the_usual(estimate) if said else None
    if problem is None or len(problem.model.effects) == len(estimate.model.effects):
        return said
    return _against_nominal(WeightedLeastSquares().solve(problem))


def _against_nominal(estimate: Estimate) -> str:
    return zero_doubt(estimate) or factor_doubt(estimate) or size_doubt(estimate)


def _of_the_log(estimate: Estimate) -> str:
    return contrary(estimate) or misreading(estimate) or _turned(estimate)


def _bounds(estimate: Estimate) -> tuple[Array, Array]:
    """Least and largest value (b,) of each base parameter, from the bounds of all that are grouped in it."""
    share = np.where(np.abs(estimate.base.regroup) > _ROUNDING, estimate.base.regroup, 0.0)
    lower, upper = (np.array([getattr(p, side) for p in estimate.base.parameters]) for side in ("lower", "upper"))
    with np.errstate(invalid="ignore"):  # nothing of what has no bound
        ends = [np.where(share == 0.0, 0.0, share * side) for side in (lower, upper)]
    return np.minimum(*ends).sum(axis=1), np.maximum(*ends).sum(axis=1)


def _few(estimate: Estimate) -> str:
    """Joints of which the fit takes up nearly all the rows that there are: next to none is left that could tell their noise."""
    if estimate.information is None:
        return ""
    counts, taken = estimate.information.counts, _taken_up(estimate)
    few = [
        f"{joint} ({int(counts[j])}; the fit absorbs {taken[j]:.2g} of them)"
        for j, joint in enumerate(estimate.model.robot.joint_names)
        if counts[j] > 0 and taken[j] >= 1.0 and counts[j] - taken[j] < _LEFT
    ]
    if not few:
        return ""
    return (
        f"few rows are usable for {', '.join(few)}: their noise level is poorly known, and the parameters they determine"
        f" may be off by far more than the standard deviations say. Record more motion there (`ident check` says why rows were left out)."
    )


def _taken_up(estimate: Estimate) -> Array:
    """How many of each joint's rows (n,) the fit takes up: the trace of its part of the hat matrix."""
    from scipy.linalg import solve_triangular

    assert estimate.information is not None
    names = list(estimate.information.names)
    information = estimate.information.selected(np.array([names.index(name) for name in estimate.names], int))
    root = information.combined(estimate.weights)[0]
    if not np.all(np.abs(np.diag(root)) > 0.0):
        return np.zeros(information.n)
    leverage = [solve_triangular(root, own[:-1, :-1].T, trans="T") for own in information.factors]
    return np.asarray(estimate.weights * [np.sum(own**2) for own in leverage])


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
        f"the error on held-out data is far larger than on the fitted data: {', '.join(worst)}. Either the held-out logs"
        f" differ (signs, units, a load, motion outside the range), or the fitted logs do not determine the parameters"
        " that the held-out ones need."
    )


def require_rows(estimate: Estimate) -> None:
    """Refuse a fit of as many parameters as rows: it passes through every row, and says nothing (DataError)."""
    if estimate.samples <= len(estimate.values):
        raise DataError(
            f"{counted(estimate.samples, 'usable row')} for {counted(len(estimate.values), 'parameter')}: a fit would"
            f" pass through every row and mean nothing. Give more data, or a higher cut-off (`ident check` says what limits it),"
            " or fewer effects."
        )
