"""What `[drive]` gives of a law, as arrays: constants joint by joint, and forms of commands."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.text import counted
from ..errors import ConfigurationError
from ..robots.tables import ENDLESS
from .loads import Load

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray
#: What stands for a constant that is to be identified, and for one that a drive does not have.
IDENTIFY, NONE = "identify", "none"
#: Constants that may be negative.
_SIGNED = ("integral_start",)


class CommandForm(StrEnum):
    """What a command is between two samples: held, or straight to the next."""

    STAIRCASE = "staircase"
    RAMP = "ramp"


class VelocityCommand(StrEnum):
    """The velocity that a drive is sent: as logged (0 where it is not), none, or the derivative of the position command."""

    LOGGED = "logged"
    ZERO = "zero"
    DERIVATIVE = "derivative"


class SupplyForm(StrEnum):
    """The voltage that a drive's pulses are shares of: the logged readings, or their mean over the log.

    A reading is of one instant, while the pulses of the drive draw on the supply and pump it up again thousands of times a second."""

    LOGGED = "logged"
    MEAN = "mean"


#: What a law says besides constants, and of what kind it is.
FORMS: dict[str, type[StrEnum]] = {"command": CommandForm, "velocity_command": VelocityCommand, "supply": SupplyForm}


def per_joint(key: str, value: Any, robot: Robot) -> Array:
    """(n,), NaN where to be identified, infinite where there is none."""
    own = key.rpartition(" ")[2]
    choice = f'a number, "{IDENTIFY}", or "{NONE}"' if own in ENDLESS else f'a number or "{IDENTIFY}"'
    if isinstance(value, Mapping):
        for name in value:
            robot.joint_index(name)
        missing = [name for name in robot.joint_names if name not in value]
        if missing:
            raise ConfigurationError(f"[drive] {key}: joint {missing[0]!r} is missing from the table: give {choice}.")
        value = [value[name] for name in robot.joint_names]
    entries = list(value) if isinstance(value, list | tuple | np.ndarray) else [value] * robot.n
    if len(entries) != robot.n:
        raise ConfigurationError(
            f"[drive] {key}: {counted(len(entries), 'value')}, but the robot has"
            f" {counted(robot.n, 'joint')} ({', '.join(robot.joint_names)})."
        )
    said = {IDENTIFY: np.nan, "fit": np.nan} | ({NONE: np.inf} if own in ENDLESS else {})
    for name, x in zip(robot.joint_names, entries, strict=True):
        if isinstance(x, str) and x not in said:
            raise ConfigurationError(f"[drive] {key} of joint {name!r} is {x!r}: give {choice}.")
    found = np.array([said[x] if isinstance(x, str) else float(x) for x in entries])
    if np.any(found < 0) and own not in _SIGNED:
        raise ConfigurationError(f"[drive] {key} of joint {robot.joint_names[int(np.argmax(found < 0))]!r} is negative.")
    return found


def forms_of(given: Mapping[str, Any]) -> dict[str, Any]:
    """The forms that are given, each of its kind."""
    return {key: FORMS[key](value) for key, value in given.items() if value is not None}


def of_a_log(name: str, table: Mapping[str, Any], robot: Robot) -> dict[str, Any]:
    """What `by_log` has for one log or pattern. Raises ConfigurationError."""
    forms = {key: value for key, value in table.items() if key in FORMS}
    constants = {key: per_joint(f"by_log.{name} {key}", value, robot) for key, value in table.items() if key not in (*forms, "load")}
    load = table.get("load")
    return {
        "constants": constants,
        "forms": forms_of(forms),
        "load": None if load is None else Load.read(f"[drive] by_log.{name} load", load, robot),
    }
