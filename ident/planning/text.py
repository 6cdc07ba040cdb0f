"""A plan for the people at the machine: what to do in each test, where, and what it is for."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from .trials import MotionKind, PlannedTest, Sweep

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .sequence import Plan

_WIDTH = 120
_HOW = {
    MotionKind.STATIC: "creeps through each posture in both directions; the mean of both torques holds the posture",
    MotionKind.CONSTANT_VELOCITY: "turns steadily in both directions at two speeds; half the difference of the torques is friction",
    MotionKind.ACCELERATED: "swings about each posture while the other joints are held",
}


def plan_text(plan: Plan, robot: Robot) -> str:
    """The plan as a text: angles in degrees, lengths in m. `robot` tells which joints slide."""
    prismatic = {joint.name for joint in robot.joints if joint.prismatic}
    lines = [str(plan), ""]
    for number, test in enumerate(plan.tests, start=1):
        lines += [*_test(plan, number, test, prismatic), ""]
    lines += ["Record each test as one log under the name given, with t, positions and torque from its start to its end."]
    return "\n".join(lines)


def _test(plan: Plan, number: int, test: PlannedTest, prismatic: set[str]) -> list[str]:
    way, segments = plan.trajectory(test)
    motor = test.kind == MotionKind.CONSTANT_VELOCITY
    who = ("motor of " if motor else "") + " and ".join(test.moving)
    reveals = ", ".join(test.reveals) or "a combination that later tests resolve"
    sentences = [
        f"{number}. {test.name}: {who} {_HOW[test.kind]}.",
        f"log: {test.log}, {way.duration:.1f} s; used: {sum(s.end - s.begin for s in segments):.1f} s in {len(segments)} stretches",
        f"reads: torque of {test.row}, {test.side.value} side",
        f"reveals: {reveals}",
    ]
    if isinstance(test.motion, Sweep):
        unit = "rad/s" if motor or test.moving[0] not in prismatic else "m/s"
        sentences.append("speeds: " + ", ".join(f"{s:.3g}" for s in test.motion.speeds) + f" {unit}")
    lines = []
    for i, sentence in enumerate(sentences):
        indent = "" if i == 0 else "   "
        lines += textwrap.wrap(sentence, _WIDTH, initial_indent=indent, subsequent_indent="     ", break_on_hyphens=False)
    for i, posture in enumerate(test.postures, start=1):
        places = _posture(plan.joints, posture, test.moving, prismatic)
        lines += textwrap.wrap(f"posture {i}: {places}", _WIDTH, initial_indent="   ", subsequent_indent="     ")
    return lines


def _posture(joints: Sequence[str], posture: np.ndarray, moving: Sequence[str], prismatic: set[str]) -> str:
    def one(name: str, value: float) -> str:
        shown = f"{value:.4f} m" if name in prismatic else f"{np.degrees(value):.1f}°"
        return f"{name} {'about ' if name in moving else ''}{shown}"

    return ", ".join(one(name, value) for name, value in zip(joints, posture.tolist(), strict=True))
