"""Motions of the comparison: torque-driven, in closed loop, and the tests of the step-by-step plan; and their logs."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.effects.motion import Coordinates
from ident.logs.log import Log
from ident.planning import Plan, PlannedTest
from ident.robots.transmission import Side
from ident.simulation.command import Feedback
from ident.simulation.controller import PDFeedforward
from ident.simulation.result import Simulation
from ident.simulation.sensors import Sensors
from ident.simulation.simulate import Hold, simulate_batch
from ident.simulation.trajectory import Chained, Dwell, Trajectory

from .world import World

Array = np.ndarray
#: Without noise; replaced when the run is read.
_BARE = Sensors((), Side.MOTOR, columns=("q", "tau"))


@dataclass(frozen=True, eq=False)
class Runs:
    """Simulated runs, what they tracked, by which controller, and its rate in Hz."""

    simulations: tuple[Simulation, ...]
    desired: tuple[Trajectory, ...]
    controller: PDFeedforward
    control_rate: float

    def part(self, which: slice) -> Runs:
        return replace(self, simulations=self.simulations[which], desired=self.desired[which])


def torque_driven(world: World, desired: Sequence[Trajectory], control_rate: float) -> Runs:
    """Runs whose torque does not depend on what the sensors read.

    A controller on the exact state of the simulation makes the torque, in place of a sequence prepared beforehand: the motion
    stays within the joints' ranges, and the noise of the logs knows nothing of the torque. Kept at `control_rate`."""
    controller = PDFeedforward.tuned(world.model, world.values)
    made = simulate_batch(
        world.plant, desired=desired, controller=controller, rate=control_rate, control_rate=control_rate, step=1.0 / control_rate,
        sensors=_BARE,
    )  # fmt: skip
    return Runs(made, tuple(desired), controller, control_rate)


def played_back(world: World, runs: Runs) -> Runs:
    """The torque of runs once more, in open loop and straight between its samples: motion for which the logged torque is all there is."""
    torque = np.stack([run.tau for run in runs.simulations], axis=1)
    start = tuple(np.array([getattr(run, key)[0] for run in runs.simulations]) for key in ("q", "dq"))
    made = simulate_batch(
        world.plant, torque=torque, hold=Hold.FIRST_ORDER, start=(start[0], start[1]), rate=runs.control_rate,
        step=1.0 / runs.control_rate, sensors=_BARE,
    )  # fmt: skip
    return replace(runs, simulations=made)


def closed_loop(world: World, desired: Sequence[Trajectory]) -> Runs:
    """Runs under a controller at the sampling rate that sees the encoders alone: torque answers to their rounding."""
    controller = PDFeedforward.tuned(world.model, world.values)
    made = simulate_batch(
        world.plant, desired=desired, controller=controller, rate=world.rate, control_rate=world.rate, step=1.0 / world.rate,
        feedback=Feedback(counts=world.counts), sensors=_BARE,
    )  # fmt: skip
    return Runs(made, tuple(desired), controller, world.rate)


def thinned(run: Simulation, every: int) -> Simulation:
    """Every so many samples of a run."""
    if every == 1:
        return run

    def cut(c: Coordinates) -> Coordinates:
        return Coordinates(c.q[::every], c.dq[::every], c.ddq[::every])

    readings = replace(run.readings, t=run.readings.t[::every], motion=cut(run.readings.motion), tau=run.readings.tau[::every])
    arrays = {key: getattr(run, key)[::every] for key in ("t", "tau", "applied", "friction", "held", "states")}
    return replace(run, link=cut(run.link), motor=cut(run.motor), readings=readings, **arrays)


def read(runs: Runs, sensors: Sensors, seed: int, rate: float) -> tuple[Log, ...]:
    """Logs at `rate` of all runs as the sensors read them; run i is named `run{i}`."""
    every = round(1.0 / (rate * runs.simulations[0].t[1]))
    return tuple(thinned(run, every).reread(sensors, 1000 * seed + i).log(f"run{i}") for i, run in enumerate(runs.simulations))


@dataclass(frozen=True, eq=False)
class PlanRuns:
    """The tests of a plan, each as the pieces in which it was simulated."""

    plan: Plan
    pieces: tuple[tuple[PlannedTest, tuple[Simulation, ...]], ...]

    def read(self, sensors: Sensors, seed: int) -> tuple[Log, ...]:
        """A log a test, named as the plan asks."""
        logs, count = [], 0
        for test, parts in self.pieces:
            made = []
            for part in parts:
                made.append(part.reread(sensors, 1000 * seed + 500 + count).log(test.log.removesuffix(".csv")))
                count += 1
            logs.append(_joined(made))
        return tuple(logs)


def planned(world: World, plan: Plan, piece_s: float = 5.0) -> PlanRuns:
    """Simulate the tests of a plan. A test that pauses is simulated in pieces from pause to pause, all side by side."""
    rate = world.rate
    ways = [plan.trajectory(test)[0] for test in plan.tests]
    cuts = [_pauses(way, piece_s, rate) for way in ways]
    lanes = [_piece(way, a, b, rate) for way, edges in zip(ways, cuts, strict=True) for a, b in itertools.pairwise(edges)]
    controller = PDFeedforward.tuned(world.model, world.values)
    made = iter(
        simulate_batch(world.plant, desired=lanes, controller=controller, rate=rate, control_rate=rate, step=1.0 / rate, sensors=_BARE)
    )
    pieces = []
    for test, edges in zip(plan.tests, cuts, strict=True):
        # A piece ends one sample before the next begins.
        ends = [*(b - 1 for b in edges[1:-1]), edges[-1]]
        pieces.append((test, tuple(next(made).until((b - a) / rate) for a, b in zip(edges, ends, strict=False))))
    return PlanRuns(plan, tuple(pieces))


def _pauses(way: Chained, piece_s: float, rate: float) -> list[int]:
    """Samples at which a motion may be cut: within pauses, about `piece_s` apart; first and last one included."""
    end = round(way.duration * rate)
    found = [0]
    for start, part in zip(way.starts, way.parts, strict=True):
        middle = round((start + 0.5 * part.duration) * rate)
        if isinstance(part, Dwell) and middle - found[-1] >= piece_s * rate and end - middle >= 0.3 * piece_s * rate:
            found.append(middle)
    return [*found, end]


def _piece(way: Trajectory, first: int, last: int, rate: float) -> Coordinates:
    return way.sample(np.arange(first, last + 1) / rate)


def _joined(logs: Sequence[Log]) -> Log:
    """Pieces of one test as one log; each begins one sample after the one before."""
    first = logs[0]
    step = float(first.t[1] - first.t[0])
    count = sum(len(log) for log in logs)
    return replace(
        first,
        t=np.arange(count) * step,
        q=np.concatenate([log.q for log in logs if log.q is not None]),
        tau={side: np.concatenate([log.tau[side] for log in logs]) for side in first.tau},
    )
