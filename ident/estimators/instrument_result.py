"""A converged instrumental estimate: its covariance, its tests, its status."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DataError
from ..information import Information
from ..noise import NoiseModel, fit_noise
from ..status import StatusCode
from .instrument_system import InstrumentSystem
from .instrument_tests import DifferenceTest, Lagged, Score, difference_test, pair_gram, shea_strength
from .instruments import paired
from .solution import LinearSolution, finish

if TYPE_CHECKING:
    from ..estimate import Estimate
    from ..problem import Problem, Rows

Array = np.ndarray
#: The validity test fires at this probability, where the bias it shows is also as large as the interval it spoils.
_LEVEL = 1e-3
#: Instruments with a smaller F are called weak (Staiger & Stock 1997).
_WEAK = 10.0


class InstrumentResult:
    """What is known once the iteration has ended. `share` (M, n): how far each row's instruments count; `values` (b,) of all
    base parameters, `columns` those that the data tell apart, `start` the least-squares solution."""

    def __init__(
        self, problem: Problem, instruments: Problem, share: Array, weights: Array, system: InstrumentSystem, columns: Array, values: Array,
        start: LinearSolution,
    ) -> None:  # fmt: skip
        self.problem, self.instruments, self.share = problem, instruments, share
        self.weights, self.system, self.columns, self.values, self.start = weights, system, columns, values, start
        self.names = tuple(problem.base.names[c] for c in columns)
        self.residual = np.where(share > 0, problem.residual(values), np.nan)
        self.noise: NoiseModel = fit_noise(self.residual, problem.row_runs, problem.row_shape)
        self.covariance = system.both_sides(self._gram(self.weighted))
        self.std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def weighted(self, rows: Rows, Z: Array) -> Array:
        """W Z (m, n, b) over the columns."""
        return Z[:, :, self.columns] * self.weights[:, None]

    def _gram(self, score: Score) -> Array:
        return pair_gram(self.problem, self.instruments, self.share, self.noise, self.residual, score)

    def estimate(self, method: str, trace: dict[str, Any], converged: bool) -> Estimate:
        """The estimate with its tests in the trace."""
        own = self._information()
        exact = not np.any(self.noise.variance * own.counts > 1e-16 * own.torque_squares())
        biased = None if exact else self._against_least_squares(own)
        valid = None if exact else self._against_earlier_instruments()
        strength = self._strength(own)
        weak = [n for n, f in zip(self.names, strength, strict=True) if f < _WEAK]
        warnings = []
        if weak:
            warnings.append(
                f"weak instruments for {', '.join(weak[:6])}{' …' if len(weak) > 6 else ''}: their intervals are not to be trusted;"
                " excite these parameters more, or simulate the experiment more closely."
            )
        trace |= {
            "least_squares": None if biased is None else biased.to_dict(),
            "validity": None if valid is None else valid.to_dict(),
            "strength": dict(zip(self.names, strength.tolist(), strict=True)),
        }
        if valid is None and not exact:
            warnings.append("the log is too short to test the instruments against earlier ones: nothing tells whether they are valid.")
        code = StatusCode.OK if converged else StatusCode.NOT_CONVERGED
        details: tuple[str, ...] = ()
        if valid is not None and valid.p_value < _LEVEL and valid.largest > 1.0:
            code = StatusCode.INVALID_INSTRUMENTS
            text = (
                f"Instruments of the same instant and of earlier ones disagree (χ² = {valid.statistic:.0f} with {valid.degrees} degrees of"
                f" freedom), most on {valid.name}: by {valid.largest:.1f} standard deviations."
            )
            details = (text,)
        solution = LinearSolution(self.columns, self.start.regroup, self.values[self.columns], self.start.root, self.start.condition)
        return finish(
            self.problem, solution, self.weights, method, covariance=self.covariance, noise=self.noise, warnings=tuple(warnings), code=code,
            details=details, trace=trace,
        )  # fmt: skip

    def _information(self) -> Information:
        """Information over the rows that have instruments."""
        if np.array_equal(self.share > 0, self.problem.valid):
            return self.problem.information.selected(self.columns)
        total = Information.empty(self.problem.valid.shape[1], self.problem.base.names)
        for rows, _ in paired(self.problem, self.instruments, self.share):
            total = total.with_rows(rows.columns, rows.tau, rows.valid)
        return total.selected(self.columns)

    def _against_least_squares(self, own: Information) -> DifferenceTest:
        """Durbin, Wu & Hausman: is least squares on the same rows biased?"""
        from scipy.linalg import solve_triangular

        R, z, _ = own.combined(self.weights)
        scale = np.linalg.norm(R, axis=0)
        unit = R / scale

        def score(rows: Rows, Z: Array) -> Array:
            flat = (rows.columns[:, :, self.columns] * self.weights[:, None]).reshape(-1, len(scale)) / scale
            plain = solve_triangular(unit, solve_triangular(unit, flat.T, trans="T")).T / scale
            return self.system.solve(self.weighted(rows, Z)) - plain.reshape(*Z.shape[:2], -1)

        difference = self.values[self.columns] - solve_triangular(unit, z) / scale
        return difference_test(difference, self._gram(score), self.std, self.names)

    def _against_earlier_instruments(self) -> DifferenceTest | None:
        """Instruments of some rows ago know nothing of this row's noise: an estimate with them must agree.

        How far those of one and of two such lags disagree, which both are valid, shows by how much the noise exceeds its
        model (quantisation is not quite noise); the first disagreement is measured against that."""
        shortest = min(run.stop - run.start for run in self.problem.row_runs if run.stop > run.start)
        # A residual that instruments spoil looks correlated over much of the log. A lag within the noise's memory only costs power.
        lag = int(max(3, min(np.ceil(3 * float(self.noise.correlation_time.max())), shortest // 40)))
        if lag * 8 > shortest:
            return None
        try:
            near, far = (self._lagged(k) for k in (lag, 2 * lag))
        except DataError:
            return None  # earlier instruments are too weak to say anything

        def between(first: _LaggedEstimate, second: _LaggedEstimate | None) -> Array:
            one, two = first.score(self), self.weighted if second is None else second.score(self)
            other = self.system if second is None else second.system
            return self._gram(lambda rows, Z: first.system.solve(one(rows, Z)) - other.solve(two(rows, Z)))

        found = difference_test(near.change, between(near, None), self.std, self.names)
        control = difference_test(far.change - near.change, between(far, near), self.std, self.names)
        return found.relaxed(control.statistic / max(1, control.degrees))

    def _lagged(self, lag: int) -> _LaggedEstimate:
        b = len(self.columns)
        root = np.sqrt(self.weights)
        cross, gram, miss = np.zeros((b, b)), np.zeros((b, b)), np.zeros(b)
        earlier = Lagged(lag)
        for rows, Z in paired(self.problem, self.instruments, self.share):
            old = (earlier(rows, Z)[:, :, self.columns] * root[:, None]).reshape(-1, b)
            now = (rows.columns[:, :, self.columns] * root[:, None]).reshape(-1, b)
            e = (np.where(rows.valid, rows.tau - rows.columns @ self.values, 0.0) * root).ravel()
            cross, gram, miss = cross + old.T @ now, gram + old.T @ old, miss + old.T @ e
        system = InstrumentSystem(cross, gram, self.names)
        return _LaggedEstimate(lag, system, system.solve(miss))

    def _strength(self, own: Information) -> Array:
        R, _, _ = own.combined(self.weights)
        left, right = self.system.left, np.linalg.norm(R, axis=0)
        unit = R / right
        independent = float(np.sum(own.counts / self.noise.correlation_time))
        return shea_strength(self.system.cross / np.outer(left, right), self.system.gram / np.outer(left, left), unit.T @ unit, independent)


class _LaggedEstimate:
    """The estimate with instruments of `lag` rows ago: its equations, and its difference from the one at lag 0."""

    def __init__(self, lag: int, system: InstrumentSystem, change: Array) -> None:
        self.lag, self.system, self.change = lag, system, change

    def score(self, result: InstrumentResult) -> Score:
        earlier = Lagged(self.lag)
        return lambda rows, Z: result.weighted(rows, earlier(rows, Z))
