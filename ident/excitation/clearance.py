"""Distances along a motion: of the robot's links from each other, from the ground and from walls, with their gradients."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError
from ..robots.bodies import Bodies
from .surroundings import GROUND, Surroundings

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .limits import Limits

Array = np.ndarray
#: Random postures on which it is seen what can be kept clear of what, and the share of them beyond which shapes overlap by construction.
#: And the change (m) below which a distance to a plane is the same in all of them.
_POSTURES, _ALWAYS, _FIXED = 400, 0.95, 1e-2
#: Below the required distance and this much (m) a pair weighs on the search, and this much (m) is kept beyond what is required, for between
#: samples; pairs that are always near are kept this far (m) apart.
_ACTIVE, _MARGIN, _TOUCH = 0.06, 0.004, 0.0005


@dataclass(frozen=True, eq=False)
class Constraint:
    """A distance that is to stay above `required` (m): of shapes `first` and `second`, or of `first` from plane `plane`. `active`: m beyond
    which it does not weigh on the search; `margin`: m that the search keeps beyond what is required."""

    what: str
    first: int
    second: int
    plane: int
    required: float = 0.0
    active: float = _ACTIVE
    margin: float = 0.0


class Clearance:
    """What a robot keeps clear of, as constraints on its posture.

    `constraints`: those that hold; `touching`, `unchecked`: see `Safety`."""

    def __init__(self, robot: Robot, surroundings: Surroundings, limits: Limits) -> None:
        import pinocchio as pin

        self.robot, self.surroundings = robot, surroundings
        self.bodies = Bodies.of(robot, surroundings.link_radius)
        self._model, self._shapes = self.bodies.model, self.bodies.shapes
        self._data = self._model.createData()
        self._planes = surroundings.planes
        self._supports = [_support(shape.geometry) for shape in self._shapes.geometryObjects]
        self._joints = [int(shape.parentJoint) for shape in self._shapes.geometryObjects]
        for shape in self._shapes.geometryObjects:
            shape.geometry.computeLocalAABB()
        self._radius = np.array([shape.geometry.aabb_radius for shape in self._shapes.geometryObjects])
        self._centre = np.array([np.array(shape.geometry.aabb_center) for shape in self._shapes.geometryObjects])
        candidates = self._candidates()
        pairs = [c for c in candidates if c.plane < 0]
        self._shapes.removeAllCollisionPairs()
        for c in pairs:
            self._shapes.addCollisionPair(pin.CollisionPair(c.first, c.second))
        self._pair = {(c.first, c.second): k for k, c in enumerate(pairs)}
        self._geometry = self._shapes.createData()
        self.constraints = candidates
        self.touching: tuple[str, ...] = ()
        self.unchecked: tuple[str, ...] = ()
        rng = np.random.default_rng(0)
        self._settle(rng.uniform(limits.lower, limits.upper, (_POSTURES, robot.n)))
        #: Bound (n,) on the speed of any point per unit rate of each joint.
        self.speed = np.abs(robot.loop.W).T @ self.bodies.reach

    def _candidates(self) -> list[Constraint]:
        """Every pair of shapes on joints that are not neighbours, and every shape that moves beside every plane."""
        label, joints, parents = self.bodies.labels, self._joints, self._model.parents
        out = []
        for a in range(len(joints)):
            for b in range(a + 1, len(joints)):
                one, two = sorted((joints[a], joints[b]))
                if one != two and parents[two] != one:
                    out.append(Constraint(f"{label[a]} and {label[b]}", a, b, -1))
            if joints[a] > 0:
                out += [Constraint(f"{label[a]} and {name}", a, -1, k) for k, (name, _, _) in enumerate(self._planes)]
        return out

    def _settle(self, postures: Array) -> None:
        """What each constraint can require, by its distance on random postures: what never changes or always overlaps is no constraint."""
        distance, clear = self.distances(postures), self.surroundings.clearance
        kept: list[Constraint] = []
        touching, unchecked, sunk = list[str](), list[str](), list[str]()
        for c, own in zip(self.constraints, distance.T, strict=True):
            high = float(np.quantile(own, 0.95))
            if np.mean(own <= 0.0) > _ALWAYS:
                (sunk if c.plane >= 0 and np.ptp(own) > _FIXED else unchecked).append(c.what)
            elif np.ptp(own) > 1e-9:
                near = high < clear + 2.0 * _MARGIN
                required = min(_TOUCH, 0.25 * high) if near else clear
                room = max(high - required, 1e-4)
                touching += [c.what] if near else []
                kept.append(Constraint(c.what, c.first, c.second, c.plane, required, min(_ACTIVE, 0.5 * room), min(_MARGIN, 0.2 * room)))
            elif own[0] < clear:
                touching.append(c.what)
        self.notes = self.bodies.notes
        if sunk:
            kept = self._sunk(sunk, kept)
        self.constraints = kept
        self.touching, self.unchecked = (tuple(dict.fromkeys(x)) for x in (touching, unchecked))
        self.required = np.array([c.required for c in kept])
        self.active = np.array([c.active for c in kept])
        self.margin = np.array([c.margin for c in kept])

    def _sunk(self, what: list[str], kept: list[Constraint]) -> list[Constraint]:
        """The constraints without a ground that cannot be one. Raises ConfigurationError for a ground or wall that was asked for."""
        where = f"in nearly every posture overlap: {'; '.join(dict.fromkeys(what))}"
        if self.surroundings.ground != "base" or any(not name.endswith(GROUND) for name in what):
            raise ConfigurationError(f"excitation: {where}. Give another height of the ground (or none), or a wider workspace.")
        self.notes = (
            *self.notes,
            f"NOT checked: the ground. It is not at the height of the base frame: {where}. Give its height (--ground).",
        )
        return [c for c in kept if c.plane < 0 or self._planes[c.plane][0] != GROUND]

    # --- distances ----------------------------------------------------------------------------------------------------

    def distances(self, q: Array, within: float = np.inf) -> Array:
        """Distance (N, C) of each constraint at joint positions q (N, n), negative where shapes overlap; beyond `within` m possibly a
        lower bound."""
        return self._evaluate(self.robot.tree_position(np.asarray(q, float)), within, None)

    def slack(self, q: Array, within: float = 0.0) -> Array:
        """Distance less what is required (N, C); beyond `within` m a lower bound that is not below it."""
        return self.distances(q, within + self.surroundings.clearance) - self.required

    def barrier(self, q: Array, wants_gradient: bool = True) -> tuple[float, Array]:
        """A barrier that rises without bound as a distance falls to what is required and the margin, summed over constraints and averaged
        over the rows of q (N, n); inf beyond. And its gradient (N, n), zero where it is not wanted."""
        tree = self.robot.tree_position(np.asarray(q, float))
        floor = self.required + self.margin
        gradients: dict[tuple[int, int], Array] | None = {} if wants_gradient else None
        near = floor + self.active
        distance = self._evaluate(tree, float(near.max(initial=0.0)), gradients, near if wants_gradient else None)
        share = (distance - floor) / self.active
        if share.size == 0:
            return 0.0, np.zeros_like(q)
        if share.min() <= 0.0:
            return np.inf, np.zeros_like(q)
        inside = np.minimum(share, 1.0)
        value = float(np.sum((1.0 - inside) ** 2 * -np.log(inside))) / len(q)
        if gradients is None:
            return value, np.zeros_like(q)
        slope = (2.0 * (1.0 - inside) * np.log(inside) - (1.0 - inside) ** 2 / inside) / self.active / len(q)
        out = np.zeros_like(tree)
        for (i, c), gradient in gradients.items():
            out[i] += slope[i, c] * gradient
        return value, out @ self.robot.loop.W

    def _evaluate(self, tree: Array, within: float, gradients: dict[tuple[int, int], Array] | None, below: Array | None = None) -> Array:
        """Distances (N, C), exact up to `within`; gradients by tree joints of those below `below` (C,) go into `gradients`."""
        import pinocchio as pin

        count = len(self._shapes.geometryObjects)
        R, p = np.empty((len(tree), count, 3, 3)), np.empty((len(tree), count, 3))
        for i, q in enumerate(tree):
            pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._geometry, q)
            for g, placement in enumerate(self._geometry.oMg):
                R[i, g], p[i, g] = placement.rotation, placement.translation
        centre = p + np.einsum("ngij,gj->ngi", R, self._centre)
        out = np.empty((len(tree), len(self.constraints)))
        points: dict[int, Array] = {}
        near: dict[int, list[int]] = {}
        for c, own in enumerate(self.constraints):
            if own.plane >= 0:
                _, direction, limit = self._planes[own.plane]
                local = np.einsum("nij,i->nj", R[:, own.first], direction)
                height, support = self._supports[own.first](local)
                out[:, c] = limit - p[:, own.first] @ direction - height
                points[c] = p[:, own.first] + np.einsum("nij,nj->ni", R[:, own.first], support)
                continue
            apart = np.linalg.norm(centre[:, own.first] - centre[:, own.second], axis=1)
            out[:, c] = apart - self._radius[own.first] - self._radius[own.second]
            for row in np.flatnonzero(out[:, c] < within).tolist():
                near.setdefault(row, []).append(c)
        wanted = np.zeros_like(out, bool) if below is None else out < below
        for row in sorted(set(near) | set(np.flatnonzero(wanted.any(axis=1)).tolist())):
            self._at(tree[row], row, near.get(row, []), out, points, gradients, below)
        return out

    def _at(
        self,
        q: Array,
        i: int,
        pairs: list[int],
        out: Array,
        points: dict[int, Array],
        gradients: dict[tuple[int, int], Array] | None,
        below: Array | None,
    ) -> None:
        """Exact distances of some pairs at one posture, and the gradients that are wanted."""
        import pinocchio as pin

        pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._geometry, q)
        found: dict[int, Any] = {}
        for c in pairs:
            own = self.constraints[c]
            found[c] = pin.computeDistance(self._shapes, self._geometry, self._pair[own.first, own.second])
            out[i, c] = found[c].min_distance
        if gradients is None or below is None:
            return
        weighing = np.flatnonzero(out[i] < below).tolist()
        if not weighing:
            return
        pin.computeJointJacobians(self._model, self._data, q)
        for c in weighing:
            own = self.constraints[c]
            if own.plane >= 0:
                gradients[i, c] = -self._rate(own.first, points[c][i], self._planes[own.plane][1])
            elif c in found:
                one, two = (np.array(x) for x in (found[c].getNearestPoint1(), found[c].getNearestPoint2()))
                normal = (two - one) / max(float(np.linalg.norm(two - one)), 1e-12)
                gradients[i, c] = self._rate(own.second, two, normal) - self._rate(own.first, one, normal)

    def _rate(self, shape: int, point: Array, direction: Array) -> Array:
        """Speed (n_tree,) of a point of a shape along a direction, per unit rate of each joint."""
        import pinocchio as pin

        joint = self._joints[shape]
        if joint == 0:
            return np.zeros(self._model.nv)
        J = pin.getJointJacobian(self._model, self._data, joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        x, y, z = point - self._data.oMi[joint].translation
        u, v, w = direction
        return direction @ J[:3] + np.array([y * w - z * v, z * u - x * w, x * v - y * u]) @ J[3:]


def _support(geometry: Any) -> Callable[[Array], tuple[Array, Array]]:
    """For directions (N, 3) in a shape's frame, how far it reaches along them (N,), and the point (N, 3) that does."""
    import coal

    if isinstance(geometry, coal.ConvexBase):
        corners, round_by = np.array(geometry.points(), float).reshape(-1, 3), 0.0
    elif isinstance(geometry, coal.Sphere):
        corners, round_by = np.zeros((1, 3)), float(geometry.radius)
    elif isinstance(geometry, coal.Capsule):
        corners, round_by = np.array([[0, 0, 1.0], [0, 0, -1.0]]) * geometry.halfLength, float(geometry.radius)
    else:  # a box is its own; anything else lies within its own
        geometry.computeLocalAABB()
        low, high = np.array(geometry.aabb_local.min_), np.array(geometry.aabb_local.max_)
        corners, round_by = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, -1).T, 0.0

    def support(directions: Array) -> tuple[Array, Array]:
        along = directions @ corners.T
        best = along.argmax(axis=1)
        return along[np.arange(len(directions)), best] + round_by, corners[best] + round_by * directions

    return support
