"""Shapes of a robot's links, for collisions: convex hulls of its meshes and its primitive shapes; capsules along links without any."""

from __future__ import annotations

import os
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from lxml import etree

from ..errors import ConfigurationError
from .joints import held_joints
from .urdf import prepare_urdf
from .urdf_text import parsed

if TYPE_CHECKING:
    import pinocchio as pin

    from .robot import Robot

Array = np.ndarray
#: Radius (m) of the capsule that stands for a link without a shape, and its largest share of the longest link.
_RADIUS, _SHARE = 0.05, 0.25


@dataclass(frozen=True, eq=False)
class Bodies:
    """Shapes on a robot's joints, at any position of its tree joints.

    `model`: the tree, one coordinate per joint, base fixed; `shapes`: convex ones, in metres; `labels`: the link that each belongs to;
    `invented`: links that stand as capsules of `radius` m because the URDF gives them no shape that can be read; `notes`: why."""

    model: pin.Model
    shapes: pin.GeometryModel
    labels: tuple[str, ...]
    invented: tuple[str, ...]
    radius: float
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, robot: Robot, radius: float | None = None) -> Bodies:
        """The shapes that the robot's URDF gives; `radius` of the capsules of links without any (m), by default 5 cm, or a quarter of the
        longest link if that is less.

        Examples
        --------
        >>> import ident
        >>> from ident.robots.bodies import Bodies
        >>> Bodies.of(ident.load_robot("scara")).invented != ()
        True
        """
        import pinocchio as pin

        if "urdf_text" not in robot.source:
            raise ConfigurationError(f"robot {robot.name!r}: has no URDF from which to take the shapes of its links.")
        xml, notes = _with_collisions(robot)
        urdf = prepare_urdf(robot.source["urdf_text"])
        model = pin.buildModelFromXML(xml)
        try:
            shapes = pin.buildGeomFromUrdfString(model, xml, pin.GeometryType.COLLISION)
        except (ValueError, RuntimeError) as error:
            notes.append(f"the shapes of the URDF cannot be read ({str(error).strip().splitlines()[0]}).")
            shapes = pin.GeometryModel()
        held = held_joints(urdf, list(model.names)[1:], robot.source["locked"], robot.source["joints"], robot.source["loop"])
        if held:
            at = pin.neutral(model)
            for joint, position in held.items():
                at[model.joints[model.getJointId(joint)].idx_q] = position
            model, shapes = pin.buildReducedModel(model, shapes, [model.getJointId(j) for j in held], at)
        boxed = [_label(shape.name) for shape in shapes.geometryObjects if not _made_convex(shape)]
        if boxed:
            notes.append(
                f"represented by bounding boxes, because coal cannot build the convex hulls of their meshes:"
                f" {', '.join(dict.fromkeys(boxed))}."
            )
        longest = max((float(np.linalg.norm(p.translation)) for p in list(model.jointPlacements)[1:]), default=1.0)
        radius = min(_RADIUS, _SHARE * longest or _RADIUS) if radius is None else radius
        invented = _invent(model, shapes, radius)
        labels = tuple(_label(shape.name) for shape in shapes.geometryObjects)
        return cls(model, shapes, labels, invented, float(radius), tuple(notes))


def _label(name: str) -> str:
    """The link of a shape: Pinocchio appends a number."""
    head, _, number = name.rpartition("_")
    return head if number.isdigit() and head else name


def _with_collisions(robot: Robot) -> tuple[str, list[str]]:
    """The prepared URDF with its collision shapes, meshes by their whole paths; and what could not be found."""
    notes: list[str] = []
    text = robot.source["urdf_text"]
    root = etree.fromstring(prepare_urdf(text).xml.encode())
    links = {link.get("name"): link for link in root.findall("link")}
    file = robot.source.get("urdf")
    missing: list[str] = []
    for link in parsed(text, "text", []).findall("link"):
        for collision in link.findall("collision"):
            own = deepcopy(collision)
            mesh = own.find("geometry/mesh")
            if mesh is not None:
                path = _mesh(mesh.get("filename", ""), None if file is None else Path(str(file)))
                if path is None:
                    missing.append(mesh.get("filename", ""))
                    continue
                mesh.set("filename", str(path))
            if link.get("name") in links:
                links[link.get("name")].append(own)
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        notes.append(f"mesh {missing[0]!r}{more} was not found: set ROS_PACKAGE_PATH to the folder that holds the package.")
    return etree.tostring(root, encoding="unicode"), notes


def _mesh(name: str, urdf: Path | None) -> Path | None:
    """The file of a mesh: a path, a path from the URDF's folder, or package://… below any folder above the URDF or ROS_PACKAGE_PATH."""
    if not name.startswith("package://"):
        path = Path(name.removeprefix("file://"))
        path = path if path.is_absolute() or urdf is None else urdf.resolve().parent / path
        return path if path.is_file() else None
    package, _, rest = name.removeprefix("package://").partition("/")
    above = [] if urdf is None else list(urdf.resolve().parents)
    above += [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    for folder in above:
        for path in (folder / package / rest, *([folder / rest] if folder.name == package else [])):
            if path.is_file():
                return path
    return None


def _made_convex(shape: Any) -> bool:
    """Replace the mesh of a shape by its convex hull, or by the box about it where that cannot be had, which is False."""
    import coal
    import pinocchio as pin

    mesh = shape.geometry
    if not isinstance(mesh, coal.BVHModelBase):
        return True
    try:
        mesh.buildConvexHull(True, "Qt")
    except RuntimeError:  # more neighbours of a corner than coal counts
        mesh.computeLocalAABB()
        low, high = np.array(mesh.aabb_local.min_), np.array(mesh.aabb_local.max_)
        shape.geometry = coal.Box(*(high - low))
        shape.placement = shape.placement * pin.SE3(np.eye(3), 0.5 * (low + high))
        return False
    shape.geometry = mesh.convex
    return True


def _invent(model: pin.Model, shapes: pin.GeometryModel, radius: float) -> tuple[str, ...]:
    """Add a capsule to each joint that carries no shape: to the next joints, or twice as far as the centre of mass."""
    import pinocchio as pin

    covered = {shape.parentJoint for shape in shapes.geometryObjects}
    names = []
    for joint in range(model.njoints):
        if joint in covered:
            continue
        links = [f.name for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY]
        name = next((n for n in links if n != "universe"), f"link of {model.names[joint]}" if joint else "base")
        ends = [np.array(model.jointPlacements[c].translation) for c in range(1, model.njoints) if model.parents[c] == joint]
        if not ends and joint:
            ends = [2.0 * np.array(model.inertias[joint].lever)]
        names.append(name)
        for k, end in enumerate(ends or [np.zeros(3)]):
            shapes.addGeometryObject(_capsule(f"{name}_{k}", joint, end, radius))
    return tuple(names)


def _capsule(name: str, joint: int, end: Array, radius: float) -> Any:
    """A capsule on a joint from its origin to `end`; a ball where they coincide."""
    import coal
    import pinocchio as pin

    length = float(np.linalg.norm(end))
    if length < 1e-6:
        return pin.GeometryObject(name, joint, pin.SE3.Identity(), coal.Sphere(radius))
    axis = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end / length).toRotationMatrix()
    return pin.GeometryObject(name, joint, pin.SE3(axis, 0.5 * end), coal.Capsule(radius, length))
