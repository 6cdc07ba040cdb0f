"""What the name of a log's column says: which quantity of which joint it holds, and in what unit (docs/formats.md)."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..errors import ConfigurationError
from .units import UNITS, expected_units, split_unit, unit_of

if TYPE_CHECKING:
    from ..robots.robot import Robot

#: Quantities a log may hold. Torque is kept by what was logged: on the joint side, on the motor side, or as a motor current.
QUANTITIES = ("t", "q", "dq", "ddq", "q_motor", "dq_motor", "ddq_motor", "tau_joint", "tau_motor", "tau_current")
#: The name that a quantity has under [columns], before the joint's number.
KEYS = {
    "t": "t", "q": "q", "dq": "dq", "ddq": "ddq", "q_motor": "q_m", "dq_motor": "dq_m", "ddq_motor": "ddq_m", "tau_joint": "tau",
    "tau_motor": "tau_m", "tau_current": "i",
}  # fmt: skip
#: What messages call a quantity.
TEXT = {
    "t": "time", "q": "position", "dq": "velocity", "ddq": "acceleration", "q_motor": "motor position", "dq_motor": "motor velocity",
    "ddq_motor": "motor acceleration", "tau_joint": "torque", "tau_motor": "motor torque", "tau_current": "current",
}  # fmt: skip
#: Index of a joint that is locked.
LOCKED = -2
_SYMBOL = re.compile(r"^(?P<symbol>ddq|dq|q|tau|i)(?P<motor>_?m)?_?(?P<joint>[0-9]+)$", re.IGNORECASE)
_BY_NAME = re.compile(r"^(?P<joint>.+)[./](?P<word>position|velocity|acceleration|effort|torque|current)$", re.IGNORECASE)
_WORDS = {
    "position": "q", "velocity": "dq", "acceleration": "ddq", "effort": "tau_joint", "torque": "tau_joint", "current": "tau_current",
}  # fmt: skip


@dataclass(frozen=True)
class JointNames:
    """What a log's columns are matched against: joint names in order, and which joints are prismatic. `side`: of a torque whose name
    tells none (`<joint>.effort`), as the drive declares it. `whole`: the joints in order before some were locked; `numbered`: those that
    a log's numbers count, where these are not `names`."""

    names: tuple[str, ...]
    prismatic: tuple[bool, ...]
    side: str = "joint"
    whole: tuple[str, ...] = ()
    numbered: tuple[str, ...] = ()

    @classmethod
    def of(cls, robot: Robot) -> JointNames:
        """Those of a robot behind its drive."""
        return cls(robot.joint_names, tuple(j.prismatic for j in robot.joints), robot.transmission.measured.value, robot.whole)

    @property
    def locked(self) -> tuple[str, ...]:
        """Joints that were locked."""
        return tuple(name for name in self.whole if name not in self.names)

    def counted(self, columns: Iterable[str]) -> JointNames:
        """The same for a log with these columns: where numbers go up to the last joint of the whole robot, they count its joints."""
        if not self.locked:
            return self
        found: dict[str, set[int]] = {}
        for source in columns:
            named = parse_name(source, self)
            if named is not None and named.numbered:
                found.setdefault(named.quantity, set()).add(named.joint)
        positions = [found[quantity] for quantity in ("q", "q_motor") if quantity in found]
        every = set(range(len(self.whole)))
        return replace(self, numbered=self.whole) if any(numbers == every for numbers in positions or found.values()) else self

    def index(self, number: int) -> int:
        """Index of the joint that a log numbers so (from 0): -1 where there is none of number -1, `LOCKED` of a locked one."""
        if not 0 <= number < len(self.numbered):
            return number
        name = self.numbered[number]
        return self.names.index(name) if name in self.names else LOCKED


@dataclass(frozen=True)
class Column:
    """One column of a file as one quantity: SI value = scale * value + offset. `joint` counts from 0 (0 for time)."""

    source: str
    quantity: str
    joint: int
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""


@dataclass(frozen=True)
class Named:
    """What a name says. `joint` counts from 0 (0 for time; -1 where the name's number is 0, `LOCKED`); `numbered`: it is told by a number.
    `unit`: the suffix, or "" without one; `unread`: what stands in brackets where a unit may, but is none that is known."""

    quantity: str
    joint: int
    numbered: bool = False
    unit: str = ""
    unread: str | None = None

    def column(self, source: str, where: str) -> Column:
        """`source` as this quantity. Raises ConfigurationError for a unit that the quantity cannot have."""
        if not self.unit:
            return Column(source, self.quantity, self.joint)
        unit = unit_of(self.unit)
        if unit.dimension not in expected_units(self.quantity):
            raise ConfigurationError(
                f"{where}: column {source!r}: {self.unit} is not a unit of {TEXT[self.quantity]} ({', '.join(known_units(self.quantity))})."
                " Rename the column, or name the quantity it holds under [columns] of a study file."
            )
        return Column(source, self.quantity, self.joint, unit.scale, 0.0, self.unit)


def known_units(quantity: str) -> list[str]:
    """Suffixes of the units that a quantity may have."""
    return [u.name for u in UNITS.values() if u.dimension in expected_units(quantity)]


def parse_name(source: str, joints: JointNames | None = None, names: list[str] | None = None) -> Named | None:
    """What the contract says about a column's name, or None. `names` collects joint names when the robot is not known."""
    name = source.strip().strip('"').replace("τ", "tau")
    stem, unit = split_unit(name)
    for candidate, suffix in ((name, None), (stem, unit)):
        if candidate.lower() in ("t", "time", "%time", "timestamp"):
            return Named("t", 0, unit=suffix or ("ns" if candidate == "%time" else ""))
        match = _SYMBOL.match(candidate)
        if match:
            quantity = match["symbol"].lower()
            if quantity == "i":
                if match["motor"]:
                    continue
                quantity = "tau_current"
            elif quantity == "tau":
                quantity = "tau_motor" if match["motor"] else "tau_joint"
            elif match["motor"]:
                quantity += "_motor"
            number = int(match["joint"]) - 1
            return Named(quantity, number if joints is None else joints.index(number), True, suffix or "")
        match = _BY_NAME.match(candidate)
        if match:
            quantity = _WORDS[match["word"].lower()]
            if quantity == "tau_joint" and suffix and unit_of(suffix).dimension == "current":
                quantity = "tau_current"
            elif quantity == "tau_joint" and joints is not None:
                quantity = f"tau_{joints.side}"
            index = _joint_of(match["joint"], joints, names)
            return None if index is None else Named(quantity, index, unit=suffix or "")
    return None


def _joint_of(name: str, joints: JointNames | None, names: list[str] | None) -> int | None:
    """Index of a joint given by name, which may be the end of a path (`/joint_states/elbow`)."""
    last = re.split(r"[./]", name)[-1]
    if joints is not None:
        for candidate in (name, last):
            if candidate in joints.names:
                return joints.names.index(candidate)
        return None
    if names is None:
        return None
    if name not in names:
        names.append(name)
    return names.index(name)
