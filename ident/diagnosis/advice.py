"""Advice: what to do about a finding, and which motion would tell it from its competing models."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..effects.base import Effect
from ..effects.kinds import Axis
from ..effects.places import on
from ..effects.registry import effect_types
from .held_out import partly, unconfirmed

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
            same = "No motion distinguishes them as long as they act alike" if other.axis == Axis.VELOCITY else "They differ only in detail"
            motion = _MOTION[finding.effect.axis].format(joint=joint)
            return (
                f"{title} or {competing.effect}: {same}; {motion}, over a wider range than in this log, or use either: they predict alike."
            )
        ways = dict.fromkeys(
            [_MOTION[finding.effect.axis].format(joint=joint)] + ([_MOTION[other.axis].format(joint=where)] if other is not None else [])
        )
        return f"{title} or {competing.effect}{on(competing.place)}: to tell them apart, {'; and '.join(ways)}."
    if unconfirmed(finding.presence):
        motion = _MOTION[finding.effect.axis].format(joint=joint)
        if partly(finding.presence):
            return (
                f"{title}: held-out data have less of it than it predicts; it changes or stands for another effect: {motion} in both logs."
            )
        return f"{title}: held-out data neither show it nor rule it out; {motion} in the log held out."
    if verdict in ("unexplained", "ambiguous") and finding.confidence < 0.5:
        return f"{title} explains a part only; take it as a hint, and look at the residual before acting on it."
    if verdict == "unexplained":
        return (
            f"Add {finding.name}{on(finding.place)} to the declared model ({title}): all that it predicts is present in the held-out data."
            " Something else is left, which it does not account for."
        )
    return f"Add {finding.name}{on(finding.place)} to the declared model ({title})."


def motion_for(effect: Effect, joint: str) -> str:
    """The motion of a joint that shows an effect."""
    return _MOTION[effect.axis].format(joint=joint)
