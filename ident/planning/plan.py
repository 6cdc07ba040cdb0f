"""Step-by-step identification as a plan: tests of one or two joints at a time, from the tip to the base (SCIENCE.md 4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError, unknown_name
from ..excitation.limits import Limits
from ..friction import Coulomb, RotorInertia, Viscous
from ..robots.robot import Robot
from .choice import Chooser, Separation
from .logs import Tracking, simulate_logs
from .manifest import plan_tables, read_manifest, write_manifest
from .trials import Kind, PlannedTest, Segment, Sweep, Swing

if TYPE_CHECKING:
    from ..model import Model
    from ..simulation.plant import Plant
    from ..simulation.trajectory import Chained

Array = np.ndarray

__all__ = [
    "Kind",
    "Plan",
    "PlannedTest",
    "Segment",
    "Separation",
    "Sweep",
    "Swing",
    "Tracking",
    "default_model",
    "make_plan",
    "read_plan",
    "simulate_plan",
    "write_plan",
]


@dataclass(frozen=True, eq=False)
class Plan:
    """Tests in the order in which they are evaluated; each uses what those before it have revealed.

    `robot`, `joints`: of whom; `effects`: names of the model's effects; `base`: its b base parameters; `rank`: how many
    combinations of them the tests determine; `velocity`, `acceleration` (n,): bounds of the moves between postures."""

    robot: str
    joints: tuple[str, ...]
    effects: tuple[str, ...]
    base: tuple[str, ...]
    tests: tuple[PlannedTest, ...]
    rank: int
    velocity: Array = field(repr=False)
    acceleration: Array = field(repr=False)
    notes: tuple[str, ...] = ()

    def test(self, name: str) -> PlannedTest:
        """A test by its name. Raises ConfigurationError with the nearest."""
        for test in self.tests:
            if test.name == name:
                return test
        raise unknown_name("test of the plan", name, [t.name for t in self.tests])

    def of_kind(self, kind: Kind) -> tuple[PlannedTest, ...]:
        """The tests of one kind."""
        return tuple(t for t in self.tests if t.kind == kind)

    def trajectory(self, test: PlannedTest) -> tuple[Chained, tuple[Segment, ...]]:
        """The motion of a test, and the stretches of its log to use."""
        return test.trajectory(self.velocity, self.acceleration)

    @property
    def duration(self) -> float:
        """Seconds of all tests together."""
        return float(sum(self.trajectory(t)[0].duration for t in self.tests))

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        tables = plan_tables(self)
        return {"schema": "ident.plan/1", **tables.pop("plan"), "tests": [{"name": name, **table} for name, table in tables.items()]}

    def __str__(self) -> str:
        head = f"plan for {self.robot}: {len(self.tests)} tests, {self.duration:.0f} s"
        lines = [f"{head}, {self.rank} of {len(self.base)} base parameters determined"]
        width = max((len(t.name) for t in self.tests), default=4)
        for number, test in enumerate(self.tests, start=1):
            told = ", ".join(test.reveals) or "a combination"
            extra = test.gain - len(test.reveals)
            if test.reveals and extra > 0:
                told += f" and {extra} combination" + ("s" if extra > 1 else "")
            weak = "  (weakly)" if test.strength < 1e-2 else ""
            lines.append(f"{number:>3} {test.name:<{width}}  row {test.row} ({test.side}), {len(test.postures)} postures: {told}{weak}")
        return "\n".join([*lines, *(f"note: {n}" for n in self.notes)])


def default_model(robot: Robot) -> Model:
    """Rigid body, rotor inertia, viscous and Coulomb friction on every joint: what the step-by-step method identifies."""
    return robot.rigid_body() + RotorInertia() + Viscous() + Coulomb()


def make_plan(
    model: Model | Robot,
    *,
    limits: Limits | None = None,
    postures: int = 3,
    separation: Separation | str = Separation.COUPLED,
    seed: int = 0,
) -> Plan:
    """The step-by-step plan of a model, or of a robot with rotor inertia, viscous and Coulomb friction on every joint.

    Static tests, constant velocity, and motion of one or two joints with the others frozen at `postures` postures or more; as
    many as it takes to determine every base parameter, decided by ranks within `limits` (by default nine tenths of what the
    robot's description allows). Collisions are not looked at. Raises UnsupportedError for effects that a plan cannot hold."""
    if isinstance(model, Robot):
        model = default_model(model)
    robot = model.robot
    limits = limits or Limits.of(robot)
    if postures < 2:
        raise ConfigurationError(f"plan: at least 2 postures are needed to tell gravity and inertia of the frozen joints, not {postures}.")
    tests, rank = Chooser(model, limits, postures, seed).tests(Separation(separation))
    notes = []
    if rank < model.base.count:
        revealed = {name for test in tests for name in test.reveals}
        left = [name for name in model.base.names if name not in revealed]
        notes.append(f"{model.base.count - rank} combination(s) of {', '.join(left[:8])} stay unknown within these limits.")
    return Plan(
        robot.name,
        robot.joint_names,
        tuple(e.name for e in model.effects),
        model.base.names,
        tuple(tests),
        rank,
        0.5 * limits.velocity,
        0.5 * limits.acceleration,
        tuple(notes),
    )


def write_plan(plan: Plan, path: str | Path, *, force: bool = False) -> Path:
    """Write a plan as its manifest (TOML). Raises ConfigurationError if the file exists and `force` is false."""
    return write_manifest(plan, Path(path), force=force)


def read_plan(path: str | Path) -> Plan:
    """Read a manifest. Raises ConfigurationError that names the file, the test and the key."""
    return Plan(**read_manifest(Path(path)))


def simulate_plan(
    plan: Plan,
    plant: Plant,
    folder: str | Path,
    *,
    tests: Sequence[str] | None = None,
    tracking: str = Tracking.CONTROLLER,
    seed: int = 0,
    force: bool = False,
    **settings: Any,
) -> Path:
    """Simulate the tests of a plan, write a log of each and the manifest `plan.toml` into `folder`; returns the manifest's path.

    `plant`: what is tested; `tests`: names, by default all; `tracking`: see `Tracking`. `settings` go to `simulate_batch`
    (sensors, controller, rate, feedback …); with exact tracking only rate (Hz), sensors and progress mean something. Test
    number i takes the seed `seed` + i. Raises ConfigurationError for other joints or existing files."""
    return simulate_logs(plan, plant, Path(folder), tests, tracking, seed, force, settings)
