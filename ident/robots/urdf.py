"""Reading a URDF for identification: what Pinocchio would silently accept, drop or misread is settled here."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

from lxml import etree

from ..errors import ConfigurationError
from .inertials import check_inertials, link_faults, link_oddities, plain_number, written
from .urdf_text import decoded, parsed, settle_elements

_SUPPORTED = {"revolute", "continuous", "prismatic", "fixed"}
#: Positions (rad, m) and speeds that are no limits, and efforts that are none: what exporters write for "without".
_NO_LIMIT = 1e5
_NO_EFFORT = 1e9
#: Lengths (m) and angles (rad) between joints that no robot has: beside them, the digits of the others would be lost.
_FARTHEST = 1e3
_NOISE = 1e-6  # rad: below this, an angle differs from an exact one by the writer's round-off alone
_TOLD = 1e-5  # rad: below this, an angle differs from an exact one by how many digits of it were written, and nothing is said


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

    `xml`: links and joints with exact right angles, mimic tags taken out; `text`: the file as it was read; `kinds`: joint name → URDF type;
    `limits`: joint name → (lower, upper, velocity, effort), infinite where not given; `dynamics`: joint name → (damping, friction)
    of <dynamics>, zero where not given; `mimics`: followers, each bound to
    a joint that follows none; `notes`: what was changed, for the user; `faults`: link → what no body can have of its inertial;
    `oddities`: link → moments of inertia that no mass distribution has, though each is positive."""

    xml: str
    text: str
    name: str
    kinds: dict[str, str]
    limits: dict[str, tuple[float, float, float, float]]
    dynamics: dict[str, tuple[float, float]]
    mimics: tuple[Mimic, ...]
    notes: tuple[str, ...]
    faults: dict[str, str]
    oddities: dict[str, str]


def read_urdf(path: Path) -> UrdfText:
    """Read and prepare a URDF file. Raises ConfigurationError with the file and what is wrong in it."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise ConfigurationError(f"URDF {path}: no such file.") from None
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"URDF {path}: cannot be read ({getattr(error, 'strerror', None) or error}).") from None
    return prepare_urdf(data, str(path))


def prepare_urdf(data: bytes | str, where: str = "text") -> UrdfText:
    """Prepare URDF text (bytes). `where` names the source in messages. Raises ConfigurationError."""
    text, notes = decoded(data, where), list[str]()
    root = parsed(text, where, notes)
    if etree.QName(root).localname != "robot":
        raise ConfigurationError(f"URDF {where}: the root element is <{etree.QName(root).localname}>, not <robot>.")
    settle_elements(root, where, notes)
    if not root.get("name"):
        root.set("name", "robot")
    kinds: dict[str, str] = {}
    limits: dict[str, tuple[float, float, float, float]] = {}
    dynamics: dict[str, tuple[float, float]] = {}
    mimics: dict[str, Mimic] = {}
    snapped: dict[str, float] = {}
    for joint in root.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type", "")
        if not name:
            raise ConfigurationError(f"URDF {where}: a <joint> has no name.")
        if name in kinds:
            raise ConfigurationError(f"URDF {where}: two joints are named {name!r}.")
        if kind not in _SUPPORTED:
            raise ConfigurationError(
                f"URDF {where}: joint {name!r} has type {kind!r}; supported are {', '.join(sorted(_SUPPORTED))}."
                " Replace it by a chain of those (a floating base: pass floating_base=True and leave the joint out)."
            )
        kinds[name] = kind
        limits[name] = _limits(joint, where, name, notes)
        dynamics[name] = _dynamics(joint, where, name, notes)
        snapped[name] = _snap_origin(joint, where, name)
        mimic = joint.find("mimic")
        if mimic is not None:
            factor, offset = (_coefficient(mimic, key, default, where, name) for key, default in (("multiplier", "1"), ("offset", "0")))
            mimics[name] = Mimic(name, mimic.get("joint", ""), factor, offset)
            joint.remove(mimic)
        if kind != "fixed":
            _settle_axis(joint, where, name, notes)
            # One coordinate a joint: Pinocchio would store (cos, sin) for a continuous joint.
            joint.set("type", "prismatic" if kind == "prismatic" else "revolute")
            for old in joint.findall("limit"):
                joint.remove(old)
            etree.SubElement(joint, "limit", lower="-1e30", upper="1e30", velocity="1e30", effort="1e30")
    _check_tree(root, where)
    check_inertials(root, where)
    moved = {name: by for name, by in snapped.items() if by > _TOLD}
    if moved:
        notes.append(f"rpy of {some(moved)} taken as exact multiples of pi/4 (moved by at most {max(moved.values()):.1e} rad).")
    bound = _resolve(mimics, kinds, where, notes)
    xml, name = etree.tostring(root, encoding="unicode"), root.get("name", "robot")
    return UrdfText(xml, text, name, kinds, limits, dynamics, bound, tuple(notes), link_faults(root), link_oddities(root))


def some(names: Iterable[str], most: int = 6) -> str:
    """The first few names of many, for messages."""
    names = list(names)
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _check_tree(root: etree._Element, where: str) -> None:
    """Every joint hangs between two declared links, and the links form one tree."""
    links = [link.get("name", "") for link in root.findall("link")]
    if not links:
        raise ConfigurationError(f"URDF {where}: there is no <link>.")
    twice = [name for name in links if links.count(name) > 1] if len(set(links)) < len(links) else []
    if twice:
        raise ConfigurationError(f"URDF {where}: two links are named {twice[0]!r}.")
    parent_of: dict[str, str] = {}
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        ends = []
        for tag in ("parent", "child"):
            end = joint.find(tag)
            link = "" if end is None else end.get("link", "")
            if not link:
                raise ConfigurationError(f"URDF {where}: joint {name!r} lacks <{tag} link=…>.")
            if link not in links:
                raise ConfigurationError(f"URDF {where}: joint {name!r}: its {tag} link {link!r} is not declared.")
            ends.append(link)
        parent, child = ends
        if child in parent_of:
            raise ConfigurationError(
                f"URDF {where}: link {child!r} is the child of two joints. Cut the loop at one of them, and declare it in [loop]."
            )
        parent_of[child] = parent
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise ConfigurationError(f"URDF {where}: the links do not form one tree: {some(roots)} have no parent. Join them by fixed joints.")
    reached = set(roots)
    while grown := {child for child, parent in parent_of.items() if parent in reached} - reached:
        reached |= grown
    if len(reached) < len(links):
        raise ConfigurationError(f"URDF {where}: the links do not form a tree: {some(n for n in links if n not in reached)} form a loop.")


def _resolve(mimics: dict[str, Mimic], kinds: dict[str, str], where: str, notes: list[str]) -> tuple[Mimic, ...]:
    """Followers of followers are bound to the joint at the head of the chain; a fixed head is at zero."""
    found = []
    for mimic in mimics.values():
        master, factor, offset, passed = mimic.master, mimic.multiplier, mimic.offset, {mimic.joint}
        if kinds[mimic.joint] == "fixed":
            continue
        while master in mimics and master not in passed and kinds[master] != "fixed":
            passed.add(master)
            above = mimics[master]
            offset, factor, master = offset + factor * above.offset, factor * above.multiplier, above.master
        if master in passed:
            raise ConfigurationError(f"URDF {where}: joint {mimic.joint!r} mimics itself, through {some(sorted(passed))}.")
        if master not in kinds:
            notes.append(f"joint {mimic.joint} mimics {master!r}, which is not in the file: treated as an independent joint.")
            continue
        found.append(Mimic(mimic.joint, master, factor, offset))
    return tuple(found)


def _limits(joint: etree._Element, where: str, name: str, notes: list[str]) -> tuple[float, float, float, float]:
    limit = joint.find("limit")
    found = {} if limit is None else dict(limit.attrib)
    bounded = joint.get("type") != "continuous"
    lower, upper = -math.inf, math.inf
    if bounded and {"lower", "upper"} & set(found):
        lower, upper = (_number(found.get(key, "0"), where, name) for key in ("lower", "upper"))  # URDF's default is 0
    if lower > upper:
        notes.append(f"joint {name}: its lower limit ({lower:g}) is above its upper limit ({upper:g}): swapped.")
        lower, upper = upper, lower
    if lower == upper:  # 0, 0: not a limit anyone meant
        lower, upper = -math.inf, math.inf
    lower, upper = (math.copysign(math.inf, x) if abs(x) >= _NO_LIMIT else x for x in (lower, upper))
    velocity = _number(found.get("velocity", "0"), where, name)
    effort = _number(found.get("effort", "0"), where, name)
    return lower, upper, velocity if 0 < velocity < _NO_LIMIT else math.inf, effort if 0 < effort < _NO_EFFORT else math.inf


def _dynamics(joint: etree._Element, where: str, name: str, notes: list[str]) -> tuple[float, float]:
    """Damping and friction; those of no joint count as none. Pinocchio gets neither: friction is an effect."""
    found = joint.find("dynamics")
    values = [_number("0" if found is None else found.get(key, "0"), where, name) for key in ("damping", "friction")]
    for key, value in zip(("damping", "friction"), values, strict=True):
        if not 0 <= value < math.inf:
            notes.append(f"joint {name}: {key} = {value:g} in <dynamics> is not plausible: ignored.")
    if found is not None:
        joint.remove(found)
    damping, friction = (v if 0 <= v < math.inf else 0.0 for v in values)
    return damping, friction


def _coefficient(mimic: etree._Element, key: str, default: str, where: str, name: str) -> float:
    value = _number(mimic.get(key, default), where, name)
    if abs(value) > _NO_LIMIT:
        raise ConfigurationError(f"URDF {where}: joint {name!r}: <mimic {key}={mimic.get(key)!r}> is not a finite number.")
    return value


def _number(text: str, where: str, name: str) -> float:
    value = plain_number(text)
    if math.isnan(value):
        raise ConfigurationError(f"URDF {where}: joint {name!r}: {text!r} is not a number.")
    return value


def _three(text: str, key: str, where: str, name: str) -> list[float]:
    words = text.split()
    values = [_number(word, where, name) for word in words]
    if len(words) != 3 or not all(math.isfinite(v) for v in values):
        raise ConfigurationError(f"URDF {where}: joint {name!r}: {key}={text!r} does not hold three finite numbers.")
    if max(map(abs, values)) > _FARTHEST:
        raise ConfigurationError(f"URDF {where}: joint {name!r}: {key}={text!r} is not a plausible length or angle.")
    return values


def _axis_numbers(text: str, where: str, name: str) -> list[float]:
    """Three numbers of which only the ratio counts: of a size that squares can hold."""
    words = text.split()
    values = [_number(word, where, name) for word in words]
    if len(words) != 3 or not all(math.isfinite(v) for v in values):
        raise ConfigurationError(f"URDF {where}: joint {name!r}: axis xyz={text!r} does not hold three finite numbers.")
    largest = max(map(abs, values))
    return [v / largest for v in values] if largest > 0 else values


def _settle_axis(joint: etree._Element, where: str, name: str, notes: list[str]) -> None:
    """Make the axis a unit vector, and exact where it is a coordinate axis but for round-off. URDF's own is (1, 0, 0)."""
    axis = joint.find("axis")
    if axis is None:
        return
    if not axis.get("xyz"):
        notes.append(f"joint {name}: its <axis> has no xyz: taken as URDF's default, (1, 0, 0).")
        axis.set("xyz", "1 0 0")
    given = _axis_numbers(axis.get("xyz", ""), where, name)
    length = math.hypot(*given)
    if length == 0:
        raise ConfigurationError(f"URDF {where}: joint {name!r}: its axis is the zero vector.")
    unit = [v / length for v in given]
    unit = [float(round(v)) for v in unit] if max(abs(v - round(v)) for v in unit) < _NOISE else unit
    axis.set("xyz", written(unit))


def _snap_origin(joint: etree._Element, where: str, name: str) -> float:
    """Make the origin's angles exact; returns by how much (rad) the furthest moved."""
    origin = joint.find("origin")
    if origin is None:
        return 0.0
    if "xyz" in origin.attrib:
        origin.set("xyz", written(_three(origin.get("xyz", ""), "xyz", where, name)))
    if "rpy" not in origin.attrib:
        return 0.0
    given = _three(origin.get("rpy", ""), "rpy", where, name)
    exact = [exact_angle(word) for word in origin.get("rpy", "").split()]
    values = [g if e is None else e for g, e in zip(given, exact, strict=True)]
    origin.set("rpy", written(values))
    return max(abs(v - g) for v, g in zip(values, given, strict=True))


def exact_angle(text: str) -> float | None:
    """The multiple of π/4 that `text` rounds, or None if it rounds none.

    A URDF writes π/2 as 1.5708; taken literally the axes are not perpendicular, and a base reduction finds parameters
    that the robot does not have. The decision rests on the digits written: an angle is exact if the multiple, rounded or
    cut off at as many decimals, gives the very text (at least two decimals for a multiple of π/2, three for one of π/4:
    0.79 says too little). A calibrated 1.5701 stays. Beside that, whatever is nearer than 1e-6 rad (the noise of single
    precision, which no assembly holds) is exact, zero included."""
    try:
        number = Decimal(text)
    except InvalidOperation:
        return None
    exponent = number.as_tuple().exponent
    if not number.is_finite() or not isinstance(exponent, int):
        return None
    value, decimals = float(number), -exponent
    multiple = round(value / (math.pi / 4))
    exact = multiple * math.pi / 4
    if abs(exact - value) < _NOISE:
        return exact
    if multiple == 0 or decimals < (3 if multiple % 2 else 2):
        return None
    unit = 10.0**-decimals
    rounded = abs(exact - value) <= 0.5 * unit
    cut_off = 0 <= abs(exact) - abs(value) < unit
    return exact if rounded or cut_off else None
