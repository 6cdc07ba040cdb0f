"""Where a robot's shapes stand along a motion, for all samples at once, and capsules about them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from .._utils.singular_values import svd
from ..robots.tree import RigidBodyTree

if TYPE_CHECKING:
    from ..robots.bodies import Bodies

Array = np.ndarray
Support = Callable[[Array], tuple[Array, Array]]
#: Lengths (m) below which a segment is a point.
_POINT = 1e-12


@dataclass(frozen=True, eq=False)
class Placed:
    """Placements along N samples: of shapes `R` (N, S, 3, 3), `p` (N, S, 3); of joints their origins `origin` (N, J, 3) and axes `axis`
    (N, J, 3), all in the base frame."""

    R: Array
    p: Array
    origin: Array
    axis: Array


class ShapePlacements:
    """The shapes of a robot (S of them) on its J tree joints, and fixed ones beside it.

    `joint` (S,): number of the tree joint that carries each, −1: the base; `moves` (S, J): whether a joint moves a shape; `ends` (S, 2, 3)
    and `radius` (S,): a capsule in the shape's frame that holds it."""

    def __init__(self, bodies: Bodies) -> None:
        self.tree = RigidBodyTree.from_pinocchio(bodies.model)
        objects = list(bodies.shapes.geometryObjects)
        self.joint = np.array([int(shape.parentJoint) - 1 for shape in objects], int)
        self._rotation = np.array([shape.placement.rotation for shape in objects]).reshape(-1, 3, 3)
        self._translation = np.array([shape.placement.translation for shape in objects]).reshape(-1, 3)
        self.moves = np.zeros((len(objects), self.tree.nb), bool)
        for s, joint in enumerate(self.joint.tolist()):
            while joint >= 0:
                self.moves[s, joint] = True
                joint = int(self.tree.parent[joint])
        self.supports: list[Support] = [support_of(shape.geometry) for shape in objects]
        capsules = [_capsule(shape.geometry) for shape in objects]
        self.ends = np.array([ends for ends, _ in capsules]).reshape(-1, 2, 3)
        self.radius = np.array([radius for _, radius in capsules])

    @property
    def last(self) -> int:
        """The shape at the end of the robot: of those that most joints move, the last."""
        joints = self.moves.sum(axis=1)
        return len(joints) - 1 - int(np.argmax(joints[::-1]))

    def at(self, q: Array) -> Placed:
        """Placements at positions q (N, J) of the tree joints."""
        tree, N = self.tree, len(q)
        R, p = np.empty((tree.nb + 1, N, 3, 3)), np.empty((tree.nb + 1, N, 3))
        R[0], p[0] = np.eye(3), 0.0  # the base, to which the last index of -1 + 1 points
        axis = np.empty((tree.nb, N, 3))
        for i, up in enumerate(tree.parent.tolist()):
            R0, u, angle = tree.rotation[i], tree.axis[i], q[:, i]
            above = R[up + 1]
            p[i + 1] = p[up + 1] + above @ tree.translation[i]
            axis[i] = above @ (R0 @ u)
            if tree.prismatic[i]:
                p[i + 1] += axis[i] * angle[:, None]
                R[i + 1] = above @ R0
                continue
            along = R0 @ np.outer(u, u)
            skew = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
            turn = along + np.cos(angle)[:, None, None] * (R0 - along) + np.sin(angle)[:, None, None] * (R0 @ skew)
            R[i + 1] = above @ turn
        own = self.joint + 1
        shapes = np.swapaxes(R[own] @ self._rotation[:, None], 0, 1)
        origins = np.swapaxes(p[own] + (R[own] @ self._translation[:, None, :, None])[..., 0], 0, 1)
        return Placed(shapes, origins, np.swapaxes(p[1:], 0, 1), np.swapaxes(axis, 0, 1))

    def rate(self, placed: Placed, row: Array, shape: Array, point: Array, direction: Array) -> Array:
        """Speed (A, J) along `direction` (A, 3) of `point` (A, 3), fixed to shape number `shape` (A,), at sample `row` (A,), per unit rate
        of each joint."""
        axis, arm = placed.axis[row], point[:, None] - placed.origin[row]
        turned = np.einsum("aji,aji->aj", axis, np.cross(arm, direction[:, None]))
        slid = np.einsum("aji,ai->aj", axis, direction)
        return np.where(self.tree.prismatic, slid, turned) * self.moves[shape]

    def capsule_gap(self, placed: Placed, row: Array, first: Array, second: Array) -> Array:
        """Distance (A,) between the capsules of two shapes each: a lower bound on that of the shapes."""
        a, b = (placed.p[row, s][:, None] + np.einsum("aij,aej->aei", placed.R[row, s], self.ends[s]) for s in (first, second))
        return segment_gap(a[:, 0], a[:, 1], b[:, 0], b[:, 1]) - self.radius[first] - self.radius[second]

    @cached_property
    def span(self) -> Array:
        """Bound (S, J) on the speed (m/s) of any point of a shape per unit rate of a joint that moves it, wherever the others stand.

        Joints that slide are taken to be within 1 m of their zero."""
        tree = self.tree
        step = np.linalg.norm(tree.translation, axis=1) + np.where(tree.prismatic, 1.0, 0.0)
        out = np.zeros((len(self.joint), tree.nb))
        for s, joint in enumerate(self.joint.tolist()):
            middle = self._translation[s] + self._rotation[s] @ self.ends[s].mean(axis=0)
            far = float(np.linalg.norm(middle) + 0.5 * np.linalg.norm(np.diff(self.ends[s], axis=0)) + self.radius[s])
            while joint >= 0:
                out[s, joint] = 1.0 if tree.prismatic[joint] else far
                far += float(step[joint])
                joint = int(tree.parent[joint])
        return out


def segment_gap(a0: Array, a1: Array, b0: Array, b1: Array) -> Array:
    """Distance (A,) between segments a0 a1 and b0 b1, each end (A, 3)."""
    u, v, w = a1 - a0, b1 - b0, a0 - b0
    uu, uv, vv, uw, vw = (np.einsum("ai,ai->a", x, y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    cross = uu * vv - uv * uv
    safe_uu, safe_vv = np.maximum(uu, _POINT), np.maximum(vv, _POINT)
    s = np.where(cross > 1e-12 * safe_uu * safe_vv, (uv * vw - vv * uw) / np.maximum(cross, 1e-300), 0.0).clip(0.0, 1.0)
    t = ((uv * s + vw) / safe_vv).clip(0.0, 1.0)
    s = ((uv * t - uw) / safe_uu).clip(0.0, 1.0)
    t = ((uv * s + vw) / safe_vv).clip(0.0, 1.0)
    return np.linalg.norm(w + s[:, None] * u - t[:, None] * v, axis=1)


def corners_of(geometry: Any) -> tuple[Array, float]:
    """Points (K, 3) whose convex hull, grown by a radius, holds a shape, and the radius."""
    import coal

    if isinstance(geometry, coal.ConvexBase):
        return np.array(geometry.points(), float).reshape(-1, 3), 0.0
    if isinstance(geometry, coal.Sphere):
        return np.zeros((1, 3)), float(geometry.radius)
    if isinstance(geometry, coal.Capsule):
        return np.array([[0, 0, 1.0], [0, 0, -1.0]]) * geometry.halfLength, float(geometry.radius)
    # A box is its own; anything else lies within its own.
    geometry.computeLocalAABB()
    low, high = np.array(geometry.aabb_local.min_), np.array(geometry.aabb_local.max_)
    return np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T, 0.0


def support_of(geometry: Any) -> Support:
    """For directions (N, 3) in a shape's frame, how far it reaches along them (N,), and the point (N, 3) that does."""
    corners, round_by = corners_of(geometry)

    def support(directions: Array) -> tuple[Array, Array]:
        along = directions @ corners.T
        best = along.argmax(axis=1)
        return along[np.arange(len(directions)), best] + round_by, corners[best] + round_by * directions

    return support


def _capsule(geometry: Any) -> tuple[Array, float]:
    """Ends (2, 3) and radius of a capsule that holds a shape, along its longest direction."""
    corners, round_by = corners_of(geometry)
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    local = corners - centre
    _, _, axes = svd(local, full_matrices=True)
    along = local @ axes[0]
    beside = np.linalg.norm(local - np.outer(along, axes[0]), axis=1)
    radius = float(beside.max())
    inside = np.sqrt(np.maximum(radius**2 - beside**2, 0.0))
    low, high = float((along + inside).min()), float((along - inside).max())
    if low > high:
        low = high = 0.5 * (low + high)
        radius = float(np.linalg.norm(local - low * axes[0], axis=1).max())
    return centre + np.outer([low, high], axes[0]), radius + round_by + 1e-9
