"""The check of a motion, by Pinocchio and coal alone: the URDF's own meshes, the pairs that its SRDF leaves, a thousand times a second."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pandas as pd
import pinocchio as pin
from scipy.spatial import ConvexHull

from ident import Robot
from ident.excitation import Limits, Surroundings

Array = np.ndarray
_SRDF = {"ur5": "srdf/ur5.srdf", "panda": "srdf/panda.srdf", "talos_left_arm": "srdf/talos.srdf"}
#: Samples between two looks at heights and walls.
_PLANES = 5


def box_mesh(file: Path, centre: Array, half: Array) -> Path:
    """A box as STL."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half + centre
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    lines = ["solid box"]
    for a, b, c, d in sides:
        for triangle in ((a, b, c), (a, c, d)):
            points = "".join(f"vertex {' '.join(f'{x:.9g}' for x in corners[k])}\n" for k in triangle)
            lines.append(f"facet normal 0 0 0\nouter loop\n{points}endloop\nendfacet")
    file.write_text("\n".join([*lines, "endsolid box"]) + "\n")
    return file


class Checker:
    """A robot and its surroundings as Pinocchio reads the URDF."""

    def __init__(self, arm: str, robot: Robot, room: Surroundings, box: tuple[Array, Array] | None) -> None:
        urdf = Path(str(robot.source["urdf"]))
        self.model = pin.buildModelFromUrdf(str(urdf))
        self.shapes = pin.buildGeomFromUrdf(self.model, str(urdf), pin.COLLISION, package_dirs=[str(p) for p in urdf.parents])
        self.shapes.addAllCollisionPairs()
        if arm in _SRDF:
            pin.removeCollisionPairs(self.model, self.shapes, str(urdf.parents[1] / _SRDF[arm]))
        else:  # without an SRDF: all but what a joint joins
            joint = [shape.parentJoint for shape in self.shapes.geometryObjects]
            for a, b in [(int(pair.first), int(pair.second)) for pair in self.shapes.collisionPairs]:
                one, two = sorted((joint[a], joint[b]))
                if one == two or self.model.parents[two] == one:
                    self.shapes.removeCollisionPair(pin.CollisionPair(a, b))
        if box is not None:
            own = self.shapes.addGeometryObject(pin.GeometryObject("box", 0, pin.SE3(np.eye(3), box[0]), coal.Box(*(2.0 * box[1]))))
            for k in range(own):
                if self.shapes.geometryObjects[k].parentJoint > 0:
                    self.shapes.addCollisionPair(pin.CollisionPair(k, own))
        self.data, self.geometry = self.model.createData(), self.shapes.createData()
        self.room = room
        self.places = [self.model.joints[self.model.getJointId(name)].idx_q for name in robot.joint_names]
        self.speeds = [self.model.joints[self.model.getJointId(name)].idx_v for name in robot.joint_names]
        self.corners = [self._corners(shape.geometry) for shape in self.shapes.geometryObjects]

    @staticmethod
    def _corners(shape: Any) -> tuple[Array, float]:
        """Points, and the radius of balls about them, that reach as far as a shape."""
        if isinstance(shape, coal.BVHModelBase):
            points = np.asarray(shape.vertices())
            return points[ConvexHull(points).vertices], 0.0
        if isinstance(shape, coal.Sphere):
            return np.zeros((1, 3)), shape.radius
        if isinstance(shape, coal.Cylinder):
            a = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)
            rim = np.column_stack([shape.radius * np.cos(a), shape.radius * np.sin(a)])
            return np.vstack([np.column_stack([rim, np.full(64, s * shape.halfLength)]) for s in (-1, 1)]), 0.0
        if isinstance(shape, coal.Box):
            return np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * shape.halfSide, 0.0
        raise TypeError(type(shape))

    def position(self, q: Array) -> Array:
        full = pin.neutral(self.model)
        full[self.places] = q
        return full

    def collisions(self, motion: Array) -> int:
        """Rows of motion (N, n) in which shapes touch."""
        return sum(pin.computeCollisions(self.model, self.data, self.shapes, self.geometry, self.position(q), True) for q in motion)

    def room_left(self, motion: Array) -> float:
        """The least distance (m) of anything that moves from the ground and the walls, over rows of motion."""
        low, high = np.full(3, np.inf), np.full(3, -np.inf)
        for q in motion:
            pin.updateGeometryPlacements(self.model, self.data, self.shapes, self.geometry, self.position(q))
            for shape, placed, (corners, radius) in zip(self.shapes.geometryObjects, self.geometry.oMg, self.corners, strict=True):
                if shape.parentJoint > 0:
                    points = corners @ placed.rotation.T + placed.translation
                    low = np.minimum(low, points.min(axis=0) - radius)
                    high = np.maximum(high, points.max(axis=0) + radius)
        left = low[2] - float(self.room.ground)  # type: ignore[arg-type]
        for i, (a, b) in enumerate(self.room.box or ()):
            left = min(left, low[i] - a, b - high[i])
        return float(left)

    def clear_posture(self, rng: np.random.Generator, limits: Limits) -> Array:
        """A random posture without contact and with room, somewhere in the middle of the range; the last tried where there is none."""
        middle, way = 0.5 * (limits.lower + limits.upper), 0.5 * (limits.upper - limits.lower)
        q = middle
        for _ in range(300):
            q = middle + rng.uniform(-0.6, 0.6, len(middle)) * way
            if self.room_left(q[None]) > self.room.clearance + 0.03 and not self.collisions(q[None]):
                break
        return q

    def torque(self, q: Array, dq: Array, ddq: Array, drive: Array) -> Array:
        """Torque (N, n): rigid body by Pinocchio, and rotors, viscous and Coulomb friction `drive` (3, n)."""
        out = np.empty_like(q)
        v, a = np.zeros(self.model.nv), np.zeros(self.model.nv)
        for i, x in enumerate(q):
            v[self.speeds], a[self.speeds] = dq[i], ddq[i]
            out[i] = pin.rnea(self.model, self.data, self.position(x), v, a)[self.speeds]
        return out + drive[0] * ddq + drive[1] * dq + drive[2] * np.sign(dq)

    def verdict(self, motion: pd.DataFrame, limits: Limits, drive: Array) -> dict[str, float]:
        """Of a motion sampled at 1 kHz: samples that touch, room left beside the clearance (m), and by how much each limit is exceeded."""
        n = len(self.places)
        q, dq, ddq = (motion[[f"{key}{j + 1}" for j in range(n)]].to_numpy() for key in ("q", "dq", "ddq"))
        step = 1e-3
        jerk = np.diff(ddq, axis=0) / step
        over = {
            "position": max(float((q - limits.upper).max()), float((limits.lower - q).max())),
            "velocity": float((np.abs(dq) - limits.velocity).max()),
            "acceleration": float((np.abs(ddq) - limits.acceleration).max()),
            "jerk": float((np.abs(jerk) - limits.jerk).max()),
            "torque": float((np.abs(self.torque(q, dq, ddq, drive)) - limits.torque).max()),
        }
        still = max(float(np.abs(x[[0, -1]]).max()) for x in (dq, ddq))
        # Speeds and accelerations are those of the positions: by the trapezoidal rule.
        own = max(float(np.abs(np.diff(a, axis=0) - 0.5 * step * (b[1:] + b[:-1])).max()) for a, b in ((q, dq), (dq, ddq)))
        return {
            "samples": float(len(q)),
            "touching": float(self.collisions(q)),
            "room": self.room_left(q[::_PLANES]) - self.room.clearance,
            "still": still,
            "consistent": own,
            **{f"over_{kind}": x for kind, x in over.items()},
        }
