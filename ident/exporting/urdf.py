"""Identified inertia into a URDF, patched in place: everything else in the file (comments, transmissions, plugins, layout) stays as it is.

A moving body is what hangs together behind a moving joint: the joint's child link and all links attached to it through fixed and locked
joints. Identification sees their sum only. The sum is written to the child link; the attached links keep their inertials, which are
subtracted, or give them up, so that the sum is right in either case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError
from ..physical.energy import skew
from ..physical.pseudo_inertia import centre_of_mass, displaced, from_centre_of_mass, smallest_eigenvalues
from ..robots.joints import held_joints
from ..robots.urdf import exact_angle, prepare_urdf
from .xml_patch import Element, NewElement, XmlPatch

if TYPE_CHECKING:
    from ..robots.robot import Robot

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


def _is_left(own: Array, rest: Array) -> bool:
    """Whether the `rest` (10,) of a body's `own` parameters (10,) is as real as it: a real body, or one with mass."""
    return bool(smallest_eigenvalues(rest)[0] > 0 if smallest_eigenvalues(own)[0] > 0 else rest[0] > 0)


def _shared_note(link: str, others: list[str], attached: Attached, kept: bool) -> str:
    """What became of the inertials of links attached to one that moves."""
    if attached == Attached.KEEP and not kept:
        return (
            f"{link}: subtracting the nominal inertials of {', '.join(others)} would leave no physical body;"
            " their inertials were removed, and the link holds the sum."
        )
    how = (
        "their nominal inertials were kept, and subtracted from the link"
        if kept
        else "their inertials were removed, and the link holds the sum"
    )
    return f"{link}: identified together with {', '.join(others)} (joined by fixed or locked joints); {how}."


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
    attached = Attached(attached)
    patch = XmlPatch(data, f"URDF {where}")
    root = patch.root
    bodies = _bodies(data, root, where, robot)
    parameters = np.asarray(inertial, float).reshape(-1, 10)
    if len(parameters) != len(bodies):
        raise ConfigurationError(f"URDF {where}: {len(parameters)} sets of inertial parameters for {len(bodies)} moving bodies.")
    real = smallest_eigenvalues(parameters) > 0
    if not real.all() and not allow_inconsistent:
        bad = ", ".join(bodies[i].link for i in np.flatnonzero(~real))
        raise ConfigurationError(
            f"the parameters of {bad} are physically inconsistent, and programs that read URDFs reject them."
            " Export standard parameters (a consistent fit), or allow inconsistent bodies if your program accepts them."
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
        keep = attached == Attached.KEEP and bool(others) and _is_left(own, rest)
        if others:
            notes.append(_shared_note(body.link, [name for name, _ in others], attached, keep))
        if not keep:
            for name, _ in others:
                inertial_node = links[name].find("inertial")
                assert inertial_node is not None
                patch.remove(inertial_node)
        _write_inertial(patch, links[body.link], rest if keep else own)
        done.append(BodyExport(body.joint, body.link, tuple(name for name, _, _ in body.attached), keep))
    notes += _exact_angles(patch)
    for joint in {**(damping or {}), **(friction or {})}:
        values = {tag: repr(float(of[joint])) for tag, of in (("damping", damping or {}), ("friction", friction or {})) if joint in of}
        _write_dynamics(patch, joint, values, where)
    return UrdfExport(patch.result(), tuple(done), tuple(notes))


@dataclass(frozen=True)
class _Body:
    joint: str
    link: str
    attached: tuple[tuple[str, Array, Array], ...]


def _bodies(data: bytes, root: Element, where: str, robot: Robot) -> list[_Body]:
    """The moving bodies in the robot's order: joint, main link, attached links with their placement in the main link's frame."""
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    moving = [j.name for j in robot.tree_joints]
    for name in moving:
        if name not in joints:
            raise ConfigurationError(
                f"URDF {where}: it has no joint {name!r}, which robot {robot.name!r} has. Name the URDF that the robot was loaded from."
            )
    source = robot.source
    prepared = prepare_urdf(data, where)
    movable = [name for name, kind in prepared.kinds.items() if kind != "fixed"]
    held = held_joints(prepared, movable, source.get("locked") or {}, source.get("joints"), source.get("loop") or {})
    loose = [name for name in movable if name not in moving and name not in held]
    if loose:
        raise ConfigurationError(
            f"URDF {where}: joint {loose[0]!r} moves, but robot {robot.name!r} does not have it."
            " Name the URDF that the robot was loaded from."
        )
    below: dict[str, list[Element]] = {}
    for joint in root.findall("joint"):
        below.setdefault(_end(joint, "parent"), []).append(joint)
    children = {_end(joint, "child") for joint in root.findall("joint")}
    starts = [(name, _end(joints[name], "child")) for name in moving]
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
                waiting.append((_end(joint, "child"), R @ R1, R @ p1 + p))
        found.append(_Body(joint_name, main, tuple(attached)))
    return found


def _end(joint: Element, side: str) -> str:
    """Link at the "parent" or "child" side of a joint (`prepare_urdf` has seen that there is one)."""
    node = joint.find(side)
    return "" if node is None else node.get("link")


def _numbers(text: str, default: str, exact: bool = False) -> Array:
    words = (text or default).split()
    return np.array([(exact_angle(w) if exact else None) or float(w) for w in words])


def _rpy(angles: Array) -> Array:
    (r, p, y) = angles
    Rx = np.array([[1, 0, 0], [0, np.cos(r), -np.sin(r)], [0, np.sin(r), np.cos(r)]])
    Ry = np.array([[np.cos(p), 0, np.sin(p)], [0, 1, 0], [-np.sin(p), 0, np.cos(p)]])
    Rz = np.array([[np.cos(y), -np.sin(y), 0], [np.sin(y), np.cos(y), 0], [0, 0, 1]])
    return np.asarray(Rz @ Ry @ Rx)


def _placement(joint: Element, position: float) -> tuple[Array, Array]:
    """Placement (R, p) of a joint's child link in its parent link, the joint held at `position`."""
    origin = joint.find("origin")
    xyz = _numbers("" if origin is None else origin.get("xyz"), "0 0 0")
    R = _rpy(_numbers("" if origin is None else origin.get("rpy"), "0 0 0", exact=True))
    kind = joint.get("type")
    if kind == "fixed" or position == 0.0:
        return R, xyz
    node = joint.find("axis")
    axis = _numbers("" if node is None else node.get("xyz"), "1 0 0")
    axis = axis / np.linalg.norm(axis)
    if kind == "prismatic":
        return R, xyz + R @ axis * position

    K = skew(axis)
    return R @ (np.eye(3) + np.sin(position) * K + (1.0 - np.cos(position)) * K @ K), xyz


def _read_inertial(link: Element, where: str) -> Array:
    """Ten parameters (10,) of a link's <inertial> about the link's origin; zero where there is none."""
    node = link.find("inertial")
    if node is None:
        return np.zeros(10)
    try:
        mass = float(node.find("mass").get("value"))  # type: ignore[union-attr, arg-type]
        origin = node.find("origin")
        com = _numbers("" if origin is None else origin.get("xyz"), "0 0 0")
        R = _rpy(_numbers("" if origin is None else origin.get("rpy"), "0 0 0"))
        values = {k: float(node.find("inertia").get(k, "0")) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}  # type: ignore[union-attr]
    except (AttributeError, TypeError, ValueError):
        raise ConfigurationError(
            f"URDF {where}: the <inertial> of link {link.get('name')!r} lacks a mass or inertia, or its values are not numbers."
        ) from None
    v = values
    inertia_c = np.array([[v["ixx"], v["ixy"], v["ixz"]], [v["ixy"], v["iyy"], v["iyz"]], [v["ixz"], v["iyz"], v["izz"]]])
    return from_centre_of_mass(mass, com, R @ inertia_c @ R.T)


def _write_inertial(patch: XmlPatch, link: Element, parameters: Array) -> None:
    """Put ten parameters into a link's <inertial>, in place where it has one; inertia is written in the link's own axes."""
    try:
        mass, com, inertia = centre_of_mass(parameters)
    except ZeroDivisionError:
        raise ConfigurationError(
            f"link {link.get('name')!r} has no mass, so a URDF cannot hold its first moments; export standard parameters instead."
        ) from None
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    wanted = {
        "origin": {"xyz": " ".join(repr(float(x)) for x in com), "rpy": "0 0 0"},
        "mass": {"value": repr(float(mass))},
        "inertia": {key: repr(float(inertia[place])) for key, place in entries.items()},
    }
    node = link.find("inertial")
    if node is None:
        patch.insert(link, NewElement("inertial", {}, [NewElement(tag, attributes) for tag, attributes in wanted.items()]))
        return
    for tag, attributes in wanted.items():
        child = node.find(tag)
        if child is None:
            patch.insert(node, NewElement(tag, attributes))
        else:
            patch.set(child, **attributes)


def _write_dynamics(patch: XmlPatch, joint: str, values: dict[str, str], where: str) -> None:
    node = next((j for j in patch.root.findall("joint") if j.get("name") == joint), None)
    if node is None:
        raise ConfigurationError(f"URDF {where}: it has no joint {joint!r} to give {' and '.join(values)}.")
    dynamics = node.find("dynamics")
    if dynamics is not None:
        patch.set(dynamics, **values)
    else:
        patch.insert(node, NewElement("dynamics", values), last=True)


def _exact_angles(patch: XmlPatch) -> list[str]:
    """Right angles written with few digits become exact, as they were when the robot was identified."""
    changed = []
    for joint in patch.root.findall("joint"):
        origin = joint.find("origin")
        if origin is None:
            continue
        words = origin.get("rpy").split()
        exact = [exact_angle(w) for w in words]
        new = [w if e is None or e == float(w) else repr(e) for w, e in zip(words, exact, strict=True)]
        if new != words:
            patch.set(origin, rpy=" ".join(new))
            changed.append(joint.get("name"))
    if not changed:
        return []
    names = ", ".join(changed[:6]) + (" …" if len(changed) > 6 else "")
    return [f"joints {names}: angles that round multiples of pi/4 are written in full, as the robot was identified."]
