"""Units a log's columns may carry, as a suffix or in brackets, and their conversion to SI."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass


@dataclass(frozen=True)
class Unit:
    """A unit by its suffix: SI value = scale * value."""

    name: str
    dimension: str
    scale: float


_DEG = math.pi / 180
_TABLE = (
    Unit("s", "time", 1.0), Unit("ms", "time", 1e-3), Unit("us", "time", 1e-6), Unit("ns", "time", 1e-9),
    Unit("rad", "angle", 1.0), Unit("deg", "angle", _DEG),
    Unit("m", "length", 1.0), Unit("mm", "length", 1e-3), Unit("cm", "length", 1e-2),
    Unit("rad_s", "rate", 1.0), Unit("deg_s", "rate", _DEG), Unit("rpm", "rate", math.pi / 30),
    Unit("m_s", "speed", 1.0), Unit("mm_s", "speed", 1e-3),
    Unit("rad_s2", "acceleration", 1.0), Unit("deg_s2", "acceleration", _DEG),
    Unit("m_s2", "linear acceleration", 1.0), Unit("mm_s2", "linear acceleration", 1e-3),
    Unit("Nm", "torque", 1.0), Unit("mNm", "torque", 1e-3), Unit("kNm", "torque", 1e3),
    Unit("N", "force", 1.0), Unit("kN", "force", 1e3), Unit("mN", "force", 1e-3),
    Unit("A", "current", 1.0), Unit("mA", "current", 1e-3), Unit("V", "current", 1.0), Unit("mV", "current", 1e-3),
)  # fmt: skip
#: Suffix → unit. A drive command in V stands where a current may: the torque constant then is in N m/V.
UNITS = {u.name: u for u in _TABLE}
# Longest first, so that rad_s2 is not read as s2 after something else.
_BY_LENGTH = sorted(UNITS, key=len, reverse=True)

_EXPECTED = {
    "t": {"time"},
    "q": {"angle", "length"},
    "dq": {"rate", "speed"},
    "ddq": {"acceleration", "linear acceleration"},
    "q_motor": {"angle", "length"},
    "dq_motor": {"rate", "speed"},
    "ddq_motor": {"acceleration", "linear acceleration"},
    "tau_joint": {"torque", "force"},
    "tau_motor": {"torque", "force"},
    "tau_current": {"current"},
}


def expected_units(quantity: str) -> set[str]:
    """Dimensions that a quantity may have."""
    return _EXPECTED[quantity]


def is_unit(name: object) -> bool:
    """Whether a suffix names a unit, as `unit_of` takes it."""
    return isinstance(name, str) and name.lower() in {u.name.lower() for u in _TABLE}


def unit_of(name: str) -> Unit:
    """The unit with this suffix (as it stands, or without regard to case where that is not ambiguous)."""
    if name in UNITS:
        return UNITS[name]
    return next(u for u in _TABLE if u.name.lower() == name.lower())


_BRACKETED = re.compile(r"(?P<stem>.*\S)\s*[\[(]\s*(?P<unit>[^\[\]()]*?)\s*[\])]")
#: How units are written in brackets → how they are in a suffix.
_WRITTEN = (("µ", "u"), ("μ", "u"), ("°", "deg"), ("²", "2"), ("^", ""), ("/", "_"), ("·", ""), ("*", ""), (" ", ""))


def bracketed(name: str) -> tuple[str, str]:
    """A column's name without the brackets that it ends on, and what they hold as a suffix would have it: "speed [deg/s]" → speed, deg_s;
    (name, "") where it ends on none."""
    found = _BRACKETED.fullmatch(name.strip())
    if found is None:
        return name, ""
    unit = found["unit"]
    for written, suffix in _WRITTEN:
        unit = unit.replace(written, suffix)
    return found["stem"], unit


def split_unit(name: str) -> tuple[str, str | None]:
    """A column's name without its unit (a suffix, or in brackets at the end), and the unit's suffix if there is one."""
    stem, unit = bracketed(name)
    if is_unit(unit):
        return stem, unit_of(unit).name
    for suffix in _BY_LENGTH:
        if name.endswith("_" + suffix) and len(name) > len(suffix) + 1:
            return name[: -len(suffix) - 1], suffix
    lower = name.lower()
    for suffix in _BY_LENGTH:
        if lower.endswith("_" + suffix.lower()) and len(name) > len(suffix) + 1:
            return name[: -len(suffix) - 1], suffix
    return name, None
