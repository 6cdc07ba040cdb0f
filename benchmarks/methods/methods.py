"""The methods that are compared, each from the logs of one seed to an estimate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ident.estimate.estimate import Estimate
from ident.estimators import (
    Estimator,
    Experiment,
    InstrumentalVariable,
    LeastSquares,
    OutputError,
    PhysicalLeastSquares,
    RecursiveLeastSquares,
    RobustLeastSquares,
    StepByStep,
    TotalLeastSquares,
    WeightedLeastSquares,
)
from ident.logs.log import Log
from ident.planning import Plan
from ident.problem.integrated import formulate
from ident.problem.problem import Problem
from ident.signals.preparation import CentralDifference, Preparation, ZeroPhase

from .world import World

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Case:
    """What one seed gives to the methods: `logs` of free motion, how they came about (`experiment`; `feedback`: whether torque
    answers to the sensors), `tests`: plans with the logs of their tests; `counts` of the encoders, `cutoff_hz` of the filtered methods."""

    world: World
    logs: tuple[Log, ...]
    experiment: Experiment | None = None
    feedback: bool = False
    tests: Mapping[str, tuple[Plan, tuple[Log, ...]]] = field(default_factory=dict)
    counts: float | None = None
    cutoff_hz: float = 20.0
    rate: float | None = None

    def problem(self, preparation: Preparation, formulation: str = "torque") -> Problem:
        world = self.world
        return formulate(world.model, preparation(self.logs, world.model.robot), formulation)

    @property
    def raw(self) -> Preparation:
        """Differences of the positions as they are: accelerations are second differences."""
        return CentralDifference()

    @property
    def filtered(self) -> Preparation:
        """Positions through a zero-phase low-pass, both sides of the equation through the rows' filter."""
        return ZeroPhase(cutoff_hz=self.cutoff_hz)

    @property
    def loop(self) -> str:
        """What the instrumental methods are told. In feedback they would refuse measured torque; told nothing, they must find out."""
        return "unknown" if self.feedback else "open"


Solver = Callable[[Case], Estimate]


@dataclass(frozen=True)
class Method:
    """A method by its short `key` and `title`; `family` as in the dissertation: step by step, simultaneous, advanced simultaneous."""

    key: str
    title: str
    family: str
    solve: Solver = field(repr=False, compare=False)
    applies: Callable[[Case], bool] = field(default=lambda case: True, repr=False, compare=False)


def _raw(make: Callable[[Case], Estimator]) -> Solver:
    return lambda case: make(case).solve(case.problem(case.raw))


def _filtered(estimator: Estimator, formulation: str = "torque") -> Solver:
    return lambda case: estimator.solve(case.problem(case.filtered, formulation))


def _steps(which: str, carry: str) -> Solver:
    def solve(case: Case) -> Estimate:
        plan, logs = case.tests[which]
        signals = case.filtered(logs, case.world.model.robot)
        return StepByStep(plan=plan, carry=carry).solve(Problem(case.world.model, signals))

    return solve


def _total(case: Case) -> TotalLeastSquares:
    """Told the noise that the encoders' rounding makes in positions and their differences."""
    std, rate = case.world.position_std(case.counts), case.rate or case.world.rate
    return TotalLeastSquares(
        position_std=tuple(std), velocity_std=tuple(std * rate / np.sqrt(2.0)), acceleration_std=tuple(std * rate**2 * np.sqrt(6.0))
    )


def _instruments(kind: str, **options: Any) -> Callable[[Case], InstrumentalVariable]:
    """Instruments need not repeat the experiment to the last digit: control at the rate of the logs, on the exact state."""

    def make(case: Case) -> InstrumentalVariable:
        experiment = None
        if kind != "forward_dynamics" and case.experiment is not None:
            experiment = replace(case.experiment, control_rate=case.rate, sensing=None, torque_window=0.0)
        return InstrumentalVariable(loop=case.loop, instruments=kind, experiment=experiment, **options)

    return make


STEPS, SIMULTANEOUS, ADVANCED = "step by step", "simultaneous", "advanced simultaneous"


def _has(plan: str) -> Callable[[Case], bool]:
    return lambda case: plan in case.tests


def _told(case: Case) -> bool:
    return case.experiment is not None


METHODS: Mapping[str, Method] = {
    m.key: m
    for m in (
        Method("steps_few", "step by step, fewest tests, values held", STEPS, _steps("few", "hold"), _has("few")),
        Method("steps_few_update", "step by step, fewest tests, values updated", STEPS, _steps("few", "update"), _has("few")),
        Method("steps", "step by step, safe tests, values held", STEPS, _steps("safe", "hold"), _has("safe")),
        Method("steps_update", "step by step, safe tests, values updated", STEPS, _steps("safe", "update"), _has("safe")),
        Method("ls_raw", "LS, raw second differences", SIMULTANEOUS, _raw(lambda case: LeastSquares())),
        Method("ls", "LS, filtered", SIMULTANEOUS, _filtered(LeastSquares())),
        Method("wls", "WLS, filtered", SIMULTANEOUS, _filtered(WeightedLeastSquares())),
        Method("irls", "robust LS (IRLS), filtered", SIMULTANEOUS, _filtered(RobustLeastSquares())),
        Method("rls", "recursive LS, filtered", SIMULTANEOUS, _filtered(RecursiveLeastSquares(trace_points=0))),
        Method("tls_raw", "total LS, raw", SIMULTANEOUS, _raw(_total)),
        Method("momentum", "WLS, momentum form", SIMULTANEOUS, _filtered(WeightedLeastSquares(), "momentum")),
        Method("energy", "WLS, energy form", SIMULTANEOUS, _filtered(WeightedLeastSquares(), "energy")),
        Method("physical", "WLS, physically consistent", SIMULTANEOUS, _filtered(PhysicalLeastSquares())),
        Method("iv_plain", "plain IV (the source's), raw", ADVANCED, _raw(_instruments("forward_dynamics", weighting="none"))),
        Method("iv_dynamics", "IV, model accelerations, raw", ADVANCED, _raw(_instruments("forward_dynamics"))),
        Method("iv_desired", "IV, desired motion, raw", ADVANCED, _raw(_instruments("reference")), _told),
        Method("iv", "IV, simulated motion, raw", ADVANCED, _raw(_instruments("simulation")), _told),
        Method(
            "didim", "DIDIM, filtered", ADVANCED,
            lambda case: OutputError(experiment=case.experiment, starts=1).solve(case.problem(case.filtered)), _told,
        ),
    )
}  # fmt: skip
