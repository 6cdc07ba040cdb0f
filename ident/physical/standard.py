"""From base to standard parameters: real links, nearest to the nominal ones, among all that give exactly these base parameters."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..robots.parameters import LINK_SYMBOLS
from .bounds import Bounds, Metric, Prior
from .conic import SolverError, solver_available
from .consistent import consistent_with_zero, zero_notes
from .constrained import ConsistentFit, fit_consistent, prior_distance
from .log_cholesky import fit_log_cholesky
from .pseudo_inertia import smallest_eigenvalues
from .structure import InertiaStructure
from .target import Target

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class StandardParameters:
    """All parameters with real links: `values` (k,), `inertial` (10 nb,) of them in Pinocchio's order.

    `distance` from the nominal links in the metric `metric` (None without nominal links); `error`: largest relative difference between
    the base parameters they give and the wanted ones."""

    structure: InertiaStructure
    values: Array
    distance: float | None
    metric: str
    error: float
    method: str
    seconds: float
    notes: tuple[str, ...] = ()

    @property
    def inertial(self) -> Array:
        """(10 nb,): ten parameters a moving link."""
        return self.values[self.structure.inertial]

    def text(self) -> str:
        """A table of the links for people."""
        lines = [
            f"standard parameters by {self.method}"
            + ("" if self.distance is None else f"; {self.metric} distance from the nominal links {self.distance:.4g}")
        ]
        lines.append("link".ljust(24) + "".join(s.rjust(11) for s in LINK_SYMBOLS))
        for name, row in zip(self.structure.body_names, self.inertial.reshape(-1, 10), strict=True):
            lines.append(name[:24].ljust(24) + "".join(f"{x:11.4g}" for x in row))
        return "\n".join([*lines, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        links = {
            name: dict(zip(LINK_SYMBOLS, row.tolist(), strict=True))
            for name, row in zip(self.structure.body_names, self.inertial.reshape(-1, 10), strict=True)
        }
        taken = set(self.structure.inertial.tolist())
        others = {n: float(v) for i, (n, v) in enumerate(zip(self.structure.names, self.values, strict=True)) if i not in taken}
        return {
            "links": links,
            "drive": others,
            "distance": self.distance,
            "metric": self.metric,
            "error": self.error,
            "method": self.method,
            "seconds": self.seconds,
            "notes": list(self.notes),
        }


def standard_parameters(
    structure: InertiaStructure,
    values: Array,
    *,
    prior: Prior | None = None,
    bounds: Bounds | None = None,
    covariance: Array | None = None,
) -> StandardParameters:
    """Real links that give base values (b,), nearest to the nominal ones.

    `prior` holds those (its spread does not matter); without it light and compact links are taken. `covariance` (b, b) of the base
    values: friction below zero by less than two of its standard deviations becomes zero, and a note says so.

    Raises InfeasibleError where the base values are not consistent (repair them first) or the bounds leave nothing."""
    start = time.perf_counter()
    values = structure.check_values(values)
    zero = consistent_with_zero(structure, values, structure.null_space, covariance)
    if zero:
        # Such a coefficient is a base parameter of its own: nothing else depends on it.
        at = [structure.names.index(name) for name in zero]
        values = values - structure.regroup[:, at] @ (structure.lift[at] @ values)
    target = Target.fixed(values)
    metric = None if prior is None else prior.metric
    if not solver_available():
        fit = fit_log_cholesky(structure, target, bounds=bounds, prior=prior)
    else:
        fit, metric = _nearest(structure, target, bounds, prior)
    notes = fit.notes
    if zero:
        notes += (*zero_notes(zero), "those coefficients were set to zero: a negative one would drive the motion.")
    if prior is not None and metric != prior.metric:
        instead = "the quadratic metric was used" if metric else "they are consistent, but not the nearest to the nominal ones"
        notes += (f"these links lie so near to the border that the {prior.metric.value} metric could not be minimised: {instead}.",)
    if prior is None:
        notes += ("no nominal inertials are known: among the links that give the same torque, light and compact ones were chosen.",)
    else:
        unknown = [structure.body_names[i] for i, root in enumerate(prior.roots(structure)) if root is None]
        if unknown:
            notes += (f"no nominal inertials are known of {', '.join(unknown)}: light and compact bodies were chosen.",)
    size = np.maximum(np.abs(values), 1e-6 * float(np.abs(values).max(initial=1.0)))
    error = float(np.abs((structure.regroup @ fit.standard - values) / size).max(initial=0.0))
    assert np.all(smallest_eigenvalues(fit.standard[structure.inertial]) > 0)
    distance = None if prior is None else prior_distance(structure, prior, fit.standard)
    return StandardParameters(
        structure,
        fit.standard,
        distance,
        "none" if prior is None else prior.metric.value,
        error,
        fit.method,
        time.perf_counter() - start,
        notes,
    )


def _nearest(
    structure: InertiaStructure, target: Target, bounds: Bounds | None, prior: Prior | None
) -> tuple[ConsistentFit, Metric | None]:
    """The links nearest to nominal, and the metric in which they are: on the very border only a simpler one can be minimised."""
    if prior is None:
        return fit_consistent(structure, target, bounds=bounds), None
    for metric in dict.fromkeys((prior.metric, Metric.QUADRATIC)):
        try:
            return fit_consistent(structure, target, bounds=bounds, prior=replace(prior, metric=metric)), metric
        except SolverError:
            continue
    return fit_consistent(structure, target, bounds=bounds), None
