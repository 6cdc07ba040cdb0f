"""Reading a URDF for identification: what Pinocchio would silently accept, drop or misread is settled here."""

from __future__ import annotations

import math
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

from lxml import etree

from .errors import ConfigurationError

_SUPPORTED = {"revolute", "continuous", "prismatic", "fixed"}


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another: position = multiplier * master + offset."""

    joint: str
    master: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class UrdfText:
    """A URDF made ready for Pinocchio.

    `xml`: the text with exact right angles and mimic tags taken out; `kinds`: joint name → URDF type;
    `limits`: joint name → (lower, upper, velocity, effort), infinite where not given; `mimics`: followers;
    `links_without_inertial`: moving links that carry none; `notes`: what was changed, for the user."""

    xml: str
    name: str
    kinds: dict[str, str]
    limits: dict[str, tuple[float, float, float, float]]
    mimics: tuple[Mimic, ...]
    links_without_inertial: tuple[str, ...]
    notes: tuple[str, ...]


def read_urdf(path: Path) -> UrdfText:
    """Read and prepare a URDF file. Raises ConfigurationError with the file and what is wrong in it."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ConfigurationError(f"URDF {path}: no such file.") from None
    except OSError as error:
        raise ConfigurationError(f"URDF {path}: cannot be read ({error.strerror}).") from None
    return prepare_urdf(data, str(path))


def prepare_urdf(data: bytes, where: str = "URDF") -> UrdfText:
    """Prepare URDF text (bytes). `where` names the source in messages."""
    try:
        root = etree.fromstring(data, etree.XMLParser(remove_comments=True, resolve_entities=False))
    except etree.XMLSyntaxError as error:
        raise ConfigurationError(f"URDF {where}: does not parse: {error.msg}.") from None
    if root.tag != "robot":
        hint = " Run xacro on it first." if "xacro" in str(root.nsmap) else ""
        raise ConfigurationError(f"URDF {where}: the root element is <{root.tag}>, not <robot>.{hint}")
    notes: list[str] = []
    kinds: dict[str, str] = {}
    limits: dict[str, tuple[float, float, float, float]] = {}
    mimics: list[Mimic] = []
    children = set()
    for joint in root.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if not name:
            raise ConfigurationError(f"URDF {where}: a <joint> has no name.")
        if kind not in _SUPPORTED:
            raise ConfigurationError(
                f"URDF {where}: joint {name!r} has type {kind!r}; supported are {', '.join(sorted(_SUPPORTED))}."
                " Replace it by a chain of those (a floating base: pass floating_base=True and leave the joint out)."
            )
        child = joint.find("child")
        if child is None or joint.find("parent") is None:
            raise ConfigurationError(f"URDF {where}: joint {name!r} lacks <parent> or <child>.")
        kinds[name] = kind
        limits[name] = _limits(joint, where, name)
        _snap_origin(joint, where, name, notes)
        mimic = joint.find("mimic")
        if mimic is not None:
            mimics.append(
                Mimic(name, mimic.get("joint", ""), _number(mimic.get("multiplier", "1"), where, name), _number(mimic.get("offset", "0"), where, name))
            )
            joint.remove(mimic)
        if kind != "fixed":
            children.add(child.get("link", ""))
        if kind == "continuous":
            # One coordinate a joint: Pinocchio would store (cos, sin) for a continuous joint.
            joint.set("type", "revolute")
        if kind != "fixed":
            for old in joint.findall("limit"):
                joint.remove(old)
            etree.SubElement(joint, "limit", lower="-1e30", upper="1e30", velocity="1e30", effort="1e30")
    bare = tuple(link.get("name", "") for link in root.findall("link") if link.find("inertial") is None and link.get("name") in children)
    return UrdfText(
        etree.tostring(root, encoding="unicode"), root.get("name", "robot"), kinds, limits, tuple(mimics), bare, tuple(notes)
    )


def _limits(joint: etree._Element, where: str, name: str) -> tuple[float, float, float, float]:
    limit = joint.find("limit")
    found = {} if limit is None else dict(limit.attrib)
    bounded = joint.get("type") != "continuous"
    lower = _number(found.get("lower", "-inf"), where, name) if bounded else -math.inf
    upper = _number(found.get("upper", "inf"), where, name) if bounded else math.inf
    if lower >= upper:  # URDF's default of 0, 0: not a limit anyone meant
        lower, upper = -math.inf, math.inf
    velocity = _number(found.get("velocity", "inf"), where, name)
    effort = _number(found.get("effort", "inf"), where, name)
    return lower, upper, velocity if velocity > 0 else math.inf, effort if effort > 0 else math.inf


def _number(text: str, where: str, name: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ConfigurationError(f"URDF {where}: joint {name!r}: {text!r} is not a number.") from None


def _snap_origin(joint: etree._Element, where: str, name: str, notes: list[str]) -> None:
    origin = joint.find("origin")
    if origin is None or not origin.get("rpy"):
        return
    words = origin.get("rpy", "").split()
    if len(words) != 3:
        raise ConfigurationError(f"URDF {where}: joint {name!r}: rpy={origin.get('rpy')!r} does not hold three numbers.")
    snapped = [exact_angle(word) for word in words]
    values = [_number(w, where, name) if s is None else s for w, s in zip(words, snapped, strict=True)]
    moved = max(abs(v - _number(w, where, name)) for v, w in zip(values, words, strict=True))
    if moved > 1e-7 and joint.get("type") != "fixed":
        notes.append(f"joint {name}: rpy {' '.join(words)!r} taken as exact multiples of pi/4 (moved by {moved:.1e} rad).")
    origin.set("rpy", " ".join(repr(v) for v in values))


def exact_angle(text: str) -> float | None:
    """The multiple of π/4 that `text` rounds, or None if it rounds none.

    A URDF writes π/2 as 1.5708; taken literally the axes are not perpendicular, and a base reduction finds parameters
    that the robot does not have. The decision rests on the digits written: an angle is exact only if the multiple,
    rounded or cut off at as many decimals (two at least), gives the very text. A calibrated 1.5701 stays."""
    try:
        number = Decimal(text)
    except InvalidOperation:
        return None
    exponent = number.as_tuple().exponent
    if not number.is_finite() or not isinstance(exponent, int) or number == 0:
        return None
    decimals = -exponent
    multiple = round(float(number) / (math.pi / 4))
    exact = multiple * math.pi / 4
    if multiple == 0 or decimals < 2:
        return None
    unit = 10.0 ** -min(decimals, 15)
    # Rounded: within half a unit; cut off: within one unit towards zero. 1e-15: double precision of the comparison.
    inside = abs(exact - float(number)) <= 0.5 * unit + 1e-15 or 0 <= abs(exact) - abs(float(number)) < unit + 1e-15
    return exact if inside else None
