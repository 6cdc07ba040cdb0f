"""A converged instrumental estimate: its covariance, its tests, its status."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import DataError
from ..estimate.status import StatusCode
from ..problem.linear_solution import LinearSolution
from .finish import finish
from .instrument_bias import shared_noise
from .instrument_rows import InstrumentRows
from .instrument_scores import score_covariance
from .instrument_system import InstrumentSystem
from .instrument_tests import DifferenceTest, difference_test, shea_strength

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate

Array = np.ndarray
#: The validity test fires at this probability, where the bias it shows is also as large as the interval it spoils (in standard
#: deviations), or visible at all while the disagreement could not be chance if noise were twice as large as it seems.
_LEVEL, _SPOILED, _VISIBLE, _TWICE = 1e-3, 1.0, 0.25, 4.0
#: Instruments with a smaller F are called weak (Staiger & Stock 1997).
_WEAK = 10.0
#: Number of least squares among the scores.
_LEAST_SQUARES = -1


class InstrumentResult:
    """What is known once the iteration has ended: one more pass over the `rows`; `start`: the least-squares solution."""

    def __init__(
        self, rows: InstrumentRows, start: LinearSolution, *, commanded: bool = False, judged: InstrumentRows | None = None
    ) -> None:
        """`commanded`: the instruments are made of a measured torque that was commanded, so all they can share is its noise. `judged`:
        rows weighted by the noise's colour, which show how much torque is explained where `rows` are not weighted."""
        self.rows, self.start, self.commanded, self.judged = rows, start, commanded, judged
        self.names = tuple(rows.problem.base.names[c] for c in rows.columns)
        self.lag = self._shortest_lag()
        lags = (0,) if self.lag is None else (0, self.lag, 2 * self.lag)
        self.moments = rows.moments(lags, windowed=True)
        self.system = InstrumentSystem(self.moments.cross[0], self.moments.gram[0], self.names)
        count, b = float(self.moments.rows.sum()), len(self.names)
        self.scores = score_covariance(rows, self.moments.error, lags)
        self.covariance = self.system.both_sides(self._gram(0, 0))
        # The residual lacks what the fit took up of the noise; and its model misses what is weak beside noise at other frequencies.
        slow = np.diag(self.system.both_sides(self.moments.windowed)) / np.maximum(np.diag(self.covariance), 1e-300)
        self.covariance = self.covariance * (count / max(count - b, 1.0) * max(1.0, float(np.mean(slow))))
        self.covariance = (self.covariance + self.covariance.T) / 2
        self.std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def estimate(self, method: str, trace: dict[str, Any], converged: bool, supposed: tuple[str, ...] = ()) -> Estimate:
        """The estimate with its tests in the trace. `supposed`: what it warns of in any case."""
        rows, exact = self.rows, self.rows.exact
        biased = None if exact else self._against_least_squares()
        valid = None if exact else self._against_earlier_instruments()
        strength = self._strength()
        weak = [n for n, f in zip(self.names, strength, strict=True) if f < _WEAK]
        warnings = list(supposed)
        if weak:
            warnings.append(
                f"weak instruments for {', '.join(weak[:6])}{' …' if len(weak) > 6 else ''}: do not trust their"
                f" intervals; excite these parameters more, or simulate the experiment more closely."
            )
        trace |= {
            "least_squares": None if biased is None else biased.to_dict(),
            "validity": None if valid is None else valid[0].to_dict(),
            "strength": dict(zip(self.names, strength.tolist(), strict=True)),
        }
        if valid is None and not exact:
            warnings.append("the log is too short to test the instruments against earlier ones: their validity is not known.")
        code = StatusCode.OK if converged else StatusCode.NOT_CONVERGED
        details: tuple[str, ...] = ()
        if valid is not None and self.commanded and _disagree(valid[0]):
            shared = shared_noise(valid[1], valid[2], self.moments.gram[0], float(self.moments.torques.sum()), valid[0])
            trace["validity"] |= {"bias": shared.to_dict()}
            warnings.append(shared.text())
        elif valid is not None and _disagree(valid[0]):
            code = StatusCode.INVALID_INSTRUMENTS
            text = (
                f"Instruments of the same instant and of earlier ones disagree (χ² = {valid[0].statistic:.0f} with {valid[0].degrees}"
                f" degrees of freedom), most on {valid[0].name}: by {valid[0].largest:.1f} standard deviations."
            )
            details = (text,)
        solution = LinearSolution(rows.columns, self.start.regroup, rows.values[rows.columns], self.start.root, self.start.condition)
        return finish(
            rows.problem, solution, rows.weights, method, covariance=self.covariance, noise=rows.noise, warnings=tuple(warnings), code=code,
            details=details, trace=trace, unexplained=self._unexplained(),
        )  # fmt: skip

    def _unexplained(self) -> Array:
        """Torque (n,) left unexplained, relative, at the frequencies where the noise lets torque be seen."""
        moments = self.moments if self.judged is None else self.judged.moments()
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.nan_to_num(np.sqrt(np.nansum(moments.error**2, axis=0) / moments.torques))

    def _against_least_squares(self) -> DifferenceTest:
        """Durbin, Wu & Hausman: is least squares on the same whitened rows biased?"""
        m = self.moments
        plain = InstrumentSystem(m.own, m.own, self.names)
        return difference_test(plain.solve(m.own_miss), self._between(plain, _LEAST_SQUARES, self.system, 0), self.std, self.names)

    def _against_earlier_instruments(self) -> tuple[DifferenceTest, Array, Array] | None:
        """The test, the difference (b,) and its covariance (b, b).

        Instruments of some rows ago know nothing of this row's noise: an estimate with them must agree.
        How far those of one and of two such lags disagree, which both are valid, shows by how much the noise exceeds its
        model (quantisation is not quite noise); the first disagreement is measured against that."""
        if self.lag is None:
            return None
        m = self.moments
        try:
            near, far = (InstrumentSystem(m.cross[i], m.gram[i], self.names) for i in (1, 2))
        except DataError:
            return None  # earlier instruments are too weak to say anything
        first, second = near.solve(m.miss[1]), far.solve(m.miss[2])
        gram = self._between(near, 1, self.system, 0)
        found = difference_test(first, gram, self.std, self.names)
        control = difference_test(second - first, self._between(far, 2, near, 1), self.std, self.names)
        factor = control.statistic / max(1, control.degrees)
        return found.relaxed(factor), first, gram * max(1.0, factor)

    def _shortest_lag(self) -> int | None:
        """Rows after which instruments are taken for earlier ones; None where the log is too short for any."""
        shortest = min(run.stop - run.start for run in self.rows.problem.row_runs if run.stop > run.start)
        # A residual that instruments spoil looks correlated over much of the log. A lag within the noise's memory only costs power.
        lag = int(max(3, min(np.ceil(3 * float(self.rows.noise.correlation_time.max())), shortest // 40)))
        return None if lag * 8 > shortest else lag

    def _between(self, one: InstrumentSystem, i: int, other: InstrumentSystem, j: int) -> Array:
        """Covariance (b, b) of the difference of two estimates, by the numbers of their scores."""
        mixed = one.both_sides(self._gram(i, j), other)
        return one.both_sides(self._gram(i, i)) + other.both_sides(self._gram(j, j)) - mixed - mixed.T

    def _gram(self, i: int, j: int) -> Array:
        """Covariance (b, b) of the sums of scores number `i` and `j`: by lag, −1 of least squares."""
        b = len(self.names)
        count = len(self.scores) // b
        one, other = ((k % count) * b for k in (i, j))
        return self.scores[one : one + b, other : other + b]

    def _strength(self) -> Array:
        m, left = self.moments, self.system.left
        right = np.sqrt(np.maximum(np.diag(m.own), 1e-300))
        unit = m.own / np.outer(right, right)
        return shea_strength(m.cross[0] / np.outer(left, right), m.gram[0] / np.outer(left, left), unit, float(m.rows.sum()))


def _disagree(test: DifferenceTest) -> bool:
    """Whether instruments of different instants tell different things."""
    beyond_doubt = test.statistic > _TWICE * test.degrees and test.largest > _VISIBLE
    return test.p_value < _LEVEL and (test.largest > _SPOILED or beyond_doubt)
