"""The data sets of the comparison and how much of each is simulated: the full scale, and a short one for continuous integration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.estimators import Experiment
from ident.logs.log import Log
from ident.planning import Separation, make_plan
from ident.problem.problem import Problem
from ident.signals.preparation import Recorded, ZeroPhase
from ident.simulation.command import Feedback

from .bound import filtered_bound
from .methods import Case
from .motions import PlanRuns, Runs, closed_loop, planned, played_back, read, torque_driven
from .random_motion import fourier
from .world import TorqueMeasure, World, puma

Array = np.ndarray
FAST, SLOW = 0.9, 0.3
#: Cut-off of the well-filtered problem, Hz.
CUTOFF = 20.0


@dataclass(frozen=True)
class Scale:
    """How much is done. `lanes` runs of `seconds` make one data set; `seeds` of the torque-driven, slow and closed-loop one;
    `deciding_seeds` of the first, on which the requirements on instrumental variables are judged;
    `recursion`: runs of the recursion; `validation` runs; `sizes`: runs for the data that a method needs; `points`: values of every
    quantity along which degradation is followed; `postures` of every test of the plans; `control_rate` Hz of the torque-driven
    motion; `everything`: all methods, and each of
    them simulated forward; else one of each kind."""

    seeds: int
    deciding_seeds: int
    slow_seeds: int
    loop_seeds: int
    lanes: int
    seconds: float
    recursion: int
    validation: int
    sizes: tuple[int, ...]
    points: int
    postures: int
    control_rate: float
    everything: bool


FULL = Scale(
    seeds=12, deciding_seeds=48, slow_seeds=4, loop_seeds=6, lanes=12, seconds=5.0, recursion=126, validation=16,
    sizes=(1, 2, 4, 8, 16, 32), points=4, postures=3, control_rate=1000.0, everything=True,
)  # fmt: skip
SHORT = Scale(
    seeds=2, deciding_seeds=2, slow_seeds=0, loop_seeds=1, lanes=2, seconds=4.0, recursion=3, validation=2, sizes=(1, 2), points=2,
    postures=2, control_rate=400.0, everything=False,
)  # fmt: skip
#: Samples per second of the validation motion (2 ms, as in the source), and of the rows on which torque errors are measured.
VALIDATION_RATE, _MEASURED_RATE = 500.0, 250.0


@dataclass(frozen=True, eq=False)
class Data:
    """Everything that is simulated once: quick motions (`recursion` of them, of which the first `lanes` are the main data), slow ones,
    validation, the tests of plans by name: "few", as many as the coupled gears need, and "safe"."""

    world: World
    scale: Scale
    quick: Runs
    slow: Runs
    validation: Runs
    tests: Mapping[str, PlanRuns]

    @classmethod
    def make(cls, scale: Scale, world: World | None = None) -> Data:
        world = world or puma()
        counts = max(scale.recursion, scale.lanes), scale.lanes if scale.slow_seeds else 0, scale.validation
        first, second, third = np.cumsum([0, *counts[:2]]).tolist()
        free = [fourier(world.model, seed, scale.seconds, FAST if seed < second else SLOW) for seed in range(third)]
        runs = torque_driven(world, free, scale.control_rate)
        unseen = [fourier(world.model, 5_000 + i, scale.seconds, FAST) for i in range(scale.validation)]
        kinds = {"few": Separation.COUPLED, "safe": Separation.SAFE} if scale.everything else {"safe": Separation.SAFE}
        return cls(
            world,
            scale,
            runs.part(slice(first, second)),
            runs.part(slice(second, third)),
            played_back(world, torque_driven(world, unseen, VALIDATION_RATE)),
            {name: planned(world, make_plan(world.model, postures=scale.postures, separation=kind)) for name, kind in kinds.items()},
        )

    @cached_property
    def main(self) -> Runs:
        return self.quick.part(slice(0, self.scale.lanes))

    def loop(self, seed: int) -> Runs:
        """A closed-loop data set. Every seed has motions of its own, for the encoders' rounding acts on the motion and is not random."""
        scale = self.scale
        return closed_loop(
            self.world, [fourier(self.world.model, 10_000 + 100 * seed + i, scale.seconds, FAST) for i in range(scale.lanes)]
        )

    def exact_problem(self, runs: Runs, rate: float | None = None) -> Problem:
        """The well-filtered problem on exact motion, torque without noise; `rate`: samples per second, by default those of the logs."""
        logs = exact_logs(self, runs, rate or self.world.rate)
        return Problem(self.world.model, ZeroPhase(cutoff_hz=CUTOFF)(logs, self.world.model.robot))

    def bound(self, runs: Runs) -> Array:
        """Cramér-Rao standard deviations (b,) of the well-filtered problem."""
        return filtered_bound(self.exact_problem(runs), self.world.noise)

    @cached_property
    def torque_measure(self) -> TorqueMeasure:
        """Torque error on the validation motion."""
        return TorqueMeasure.of(self.exact_problem(self.validation, _MEASURED_RATE))


def experiment(data: Data, runs: Runs, rate: float, feedback: bool) -> Experiment:
    """How the runs came about and how their torque was logged, for methods that repeat them; `feedback`: on the encoders' readings."""
    desired = {f"run{i}": way for i, way in enumerate(runs.desired)}
    sensing = Feedback(counts=data.world.counts) if feedback else None
    return Experiment(
        controller=runs.controller, desired=desired, control_rate=runs.control_rate, sensing=sensing, torque_window=1.0 / rate
    )


def make_case(
    data: Data, runs: Runs, seed: int, *, feedback: bool = False, tests: bool = False, counts: float | None = None, noise: float = 1.0,
    rate: float | None = None, cutoff: float = CUTOFF,
) -> Case:  # fmt: skip
    """The logs of one seed and what is known of them."""
    world = data.world if noise == 1.0 else replace(data.world, noise=noise * data.world.noise)
    rate = rate or world.rate
    sensors = world.sensors(counts=counts, rate=rate)
    return Case(
        world, read(runs, sensors, seed, rate), experiment(data, runs, rate, feedback), feedback,
        {name: (made.plan, made.read(sensors, seed)) for name, made in data.tests.items()} if tests else {}, counts, cutoff, rate,
    )  # fmt: skip


def exact_logs(data: Data, runs: Runs, rate: float) -> tuple[Log, ...]:
    """Logs of the exact motion and torque at a rate."""
    return read(runs, data.world.exact(rate), 0, rate)


def recorded() -> Recorded:
    """Preparation of exact logs: as they are."""
    return Recorded(standstill=None)
