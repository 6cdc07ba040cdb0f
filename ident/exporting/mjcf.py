"""An MJCF model (MuJoCo) of the identified robot: bodies, joints, inertia, reflected rotor inertia and friction; no geometry.

A diagonal transmission becomes armature, damping and frictionloss of the joints; a coupled one becomes one fixed tendon per motor, whose
length is the motor's angle, so that rotor inertia and friction act through K exactly."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError, UnsupportedError
from ..physical.pseudo_inertia import centre_of_mass, smallest_eigenvalues
from ..robots.tree import link_names

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray


def mjcf_text(
    robot: Robot, inertial: Array, drive: Mapping[str, Array], beside: Mapping[str, Array] | None = None
) -> tuple[str, tuple[str, ...]]:
    """MJCF text and notes. `inertial` (10 nb,); `drive`: "armature", "damping", "frictionloss" -> (n,) per motor, on the motor side;
    `beside`: attributes of the joints themselves -> (n,), "armature", "damping", "frictionloss", "stiffness", "springref".

    Raises ConfigurationError where a body is not real, UnsupportedError for loop closures with several masters."""
    from lxml import etree

    tree = robot.tree
    real_bodies(robot, inertial, "MuJoCo")
    parameters = np.asarray(inertial, float).reshape(-1, 10)
    names = _body_names(robot)
    root = etree.Element("mujoco", model=robot.name)
    # Angles in radians; inertia as given, not balanced.
    etree.SubElement(root, "compiler", angle="radian", autolimits="true", balanceinertia="false")
    etree.SubElement(root, "option", gravity=_words(tree.gravity))
    world = etree.SubElement(root, "worldbody")
    if np.count_nonzero(tree.parent < 0) > 1 and not tree.floating:
        # Several trees on one base: a body that stands still holds them, for readers that know one root only.
        world = etree.SubElement(world, "body", name=_base_name(names))
    nodes: list[etree._Element] = []
    diagonal = robot.transmission.is_diagonal
    K = robot.transmission.K
    for i in range(tree.nb):
        up = int(tree.parent[i])
        body = etree.SubElement(
            world if up < 0 else nodes[up],
            "body",
            name=names[i],
            pos=_words(tree.translation[i]),
            quat=_words(quaternion(tree.rotation[i])),
        )
        nodes.append(body)
        mass, com, inertia_c = centre_of_mass(parameters[i])
        full = [inertia_c[0, 0], inertia_c[1, 1], inertia_c[2, 2], inertia_c[0, 1], inertia_c[0, 2], inertia_c[1, 2]]
        etree.SubElement(body, "inertial", pos=_words(com), mass=repr(float(mass)), fullinertia=_words(full))
        if tree.floating and i == 0:
            etree.SubElement(body, "freejoint", name="floating_base")
            continue
        joint = robot.tree_joints[i - int(tree.floating)]
        node = etree.SubElement(body, "joint", name=joint.name, type="slide" if joint.prismatic else "hinge", axis=_words(tree.axis[i]))
        if np.isfinite(joint.lower) and np.isfinite(joint.upper):
            node.set("range", _words([joint.lower, joint.upper]))
        if joint.name in robot.joint_names:
            j = robot.joint_index(joint.name)
            _attributes(node, j, abs(K[j, j]) if diagonal else 0.0, drive, beside or {})
    notes = ["the MJCF contains no geometry: add it to the bodies, whose frames are the joint frames."]
    notes += _closure(root, robot)
    if not diagonal and any(np.any(v != 0) for v in drive.values()):
        _tendons(root, robot, drive)
        notes.append("the coupled transmission is written as one fixed tendon per motor, with its rotor inertia and friction.")
        notes += _across_branches(robot, drive)
    return etree.tostring(root, pretty_print=True, encoding="unicode"), tuple(notes)


def real_bodies(robot: Robot, inertial: Array, reader: str) -> None:
    """Raises ConfigurationError where links (10 nb,) are no real bodies."""
    names = link_names(robot.model)
    bad = [names[i] for i in np.flatnonzero(smallest_eigenvalues(np.asarray(inertial, float).reshape(-1, 10)) <= 0)]
    if bad:
        raise ConfigurationError(
            f"the parameters of {', '.join(bad)} are physically inconsistent, and {reader} rejects them; export standard parameters."
        )


def _attributes(node: Any, j: int, k: float, drive: Mapping[str, Array], beside: Mapping[str, Array]) -> None:
    """What a joint's element says beside its place; k: joint turns per motor turn, 0 where motors act through tendons."""
    own = {key: float(values[j]) for key, values in beside.items()}
    if k:
        for key, power in (("armature", 2), ("damping", 2), ("frictionloss", 1)):
            if key in drive:
                own[key] = own.get(key, 0.0) + float(drive[key][j] / k**power)
    for key, value in own.items():
        if value != 0.0:
            node.set(key, repr(value))


def _tendons(root: object, robot: Robot, drive: Mapping[str, Array]) -> None:
    from lxml import etree

    section = etree.SubElement(root, "tendon")  # type: ignore[arg-type]
    for motor, row in enumerate(robot.transmission.K_inverse):
        tendon = etree.SubElement(section, "fixed", name=f"motor_{robot.joint_names[motor]}")
        for key in ("armature", "damping", "frictionloss"):
            if key in drive and drive[key][motor] != 0.0:
                tendon.set(key, repr(float(drive[key][motor])))
        for j, coefficient in enumerate(row):
            if coefficient != 0.0:
                etree.SubElement(tendon, "joint", joint=robot.joint_names[j], coef=repr(float(coefficient)))


def _across_branches(robot: Robot, drive: Mapping[str, Array]) -> list[str]:
    """MuJoCo's inertia matrix has no place for pairs of joints of which none moves the other: tendons' inertia between those is lost."""
    back = robot.transmission.K_inverse
    inertia = back.T @ np.diag(drive.get("armature", np.zeros(robot.n))) @ back
    names = [joint.name for joint in robot.tree_joints]
    moved: list[set[int]] = []  # bodies from the base to each one
    for i, up in enumerate(robot.tree.parent):
        moved.append({i} | (moved[up] if up >= 0 else set()))
    bodies = [names.index(name) + int(robot.tree.floating) for name in robot.joint_names]
    lost = [
        (abs(float(inertia[i, j])), f"{robot.joint_names[i]} and {robot.joint_names[j]}")
        for i in range(robot.n)
        for j in range(i)
        if inertia[i, j] != 0.0 and bodies[i] not in moved[bodies[j]] and bodies[j] not in moved[bodies[i]]
    ]
    if not lost:
        return []
    worst = max(lost)
    pairs = ", ".join(pair for _, pair in lost)
    size = f"up to {worst[0]:.3g} kg m^2 ({worst[1]}), in N m per rad/s^2 of the other joint"
    return [f"not expressible: rotor inertia between joints of different branches ({pairs}): {size}."]


def _closure(root: object, robot: Robot) -> list[str]:
    from lxml import etree

    if robot.loop.is_trivial:
        return []
    section = etree.SubElement(root, "equality")  # type: ignore[arg-type]
    dependent = []
    for joint, row, offset in zip(robot.tree_joints, robot.loop.W, robot.loop.offset, strict=True):
        if joint.name in robot.joint_names:
            continue
        masters = np.flatnonzero(row)
        if len(masters) > 1:
            raise UnsupportedError(
                f"joint {joint.name!r} follows {len(masters)} joints at once, which an MJCF joint equality cannot express;"
                " export a URDF or JSON instead."
            )
        attributes = {"joint1": joint.name, "polycoef": _words([offset, row[masters[0]] if len(masters) else 0.0, 0, 0, 0])}
        if len(masters):
            attributes["joint2"] = robot.joint_names[int(masters[0])]
        etree.SubElement(section, "joint", attributes)
        dependent.append(joint.name)
    return [f"dependent joints {', '.join(dependent)} are tied by equality constraints, which are soft in MuJoCo."]


def _body_names(robot: Robot) -> tuple[str, ...]:
    return link_names(robot.model)


def _base_name(taken: tuple[str, ...]) -> str:
    name = "base"
    while name in taken:
        name += "_0"
    return name


def _words(values: object) -> str:
    return " ".join(repr(float(x)) for x in np.asarray(values, float).reshape(-1))


def quaternion(R: Array) -> Array:
    """Unit quaternion w x y z of a rotation matrix, from its largest component (Shepperd, 1978)."""
    squares = np.array(
        [1 + R[0, 0] + R[1, 1] + R[2, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2], 1 - R[0, 0] + R[1, 1] - R[2, 2], 1 - R[0, 0] - R[1, 1] + R[2, 2]]
    )
    k = int(np.argmax(squares))
    pairs = [
        [squares[0], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
        [R[2, 1] - R[1, 2], squares[1], R[1, 0] + R[0, 1], R[0, 2] + R[2, 0]],
        [R[0, 2] - R[2, 0], R[1, 0] + R[0, 1], squares[2], R[2, 1] + R[1, 2]],
        [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[2, 1] + R[1, 2], squares[3]],
    ][k]
    q = np.array(pairs)
    return q / np.linalg.norm(q)
