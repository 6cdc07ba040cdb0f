"""Instrumental variables from the log alone: the motion in the band in which the reference drives it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..errors import DataError, UnsupportedError
from ..instruments.prepared import Instrument, prepared
from ..instruments.solved import inverse_of
from ..problem.linear_solution import LinearSolution, full_values
from .base import Capability, Estimator, register
from .finish import finish
from .least_squares import weighted_solution

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..instruments.fit import Fit
    from ..instruments.solved import Solved
    from ..problem.problem import Problem

Array = np.ndarray
#: Part that a combination may have in directions which the instruments leave open and still count as determined.
_OPEN = 1e-6


@register
@dataclass(frozen=True, kw_only=True)
class BandInstruments(Estimator):
    """Instrumental variables from the log alone: the motion in the band in which the reference drives it.

    In closed loop the controller responds to every disturbance, so that the measured motion is correlated with it and least squares are
    biased. Instruments are the columns of the desired motion where the log has it (`q_ref`), else of the measured motion below the
    frequency up to which the reference drives it, which the log itself shows. Needs no model of the controller and no first estimate that
    can be simulated; torque and all columns go through one filter, and rows are weighted by the noise's own colour. Where instruments are
    weak, an inertial prior of three times a link's size keeps parameters finite.

    The trace holds the kind of instrument ("q_ref" or "low_band") and its band (Hz).

    Examples
    --------
    >>> import ident
    >>> train, _ = ident.demo_logs()
    >>> estimate = ident.fit(train, "puma560", method=ident.estimators.BandInstruments(), held=0)
    >>> estimate.trace["instrument"]
    'low_band'
    """

    name: ClassVar[str] = "iv_band"
    title: ClassVar[str] = "instrumental variables in the reference's band"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.WEIGHTS, Capability.NOISY_REGRESSOR})
    own_rows: ClassVar[bool] = True

    def check(self, problem: Problem) -> None:
        if problem.signals.source is None:
            raise UnsupportedError(
                "method 'iv_band' prepares the logs in a band of its own and needs them at hand, not signals alone or rows on disk;"
                " use ZeroPhase on logs in memory, or method 'wls'."
            )

    def _solve(self, problem: Problem) -> Estimate:
        return BandFit.of(problem).estimate(self.name)


@dataclass(frozen=True, eq=False)
class BandFit:
    """A problem fitted by instruments of the band. `start`: least squares on the problem's rows, with `weights` (n,); `T` (k, p): the base
    parameters that the data determine, as sums of the coefficients of `frame`, which is solved on the rows of `fit`."""

    problem: Problem
    start: LinearSolution
    weights: Array
    fit: Fit
    instrument: Instrument
    frame: Solved
    T: Array

    @classmethod
    def of(cls, problem: Problem) -> BandFit:
        """Raises DataError where logs are too short, or the instruments leave something open."""
        start, weights = weighted_solution(problem)
        fit, instrument, _ = prepared(problem.model, problem.signals, problem.base.expand(full_values(problem, start)))
        frame = fit.solved()
        # Base parameters of the problem, of which the data determine those combinations that least squares keep.
        T = start.regroup @ _between(problem, fit)
        _require_determined(problem, T, frame)
        return cls(problem, start, weights, fit, instrument, frame, T)

    def estimate(self, method: str) -> Estimate:
        """Under the name of a method."""
        covariance = self.T @ self.frame.covariance @ self.T.T
        told = self.instrument
        trace = {"instrument": told.kind, "band_hz": told.band_hz, "narrower_hz": dict(told.narrower)}
        solution = replace(self.start, values=self.T @ self.frame.theta)
        return finish(self.problem, solution, self.weights, method, covariance=covariance, trace=trace)

    def influences(self) -> tuple[Array, Array]:
        """Time (R,) of each row, and what its error adds to the estimate (R, k)."""
        times = [run.measured.t[0] + run.band.time for run in self.fit.runs]
        inverse = (self.T / self.frame.scale) @ inverse_of(self.frame.equations)[0]
        return np.concatenate(times), self.frame.row_scores @ inverse.T


def _between(problem: Problem, fit: Fit) -> Array:
    """The problem's base parameters (b, p) as sums of those of the instrumental fit."""
    inner, outer = fit.declared.base, problem.base
    return np.stack([outer.base_values(inner.expand(row)) for row in np.eye(inner.count)], axis=1)


def _require_determined(problem: Problem, T: Array, frame: Solved) -> None:
    """Raises DataError for combinations T (k, p) that the instruments leave open."""
    scaled = T / frame.scale
    part = np.linalg.norm(scaled @ frame.open_directions.T, axis=1) / np.maximum(np.linalg.norm(scaled, axis=1), 1e-300)
    if np.any(part > _OPEN):
        names = [problem.base.names[k] for k in np.flatnonzero(part > _OPEN)]
        raise DataError(
            f"the motion that the reference drives does not determine {', '.join(names[:6])}{' …' if len(names) > 6 else ''};"
            " use method 'wls', or record motions that move these joints faster."
        )
