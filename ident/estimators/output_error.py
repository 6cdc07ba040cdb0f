"""Output error on the torque (DIDIM): the parameters whose simulated torque matches the measured one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..errors import ConfigurationError, DataError, UnsupportedError
from ..status import StatusCode
from .base import Capability, Estimator, register
from .experiment import Experiment
from .instruments import Instruments, instrument_problem
from .least_squares import weighted_solution
from .possible import possible_along
from .solution import LinearSolution, finish, full_values, order_of, solve_triangle

if TYPE_CHECKING:
    from ..estimate import Estimate
    from ..problem import Problem

Array = np.ndarray
#: A step below this many standard deviations ends the iteration.
_SETTLED = 0.1
#: Steps are cut this often before a start is given up.
_CUTS = 3


@register
@dataclass(frozen=True, kw_only=True)
class OutputError(Estimator):
    """Direct and inverse dynamic identification (Gautier, Janot & Vandanjon 2013): only torque is measured.

    The experiment is simulated with its controller; under a tracking controller the simulated motion hardly depends on the
    parameters, so the simulated torque's sensitivities are the columns along it. Gauss-Newton steps, cut until the torque
    error falls. `experiment`: controller and desired motion. `starts`: weighted least squares on the measured motion, fit along
    the desired motion, then random points around the best; the best end is kept. `iterations`: at most, each start."""

    name: ClassVar[str] = "didim"
    title: ClassVar[str] = "output error on simulated torque (DIDIM)"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.WEIGHTS, Capability.NOISY_REGRESSOR})

    experiment: Experiment | None = None
    starts: int = 2
    iterations: int = 10

    def check(self, problem: Problem) -> None:
        if self.experiment is None or not self.experiment.feedback:
            raise UnsupportedError(
                "method 'didim' simulates the experiment and must know its controller and desired motion:"
                " experiment = Experiment(controller=…, desired=…). For torque-driven logs use 'iv'; without either, 'wls'."
            )
        if self.starts < 1 or self.iterations < 1:
            raise ConfigurationError("method 'didim': starts and iterations must be at least 1.")

    def _solve(self, problem: Problem) -> Estimate:
        assert self.experiment is not None
        search = _Search(problem, self.experiment, self.iterations)
        ends: list[_Point] = []
        rng = np.random.default_rng(0)
        for attempt in range(self.starts):
            try:
                ends.append(search.run(search.start(attempt, ends, rng)))
            except DataError:
                # A model too wrong to be simulated is no start; another one may do.
                if attempt == self.starts - 1 and not ends:
                    raise
        best = min(ends, key=lambda point: point.cost)
        trace: dict[str, Any] = {"ends": [{"cost": end.cost, "steps": end.steps, "cuts": end.cuts} for end in ends]}
        code = StatusCode.OK if best.settled else StatusCode.NOT_CONVERGED
        solution = replace(best.solution, values=best.values[best.solution.columns])
        return finish(best.problem, solution, best.weights, self.name, code=code, trace=trace)


@dataclass(frozen=True, eq=False)
class _Point:
    """Base values (b,), the problem along their simulated motion, and its torque error `cost` (weighted squares a row)."""

    values: Array
    problem: Problem
    cost: float
    solution: LinearSolution
    weights: Array
    steps: tuple[float, ...] = ()
    cuts: int = 0
    settled: bool = False


class _Search:
    """Gauss-Newton from one start at a time; rows weigh alike in all of them, so that their ends compare."""

    def __init__(self, problem: Problem, experiment: Experiment, iterations: int) -> None:
        self.problem, self.experiment, self.iterations = problem, experiment, iterations
        self.measured, self.weights = weighted_solution(problem)
        root = np.zeros((problem.base.count,) * 2)
        root[np.ix_(self.measured.columns, self.measured.columns)] = self.measured.root
        gone = np.setdiff1d(np.arange(problem.base.count), self.measured.columns)
        root[gone, gone] = 1e3 * float(np.abs(np.diag(self.measured.root)).max(initial=1.0))
        self.root = root

    def start(self, attempt: int, ends: list[_Point], rng: np.random.Generator) -> Array:
        """Base values (b,) of the start number `attempt`."""
        if attempt == 0:
            possible = possible_along(self.problem, full_values(self.problem, self.measured), self.root)
            desired, _ = instrument_problem(self.problem, possible, Instruments.REFERENCE, self.experiment, 0.0)
            solution, self.weights = weighted_solution(desired)
            return full_values(self.problem, solution)
        if attempt == 1:
            return full_values(self.problem, self.measured)
        best = min(ends, key=lambda point: point.cost) if ends else None
        centre = best.values if best else full_values(self.problem, self.measured)
        return centre * (1.0 + 0.3 * rng.normal(size=len(centre)))

    def run(self, values: Array) -> _Point:
        """From base values to where the torque error no longer falls."""
        point = self.at(values)
        steps: list[float] = []
        cuts = 0
        for _ in range(self.iterations):
            step = full_values(self.problem, point.solution) - point.values
            share = 1.0
            while True:
                try:
                    trial = self.at(point.values + share * step)
                except DataError:
                    trial = None
                if trial is not None and trial.cost <= point.cost * (1 + 1e-9):
                    break
                if share < 0.5**_CUTS:
                    trial = None
                    break
                share, cuts = share / 2, cuts + 1
            moved = float(np.max(np.abs(point.solution.root @ step[point.solution.columns]), initial=0.0))
            length = float(moved / np.sqrt(max(point.cost, 1e-300)))
            steps.append(length)
            if trial is None:
                # No shorter step helps: the end, if the step asked for was within the noise.
                return replace(point, steps=tuple(steps), cuts=cuts, settled=length < 1.0)
            gain = point.cost - trial.cost
            point = trial
            if length < _SETTLED or gain < 1e-4 * point.cost:
                return replace(point, steps=tuple(steps), cuts=cuts, settled=True)
        return replace(point, steps=tuple(steps), cuts=cuts, settled=steps[-1] < 1.0)

    def at(self, values: Array) -> _Point:
        """Simulate the nearest possible model to base values (b,), and linearise along its motion."""
        possible = possible_along(self.problem, values, self.root)
        along, share = instrument_problem(self.problem, possible, Instruments.SIMULATION, self.experiment, 0.0)
        if not np.array_equal(share > 0, self.problem.valid):
            raise DataError("the experiment could not be repeated over the whole log.")
        information = along.information
        rows = max(1, int(information.counts.sum()))
        cost = float(self.weights @ information.residual_squares(possible.values)) / rows
        R, z, _ = information.combined(self.weights)
        return _Point(possible.values, along, cost, solve_triangle(R, z, order_of(self.problem.base)), self.weights)
