"""A plan: tests of one or two joints at a time in the order in which they are evaluated."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .._utils.short_repr import ShortRepr
from ..errors import unknown_name
from ..simulation.trajectory import Chained
from .trials import MotionKind, PlannedTest, Segment, Sweep

Array = np.ndarray
#: Keys of a motion in the tables of a plan.
SWEEP_KEYS = ("direction", "speeds", "reach")
SWING_KEYS = ("sine", "cosine", "base_hz")
SCHEMA = "ident.plan/1"


@dataclass(frozen=True, eq=False, repr=False)
class Plan(ShortRepr):
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

    def of_kind(self, kind: MotionKind) -> tuple[PlannedTest, ...]:
        """The tests of one kind."""
        return tuple(t for t in self.tests if t.kind == kind)

    def trajectory(self, test: PlannedTest) -> tuple[Chained, tuple[Segment, ...]]:
        """The motion of a test, and the stretches of its log to use."""
        return test.trajectory(self.velocity, self.acceleration)

    @property
    def duration(self) -> float:
        """Seconds of all tests together."""
        return float(sum(self.trajectory(t)[0].duration for t in self.tests))

    def tables(self) -> dict[str, dict[str, Any]]:
        """Tables of plain values: "plan", then each test by its name."""
        tables: dict[str, dict[str, Any]] = {
            "plan": {
                "schema": SCHEMA,
                "robot": self.robot,
                "joints": list(self.joints),
                "effects": list(self.effects),
                "base": list(self.base),
                "rank": self.rank,
                "velocity": self.velocity.tolist(),
                "acceleration": self.acceleration.tolist(),
                "notes": list(self.notes),
            }
        }
        for test in self.tests:
            motion = test.motion
            keys = SWEEP_KEYS if isinstance(motion, Sweep) else SWING_KEYS
            own = {key: np.asarray(getattr(motion, key)).tolist() for key in keys}
            _, segments = self.trajectory(test)
            tables[test.name] = {
                "kind": test.kind.value,
                "moving": list(test.moving),
                "row": test.row,
                "side": test.side.value,
                "log": test.log,
                "reveals": list(test.reveals),
                "gain": test.gain,
                "strength": test.strength,
                "postures": test.postures.tolist(),
                **own,
                # For people and other programs; reading a plan makes them anew.
                "segments": [
                    {"begin": s.begin, "end": s.end, "posture": s.posture, "direction": s.direction, "speed": s.speed} for s in segments
                ],
            }
        return tables

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        tables = self.tables()
        return {"schema": SCHEMA, **tables.pop("plan"), "tests": [{"name": name, **table} for name, table in tables.items()]}

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
