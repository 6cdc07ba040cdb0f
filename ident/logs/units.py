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
    Unit("rad", "angle", 1.0), Unit("mrad", "angle", 1e-3), Unit("deg", "angle", _DEG),
    Unit("urad", "angle", 1e-6), Unit("mdeg", "angle", 1e-3 * _DEG), Unit("cdeg", "angle", 1e-2 * _DEG),
    Unit("m", "length", 1.0), Unit("mm", "length", 1e-3), Unit("cm", "length", 1e-2), Unit("um", "length", 1e-6),
    Unit("rad_s", "rate", 1.0), Unit("mrad_s", "rate", 1e-3), Unit("deg_s", "rate", _DEG), Unit("rpm", "rate", math.pi / 30),
    Unit("mdeg_s", "rate", 1e-3 * _DEG), Unit("cdeg_s", "rate", 1e-2 * _DEG),
    Unit("m_s", "speed", 1.0), Unit("mm_s", "speed", 1e-3), Unit("cm_s", "speed", 1e-2),
    Unit("rad_s2", "acceleration", 1.0), Unit("deg_s2", "acceleration", _DEG),
    Unit("m_s2", "linear acceleration", 1.0), Unit("mm_s2", "linear acceleration", 1e-3),
    Unit("Nm", "torque", 1.0), Unit("mNm", "torque", 1e-3), Unit("kNm", "torque", 1e3), Unit("Nmm", "torque", 1e-3),
    Unit("N", "force", 1.0), Unit("kN", "force", 1e3), Unit("mN", "force", 1e-3),
    Unit("A", "current", 1.0), Unit("mA", "current", 1e-3), Unit("uA", "current", 1e-6),
    Unit("V", "current", 1.0), Unit("mV", "current", 1e-3),
)  # fmt: skip
#: Units that only brackets and rows of units tell: as a suffix they may be words (`q1_min`).
_BRACKETS = (
    Unit("min", "time", 60.0), Unit("h", "time", 3600.0),
    Unit("in", "length", 0.0254), Unit("mm_min", "speed", 1e-3 / 60), Unit("m_min", "speed", 1 / 60), Unit("in_s", "speed", 0.0254),
    Unit("arcmin", "angle", _DEG / 60), Unit("arcsec", "angle", _DEG / 3600),
    Unit("turn", "angle", 2 * math.pi), Unit("rev", "angle", 2 * math.pi),
    Unit("turn_s", "rate", 2 * math.pi), Unit("rev_s", "rate", 2 * math.pi), Unit("rps", "rate", 2 * math.pi),
    Unit("rev_min", "rate", math.pi / 30), Unit("r_min", "rate", math.pi / 30), Unit("deg_min", "rate", _DEG / 60),
    Unit("Ncm", "torque", 1e-2), Unit("cNm", "torque", 1e-2), Unit("dNm", "torque", 0.1), Unit("daNm", "torque", 10.0),
    Unit("kgfcm", "torque", 0.0980665), Unit("kgfm", "torque", 9.80665),
    Unit("lbfin", "torque", 0.1129848290276167), Unit("inlbf", "torque", 0.1129848290276167),
    Unit("lbfft", "torque", 1.3558179483314004), Unit("ftlbf", "torque", 1.3558179483314004),
    Unit("ozfin", "torque", 0.00706155181422604), Unit("ozin", "torque", 0.00706155181422604),
)  # fmt: skip
#: Suffix → unit. A drive command in V stands where a current may: the torque constant then is in N m/V.
UNITS = {u.name: u for u in _TABLE}
# Longest first, so that rad_s2 is not read as s2 after something else.
_BY_LENGTH = sorted(UNITS, key=len, reverse=True)
_LOWER = {u.name.lower() for u in (*_TABLE, *_BRACKETS)}

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
    return isinstance(name, str) and name.lower() in _LOWER and not _is_mega(name)


def _is_mega(name: str) -> bool:
    """Whether a capital M stands before a unit of which the rest has small letters: mega, which no log of a robot needs, and not milli."""
    return name.startswith("M") and name not in UNITS and not name.isupper() and name[1:] in UNITS


def unit_of(name: str) -> Unit:
    """The unit with this suffix (as it stands, or without regard to case where that is not ambiguous)."""
    if name in UNITS:
        return UNITS[name]
    return next(u for u in (*_TABLE, *_BRACKETS) if u.name.lower() == name.lower())


_BRACKETED = re.compile(r"[\[(]([^\[\]()]*)[\])]|<([^<>]*)>|\{([^{}]*)\}")
#: What stands between the factors of a unit; powers, and what is divided by seconds, as they may be written.
_BETWEEN = re.compile(r"[\s·⋅•∙*.\-]+")
_PLAIN = (("µ", "u"), ("μ", "u"), ("²", "2"), ("⁻¹", "-1"), ("⁻", "-"), ("^", ""), ("°", "deg"), ("º", "deg"))
_PER_SECOND = re.compile(r"[\s·⋅•∙*.]*\b(?:s|sec)-([12])$", re.IGNORECASE)
#: Words, and abbreviations that are not this contract's.
_WORDS = {
    "degree": "deg", "grad": "deg", "degrees": "deg", "degs": "deg", "radian": "rad", "radians": "rad", "rads": "rad",
    "sec": "s", "secs": "s", "second": "s", "seconds": "s", "msec": "ms", "millisecond": "ms", "milliseconds": "ms",
    "usec": "us", "microsecond": "us", "microseconds": "us", "nsec": "ns", "nanosecond": "ns", "nanoseconds": "ns",
    "millis": "ms", "micros": "us", "nanos": "ns",
    "sec2": "s2", "meter": "m", "meters": "m", "metre": "m", "metres": "m", "millimeter": "mm", "millimeters": "mm",
    "minute": "min", "minutes": "min", "hour": "h", "hours": "h", "revolution": "rev", "revolutions": "rev",
    "turn": "turn", "turns": "turn", "rot": "turn", "rotations": "turn", "rev": "rev", "revs": "rev",
    "ftlb": "lbfft", "ftlbs": "lbfft", "lbft": "lbfft", "inlb": "lbfin", "inlbs": "lbfin", "lbin": "lbfin",
    "lb": "lbf", "lbs": "lbf", "oz": "ozf", "kg": "kgf", "inch": "in",
    "newton": "N", "newtons": "N", "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "volt": "V", "volts": "V",
    "grader": "deg", "stopnie": "deg", "stopni": "deg", "fok": "deg", "grados": "deg", "degrés": "deg", "degres": "deg", "gradi": "deg",
    "graus": "deg", "graden": "deg", "stupně": "deg", "stupňů": "deg", "stupne": "deg", "derajat": "deg", "derece": "deg", "astetta": "deg",
    "grade": "deg", "stopinje": "deg", "stepeni": "deg", "градусы": "deg", "градусов": "deg", "μοίρες": "deg",
    "град": "deg", "рад": "rad", "с": "s", "мс": "ms", "мкс": "us", "н": "N", "нм": "Nm", "м": "m", "мм": "mm", "а": "A",
    "度": "deg", "弧度": "rad", "秒": "s", "毫秒": "ms", "微秒": "us", "牛米": "Nm", "牛": "N", "米": "m", "毫米": "mm", "安": "A",
    "도": "deg", "라디안": "rad", "초": "s", "밀리초": "ms",
}  # fmt: skip
#: A rate as words at the end of a name: `vel1_turns_per_s`, `m1_velocity_rot_s`.
_RATE = re.compile(r"(.+)_([A-Za-z]{3,})_(?:per_)?(s|sec|min)", re.IGNORECASE)
#: Units that are written as a whole.
_WHOLE = {
    "u/min": "rpm", "1/min": "rpm", "min-1": "rpm", "tr/min": "rpm", "obr/min": "rpm", "ot/min": "rpm", "giri/min": "rpm", "omw/min": "rpm",
    "об/мин": "rpm", "转/分": "rpm", "dev/dak": "rpm", "fordulat/min": "rpm", "varv/min": "rpm",
}  # fmt: skip


def as_suffix(written: str) -> str:
    """A unit as it may be written in brackets, as a suffix has it ("deg/s²" → deg_s2, "N·m" → Nm); whether there is such a unit is not
    looked at."""
    for sign, plain in _PLAIN:
        written = written.replace(sign, plain)
    if whole := _WHOLE.get(written.strip().lower()):
        return whole
    written = _PER_SECOND.sub(lambda found: "/s" if found[1] == "1" else "/s2", written.strip())
    parts = []
    for part in written.split("/"):
        factors = [_WORDS.get(factor.lower(), factor) for factor in _BETWEEN.split(part.strip()) if factor]
        # A metre times a newton is no millinewton.
        parts.append("".join(factors[::-1] if len(factors) == 2 and factors[0] in ("m", "mm", "cm", "in", "ft") else factors))
    return "_".join(parts)


def bracketed(name: str) -> tuple[str, str]:
    """A column's name without the brackets in it that hold a unit, and that unit as a suffix would have it: "speed [deg/s]" → speed, deg_s.
    Without such: without the last brackets, and what they hold; (name, "") where there are none."""
    last = name, ""
    for mark in (", ", " / "):  # "angle 1, deg", "angle 1 / deg"
        stem, _, unit = name.rpartition(mark)
        if stem and is_unit(as_suffix(unit)):
            return stem.strip(), as_suffix(unit)
    for found in _BRACKETED.finditer(name):
        stem = f"{name[: found.start()].strip()} {name[found.end() :].strip()}".strip()
        if stem:
            last = stem, as_suffix(next(inside for inside in found.groups() if inside is not None))
            if is_unit(last[1]):
                break
    return last


def split_unit(name: str) -> tuple[str, str | None]:
    """A column's name without its unit (a suffix, or in brackets), and the unit's suffix if there is one."""
    stem, unit = bracketed(name)
    if is_unit(unit):
        return stem, unit_of(unit).name
    if (found := _RATE.fullmatch(name)) and is_unit(rate := as_suffix(f"{found[2]}/{found[3]}")):
        return found[1], unit_of(rate).name
    stem, _, word = name.rpartition("_")
    if stem and word.lower() in _WORDS and is_unit(_WORDS[word.lower()]):
        return stem, _WORDS[word.lower()]
    for suffix in _BY_LENGTH:
        if name.endswith("_" + suffix) and len(name) > len(suffix) + 1:
            return name[: -len(suffix) - 1], suffix
    lower = name.lower()
    for suffix in _BY_LENGTH:
        if lower.endswith("_" + suffix.lower()) and len(name) > len(suffix) + 1 and not _is_mega(name[-len(suffix) :]):
            return name[: -len(suffix) - 1], suffix
    # Torques of the workshop, in one word or two, are no words of anything else: tau1_Ncm, torque_1_in_lb.
    for count in (1, 2):
        stem, *words = name.rsplit("_", count)
        unit = as_suffix(" ".join(words))
        if stem and len(words) == count and is_unit(unit) and unit_of(unit).dimension == "torque":
            return stem, unit_of(unit).name
    return name, None
