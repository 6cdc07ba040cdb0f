"""Repair: the nearest set of base parameters that is possible, or consistent, in the metric of the estimate's covariance.

Every result is judged again before it is returned: what fails its own judgement is an error, not a repair. A repair removes
what cannot be; it does not remove an estimator's bias."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.short_repr import ShortRepr
from ..errors import ConfigurationError, UnsupportedError, unknown_name
from .binding import Binding, binding_constraints
from .bounds import Bounds, Metric, Prior
from .conic import SolverError, solver_available
from .consistent import Consistent, judge_consistent
from .constrained import ConsistentFit, Settling, fit_consistent
from .cuts import nearest_by_cuts
from .log_cholesky import fit_log_cholesky
from .modification import modify_by_cone
from .possible import Possible, judge_possible
from .search import typical_diagonal
from .stepwise import repair_stepwise
from .structure import InertiaStructure
from .target import Target, covariance_root, mahalanobis

if TYPE_CHECKING:
    from ..problem.information import Information

Array = np.ndarray


#: Spread of the prior that keeps the factors of the fallback from running away: changes of thirty times a link's own inertia count.
_WEAK = 30.0
#: How often a repair asks for twice the margin, or at least this, and the most seconds of its own judgement.
_ENLARGED = 4
_LEAST = 1e-3
_JUDGED = 20.0


class RepairMethod(StrEnum):
    """How a set is repaired.

    CONE: the dissertation's Steps 1 to 4, for a few joints. STEPWISE: the least change joint by joint from the tip. POSSIBLE: nearest
    set with H(q) > 0. CONSISTENT: nearest set with real links. FIT: the constrained fit from the information block, which is what a user
    should use."""

    CONE = "cone"
    STEPWISE = "stepwise"
    POSSIBLE = "possible"
    CONSISTENT = "consistent"
    FIT = "fit"


@dataclass(frozen=True, eq=False, repr=False)
class Repair(ShortRepr):
    """A repaired set. `values` (b,) and, for consistent ones, `standard` (k,) parameters that give them.

    `distance`: change in standard deviations (Mahalanobis) of the estimate's covariance; `changes`: base name -> (before, after, change
    in own standard deviations). `possible`, `consistent`: its own judgement. `binding`: which links and signs cost what (methods that
    make links). `errors`: data set -> torque error before and after, and on held-out data the relative change of its square ± std."""

    method: RepairMethod
    values: Array
    standard: Array | None
    distance: float
    changes: dict[str, tuple[float, float, float]]
    possible: Possible
    consistent: Consistent | None
    binding: Binding | None
    how: str
    seconds: float
    errors: dict[str, dict[str, Any]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    def text(self) -> str:
        """A few lines for people."""
        lines = [
            f"repair ({self.method.value}): {self.distance:.4g} standard deviations from the estimate, by {self.how}",
            self.possible.text(),
        ]
        if self.consistent is not None:
            lines.append(self.consistent.text())
        most = sorted(self.changes.items(), key=lambda item: -abs(item[1][2]))[:6]
        lines += [f"  {name}: {before:.4g} -> {after:.4g} ({change:+.1f} std)" for name, (before, after, change) in most if change]
        for name, error in self.errors.items():
            before, after = error["before"]["relative_all"], error["after"]["relative_all"]
            lines.append(f"torque error on {name} data: {100 * before:.4g} % before, {100 * after:.4g} % after{_chance(error)}")
        if self.binding is not None:
            lines += self.binding.sentences()
        return "\n".join([*lines, *self.notes])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "method": self.method.value,
            "values": {name: after for name, (_, after, _) in self.changes.items()},
            "standard": None if self.standard is None else self.standard.tolist(),
            "distance": self.distance,
            "changes": {name: {"before": b, "after": a, "std": c} for name, (b, a, c) in self.changes.items()},
            "possible": self.possible.to_dict(),
            "consistent": None if self.consistent is None else self.consistent.to_dict(),
            "binding": None if self.binding is None else self.binding.to_dict(),
            "how": self.how,
            "seconds": self.seconds,
            "torque_error": self.errors,
            "notes": list(self.notes),
        }


def repair(
    structure: InertiaStructure,
    values: Array,
    covariance: Array | None,
    method: RepairMethod | str = RepairMethod.CONSISTENT,
    *,
    unseen: Array | None = None,
    triangle: tuple[Array, Array] | None = None,
    bounds: Bounds | None = None,
    prior: Prior | None = None,
    near: Prior | None = None,
    margin: float = 1e-2,
    limits: bool = False,
    data: dict[str, Information] | None = None,
    time_limit: float = 60.0,
) -> Repair:
    """Repair base values (b,) with their covariance (b, b). `unseen` (b, u): directions that the data did not see, and that cost nothing.

    `triangle` (R, z): the whitened information block for method "fit" (`Information.combined` with weights 1/variance). `bounds`,
    `prior`: what else is known of the links (consistent and fit). `near`: links on which what the data hardly see is settled without a
    prior (`Settling`; fit: within one standard deviation, consistent: one hundredth of the squared distance). `margin`: least
    eigenvalue of H, relative to its typical diagonal, for stepwise and possible (stepwise asks up to twice as much of the outer joints'
    blocks, so that what couples them to the inner ones can be outweighed); for cone, least value of its minors, of their root mean
    square; enlarged, a few times at most, where the result does not pass its own judgement: `how` tells. `limits`: possible within the
    joint limits only.
    `data`: name -> information block on which the torque error before and after is reported ("fitted", "held out").
    Raises InfeasibleError, SolverError, ConfigurationError."""
    start = time.perf_counter()
    if method not in list(RepairMethod):
        raise unknown_name("repair method", str(method), [m.value for m in RepairMethod])
    method = RepairMethod(method)
    values = structure.check_values(values)
    covariance, notes = _known_to(structure, values, covariance)
    root = covariance_root(covariance)
    standard: Array | None = None
    binding: Binding | None = None
    if method in (RepairMethod.CONE, RepairMethod.STEPWISE, RepairMethod.POSSIBLE):
        if bounds is not None or prior is not None:
            raise UnsupportedError(
                f"repair method {method.value!r} knows no links, so it takes neither bounds nor a prior; 'consistent' and 'fit' do."
            )
        repaired, how, possible = _inside(structure, values, covariance, root, unseen, method, margin, limits, time_limit)
    else:
        known = Target.from_covariance(values, covariance, unseen)
        target, settling = (known, Settling(near, share=0.01)) if method != RepairMethod.FIT else (_fitted(triangle), Settling(near))
        fit = consistent_fit(structure, target, bounds=bounds, prior=prior, settling=settling)
        repaired, standard, how, notes = fit.values, fit.standard, fit.method, notes + fit.notes
        if solver_available():
            binding = binding_constraints(structure, known, bounds=bounds, prior=prior)
        possible = judge_possible(structure, repaired, covariance=covariance, limits=limits, time_limit=min(time_limit, _JUDGED))
    consistent, unsolved = _consistency(structure, repaired, needed=standard is not None)
    _require_passed(method, possible, consistent if standard is not None else None)
    errors = {
        name: {"before": torque_errors(block, values), "after": torque_errors(block, repaired)} for name, block in (data or {}).items()
    }
    return Repair(
        method, repaired, standard, mahalanobis(root, repaired - values, unseen),
        _changes(structure, values, repaired, covariance), possible, consistent, binding, how,
        time.perf_counter() - start, errors, notes + unsolved,
    )  # fmt: skip


def _changes(structure: InertiaStructure, values: Array, repaired: Array, covariance: Array) -> dict[str, tuple[float, float, float]]:
    """Of each base parameter: before, after, and the change in standard deviations."""
    std = np.sqrt(np.diagonal(covariance))
    return {
        name: (float(b), float(a), float((a - b) / s) if s > 0 else (0.0 if a == b else np.inf))
        for name, b, a, s in zip(structure.base_names, values, repaired, std, strict=True)
    }


def _fitted(triangle: tuple[Array, Array] | None) -> Target:
    """The target of method "fit"."""
    if triangle is None:
        raise ConfigurationError("repair method 'fit' works from the information block: give triangle=(R, z), or use 'consistent'.")
    return Target.from_information(*triangle)


def _require_passed(method: RepairMethod, possible: Possible, consistent: Consistent | None) -> None:
    """Refuse a result that does not pass its own judgement."""
    failed = possible.text() if not possible.possible else consistent.text() if consistent is not None and not consistent.consistent else ""
    if failed:
        raise SolverError(f"repair ({method.value}): the result does not pass its own judgement ({failed}).")


def _known_to(structure: InertiaStructure, values: Array, covariance: Array | None) -> tuple[Array, tuple[str, ...]]:
    """The covariance (b, b) of base values, and what is to be said where none is known. Raises ConfigurationError for one that does not
    fit."""
    notes: tuple[str, ...] = ()
    if covariance is None:
        covariance = np.diag((0.1 * np.abs(values) + 1e-6 * float(np.abs(values).max(initial=1.0))) ** 2)
        notes = ("no covariance is known: every parameter counts as known to 10 % of itself.",)
    covariance = np.asarray(covariance, float)
    if covariance.shape != (structure.b, structure.b):
        raise ConfigurationError(f"the covariance has shape {covariance.shape}, but there are {structure.b} base parameters.")
    return covariance, notes


def _consistency(structure: InertiaStructure, values: Array, *, needed: bool) -> tuple[Consistent | None, tuple[str, ...]]:
    """Whether a repaired set is consistent, with a note where its judgement fails and is not `needed`: only links are made consistent."""
    if not solver_available():
        return None, ()
    try:
        return judge_consistent(structure, values), ()
    except SolverError as error:
        if needed:
            raise
        return None, (f"whether it is consistent was not decided: {error}",)


def consistent_fit(
    structure: InertiaStructure,
    target: Target,
    *,
    bounds: Bounds | None = None,
    prior: Prior | None = None,
    method: str = "auto",
    settling: Settling | None = None,
) -> ConsistentFit:
    """Best consistent base values for a target: by linear matrix inequalities, or by log-Cholesky factors where the solver is missing.

    `method`: "auto", "lmi" or "log_cholesky"; the result says which one it was. `settling`: see there (its links are a weak prior
    of the factors)."""
    if method == "auto":
        method = "lmi" if solver_available() else "log_cholesky"
    if method == "lmi":
        return fit_consistent(structure, target, bounds=bounds, prior=prior, settling=settling)
    if method != "log_cholesky":
        raise unknown_name("method of the consistent fit", method, ["auto", "lmi", "log_cholesky"])
    if prior is None and settling is not None and settling.near is not None:
        prior = replace(settling.near, metric=Metric.QUADRATIC, spread=_WEAK)
    return fit_log_cholesky(structure, target, bounds=bounds, prior=prior)


def _chance(error: dict[str, Any]) -> str:
    """Whether a change of the error on held-out data is more than chance, in words."""
    if "change" not in error or not error["change_std"] > 0:
        return ""
    t = error["change"] / error["change_std"]
    verdict = "no more than chance" if abs(t) < 2 else "more than chance"
    return f" ({verdict}: the squared error changes by {100 * error['change']:+.2g} ± {100 * error['change_std']:.2g} %)"


def torque_errors(information: Information, values: Array) -> dict[str, Any]:
    """Torque error of base values on an information block: rms (N m, N) and relative per measured row, and over all rows."""
    residual, torque = information.residual_squares(values), information.torque_squares()
    counts = np.maximum(information.counts, 1)
    total = float(torque.sum())
    return {
        "rms": np.sqrt(residual / counts).tolist(),
        "relative": np.sqrt(residual / np.where(torque > 0, torque, 1.0)).tolist(),
        "relative_all": float(np.sqrt(residual.sum() / total)) if total > 0 else 0.0,
    }


def unseen_root(values: Array, unseen: Array) -> Array:
    """Factor R (b, u) of the covariance R Rᵀ that directions `unseen` (b, u) have: known to no better than the largest of the values (b,),
    which is next to nothing, but enough for a least distance."""
    return np.asarray(10.0 * float(np.abs(values).max(initial=1.0)) * unseen)


def _inside(
    structure: InertiaStructure, values: Array, covariance: Array, root: Array, unseen: Array | None, method: RepairMethod, margin: float,
    limits: bool, time_limit: float,
) -> tuple[Array, str, Possible]:  # fmt: skip
    """A repaired set, how, and its own judgement.

    A repair aims inside the possible sets by a margin. Its search sees positions, the judgement proves what lies between them: where it
    finds one that the search missed, the aim is moved farther inside."""

    def aimed(wanted: float) -> tuple[Array, str, Possible]:
        repaired, how = _possible(structure, values, covariance, root, unseen, method, wanted, limits, time_limit)
        judged = judge_possible(structure, repaired, covariance=covariance, limits=limits, time_limit=min(time_limit, _JUDGED))
        return repaired, how, judged

    found = aimed(margin)
    for turn in range(1, _ENLARGED + 1):
        if found[2].possible:
            break
        wanted = max(margin, 0.5 * _LEAST) * 2.0**turn
        repaired, how, judged = aimed(wanted)
        found = repaired, f"{how}; with a margin of {wanted:.3g}, as less did not pass its own judgement", judged
    return found


def _possible(
    structure: InertiaStructure, values: Array, covariance: Array, root: Array, unseen: Array | None, method: RepairMethod, margin: float,
    limits: bool, time_limit: float,
) -> tuple[Array, str]:  # fmt: skip
    if unseen is not None and unseen.shape[1]:
        wide = unseen_root(values, unseen)
        root = np.concatenate([root, wide], axis=1)
        covariance = covariance + wide @ wide.T
    std = np.sqrt(np.diagonal(covariance))
    if method == RepairMethod.CONE:
        if limits:
            raise UnsupportedError("repair method 'cone' is for whole turns of every joint: leave out the limits, or use 'possible'.")
        done = modify_by_cone(structure, values, std, margin=margin)
        return done.values, done.text()
    lower, upper, _ = structure.ranges(limits)
    weight = typical_diagonal(structure, values, lower, upper)
    if method == RepairMethod.STEPWISE:
        repaired, steps = repair_stepwise(
            structure, values, std, weight=weight, margin=margin, lower=lower, upper=upper, time_limit=time_limit
        )
        changed = [step.joint for step in steps if step.changes]
        return repaired, "the least change joint by joint from the tip" + (
            f" (changed: {', '.join(changed)})" if changed else " (nothing to change)"
        )
    found = nearest_by_cuts(structure, values, root, weight=weight, margin=margin, lower=lower, upper=upper, time_limit=time_limit)
    return found.values, f"cutting planes ({found.cuts} half-spaces in {found.rounds} rounds)"
