"""Advice: what to do about a finding, and which motion would tell it from its competing models."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..effects.base import Effect
from ..effects.kinds import Axis
from ..effects.places import on
from ..effects.registry import effect_types

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .result import Finding

#: The motion that shows a quantity's influence.
_MOTION = {
    Axis.POSITION: "move {joint} slowly through its whole range, both ways",
    Axis.VELOCITY: "run {joint} at several steady speeds from slow to fast, both ways",
    Axis.ACCELERATION: "accelerate {joint} hard, at low and at high speed",
    Axis.LOAD: "repeat the same motion of {joint} in postures with little and with much load",
    Axis.TIME: "repeat one and the same motion of {joint} from the beginning to the end of a long log",
    Axis.MOTOR_ANGLE: "turn {joint} slowly and steadily over many turns of its motor",
    Axis.TORQUE: "drive {joint} with small and with large torque (loads, accelerations) while the other joints move as usual",
}


def advice_for(finding: Finding, robot: Robot, verdict: str) -> str:
    """One or two sentences."""
    joint = finding.joints[0] if finding.joints else "every joint"
    title = finding.effect.title
    if finding.ambiguous:
        competing = finding.competing[0]
        other = effect_types().get(competing.effect)
        where = competing.joints[0] if competing.joints else "every joint"
        if other is not None and other.axis == finding.effect.axis and competing.joints == finding.joints:
            same = "No motion tells them apart as long as they act alike" if other.axis == Axis.VELOCITY else "They differ only in detail"
            motion = _MOTION[finding.effect.axis].format(joint=joint)
            return (
                f"{title} or {competing.effect}: {same}; {motion}, over a wider range than in this log, or take either: they predict alike."
            )
        ways = dict.fromkeys(
            [_MOTION[finding.effect.axis].format(joint=joint)] + ([_MOTION[other.axis].format(joint=where)] if other is not None else [])
        )
        return f"{title} or {competing.effect}{on(competing.place)}: to tell them apart, {'; and '.join(ways)}."
    if verdict in ("unexplained", "ambiguous") and finding.confidence < 0.5:
        return f"{title} explains a part only; take it as a hint, and look at the residual before acting on it."
    return f"Add {finding.name}{on(finding.place)} to the declared model ({title})."


def motion_for(effect: Effect, joint: str) -> str:
    """The motion of a joint that shows an effect."""
    return _MOTION[effect.axis].format(joint=joint)


def advice_to_confirm(finding: Finding, where: str) -> str:
    """What to do before a finding is relied on that the data `where` ("fitted" or "held out") do not show beyond chance."""
    return _first(finding, f"the data {where} do not show it beyond chance")


def advice_without_period(finding: Finding) -> str:
    """What to do before a periodic finding is relied on of whose period next to nothing was seen."""
    return _first(finding, "the motion covers too little of its period to tell it from any other slow dependence on the position")


def advice_unconfirmed(finding: Finding) -> str:
    """What to do before a finding is relied on to which no data are left that had no part in it."""
    return _first(finding, "no data are left that could confirm it")


def _first(finding: Finding, why: str) -> str:
    """The motion that is to be logged before a finding is relied on."""
    motion = motion_for(finding.effect, finding.joints[0] if finding.joints else "every joint")
    return f"{finding.effect.title}: {why}; {motion}, and validate on that."
