"""What effects say of themselves in one word: what they are looked at against, what they need, where they sit, what their columns are."""

from __future__ import annotations

from enum import StrEnum
from typing import TypeVar

from ..errors import unknown_name

_S = TypeVar("_S", bound=StrEnum)


class Axis(StrEnum):
    """The quantity against which the residual of a missing effect is best looked at."""

    POSITION = "position"
    VELOCITY = "velocity"
    ACCELERATION = "acceleration"
    LOAD = "load"
    TIME = "time"
    MOTOR_ANGLE = "motor angle"
    TORQUE = "torque"


class Need(StrEnum):
    """What an effect's columns depend on beside the motion at the same instant.

    LOAD: the torque that the links ask for, as the model predicts it (`Motion.load`). REFERENCE: the model's whole
    prediction, also at other positions or of another robot (`Motion.reference`). HISTORY: the motion before, from the start
    of the run. NEIGHBOURS: the samples right before and after, uniform in time. TORQUE: the measured torque. TIME: the
    run's own clock (`Motion.clock`)."""

    LOAD = "load"
    REFERENCE = "reference"
    HISTORY = "history"
    NEIGHBOURS = "neighbours"
    TORQUE = "torque"
    TIME = "time"


class Nature(StrEnum):
    """Where in the chain from link to log an effect sits.

    LINK: torque that the links ask for and the gears transmit (rigid body, springs, payload). FRICTION: zero at standstill;
    columns whose parameter is bounded below by zero take power out. DRIVE: the rest of the drive train. SENSOR: only in
    what is measured, so that simulating the motion leaves it out."""

    LINK = "link"
    FRICTION = "friction"
    DRIVE = "drive"
    SENSOR = "sensor"


class Factor(StrEnum):
    """What a column of a joint effect can be, where it is nothing but one coordinate of the joint's own motion, on the effect's side."""

    ONE = "one"
    POSITION = "position"
    SPEED = "speed"
    DIRECTION = "direction"
    ACCELERATION = "acceleration"


def choice(kind: type[_S], value: str, key: str, effect: str) -> _S:
    """A member of an enumeration by its text. Raises ConfigurationError with the nearest members."""
    try:
        return kind(value)
    except ValueError:
        raise unknown_name(f"value of `{key}` of effect {effect!r}", str(value), [str(member) for member in kind]) from None
