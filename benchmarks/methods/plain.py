"""The source's plain instrumental variables over many seeds: `python -m benchmarks.methods.plain`, and a part of the full comparison.

Each seed has motions of its own; torque is exact, positions are rounded by the encoders, accelerations are central differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.estimators import InstrumentalVariable, LeastSquares
from ident.problem.problem import Problem
from ident.robots.transmission import Side
from ident.signals.preparation import CentralDifference, Recorded
from ident.simulation.sensors import Quantisation, TorqueWindow
from ident.simulation.simulate import Sensors

from .data import FAST, SLOW
from .motions import read, torque_driven
from .random_motion import fourier
from .tables import number, table
from .world import World, puma

Array = np.ndarray
FOLLOWED = ("Izz_joint1", "Izz_joint2", "Izz_joint3")
PASSES = 3


@dataclass(frozen=True, eq=False)
class Seeds:
    """Followed values (S, f) of least squares and of the plain method, after each pass (S, passes) the torque error over all joints, and
    the largest of a joint (S,), on motion that no fit saw."""

    title: str
    samples: int
    truth: Array
    least: Array
    plain: Array
    errors: Array
    largest: Array

    def rows(self) -> list[list[str]]:
        """For a table: mean ± scatter between seeds."""
        values = [
            [f"{self.title}, {label}", *(f"{m:.4g} ± {s:.2g}" for m, s in zip(v.mean(axis=0), v.std(axis=0, ddof=1), strict=True))]
            for label, v in (("least squares", self.least), ("plain IV", self.plain))
        ]
        passes = " -> ".join(number(100 * x) for x in np.median(self.errors, axis=0))
        values[0] += ["", ""]
        values[1] += [passes, number(100 * float(np.median(self.largest)))]
        return values


def plain_seeds(
    world: World, title: str, speed: float, counts: float, seeds: Sequence[int], lanes: int = 60, seconds: float = 5.0
) -> Seeds:
    """`lanes` motions of `seconds` for every seed, and one more on which torque is judged."""
    sensors = Sensors((Quantisation.counts(counts), TorqueWindow(1.0 / world.rate)), Side.MOTOR, columns=("q", "tau"))
    at = [world.names.index(name) for name in FOLLOWED]
    least, plain, errors, largest = [], [], [], []
    for seed in seeds:
        ways = [fourier(world.model, 50_000 + 1000 * seed + i, seconds, speed) for i in range(lanes)]
        ways.append(fourier(world.model, 90_000 + seed, seconds, FAST))
        runs = torque_driven(world, ways, 1000.0)
        train, unseen = runs.part(slice(0, lanes)), runs.part(slice(lanes, lanes + 1))
        robot = world.model.robot
        problem = Problem(world.model, CentralDifference()(read(train, sensors, seed, world.rate), robot))
        exact = Recorded(standstill=None)(read(unseen, world.exact(world.rate), seed, world.rate), robot)
        least.append(LeastSquares().solve(problem).values[at])
        course = []
        for passes in range(PASSES + 1):
            if passes == 0:
                found = LeastSquares().solve(problem)
            else:
                found = InstrumentalVariable(loop="open", instruments="forward_dynamics", weighting="none", iterations=passes).solve(
                    problem
                )
            course.append(found.torque_error(exact))
        plain.append(found.values[at])
        errors.append([e.relative_all for e in course])
        largest.append(float(np.max(course[-1].relative)))
    return Seeds(title, round(lanes * seconds * world.rate), world.truth[at], *(np.array(x) for x in (least, plain, errors, largest)))


def plain_table(found: Sequence[Seeds]) -> str:
    """All of them under the true values."""
    head = [f"{found[0].samples} samples, exact torque", "J1z", "J2z", "J3z", "torque error % by pass", "largest joint %"]
    return table(head, [["true", *(f"{x:.4g}" for x in found[0].truth), "", ""], *(row for one in found for row in one.rows())])


def plain_kinds(world: World, seeds: int = 12) -> list[Seeds]:
    """Quick and slow motion, two encoders."""
    kinds = (("quick, 1000 counts", FAST, 1000.0), ("slow, 1000 counts", SLOW, 1000.0), ("slow, 400 counts", SLOW, 400.0))
    return [plain_seeds(world, title, speed, counts, range(1, seeds + 1)) for title, speed, counts in kinds]


if __name__ == "__main__":
    print(plain_table(plain_kinds(puma())))
