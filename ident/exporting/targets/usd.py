"""OpenUSD with UsdPhysics and PhysX attributes: bodies, joints, drives; angles in degrees, as the schema has them."""

from __future__ import annotations

import re

import numpy as np

from ...errors import UnsupportedError
from ...physical.pseudo_inertia import centre_of_mass
from ...robots.tree import link_names
from ..actuation import Actuation, JointActuator
from ..identified import Identified
from ..mjcf import quaternion, real_bodies
from ..omitted import omissions
from ..target import ExportOptions, ExportTarget, Expressed, WrittenFile, register_target

Array = np.ndarray
_DEGREE = np.pi / 180.0


@register_target
class UsdTarget(ExportTarget):
    """One articulation without geometry; friction as `PhysxJointAxisAPI` has it (PhysX 5, Isaac Sim 5.0 and later)."""

    name = "usd"
    title = "OpenUSD physics"
    suffixes = (".usda", ".usd")
    expresses = frozenset({Expressed.ARMATURE, Expressed.DAMPING, Expressed.DRY_FRICTION, Expressed.BREAKAWAY, Expressed.VELOCITY_COMMAND})

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        robot = found.robot
        if robot.tree.floating:
            raise UnsupportedError("USD export supports robots on a fixed base only; export an MJCF or a URDF.")
        if not robot.loop.is_trivial:
            raise UnsupportedError("USD export supports open chains only; for joints that follow others, export an MJCF or a URDF.")
        real_bodies(robot, found.inertial, "USD")
        law = Actuation.of(found)
        names = {name: _identifier(name) for name in (*link_names(robot.model), *(j.name for j in robot.tree_joints))}
        prims = [_scene(robot.tree.gravity), *_bodies(found, names), *_joints(law, names)]
        root = _identifier(robot.name)
        changed = [f"{name} is {new}" for name, new in names.items() if name != new]
        notes: tuple[str, ...] = ("the USD contains no geometry: add it to the bodies, whose frames are the joint frames.",)
        if changed:
            notes += (f"names that USD does not allow were changed: {', '.join(changed)}.",)
        notes = (*found.notes, *notes, *omissions(found, self.expresses, options))
        text = "\n".join(prims).replace("<{root}/", f"</{root}/")
        return WrittenFile(_HEAD.format(root=root, notes="\n".join(f"# {note}" for note in notes), prims=text), notes)


_HEAD = """#usda 1.0
{notes}
(
    defaultPrim = "{root}"
    metersPerUnit = 1
    kilogramsPerUnit = 1
    upAxis = "Z"
)

def Xform "{root}" (
    prepend apiSchemas = ["PhysicsArticulationRootAPI"]
)
{{
{prims}
}}
"""


def _scene(gravity: Array) -> str:
    size = float(np.linalg.norm(gravity))
    direction = gravity / size if size > 0 else np.array([0.0, 0.0, -1.0])
    lines = [f"vector3f physics:gravityDirection = {_words(direction)}", f"float physics:gravityMagnitude = {size!r}"]
    return _prim("PhysicsScene", "physicsScene", [], lines)


def _bodies(found: Identified, names: dict[str, str]) -> list[str]:
    """The base, fixed to the world, and one rigid body for each moving link, placed as with all joints at zero."""
    tree, prims = found.robot.tree, []
    apis = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
    prims.append(_prim("Xform", "base_fixed", apis, [*_placed(np.eye(3), np.zeros(3)), "float physics:mass = 1"]))
    prims.append(_prim("PhysicsFixedJoint", "base_to_world", [], ["rel physics:body1 = <{root}/base_fixed>"]))
    places: list[tuple[Array, Array]] = []
    for i, name in enumerate(link_names(found.robot.model)):
        up = int(tree.parent[i])
        R, p = (np.eye(3), np.zeros(3)) if up < 0 else places[up]
        places.append((R @ tree.rotation[i], p + R @ tree.translation[i]))
        mass, com, inertia = centre_of_mass(found.inertial.reshape(-1, 10)[i])
        moments, axes = np.linalg.eigh(inertia)
        axes = axes * np.sign(np.linalg.det(axes))
        lines = [
            *_placed(*places[-1]),
            f"float physics:mass = {float(mass)!r}",
            f"point3f physics:centerOfMass = {_words(com)}",
            f"float3 physics:diagonalInertia = {_words(moments)}",
            f"quatf physics:principalAxes = {_words(quaternion(axes))}",
        ]
        prims.append(_prim("Xform", names[name], apis, lines))
    return prims


def _placed(R: Array, p: Array) -> list[str]:
    return [
        f"double3 xformOp:translate = {_words(p)}",
        f"quatd xformOp:orient = {_words(quaternion(R))}",
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]',
    ]


def _joints(law: Actuation, names: dict[str, str]) -> list[str]:
    robot, prims = law.robot, []
    links = [names[name] for name in link_names(robot.model)]
    for i, joint in enumerate(robot.tree_joints):
        up, actuator = int(robot.tree.parent[i]), law.actuators[robot.joint_index(joint.name)]
        turn = _first_axis(robot.tree.axis[i])
        lines = [
            f"rel physics:body0 = <{{root}}/{'base_fixed' if up < 0 else links[up]}>",
            f"rel physics:body1 = <{{root}}/{links[i]}>",
            'uniform token physics:axis = "X"',
            f"point3f physics:localPos0 = {_words(robot.tree.translation[i])}",
            f"quatf physics:localRot0 = {_words(quaternion(robot.tree.rotation[i] @ turn))}",
            "point3f physics:localPos1 = (0, 0, 0)",
            f"quatf physics:localRot1 = {_words(quaternion(turn))}",
        ]
        place = "linear" if joint.prismatic else "angular"
        apis = [f"PhysxJointAxisAPI:{place}"]
        if actuator.kp is not None:
            apis.insert(0, f"PhysicsDriveAPI:{place}")
        kind = "PhysicsPrismaticJoint" if joint.prismatic else "PhysicsRevoluteJoint"
        prims.append(_prim(kind, names[joint.name], apis, [*lines, *_numbers(actuator, place)]))
    return prims


def _numbers(actuator: JointActuator, place: str) -> list[str]:
    """What the joint's attributes say: per degree where the joint turns, as UsdPhysics and PhysX have it; metres where it slides."""
    per = 1.0 if actuator.prismatic else _DEGREE
    lines = []
    if np.isfinite([actuator.lower, actuator.upper]).all():
        lines += [f"float physics:lowerLimit = {actuator.lower / per!r}", f"float physics:upperLimit = {actuator.upper / per!r}"]
    if actuator.kp is not None and actuator.kd is not None:
        lines += [
            f'uniform token drive:{place}:physics:type = "force"',
            f"float drive:{place}:physics:stiffness = {actuator.kp * per!r}",
            f"float drive:{place}:physics:damping = {actuator.kd * per!r}",
            f"float drive:{place}:physics:targetPosition = 0",
        ]
        if actuator.limited:
            lines.append(f"float drive:{place}:physics:maxForce = {actuator.effort_limit!r}")
    axis = f"float physxJointAxis:{place}"
    lines += [
        f"{axis}:armature = {actuator.armature!r}",
        f"{axis}:staticFrictionEffort = {actuator.dry + actuator.breakaway!r}",
        f"{axis}:dynamicFrictionEffort = {actuator.dry!r}",
        f"{axis}:viscousFrictionCoefficient = {actuator.damping * per!r}",
    ]
    if np.isfinite(actuator.velocity):
        lines.append(f"{axis}:maxJointVelocity = {actuator.velocity / per!r}")
    return lines


def _first_axis(axis: Array) -> Array:
    """A rotation whose first column is the axis."""
    other = np.eye(3)[int(np.argmin(np.abs(axis)))]
    y = np.cross(axis, other)
    y /= np.linalg.norm(y)
    return np.stack([axis, y, np.cross(axis, y)], axis=1)


def _prim(kind: str, name: str, apis: list[str], lines: list[str]) -> str:
    listed = ", ".join(f'"{api}"' for api in apis)
    opening = f'    def {kind} "{name}"' + (f" (\n        prepend apiSchemas = [{listed}]\n    )" if apis else "")
    return "\n".join([opening, "    {", *(f"        {line}" for line in lines), "    }"])


def _identifier(name: str) -> str:
    word = re.sub(r"\W", "_", name, flags=re.ASCII)
    return f"_{word}" if not word or word[0].isdigit() else word


def _words(values: Array) -> str:
    return "(" + ", ".join(repr(float(x)) for x in values) + ")"
