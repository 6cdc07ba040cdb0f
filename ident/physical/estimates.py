"""Repair and payload for estimates: the same functions, with structure, metric and information taken from the estimate itself."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from .._utils.threads import with_one_blas_thread
from ..errors import ConfigurationError
from ..estimate.record import EstimateRecord
from ..estimate.status import StatusCode
from ..statistics.torque_error import JudgedOn, TorqueError
from .bounds import Bounds, Prior, reference_prior
from .judgement import Subject, subject_of
from .payload import PayloadEstimate, payload_from_logs
from .repairs import Repair, RepairMethod, repair, unseen_root
from .structure import InertiaStructure

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..signals.signals import Signals

Array = np.ndarray


def triangle_of(estimate: Estimate) -> tuple[Array, Array] | None:
    """The whitened information block (R, z) over the model's base parameters, or None where the estimate carries none that fits."""
    information = estimate.information
    if information is None or information.k != estimate.model.base.count:
        return None
    R, z, _ = information.combined(np.asarray(estimate.weights, float))
    return R, z


@with_one_blas_thread
def repair_estimate(
    estimate: Estimate,
    method: RepairMethod | str = RepairMethod.FIT,
    *,
    held: Signals | None = None,
    bounds: Bounds | None = None,
    prior: Prior | None = None,
    margin: float = 1e-2,
    limits: bool = False,
    time_limit: float = 60.0,
) -> Repair:
    """Repair an estimate; see `repair`. `held`: prepared signals that no fit saw, on which the error before and after is reported too.

    Raises ConfigurationError where method "fit" is asked of an estimate without an information block.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", held=0)
    >>> bool(ident.repair(estimate).distance < 5)
    True
    """
    subject = subject_of(estimate)
    triangle = triangle_of(estimate)
    near, notes = reference_prior(estimate.model.robot, subject.structure)
    data = {}
    if triangle is not None and estimate.information is not None:
        data["fitted"] = estimate.information
    unseen = None
    if held is not None:
        # Rows that the estimate leaves out count neither before nor after.
        unseen = estimate.problem_on(held)
        data["held out"] = unseen.information
    found = repair(
        subject.structure,
        subject.values,
        subject.covariance,
        method,
        unseen=subject.unseen,
        triangle=triangle,
        bounds=bounds,
        prior=prior,
        near=near,
        margin=margin,
        limits=limits,
        data=data,
        time_limit=time_limit,
    )
    if found.standard is not None and prior is None:
        found = replace(found, notes=(*found.notes, *notes))
    if unseen is None:
        return found
    change, std = error_change(unseen.residual(subject.values), unseen.residual(found.values))
    errors = {**found.errors, "held out": {**found.errors["held out"], "change": change, "change_std": std}}
    return replace(found, errors=errors)


def error_change(before: Array, after: Array, blocks: int = 20) -> tuple[float, float]:
    """Relative change of the squared torque error from residuals `before` to `after` (M, n), and its standard deviation.

    The deviation is that of the mean over `blocks` stretches of equal length, each longer than the residual's correlation."""
    squares = [np.where(np.isfinite(before) & np.isfinite(after), r, 0.0) ** 2 for r in (before, after)]
    total = float(squares[0].sum())
    if total == 0.0 or len(before) < 2 * blocks:
        return 0.0, 0.0
    parts = np.array([part.sum() for part in np.array_split((squares[1] - squares[0]).sum(axis=1), blocks)]) / total
    return float(parts.sum()), float(np.sqrt(blocks * parts.var(ddof=1)))


def with_repair(estimate: Estimate, found: Repair) -> Estimate:
    """The estimate with repaired values, over the model's whole base (a repair determines what the data left open, too).

    Its covariance is that of the estimate. What the data did not see is known to no better than ten times the largest parameter, and
    stays named as not determined."""
    subject = subject_of(estimate)
    assert subject.covariance is not None
    error = estimate.fit_error
    if (information := estimate.information) is not None and information.k == len(found.values):
        error = TorqueError.from_squares(information.residual_squares(found.values), information.torque_squares(), information.counts)
        error = replace(error, band_hz=estimate.fit_error.band_hz if estimate.fit_error.judged == JudgedOn.ROWS else None)
    return replace(
        estimate,
        method=f"{estimate.method}, repaired ({found.method.value})",
        base=estimate.model.base,
        values=found.values,
        covariance=_widened(subject),
        fit_error=error,
        heldout_error=None,
        warnings=(*estimate.warnings, f"repaired: {found.distance:.3g} standard deviations from what was estimated.", *found.notes),
        trace={**estimate.trace, "repair": found.to_dict()},
    )


def _widened(subject: Subject) -> Array:
    """Covariance (b, b) of a subject, wide in the directions that the data did not see."""
    assert subject.covariance is not None
    if subject.unseen is None:
        return subject.covariance
    wide = unseen_root(subject.values, subject.unseen)
    return np.asarray(subject.covariance + wide @ wide.T)


@with_one_blas_thread
def payload_of(without: Estimate, with_load: Estimate, *, link: str | None = None) -> PayloadEstimate:
    """The load that a link carries, from two estimates of the same model: without it, and with it.

    Parameters
    ----------
    without, with_load : Estimate
        Each enters as its values with their covariance; what its log did not show is left open.
    link : str, optional
        Who carries the load; by default the end of the arm. Where the tree has several ends, the one whose load explains the difference.

    Returns
    -------
    PayloadEstimate
        Mass, first moments and inertia of a real body, with covariance.

    Raises
    ------
    ConfigurationError
        Estimates of different models.
    DataError
        A load that the logs do not show, or that several ends of the tree explain equally well.

    Examples
    --------
    >>> import ident
    >>> train, test = ident.demo_logs()
    >>> first, second = (ident.fit(logs, "puma560", held=0) for logs in (train, test))
    >>> ident.payload(first, second).significant
    False
    """
    for name, given in (("without", without), ("with_load", with_load)):
        if not isinstance(given, EstimateRecord):
            raise ConfigurationError(
                f"payload: {name} must be an estimate (ident.fit of the logs, or Estimate.load), not {type(given).__name__}."
            )
    here, there = without.model, with_load.model
    if here.names != there.names or not np.array_equal(here.robot.transmission.K, there.robot.transmission.K):
        raise ConfigurationError("the two fits are of different models; fit the log with the load with the same robot and effects.")
    base = without.model.base
    structure = InertiaStructure.from_model(without.model, base)
    found = payload_from_logs(structure, known_rows(without, structure), known_rows(with_load, structure), link=link)
    notes = [
        f"the fit {which} the load is {fit.status.code.value}: {', '.join(fit.dropped) or 'see its status'}."
        for which, fit in (("without", without), ("with", with_load))
        if fit.status.code in (StatusCode.FEW_SAMPLES, StatusCode.NOT_CONVERGED) or fit.dropped
    ]
    return replace(found, notes=(*found.notes, *notes))


def known_rows(estimate: Estimate, structure: InertiaStructure) -> tuple[Array, Array]:
    """What an estimate knows of the model's base parameters p as rows (R (m, b), z (m,)): R p = z up to noise of unit variance."""
    # The estimate's own parameters (grouped further where its data could not tell them apart) from the model's.
    mine = estimate.base.regroup @ structure.lift
    covariance = np.asarray(estimate.covariance, float)
    std = np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
    # A parameter without variance (noise-free data) is known to a millionth.
    floor = np.maximum(1e-6 * np.abs(estimate.values), 1e-12)
    D = np.where(std > floor, std, floor)
    correlation = covariance / np.outer(D, D)
    np.fill_diagonal(correlation, 1.0)
    lam, vectors = np.linalg.eigh(correlation)
    whiten = (vectors / np.sqrt(np.maximum(lam, 1e-14 * max(float(lam.max(initial=0.0)), 1e-300)))).T / D
    return whiten @ mine, whiten @ estimate.values
