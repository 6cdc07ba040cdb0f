"""Instrumental variables: consistent where the motion is noisy, with instruments from the identified model itself."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from ..errors import ConfigurationError, UnsupportedError, unknown_name
from .base import Capability, Estimator, register
from .experiment import Experiment, require_experiment
from .instrument_result import InstrumentResult
from .instrument_rows import InstrumentRows
from .instrument_system import InstrumentSystem
from .instruments import Instruments, instrument_problem
from .least_squares import weighted_solution
from .plain_instruments import PlainPasses, whole_root
from .possible import possible_along

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..problem.problem import Problem

Array = np.ndarray
#: A step below this many standard deviations ends the iteration.
_SETTLED = 0.1


@register
@dataclass(frozen=True, kw_only=True)
class InstrumentalVariable(Estimator):
    """Iterated instrumental variables, started from weighted least squares (Yoshida 1995; Janot, Vandanjon & Gautier 2014).

    `instruments`: "forward_dynamics" (accelerations from the model at measured torque: torque-driven logs), "simulation" (the
    whole motion simulated along the same experiment) or "reference" (the desired motion). `loop`: "open" if the logged torque
    was commanded, "closed" if a controller made it from the measured motion, "unknown". `experiment`: controller and desired
    motion, for simulation in closed loop and for "reference". Instruments come from the nearest possible model, and
    are weighted by the noise's own colour, estimated from the residual and repeated (`estimators.instrument_rows`). `weighting`:
    "noise" does so; "none" is the plain method of Yoshida (1995), (3.22) to (3.35): every row counts alike, started from ordinary
    least squares (`estimators.plain_instruments`).

    The trace holds the steps, a Durbin-Wu-Hausman test of least squares ("least_squares"), a test of the instruments against
    earlier ones ("validity") and their strength (F of every parameter).

    Examples
    --------
    >>> import ident
    >>> method = ident.estimators.InstrumentalVariable(instruments="forward_dynamics", loop="open")
    >>> sorted(capability.value for capability in method.capabilities)
    ['noisy regressor', 'weights']
    """

    name: ClassVar[str] = "iv"
    title: ClassVar[str] = "instrumental variables"
    capabilities: ClassVar[frozenset[Capability]] = frozenset({Capability.WEIGHTS, Capability.NOISY_REGRESSOR})

    instruments: str = Instruments.FORWARD_DYNAMICS.value
    loop: str = "unknown"
    experiment: Experiment | None = None
    iterations: int = 10
    weighting: str = "noise"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_experiment(self.experiment, self.name)
        known = [i.value for i in Instruments]
        if self.instruments not in known:
            raise unknown_name("instruments of method 'iv'", self.instruments, known)
        if self.loop not in ("open", "closed", "unknown"):
            raise unknown_name("loop of method 'iv'", self.loop, ("open", "closed", "unknown"))
        if self.weighting not in ("noise", "none"):
            raise unknown_name("weighting of method 'iv'", self.weighting, ("noise", "none"))
        if self.iterations < 1:
            raise ConfigurationError(f"method 'iv': iterations must be at least 1, not {self.iterations}.")

    @property
    def _from_torque(self) -> bool:
        """Whether the instruments are made of the measured torque."""
        described = self.experiment is not None and self.experiment.feedback
        return self.instruments == Instruments.FORWARD_DYNAMICS or (self.instruments == Instruments.SIMULATION and not described)

    @property
    def from_commanded_torque(self) -> bool:
        """Whether the instruments are made of the measured torque, which was commanded: they share the noise of its reading, no more."""
        return self.loop == "open" and self._from_torque

    def check(self, problem: Problem) -> None:
        feedback = self.loop == "closed" or (self.experiment is not None and self.experiment.feedback)
        if feedback and self._from_torque:
            raise UnsupportedError(
                "inside a feedback loop the measured torque responds to measurement noise, so instruments made from it are not"
                " valid; use instruments = 'simulation' with experiment = Experiment(controller=…, desired=…), or 'reference' with the"
                " desired motion, or method 'didim'."
            )
        if self.instruments == Instruments.REFERENCE and (self.experiment is None or not self.experiment.desired):
            raise ConfigurationError("instruments 'reference' need the desired motion: experiment = Experiment(controller=…, desired=…).")

    def _plain(self, problem: Problem) -> Estimate:
        """The plain method, unweighted."""
        found = PlainPasses.begin(problem)
        while len(found.steps) < self.iterations and not (len(found.steps) > 1 and found.steps[-1] < _SETTLED):
            found = found.next(problem, Instruments(self.instruments), self.experiment)
        trace = {"steps": list(found.steps), "repaired": list(found.repaired)}
        supposed = (self.experiment.assumed,) if self.experiment is not None and self.experiment.assumed else ()
        result = found.result(problem, commanded=self.from_commanded_torque)
        return result.estimate(self.name, trace, found.steps[-1] < 1.0, supposed)

    def _solve(self, problem: Problem) -> Estimate:
        if self.weighting == "none":
            return self._plain(problem)
        start, _ = weighted_solution(problem)
        columns = start.columns
        names = tuple(problem.base.names[c] for c in columns)
        values = np.zeros(problem.base.count)
        values[columns] = start.values
        root = whole_root(problem.base.count, start.columns, start.root)
        wanted = Instruments(self.instruments)
        # A model fitted by least squares may be too wrong to be simulated under the controller; the desired motion needs no model.
        tracked = self.experiment is not None and self.experiment.feedback and wanted == Instruments.SIMULATION
        source = Instruments.REFERENCE if tracked else wanted
        steps: list[float] = []
        repaired: list[float] = []
        while True:
            possible = possible_along(problem, values, root)
            repaired.append(possible.moved)
            instruments, usable = instrument_problem(problem, possible, source, self.experiment)
            rows = InstrumentRows.at(problem, instruments, usable, columns, values)
            products = rows.products()
            system = InstrumentSystem(products.cross, products.gram, names)
            change = system.solve(products.miss)
            values = values.copy()
            values[columns] += change
            steps.append(_step(change, system.white_std, values[columns]))
            if (source == wanted and steps[-1] < _SETTLED and len(steps) > 1) or len(steps) >= self.iterations:
                break
            if source != wanted:
                # From here on the metric of nearness is that of the instruments, in which the start's bias does not count.
                source, root = wanted, whole_root(problem.base.count, start.columns, system.information_root)
        found = InstrumentResult(
            InstrumentRows.at(problem, instruments, usable, columns, values), start, commanded=self.from_commanded_torque
        )
        supposed = (self.experiment.assumed,) if self.experiment is not None and self.experiment.assumed else ()
        return found.estimate(self.name, {"steps": steps, "repaired": repaired}, steps[-1] < 1.0, supposed)


def _step(change: Array, std: Array, values: Array) -> float:
    """Largest change in standard deviations; changes within round-off of the value count as none."""
    live = np.abs(change) > 1e-10 * np.abs(values)
    return float(np.max(np.where(live, np.abs(change) / np.maximum(std, 1e-300), 0.0), initial=0.0))
