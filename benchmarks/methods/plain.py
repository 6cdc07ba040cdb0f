"""The source's plain instrumental variables over many seeds: `python -m benchmarks.methods.plain`, and a part of the full comparison.

Each seed has motions of its own; torque is exact, positions are rounded by the encoders, accelerations are central differences.
How far least squares falls short says how much acceleration a motion has against the encoders' noise. `plain_kinds` chooses its motions
so that least squares falls as short as in the values that it is compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ident.estimators import InstrumentalVariable, LeastSquares
from ident.problem.problem import Problem
from ident.robots.transmission import Side
from ident.signals.preparation import CentralDifference, Preparation
from ident.simulation.sensors import Quantisation, Sensors, TorqueWindow

from .data import FAST, SLOW, recorded
from .motions import read, torque_driven
from .random_motion import fourier
from .tables import number, table
from .world import TorqueMeasure, World, puma

Array = np.ndarray
FOLLOWED = ("Izz_joint1", "Izz_joint2", "Izz_joint3")
PASSES = 3
#: Motions of 5 s on which torque errors are measured.
UNSEEN = 8


@dataclass(frozen=True)
class Kind:
    """A motion and an encoder: `lanes` runs of one period of `seconds` at `speed` of the joints' top speed, `counts` per motor turn.

    `earlier`: what an independent program found with least squares and with plain IV (J1z, J2z, J3z), and its largest torque error of a
    joint (%), where there is such a case. `preparation`: by default rows near standstill, where dry friction may take any value, are
    left out."""

    title: str
    seconds: float
    lanes: int
    speed: float
    counts: float
    earlier: tuple[Array, Array, float] | None = None
    preparation: Preparation = field(default_factory=CentralDifference)


_COARSE = (np.array([0.45, 1.67, 0.02]), np.array([5.55, 7.06, 1.27]), 21.0)
KINDS = (
    Kind("quick, 1000 counts", 2.7, 111, FAST, 1000.0, (np.array([3.70, 6.14, 0.86]), np.array([5.364, 7.012, 1.253]), 0.3)),
    Kind("slow, 1000 counts", 5.0, 60, 0.8, 1000.0, (np.array([1.64, 4.52, 0.38]), np.array([5.38, 7.01, 1.26]), 18.0)),
    Kind("slow, 400 counts", 5.0, 60, 0.8, 400.0, _COARSE),
    Kind("slow, 400 counts, standstill too", 5.0, 60, 1.0, 400.0, _COARSE, CentralDifference(standstill=None)),
    Kind("slower, 400 counts", 5.0, 60, SLOW, 400.0),
)


@dataclass(frozen=True, eq=False)
class Seeds:
    """Followed values (S, f) of least squares and, after each pass (S, passes, f), of the plain method; torque error by wrong parameters on
    motion that no fit saw, over all joints (S, 1 + passes), and the largest of a joint (S, 1 + passes)."""

    kind: Kind
    samples: int
    truth: Array
    least: Array
    plain: Array
    errors: Array
    largest: Array

    def rows(self) -> list[list[str]]:
        """For a table: mean ± scatter between seeds, and the earlier values."""
        chosen = [("least squares", self.least, 0), *((f"plain IV, pass {k}", self.plain[:, k - 1], k) for k in (1, 2))]
        found = [
            [
                f"{self.kind.title}, {label}", *(f"{m:.4g} ± {s:.2g}" for m, s in zip(v.mean(axis=0), v.std(axis=0, ddof=1), strict=True)),
                number(100 * float(np.median(self.errors[:, k]))), number(100 * float(np.median(self.largest[:, k]))),
            ]
            for label, v, k in chosen
        ]  # fmt: skip
        if self.kind.earlier is not None:
            least, plain, largest = self.kind.earlier
            for label, values, worst in (("least squares", least, ""), ("plain IV", plain, number(largest))):
                found.append([f"  an independent program, {label}", *(f"{x:.4g}" for x in values), "", worst])
        return found


def plain_seeds(world: World, kind: Kind, seeds: Sequence[int], measure: TorqueMeasure) -> Seeds:
    """Motions of their own for every seed; torque errors by `measure`."""
    sensors = Sensors((Quantisation.counts(kind.counts), TorqueWindow(1.0 / world.rate)), Side.MOTOR, columns=("q", "tau"))
    at = [world.names.index(name) for name in FOLLOWED]
    least, plain, errors, largest = [], [], [], []
    for seed in seeds:
        ways = [fourier(world.model, 50_000 + 1000 * seed + i, kind.seconds, kind.speed) for i in range(kind.lanes)]
        logs = read(torque_driven(world, ways, 1000.0), sensors, seed, world.rate)
        problem = Problem(world.model, kind.preparation(logs, world.model.robot))
        course = [LeastSquares().solve(problem).values]
        for passes in range(1, PASSES + 1):
            estimator = InstrumentalVariable(loop="open", instruments="forward_dynamics", weighting="none", iterations=passes)
            course.append(estimator.solve(problem).values)
        least.append(course[0][at])
        plain.append([values[at] for values in course[1:]])
        errors.append([measure(values - world.truth) for values in course])
        largest.append([measure.shares(values - world.truth).max() for values in course])
    samples = round(kind.lanes * kind.seconds * world.rate)
    return Seeds(kind, samples, world.truth[at], *(np.array(x) for x in (least, plain, errors, largest)))


def plain_table(found: Sequence[Seeds]) -> str:
    """All of them under the true values."""
    head = [f"{found[0].samples} samples, exact torque", "J1z", "J2z", "J3z", "torque error %", "largest joint %"]
    return table(head, [["true", *(f"{x:.4g}" for x in found[0].truth), "", ""], *(row for one in found for row in one.rows())])


def unseen_measure(world: World) -> TorqueMeasure:
    """Torque error on quick motions that no fit sees."""
    runs = torque_driven(world, [fourier(world.model, 90_000 + i, 5.0, FAST) for i in range(UNSEEN)], 1000.0)
    return TorqueMeasure.of(Problem(world.model, recorded()(read(runs, world.exact(world.rate), 0, world.rate), world.model.robot)))


def plain_kinds(world: World, seeds: int = 12) -> list[Seeds]:
    """Quick and slow motion, two encoders."""
    measure = unseen_measure(world)
    return [plain_seeds(world, kind, range(1, seeds + 1), measure) for kind in KINDS]


if __name__ == "__main__":
    print(plain_table(plain_kinds(puma())))
