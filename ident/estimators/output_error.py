"""Output error on the torque (DIDIM): the parameters whose simulated torque matches the measured one."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ..errors import ConfigurationError, DataError, UnsupportedError
from ..estimate.status import Status, StatusCode
from ..problem.linear_solution import LinearSolution, full_values, order_of, solve_triangle
from ..problem.problem import Problem
from .base import Capability, Estimator, register
from .experiment import Experiment, require_experiment
from .finish import finish
from .instruments import along, repeated
from .least_squares import weighted_solution
from .possible import possible_along

if TYPE_CHECKING:
    from ..effects.motion import Coordinates
    from ..estimate.estimate import Estimate

Array = np.ndarray
#: A step below this many standard deviations ends the iteration.
_SETTLED = 0.1
#: And where nothing but round-off and integration is left, whose size says nothing of the parameters.
_SETTLED_EXACT = 1e-3
#: Where no step lowers the torque error, one below this many of the estimate's standard deviations counts as the end.
_NEAR = 0.5
#: Steps are cut this often before a start is given up.
_CUTS = 3
#: Least eigenvalue of the inertia matrix, in units of each joint's own inertia. First only what cannot be simulated is changed, as
#: the change stays in the estimate (coupled arms have true values of 0.01); a start that then diverges all the same is moved further.
_MARGINS = (1e-3, 1e-2, 1e-1)
#: Squares of torque error below this share of the torque's own are those of round-off and integration.
_EXACT = 1e-12


@register
@dataclass(frozen=True, kw_only=True)
class OutputError(Estimator):
    """Direct and inverse dynamic identification (Gautier, Janot & Vandanjon 2013): only torque is measured.

    The experiment is simulated with its controller; the torque that the controller then gives is compared with the measured
    one. Under a tracking controller the simulated motion hardly depends on the parameters, so the sensitivities of that torque
    are the columns along the simulated motion. Gauss-Newton steps, cut until the torque error falls. `experiment`: controller
    and desired motion. `starts`: weighted least squares on the measured motion, fit along the desired motion, then random
    points around the best; the best end is kept, and followed once more with the weights of its own residual.
    `iterations`: at most, each start.

    Examples
    --------
    >>> import ident
    >>> method = ident.estimators.OutputError(starts=2)
    >>> sorted(capability.value for capability in method.capabilities)
    ['noisy regressor', 'weights']
    """

    name: ClassVar[str] = "didim"
    title: ClassVar[str] = "output error on simulated torque (DIDIM)"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.WEIGHTS, Capability.NOISY_REGRESSOR})

    experiment: Experiment | None = None
    starts: int = 2
    iterations: int = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        require_experiment(self.experiment, self.name)

    def check(self, problem: Problem) -> None:
        if self.experiment is None or not self.experiment.feedback:
            raise UnsupportedError(
                "method 'didim' simulates the experiment and must know its controller and desired motion:"
                " experiment = Experiment(controller=…, desired=…). Where they are not known, assumed_experiment(logs, model, values,"
                " cutoff_hz) assumes them. Both are Python objects (ident.estimators), which neither a study file nor the command line can"
                " give: there, use 'iv' for torque-driven logs, else 'wls'."
            )

        if type(problem) is not Problem:
            raise UnsupportedError(
                f"method 'didim' compares torque itself, not the rows of {type(problem).__name__}; give it the torque form (Problem),"
                " or use 'wls'."
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
        best = search.reweighted(min(ends, key=lambda point: point.cost))
        trace: dict[str, Any] = {"ends": [{"cost": end.cost, "steps": end.steps, "cuts": end.cuts} for end in (*ends, best)]}
        columns = best.solution.columns
        solution = replace(best.solution, values=best.values[columns])
        warnings = (self.experiment.assumed,) if self.experiment.assumed else ()
        estimate = finish(best.problem, solution, best.weights, self.name, warnings=warnings, trace=trace)
        # What the iteration counts in is white noise's standard deviation; in the end the estimate's own decides.
        left = np.abs(full_values(best.problem, best.solution) - best.values)[columns]
        if not best.settled and np.any(left > _NEAR * estimate.std):
            return replace(estimate, status=Status(StatusCode.NOT_CONVERGED))
        return estimate


@dataclass(frozen=True, eq=False)
class _Point:
    """Base values (b,), the torque error `cost` of their simulation (weighted squares a row), and the linearised problem.

    `problem`: columns along the simulated motion; its torque is the measured one less what the simulated torque is beyond
    columns times values, so that its residual at `values` is measured minus simulated torque. `solution`: its own."""

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
        self.rows = max(1, int(problem.valid.sum()))
        self.energy = problem.information.torque_squares()

    def start(self, attempt: int, ends: list[_Point], rng: np.random.Generator) -> Array:
        """Base values (b,) of the start number `attempt`."""
        if attempt == 0:
            return full_values(self.problem, self.measured)
        if attempt == 1:
            desired = self.experiment.desired_motion(self.problem.signals)
            solution, _ = weighted_solution(self._along(desired))
            return full_values(self.problem, solution)
        best = min(ends, key=lambda point: point.cost) if ends else None
        centre = best.values if best else full_values(self.problem, self.measured)
        return centre * (1.0 + 0.3 * rng.normal(size=len(centre)))

    def run(self, values: Array) -> _Point:
        """From base values to where the torque error no longer falls. Raises DataError where no model near them can be simulated."""
        for margin in _MARGINS[:-1]:
            try:
                return self._descend(self.at(values, margin))
            except DataError:
                continue
        return self._descend(self.at(values, _MARGINS[-1]))

    def reweighted(self, point: _Point) -> _Point:
        """On from a point with each row weighted by the variance of its own residual."""
        squares = point.problem.information.residual_squares(point.values)
        counts = point.problem.information.counts
        least = _EXACT * self.energy
        self.weights = np.where(counts > 0, counts / np.maximum(squares, np.where(least > 0, least, 1.0)), 0.0)
        return self._descend(self._linearised(point.values, point.problem))

    def _descend(self, point: _Point) -> _Point:
        steps: list[float] = []
        cuts = 0
        # Below this a step changes the torque by less than round-off and integration do.
        least = _EXACT * float(self.weights @ self.energy) / self.rows
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
            length = float(moved / np.sqrt(max(point.cost, least, 1e-300)))
            steps.append(length)
            if trial is None:
                # No shorter step helps: the end, if the step asked for was within the noise.
                return replace(point, steps=tuple(steps), cuts=cuts, settled=length < 1.0)
            gain = point.cost - trial.cost
            point = trial
            if length < (_SETTLED if point.cost > least else _SETTLED_EXACT) or gain < 1e-4 * point.cost:
                return replace(point, steps=tuple(steps), cuts=cuts, settled=True)
        return replace(point, steps=tuple(steps), cuts=cuts, settled=steps[-1] < 1.0)

    def at(self, values: Array, margin: float = _MARGINS[0]) -> _Point:
        """Simulate the nearest possible model to base values (b,), and linearise along its motion."""
        problem = self.problem
        possible = possible_along(problem, values, self.root, margin).values
        motion, torque = repeated(problem, problem.base.expand(possible), self.experiment)
        sound = all(np.isfinite(x).all() for x in (motion.q, motion.dq, motion.ddq))
        if not sound:
            raise DataError("the experiment could not be repeated over the whole log.")
        beyond = problem.at_rows(torque) - self._along(motion).predict(possible)
        return self._linearised(possible, self._along(motion, problem.tau - beyond))

    def _along(self, motion: Coordinates, tau: Array | None = None) -> Problem:
        """The problem along another motion, with another torque (M, n) at the rows if one is given."""
        signals = replace(self.problem.signals, q=motion.q, dq=motion.dq, ddq=motion.ddq)
        return along(self.problem, signals if tau is None else replace(signals, tau=tau))

    def _linearised(self, values: Array, problem: Problem) -> _Point:
        information = problem.information
        cost = float(self.weights @ information.residual_squares(values)) / self.rows
        R, z, _ = information.combined(self.weights)
        return _Point(values, problem, cost, solve_triangle(R, z, order_of(problem.base)), self.weights)
