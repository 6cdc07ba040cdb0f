"""Instrumental variables: consistent where the motion is noisy, with instruments from the identified model itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..errors import ConfigurationError, DataError, UnsupportedError, unknown_name
from ..information import Information
from ..noise import NoiseModel, fit_noise
from ..status import StatusCode
from .base import Capability, Estimator, register
from .experiment import Experiment
from .instrument_tests import DifferenceTest, Lagged, difference_test, pair_gram, shea_strength
from .instruments import Instruments, instrument_problem, paired
from .least_squares import weighted_solution
from .moments import CrossMoments, cross_moments
from .possible import possible_along
from .solution import LinearSolution, finish

if TYPE_CHECKING:
    from ..estimate import Estimate
    from ..problem import Problem, Rows

Array = np.ndarray
#: A step below this many standard deviations ends the iteration.
_SETTLED = 0.02
#: The validity test fires at this probability, where the bias it shows is also as large as the interval it spoils.
_LEVEL = 1e-3
#: Instruments with a smaller F are called weak (Staiger & Stock 1997).
_WEAK = 10.0


@register
@dataclass(frozen=True, kw_only=True)
class InstrumentalVariable(Estimator):
    """Iterated instrumental variables, started from weighted least squares (Yoshida 1995; Janot, Vandanjon & Gautier 2014).

    `instruments`: "forward_dynamics" (accelerations from the model at measured torque: torque-driven logs), "simulation" (the
    whole motion simulated along the same experiment) or "reference" (the desired motion). `loop`: "open" if the logged torque
    was commanded, "closed" if a controller made it from the measured motion, "unknown". `experiment`: controller and desired
    motion, for simulation in closed loop and for "reference". Instruments come from the nearest possible model.

    The trace holds the steps, a Durbin-Wu-Hausman test of least squares ("least_squares"), a test of the instruments against
    earlier ones ("validity") and their strength (F of every parameter)."""

    name: ClassVar[str] = "iv"
    title: ClassVar[str] = "instrumental variables"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.STREAMING, Capability.WEIGHTS, Capability.NOISY_REGRESSOR})

    instruments: str = Instruments.FORWARD_DYNAMICS.value
    loop: str = "unknown"
    experiment: Experiment | None = None
    iterations: int = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        known = [i.value for i in Instruments]
        if self.instruments not in known:
            raise unknown_name("instruments of method 'iv'", self.instruments, known)
        if self.loop not in ("open", "closed", "unknown"):
            raise unknown_name("loop of method 'iv'", self.loop, ("open", "closed", "unknown"))
        if self.iterations < 1:
            raise ConfigurationError(f"method 'iv': iterations must be at least 1, not {self.iterations}.")

    def check(self, problem: Problem) -> None:
        feedback = self.loop == "closed" or (self.experiment is not None and self.experiment.feedback)
        described = self.experiment is not None and self.experiment.feedback
        from_torque = self.instruments == Instruments.FORWARD_DYNAMICS or (self.instruments == Instruments.SIMULATION and not described)
        if feedback and from_torque:
            raise UnsupportedError(
                "inside a feedback loop the measured torque answers to the noise of the measurement, so instruments made from it are not"
                " valid; use instruments = 'simulation' with experiment = Experiment(controller=…, desired=…), or 'reference' with the"
                " desired motion, or method 'didim'."
            )
        if self.instruments == Instruments.REFERENCE and (self.experiment is None or not self.experiment.desired):
            raise ConfigurationError("instruments 'reference' need the desired motion: experiment = Experiment(controller=…, desired=…).")

    def _solve(self, problem: Problem) -> Estimate:
        start, weights = weighted_solution(problem)
        columns = start.columns
        values = np.zeros(problem.base.count)
        values[columns] = start.values
        root = _whole_root(problem.base.count, start)
        source = Instruments(self.instruments)
        steps: list[float] = []
        repaired: list[float] = []
        while True:
            possible = possible_along(problem, values, root)
            repaired.append(possible.moved)
            instruments, usable = instrument_problem(problem, possible, source, self.experiment)
            moments = cross_moments(problem, instruments, usable, values).selected(columns)
            weights = np.where(moments.counts > 0, 1.0 / np.maximum(moments.noise(), _floor(problem)), 0.0)
            system = _System(moments, weights, problem.base.names, columns)
            change = system.solve(moments.miss)
            values[columns] += change
            steps.append(_step(change, system.white_std(), values[columns]))
            if (steps[-1] < _SETTLED and len(steps) > 1) or len(steps) >= self.iterations or source == Instruments.REFERENCE:
                break
        found = _Found(problem, instruments, usable, weights, system, columns, values, start)
        return found.estimate(self.name, {"steps": steps, "repaired": repaired}, steps[-1] < 1.0 or source == Instruments.REFERENCE)


def _step(change: Array, std: Array, values: Array) -> float:
    """Largest change in standard deviations; changes within round-off of the value count as none."""
    live = np.abs(change) > 1e-10 * np.abs(values)
    return float(np.max(np.where(live, np.abs(change) / np.maximum(std, 1e-300), 0.0), initial=0.0))


def _whole_root(count: int, solution: LinearSolution) -> Array:
    """The solution's root over all base parameters; those that were grouped away are held where they are."""
    root = np.zeros((count, count))
    root[np.ix_(solution.columns, solution.columns)] = solution.root
    gone = np.setdiff1d(np.arange(count), solution.columns)
    root[gone, gone] = 1e3 * float(np.abs(np.diag(solution.root)).max(initial=1.0))
    return root


def _floor(problem: Problem) -> Array:
    information = problem.information
    return 1e-24 * np.maximum(information.torque_squares(), 1e-300) / np.maximum(information.counts, 1)


class _System:
    """ZᵀWΦ δ = ZᵀW e with both sides scaled; solved by LU with pivoting."""

    def __init__(self, moments: CrossMoments, weights: Array, names: tuple[str, ...], columns: Array) -> None:
        from scipy.linalg import lu_factor

        self.weights = weights
        self.cross = np.einsum("j,jab->ab", weights, moments.cross)
        self.gram = np.einsum("j,jab->ab", weights, moments.gram)
        self.left = np.sqrt(np.maximum(np.diag(self.gram), 1e-300))
        reach = np.linalg.norm(self.cross / self.left[:, None], axis=0)
        if np.any(reach == 0):
            lost = ", ".join(names[columns[i]] for i in np.flatnonzero(reach == 0)[:6])
            raise DataError(f"the instruments do not move what {lost} depend on; simulate the experiment as it was, or leave these out.")
        self.right = reach
        self.factor = lu_factor(self.cross / np.outer(self.left, self.right))
        singular = np.linalg.svd(self.cross / np.outer(self.left, self.right), compute_uv=False)
        if singular[-1] < 1e-12 * singular[0]:
            raise DataError("the instruments cannot tell all parameters apart: the simulated motion does not follow the measured one.")

    def solve(self, right: Array) -> Array:
        """δ (b,) for ZᵀE (n, b)."""
        from scipy.linalg import lu_solve

        return lu_solve(self.factor, self.weights @ right / self.left) / self.right

    def inverse_times(self, rows: Array) -> Array:
        """(ZᵀWΦ)⁻¹ applied to vectors in the last axis (…, b)."""
        from scipy.linalg import lu_solve

        flat = rows.reshape(-1, rows.shape[-1])
        return (lu_solve(self.factor, (flat / self.left).T).T / self.right).reshape(rows.shape)

    def both_sides(self, gram: Array) -> Array:
        """(ZᵀWΦ)⁻¹ gram (ΦᵀWZ)⁻¹."""
        half = self.inverse_times(gram)
        both = self.inverse_times(half.T)
        return (both + both.T) / 2

    def white_std(self) -> Array:
        """Standard deviations (b,) if the noise were white with variance 1/weight."""
        return np.sqrt(np.maximum(np.diag(self.both_sides(self.gram)), 0.0))


class _Found:
    """The converged instrumental estimate, its covariance and its tests."""

    def __init__(
        self, problem: Problem, instruments: Problem, usable: Array, weights: Array, system: _System, columns: Array, values: Array,
        start: LinearSolution,
    ) -> None:  # fmt: skip
        self.problem, self.instruments, self.usable = problem, instruments, usable
        self.weights, self.system, self.columns, self.values, self.start = weights, system, columns, values, start
        self.names = tuple(problem.base.names[c] for c in columns)
        self.residual = np.where(usable[:, None], problem.residual(values), np.nan)
        self.noise: NoiseModel = fit_noise(self.residual, problem.row_runs, problem.row_shape)
        gram = self._gram(lambda rows, Z: Z[:, :, columns] * weights[:, None])
        self.covariance = system.both_sides(gram)
        self.std = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def _gram(self, score: Any) -> Array:
        return pair_gram(self.problem, self.instruments, self.usable, self.noise, self.residual, score)

    def estimate(self, method: str, trace: dict[str, Any], converged: bool) -> Estimate:
        own = self._least_squares_information()
        exact = not np.any(self.noise.variance * own.counts > 1e-16 * own.torque_squares())
        biased = None if exact else self._against_least_squares(own)
        valid = None if exact else self._against_earlier_instruments()
        independent = float(np.sum(own.counts / self.noise.correlation_time))
        strength = self._strength(own, independent)
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

    def _least_squares_information(self) -> Information:
        """Information over the rows that have instruments."""
        if self.usable.all():
            return self.problem.information.selected(self.columns)
        total = Information.empty(self.problem.valid.shape[1], self.problem.base.names)
        for rows, _ in paired(self.problem, self.instruments, self.usable):
            total = total.with_rows(rows.columns, rows.tau, rows.valid)
        return total.selected(self.columns)

    def _against_least_squares(self, own: Information) -> DifferenceTest:
        from scipy.linalg import solve_triangular

        R, z, _ = own.combined(self.weights)
        scale = np.linalg.norm(R, axis=0)
        ls = solve_triangular(R / scale, z) / scale

        def score(rows: Rows, Z: Array) -> Array:
            flat = (rows.columns[:, :, self.columns] * self.weights[:, None]).reshape(-1, len(scale)) / scale
            plain = solve_triangular(R / scale, solve_triangular(R / scale, flat.T, trans="T")).T / scale
            return self.system.inverse_times(Z[:, :, self.columns] * self.weights[:, None]) - plain.reshape(*Z.shape[:2], -1)

        return difference_test(self.values[self.columns] - ls, self._gram(score), self.std, self.names)

    def _against_earlier_instruments(self) -> DifferenceTest | None:
        """Instruments of some rows ago know nothing of this row's noise: an estimate with them must agree."""
        lag = int(max(3, np.ceil(3 * float(self.noise.correlation_time.max()))))
        if lag * 4 > min(run.stop - run.start for run in self.problem.row_runs if run.stop > run.start):
            return None
        b = len(self.columns)
        cross, gram, miss = np.zeros((b, b)), np.zeros((b, b)), np.zeros(b)
        earlier = Lagged(lag)
        for rows, Z in paired(self.problem, self.instruments, self.usable):
            old = (earlier(rows, Z)[:, :, self.columns] * np.sqrt(self.weights)[:, None]).reshape(-1, b)
            now = (rows.columns[:, :, self.columns] * np.sqrt(self.weights)[:, None]).reshape(-1, b)
            e = np.where(rows.valid, rows.tau - rows.columns @ self.values, 0.0) * np.sqrt(self.weights)
            cross, gram, miss = cross + old.T @ now, gram + old.T @ old, miss + old.T @ e.ravel()
        left = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        right = np.maximum(np.linalg.norm(cross / left[:, None], axis=0), 1e-300)
        scaled = cross / np.outer(left, right)
        singular = np.linalg.svd(scaled, compute_uv=False)
        if singular[-1] < 1e-8 * singular[0]:
            return None
        from scipy.linalg import lu_factor, lu_solve

        factor = lu_factor(scaled)
        again = Lagged(lag)

        def score(rows: Rows, Z: Array) -> Array:
            old = (again(rows, Z)[:, :, self.columns] * self.weights[:, None]).reshape(-1, b)
            first = (lu_solve(factor, (old / left).T).T / right).reshape(*Z.shape[:2], b)
            return first - self.system.inverse_times(Z[:, :, self.columns] * self.weights[:, None])

        difference = lu_solve(factor, miss / left) / right
        return difference_test(difference, self._gram(score), self.std, self.names)

    def _strength(self, own: Information, independent: float) -> Array:
        R, _, _ = own.combined(self.weights)
        left, right = self.system.left, np.linalg.norm(R, axis=0)
        unit = R / right
        return shea_strength(self.system.cross / np.outer(left, right), self.system.gram / np.outer(left, left), unit.T @ unit, independent)
