"""From a URDF to the frames of the closed forms: {i-1}A_i = Rx(alpha_i) Rz(theta_i), o_{i+1} on axis i+1, {i}L_i = [Lx, 0, Lz].

An axis of rotation has no preferred sense, and its origin may stand anywhere on it: so the sense of each axis and the origins are
chosen anew. x_i lies along z_i × z_{i+1}; then every twist is in (0, pi), a right angle is always +90 deg, and antiparallel axes
become parallel. Turning an axis round changes the sign of a torque, not what the torques show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ....errors import UnsupportedError
from ..joint_blocks import ENERGY_BASIS, PSEUDO_INERTIA, typical_length

if TYPE_CHECKING:
    from ....robots.robot import Robot
    from ....robots.tree import RigidBodyTree

Array = np.ndarray

#: rad; axes nearer than this are parallel (perpendicular).
ANGLE = 1e-9
#: rad; axes nearer than this to parallel, but not parallel, have no usable common normal.
NEARLY_PARALLEL = 1e-3
#: Share of the typical distance between joints below which a length is zero.
LENGTH = 1e-10


@dataclass(frozen=True, eq=False)
class AxisFrames:
    """Frames of successive axes of rotation, in the world at the reference position.

    `rotation` (N, 3, 3): columns x, y, z; `origin` (N, 3); `twist` (N,): alpha_i, the first zero; `length` (N, 3): L_i in
    frame i, the last zero."""

    rotation: Array
    origin: Array
    twist: Array
    length: Array

    @property
    def count(self) -> int:
        return len(self.origin)

    def clusters(self) -> list[list[int]]:
        """Runs of parallel axes, as 1-based numbers."""
        runs: list[list[int]] = []
        for i in range(self.count):
            if i and abs(self.twist[i]) == 0.0:
                runs[-1].append(i + 1)
            else:
                runs.append([i + 1])
        return runs


def world_frames(tree: RigidBodyTree, position: Array) -> Array:
    """Poses (nb, 4, 4) of the joint frames in the base frame at one position (nb,) of the tree's joints."""
    from scipy.spatial.transform import Rotation

    poses = np.zeros((tree.nb, 4, 4))
    for body in range(tree.nb):
        local, motion = np.eye(4), np.eye(4)
        local[:3, :3], local[:3, 3] = tree.rotation[body], tree.translation[body]
        if position[body] != 0.0:
            if tree.prismatic[body]:
                motion[:3, 3] = tree.axis[body] * position[body]
            else:
                motion[:3, :3] = Rotation.from_rotvec(tree.axis[body] * position[body]).as_matrix()
        before = poses[tree.parent[body]] if tree.parent[body] >= 0 else np.eye(4)
        poses[body] = before @ local @ motion
    return poses


def axis_frames(points: Array, directions: Array, zero_length: float, level: int = 0) -> AxisFrames:
    """Frames for axes given by a point (N, 3) and a unit direction (N, 3) each.

    Between parallel axes the origin stays at the given point, except after the 1-based axis `level`, where it is put at the same
    height (Lz = 0)."""
    count = len(points)
    z, origin, x = directions.copy(), points.copy(), np.zeros((count, 3))
    twist, length = np.zeros(count), np.zeros((count, 3))
    for i in range(count):
        if i == count - 1:
            x[i] = _any_normal(z[i], x[i - 1] if count > 1 else np.array([1.0, 0.0, 0.0]))
            continue
        offset = points[i + 1] - origin[i]
        normal = np.cross(z[i], z[i + 1])
        sine, cosine = float(np.linalg.norm(normal)), float(z[i] @ z[i + 1])
        if sine < ANGLE:
            z[i + 1] = z[i]
            across = offset - (offset @ z[i]) * z[i]
            size = float(np.linalg.norm(across))
            x[i] = across / size if size > zero_length else _any_normal(z[i], x[i - 1] if i else np.array([1.0, 0.0, 0.0]))
            height = 0.0 if i + 1 == level else float(offset @ z[i])
            length[i] = [size, 0.0, height]
            origin[i + 1] = origin[i] + across + height * z[i]
            continue
        x[i] = normal / sine
        twist[i + 1] = np.pi / 2 if abs(cosine) < ANGLE else np.arctan2(sine, cosine)
        y = np.cross(z[i], x[i])
        origin[i + 1] = points[i + 1] - (offset @ y) / (z[i + 1] @ y) * z[i + 1]
        along = origin[i + 1] - origin[i]
        length[i] = [along @ x[i], 0.0, along @ z[i]]
    length[np.abs(length) < zero_length] = 0.0
    rotation = np.stack([x, np.cross(z, x), z], axis=-1)
    return AxisFrames(rotation, origin, twist, length)


def _any_normal(z: Array, hint: Array) -> Array:
    """A unit vector normal to z, near `hint` if that is not along z."""
    for candidate in (hint, *np.eye(3)):
        across = candidate - (candidate @ z) * z
        size = float(np.linalg.norm(across))
        if size > 0.5:
            unit: Array = across / size
            return unit
    raise AssertionError("three axes cannot all be along one direction")


def link_change(urdf: Array, rotation: Array, origin: Array) -> Array:
    """(10, 10): parameters in the frame (rotation, origin) = change @ parameters in the URDF's frame, both given in the world."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, origin
    back = np.linalg.inv(pose) @ urdf
    moved = back @ PSEUDO_INERTIA @ back.T
    change: Array = np.einsum("kij,lij->kl", ENERGY_BASIS, moved)
    return change


@dataclass(frozen=True, eq=False)
class Chain:
    """A serial chain read for a closed form: bodies in order, their poses and axes in the world at the reference position."""

    robot: Robot
    poses: Array
    axes: Array
    zero_length: float

    @property
    def points(self) -> Array:
        return self.poses[:, :3, 3]

    @property
    def gravity(self) -> Array:
        """Unit vector of gravity."""
        g = self.robot.tree.gravity
        unit: Array = g / np.linalg.norm(g)
        return unit

    def along_gravity(self, direction: Array) -> bool:
        return float(np.linalg.norm(np.cross(direction, self.gravity))) < ANGLE


def read_tree(robot: Robot, theorem: str) -> Chain:
    """Poses and axes of all bodies at the reference position. Refuses what no theorem covers: a floating base, no gravity."""
    if robot.floating_base:
        raise unsupported(robot, theorem, "its base floats")
    tree = robot.tree
    if not tree.gravity.any():
        raise unsupported(robot, theorem, "there is no gravity, and the count then depends on the lengths in ways the theorem leaves out")
    poses = world_frames(tree, robot.loop.offset)
    axes = np.einsum("bij,bj->bi", poses[:, :3, :3], tree.axis)
    return Chain(robot, poses, axes, LENGTH * typical_length(tree))


def read_chain(robot: Robot, theorem: str) -> Chain:
    """As `read_tree`, for an open serial chain; anything else is refused."""
    chain = read_tree(robot, theorem)
    if not robot.loop.is_trivial:
        otherwise = "closed_form.parallelogram(robot) for a planar parallelogram, else "
        raise unsupported(robot, theorem, "it has dependent joints ([loop] or mimic)", otherwise)
    for body in range(1, robot.tree.nb):
        if robot.tree.parent[body] != body - 1:
            one, other = robot.tree_joints[body].name, robot.tree_joints[body - 1].name
            raise unsupported(robot, theorem, f"it is no serial chain: joint {one!r} does not follow {other!r}, but branches off before it")
    return chain


def refuse_oblique(robot: Robot, theorem: str, frames: AxisFrames, names: Sequence[str], otherwise: str) -> None:
    """Raise for successive axes that are neither parallel nor perpendicular."""
    for i in range(1, frames.count):
        twist = float(frames.twist[i])
        if twist not in (0.0, np.pi / 2):
            angle = f"{np.degrees(twist):.6g} deg, neither parallel nor perpendicular"
            raise unsupported(robot, theorem, f"the axes of {names[i - 1]!r} and {names[i]!r} are at {angle}", otherwise)


def refuse_nearly_parallel(robot: Robot, theorem: str, frames: AxisFrames, names: Sequence[str]) -> None:
    """Raise for successive axes that are almost parallel: their common normal, on which the formulas stand, lies far away."""
    for i in range(1, frames.count):
        deviation = min(float(frames.twist[i]), np.pi - float(frames.twist[i]))
        if 0.0 < deviation < NEARLY_PARALLEL:
            pair = f"the axes of {names[i - 1]!r} and {names[i]!r}"
            raise unsupported(robot, theorem, f"{pair} are {deviation:.1e} rad from parallel, too near for its frames")


def unsupported(robot: Robot, theorem: str, reason: str, otherwise: str = "") -> UnsupportedError:
    """The error for a structure outside a theorem."""
    general = "ident.regressor.base_parameters.structural.base_set(robot), which covers any tree"
    return UnsupportedError(f"{theorem} does not cover robot {robot.name!r}: {reason}. Use {otherwise}{general}.")
