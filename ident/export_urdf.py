"""Identified inertia into a URDF, patched in place: everything else in the file (comments, transmissions, plugins, layout) stays as it is.

A moving body is what hangs together behind a moving joint: the joint's child link and all links attached to it through fixed and locked
joints. Identification sees their sum only. The sum is written to the child link; the attached links keep their inertials, which are
subtracted, or give them up, so that the sum is right in either case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from .errors import ConfigurationError
from .physical.pseudo_inertia import centre_of_mass, displaced, from_centre_of_mass, smallest_eigenvalues
from .urdf import exact_angle

if TYPE_CHECKING:
    from lxml import etree

    from .robot import Robot

Array = np.ndarray


class Attached(StrEnum):
    """What becomes of the inertials of links attached to a moving link.

    KEEP: they stay, and are subtracted; where the rest is then no real body they are moved all the same, and that is said.
    MOVE: they are removed, and the moving link carries everything."""

    KEEP = "keep"
    MOVE = "move"


@dataclass(frozen=True)
class BodyExport:
    """One moving body: its `joint`, the `link` that was written, the links `attached` to it, and whether those `kept` their inertials."""

    joint: str
    link: str
    attached: tuple[str, ...]
    kept: bool


@dataclass(frozen=True)
class UrdfExport:
    """The patched text, what was written for every body, and notes for the user."""

    data: bytes
    bodies: tuple[BodyExport, ...]
    notes: tuple[str, ...]


def source_text(robot: Robot, source: str | Path | None) -> tuple[bytes, str]:
    """The URDF (bytes, name for messages) to be patched: `source`, or the one that the robot was loaded from. Raises ConfigurationError."""
    if source is None:
        text, path = robot.source.get("urdf_text"), robot.source.get("urdf")
        if (
            path is not None
            and Path(path).is_file()
            and (data := Path(path).read_bytes()).decode(errors="replace") == (text or data.decode(errors="replace"))
        ):
            return data, str(path)
        if text is None:
            raise ConfigurationError(f"robot {robot.name!r} does not know the URDF it came from; name the file to be patched.")
        return str(text).encode(), f"URDF of {robot.name!r}"
    if str(source).lstrip().startswith("<"):
        return str(source).encode(), "URDF text"
    try:
        return Path(source).read_bytes(), str(source)
    except OSError as error:
        raise ConfigurationError(f"URDF {source}: cannot be read ({error.strerror}).") from None


def patch_urdf(
    data: bytes,
    where: str,
    robot: Robot,
    inertial: Array,
    *,
    attached: Attached | str = Attached.KEEP,
    damping: Mapping[str, float] | None = None,
    friction: Mapping[str, float] | None = None,
    allow_inconsistent: bool = False,
) -> UrdfExport:
    """Write inertial parameters (10 nb,) of the robot's moving bodies into URDF text.

    `damping`, `friction`: joint -> value for <dynamics> (N m s/rad, N m; N s/m, N). `allow_inconsistent`: also bodies that cannot be real,
    as long as they have mass. Raises ConfigurationError where the file does not hold the robot's joints, or a body cannot be written."""
    from lxml import etree

    attached = Attached(attached)
    try:
        tree = etree.fromstring(data, etree.XMLParser(resolve_entities=False)).getroottree()
    except etree.XMLSyntaxError as error:
        raise ConfigurationError(f"URDF {where}: does not parse: {error.msg}.") from None
    root = tree.getroot()
    bodies = _bodies(root, where, robot)
    parameters = np.asarray(inertial, float).reshape(-1, 10)
    if len(parameters) != len(bodies):
        raise ConfigurationError(f"URDF {where}: {len(parameters)} sets of inertial parameters for {len(bodies)} moving bodies.")
    real = smallest_eigenvalues(parameters) > 0
    if not real.all() and not allow_inconsistent:
        bad = ", ".join(bodies[i].link for i in np.flatnonzero(~real))
        raise ConfigurationError(
            f"the parameters of {bad} are not those of a real body, and programs that read URDFs need real ones."
            " Export standard parameters (a consistent fit), or allow inconsistent bodies if you know that your program does not mind."
        )
    done, notes = [], []
    links = {link.get("name"): link for link in root.findall("link")}
    for body, own in zip(bodies, parameters, strict=True):
        others = [
            (name, displaced(_read_inertial(links[name], where), R, p))
            for name, R, p in body.attached
            if _read_inertial(links[name], where).any()
        ]
        rest = own - sum((x for _, x in others), np.zeros(10))
        keep = attached == Attached.KEEP and bool(others)
        if keep and (smallest_eigenvalues(rest)[0] <= 0 if smallest_eigenvalues(own)[0] > 0 else rest[0] <= 0):
            keep = False
            notes.append(
                f"{body.link}: less the nominal inertials of {', '.join(n for n, _ in others)} no real body is left;"
                " their inertials were removed, and the link carries all of it."
            )
        elif others:
            how = (
                "their nominal inertials stay, and were subtracted"
                if keep
                else "their inertials were removed, and the link carries all of it"
            )
            notes.append(
                f"{body.link}: identified together with {', '.join(n for n, _ in others)} (joined by fixed or locked joints); {how}."
            )
        if not keep:
            for name, _ in others:
                _remove(links[name].find("inertial"))
        _write_inertial(links[body.link], rest if keep else own, body.link)
        done.append(BodyExport(body.joint, body.link, tuple(name for name, _, _ in body.attached), keep))
    notes += _exact_angles(root)
    for tag, values in (("damping", damping), ("friction", friction)):
        for joint, value in (values or {}).items():
            _write_dynamics(root, joint, tag, value, where)
    return UrdfExport(_text(tree, data), tuple(done), tuple(notes))


@dataclass(frozen=True)
class _Body:
    joint: str
    link: str
    attached: tuple[tuple[str, Array, Array], ...]


def _bodies(root: etree._Element, where: str, robot: Robot) -> list[_Body]:
    """The moving bodies in the robot's order: joint, main link, attached links with their placement in the main link's frame."""
    from .robot import _held
    from .urdf import prepare_urdf

    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    moving = [j.name for j in robot.tree_joints]
    for name in moving:
        if name not in joints:
            raise ConfigurationError(
                f"URDF {where}: it has no joint {name!r}, which robot {robot.name!r} has. Name the URDF that the robot was loaded from."
            )
    source = robot.source
    prepared = prepare_urdf(_text_of(root), where)
    movable = [name for name, kind in prepared.kinds.items() if kind != "fixed"]
    held = _held(prepared, movable, source.get("locked") or {}, source.get("joints"), source.get("loop") or {})
    loose = [name for name in movable if name not in moving and name not in held]
    if loose:
        raise ConfigurationError(
            f"URDF {where}: joint {loose[0]!r} moves, but robot {robot.name!r} does not have it."
            " Name the URDF that the robot was loaded from."
        )
    below: dict[str, list[etree._Element]] = {}
    for joint in root.findall("joint"):
        below.setdefault(joint.find("parent").get("link"), []).append(joint)  # type: ignore[union-attr]
    children = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
    starts = [(name, joints[name].find("child").get("link")) for name in moving]  # type: ignore[union-attr]
    if robot.floating_base:
        base = [link.get("name") for link in root.findall("link") if link.get("name") not in children]
        starts = [("floating base", base[0]), *starts]
    found = []
    for joint_name, main in starts:
        attached: list[tuple[str, Array, Array]] = []
        waiting = [(main, np.eye(3), np.zeros(3))]
        while waiting:
            link, R, p = waiting.pop(0)
            if link != main:
                attached.append((link, R, p))
            for joint in below.get(link, ()):
                name = joint.get("name")
                if name in moving:
                    continue
                R1, p1 = _placement(joint, held.get(name, 0.0))
                waiting.append((joint.find("child").get("link"), R @ R1, R @ p1 + p))  # type: ignore[union-attr]
        found.append(_Body(joint_name, str(main), tuple(attached)))
    return found


def _text_of(root: etree._Element) -> bytes:
    from lxml import etree

    return etree.tostring(root)


def _numbers(text: str | None, default: str, exact: bool = False) -> Array:
    words = (text or default).split()
    return np.array([(exact_angle(w) if exact else None) or float(w) for w in words])


def _rpy(angles: Array) -> Array:
    (r, p, y) = angles
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx)


def _placement(joint: etree._Element, position: float) -> tuple[Array, Array]:
    """Placement (R, p) of a joint's child link in its parent link, the joint held at `position`."""
    origin = joint.find("origin")
    xyz = _numbers(None if origin is None else origin.get("xyz"), "0 0 0")
    R = _rpy(_numbers(None if origin is None else origin.get("rpy"), "0 0 0", exact=True))
    kind = joint.get("type")
    if kind == "fixed" or position == 0.0:
        return R, xyz
    node = joint.find("axis")
    axis = _numbers(None if node is None else node.get("xyz"), "1 0 0")
    axis = axis / np.linalg.norm(axis)
    if kind == "prismatic":
        return R, xyz + R @ axis * position
    from .physical.energy import skew

    K = skew(axis)
    return R @ (np.eye(3) + np.sin(position) * K + (1.0 - np.cos(position)) * K @ K), xyz


def _read_inertial(link: etree._Element, where: str) -> Array:
    """Ten parameters (10,) of a link's <inertial> about the link's origin; zero where there is none."""
    node = link.find("inertial")
    if node is None:
        return np.zeros(10)
    try:
        mass = float(node.find("mass").get("value"))  # type: ignore[union-attr, arg-type]
        origin = node.find("origin")
        com = _numbers(None if origin is None else origin.get("xyz"), "0 0 0")
        R = _rpy(_numbers(None if origin is None else origin.get("rpy"), "0 0 0"))
        values = {k: float(node.find("inertia").get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}  # type: ignore[union-attr]
    except (AttributeError, TypeError, ValueError):
        raise ConfigurationError(
            f"URDF {where}: the <inertial> of link {link.get('name')!r} lacks a mass or inertia, or holds no numbers."
        ) from None
    v = values
    inertia_c = np.array([[v["ixx"], v["ixy"], v["ixz"]], [v["ixy"], v["iyy"], v["iyz"]], [v["ixz"], v["iyz"], v["izz"]]])
    return from_centre_of_mass(mass, com, R @ inertia_c @ R.T)


def _write_inertial(link: etree._Element, parameters: Array, name: str) -> None:
    """Put ten parameters into a link's <inertial>, in place where it has one."""
    try:
        mass, com, inertia_c = centre_of_mass(parameters)
    except ZeroDivisionError:
        raise ConfigurationError(
            f"link {name!r} has no mass, so a URDF cannot hold its first moments; export standard parameters instead."
        ) from None
    node = link.find("inertial")
    if node is None:
        node = _insert(link, "inertial", 0)
        _insert(node, "origin", 0), _insert(node, "mass", 1), _insert(node, "inertia", 2)
    for place, tag in enumerate(("origin", "mass", "inertia")):
        if node.find(tag) is None:
            _insert(node, tag, place)
    origin, m, inertia = (node.find(tag) for tag in ("origin", "mass", "inertia"))
    origin.set("xyz", " ".join(repr(float(x)) for x in com))
    # Inertia is written in the link's own axes.
    origin.set("rpy", "0 0 0")
    m.set("value", repr(mass))
    for key, (i, j) in {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}.items():
        inertia.set(key, repr(float(inertia_c[i, j])))


def _write_dynamics(root: etree._Element, joint: str, tag: str, value: float, where: str) -> None:
    node = next((j for j in root.findall("joint") if j.get("name") == joint), None)
    if node is None:
        raise ConfigurationError(f"URDF {where}: it has no joint {joint!r} to give {tag}.")
    dynamics = node.find("dynamics")
    if dynamics is None:
        dynamics = _insert(node, "dynamics", len(node))
    dynamics.set(tag, repr(float(value)))


def _insert(parent: etree._Element, tag: str, place: int) -> etree._Element:
    """A new child at a place, indented like its neighbours."""
    from lxml import etree

    node = etree.Element(tag)
    if len(parent):
        # White space before a child is the tail of the one before, or the parent's text.
        before = parent.text if place == 0 or len(parent) == 0 else parent[min(place, len(parent)) - 1].tail
        inner = parent.text or ""
        if place >= len(parent):
            parent[-1].tail = inner
            node.tail = before
        else:
            node.tail = inner
    else:
        outer = parent.getparent()
        indent = (outer.text if outer is not None else None) or "\n"
        indent = indent if indent.strip() == "" else "\n"
        parent.text = indent + "  "
        node.tail = indent
    parent.insert(place, node)
    return node


def _remove(node: etree._Element | None) -> None:
    """Take an element out, with its own indentation only."""
    if node is None:
        return
    parent = node.getparent()
    assert parent is not None
    previous = node.getprevious()
    if node.getnext() is None and previous is not None:
        previous.tail = node.tail
    elif node.getnext() is None:
        parent.text = None
    parent.remove(node)


def _exact_angles(root: etree._Element) -> list[str]:
    """Right angles written with few digits become exact, as they were when the robot was identified."""
    changed = []
    for joint in root.findall("joint"):
        origin = joint.find("origin")
        if origin is None or not origin.get("rpy"):
            continue
        words = origin.get("rpy").split()
        exact = [exact_angle(w) for w in words]
        new = [w if e is None or e == float(w) else repr(e) for w, e in zip(words, exact, strict=True)]
        if new != words:
            origin.set("rpy", " ".join(new))
            changed.append(joint.get("name"))
    if not changed:
        return []
    names = ", ".join(str(n) for n in changed[:6]) + (" …" if len(changed) > 6 else "")
    return [f"joints {names}: angles that round multiples of pi/4 are written in full, as the robot was identified."]


def _text(tree: Any, data: bytes) -> bytes:
    """The document as bytes, with the declaration, encoding and line ends of the original."""
    from lxml import etree

    encoding = tree.docinfo.encoding or "utf-8"
    declared = data.lstrip(b"\xef\xbb\xbf").lstrip().startswith(b"<?xml")
    text = bytes(etree.tostring(tree, encoding=encoding))
    if text.startswith(b"<?xml"):
        text = text.split(b"?>", 1)[1].lstrip(b"\n")
    if declared:
        # The original declaration to the letter, with what followed it on its line.
        head = data[: data.index(b"?>") + 2]
        text = head + b"\n" + text
    if data.endswith(b"\n") and not text.endswith(b"\n"):
        text += b"\n"
    return text.replace(b"\n", b"\r\n") if b"\r\n" in data else text
