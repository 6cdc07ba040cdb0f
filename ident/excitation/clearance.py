"""Distances along a motion: of the robot's links from each other, from the ground and from walls, with their gradients."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import ConfigurationError
from ..robots.bodies import Bodies
from .obstacles import convex_parts
from .placements import Placed, ShapePlacements
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
        self._labels = list(self.bodies.labels)
        for file in surroundings.obstacles:
            for k, part in enumerate(convex_parts(file, surroundings.mesh_scale)):
                self._shapes.addGeometryObject(pin.GeometryObject(f"obstacle {file} {k}", 0, pin.SE3.Identity(), part))
                self._labels.append(f"obstacle {Path(file).name}")
        self._data = self._model.createData()
        self._planes = surroundings.planes
        self._placements = ShapePlacements(self.bodies)
        self._joints = [int(shape.parentJoint) for shape in self._shapes.geometryObjects]
        candidates = self._candidates()
        pairs = [c for c in candidates if c.plane < 0]
        self._shapes.removeAllCollisionPairs()
        for c in pairs:
            self._shapes.addCollisionPair(pin.CollisionPair(c.first, c.second))
        self._pair = {(c.first, c.second): k for k, c in enumerate(pairs)}
        self._geometry = self._shapes.createData()
        self._arrange(candidates)
        self.touching: tuple[str, ...] = ()
        self.unchecked: tuple[str, ...] = ()
        rng = np.random.default_rng(0)
        self._settle(rng.uniform(limits.lower, limits.upper, (_POSTURES, robot.n)))
        #: Bound (n, C) on the change of each distance per unit of each joint.
        self.rates = np.abs(robot.loop.W).T @ self._rates

    def _candidates(self) -> list[Constraint]:
        """Every pair of shapes on joints that are not neighbours, and every shape that moves beside every obstacle and plane."""
        label, joints, parents, own = self._labels, self._joints, self._model.parents, len(self.bodies.labels)
        out = []
        for a in range(len(joints)):
            for b in range(a + 1, len(joints)):
                one, two = sorted((joints[a], joints[b]))
                if one != two and (parents[two] != one or b >= own):
                    out.append(Constraint(f"{label[a]} and {label[b]}", a, b, -1))
            if joints[a] > 0:
                out += [Constraint(f"{label[a]} and {name}", a, -1, k) for k, (name, _, _) in enumerate(self._planes)]
        return out

    def _arrange(self, constraints: list[Constraint]) -> None:
        """The constraints, and as arrays what is needed of them for many samples at once."""
        self.constraints = constraints
        self._columns = tuple(np.array([getattr(c, key) for c in constraints], int) for key in ("plane", "first", "second"))
        self._pair_numbers = [self._pair.get((c.first, c.second), -1) for c in constraints]
        own, span = self._placements.moves, self._placements.span
        # A pair feels only joints that move one shape and not the other; a plane all that move the shape.
        rates = np.zeros((len(constraints), self._placements.tree.nb))
        for k, c in enumerate(constraints):
            rates[k] = span[c.first] if c.plane >= 0 else np.where(own[c.first] != own[c.second], span[c.first] + span[c.second], 0.0)
        self._rates = rates.T

    def _settle(self, postures: Array) -> None:
        """What each constraint can require, by its distance on random postures: what never changes or always overlaps is no constraint."""
        distance, clear = self.distances(postures), self.surroundings.clearance
        kept: list[Constraint] = []
        touching, unchecked, sunk = list[str](), list[str](), list[str]()
        for c, own in zip(self.constraints, distance.T, strict=True):
            high = float(np.quantile(own, 0.95))
            if c.second >= len(self.bodies.labels):
                kept.append(self._obstructed(c, own))
            elif np.mean(own <= 0.0) > _ALWAYS:
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
        self._arrange(kept)
        self.touching, self.unchecked = (tuple(dict.fromkeys(x)) for x in (touching, unchecked))
        self.required = np.array([c.required for c in kept])
        self.active = np.array([c.active for c in kept])
        self.margin = np.array([c.margin for c in kept])

    def _obstructed(self, c: Constraint, distance: Array) -> Constraint:
        """The constraint of an obstacle, from its distances (K,) in random postures. Raises ConfigurationError where it is never kept."""
        high, clear = float(distance.max()), self.surroundings.clearance
        if high <= clear:
            raise ConfigurationError(
                f"excitation: in every posture {c.what} are nearer than {1000 * clear:g} mm. An obstacle is taken as the convex hull of"
                " each of its connected parts: give a hollow one in pieces, a room as --workspace-mesh; check its place and scale, too."
            )
        room = max(high - clear, 1e-4)
        return Constraint(c.what, c.first, c.second, c.plane, clear, min(_ACTIVE, 0.5 * room), min(_MARGIN, 0.2 * room))

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
        return self._look(q, np.full(len(self.constraints), within)).distance

    def slack(self, q: Array, within: float = 0.0) -> Array:
        """Distance less what is required (N, C); beyond `within` m a lower bound that is not below it."""
        return self.distances(q, within + self.surroundings.clearance) - self.required

    def barrier(self, q: Array, wants_gradient: bool = True, memory: NearMemory | None = None) -> tuple[float, Array]:
        """A barrier that rises without bound as a distance falls to what is required and the margin, summed over constraints and averaged
        over the rows of q (N, n); inf beyond. And its gradient (N, n), zero where it is not wanted.

        `memory`: of the same rows at earlier positions, which saves distances that cannot have become small."""
        floor = self.required + self.margin
        if len(floor) == 0 or len(q) == 0:
            return 0.0, np.zeros_like(q)
        seen = self._look(q, floor + self.active, floor, memory)
        share = (seen.distance - floor) / self.active
        if share.min() <= 0.0:
            return np.inf, np.zeros_like(q)
        inside = np.minimum(share, 1.0)
        value = float(np.sum((1.0 - inside) ** 2 * -np.log(inside))) / len(q)
        out = np.zeros((len(q), self._placements.tree.nb))
        if wants_gradient and len(seen.row):
            row, c = seen.row, seen.constraint
            own = inside[row, c]
            slope = (2.0 * (1.0 - own) * np.log(own) - (1.0 - own) ** 2 / own) / self.active[c] / len(q)
            np.add.at(out, row, slope[:, None] * self._gradients(seen))
        return value, out @ self.robot.loop.W

    def _gradients(self, seen: _Looked) -> Array:
        """Gradients (A, J) by the tree joints of the distances that were looked at closely."""
        plane, first, second = self._columns
        c = seen.constraint
        out = -self._placements.rate(seen.placed, seen.row, first[c], seen.one, seen.normal)
        pair = plane[c] < 0
        other = self._placements.rate(seen.placed, seen.row[pair], second[c[pair]], seen.two[pair], seen.normal[pair])
        out[pair] += other
        return out

    def _look(self, q: Array, near: Array, floor: Array | None = None, memory: NearMemory | None = None) -> _Looked:
        """Distances at q (N, n), exact where they are below `near` (C,), else possibly lower bounds; with `floor` (C,) only until one
        is not above it."""
        tree = self.robot.tree_position(np.asarray(q, float))
        placed = self._placements.at(tree)
        bound = np.full((len(tree), len(near)), -np.inf) if memory is None else memory.bound(tree, self._rates)
        plane, first, second = self._columns
        row, c = np.nonzero(bound < near)
        pair = plane[c] < 0
        gap = self._placements.capsule_gap(placed, row[pair], first[c[pair]], second[c[pair]])
        at = row[pair], c[pair]
        bound[at] = np.maximum(bound[at], gap)
        found = [self._planar(placed, row[~pair], c[~pair], bound)]
        close = gap < near[at[1]]
        found += self._pairs(tree, at[0][close], at[1][close], bound, floor)
        if memory is not None:
            memory.keep(tree, bound)
        row, c, one, two, normal = (np.concatenate(x) for x in zip(*found, strict=True))
        wanted = bound[row, c] < near[c]
        return _Looked(bound, placed, row[wanted], c[wanted], one[wanted], two[wanted], normal[wanted])

    def _planar(self, placed: Placed, row: Array, c: Array, bound: Array) -> tuple[Array, ...]:
        """Exact distances from planes, into `bound`; what was found, as `_Looked` has it."""
        plane, first, _ = self._columns
        points, normals = np.empty((len(row), 3)), np.empty((len(row), 3))
        for k in np.unique(c).tolist():
            own = c == k
            _, direction, limit = self._planes[plane[k]]
            R, p = placed.R[row[own], first[k]], placed.p[row[own], first[k]]
            height, support = self._placements.supports[first[k]](np.einsum("nij,i->nj", R, direction))
            bound[row[own], k] = limit - p @ direction - height
            points[own] = p + np.einsum("nij,nj->ni", R, support)
            normals[own] = direction
        return row, c, points, points, normals

    def _pairs(self, tree: Array, row: Array, c: Array, bound: Array, floor: Array | None) -> list[tuple[Array, ...]]:
        """Exact distances of pairs of shapes, into `bound`, the nearest by their bounds first; what was found, as `_Looked` has it."""
        import pinocchio as pin

        wanted: dict[int, list[int]] = {}
        for i, k in zip(row.tolist(), c.tolist(), strict=True):
            wanted.setdefault(i, []).append(k)
        lowest = np.full(len(tree), np.inf)
        np.minimum.at(lowest, row, bound[row, c])
        floors = None if floor is None else floor.tolist()
        number = self._pair_numbers
        rows, pairs, ones, twos, values = list[int](), list[int](), list[Any](), list[Any](), list[float]()
        for i in sorted(wanted, key=lowest.__getitem__):
            pin.updateGeometryPlacements(self._model, self._data, self._shapes, self._geometry, tree[i])
            for k in wanted[i]:
                found = pin.computeDistance(self._shapes, self._geometry, number[k])
                value = found.min_distance
                rows.append(i)
                pairs.append(k)
                values.append(value)
                ones.append(found.getNearestPoint1())
                twos.append(found.getNearestPoint2())
            if floors is not None and any(values[-1 - x] <= floors[pairs[-1 - x]] for x in range(len(wanted[i]))):
                break
        if not rows:
            return []
        at = np.array(rows), np.array(pairs)
        bound[at] = values
        one, two = np.array(ones), np.array(twos)
        way = two - one
        return [(*at, one, two, way / np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None])]


@dataclass(frozen=True, eq=False)
class _Looked:
    """Distances (N, C), and those A that were looked at closely: sample `row`, `constraint`, the nearest points `one` and `two` (A, 3), and
    `normal` (A, 3) from the first to the second, or out of the plane."""

    distance: Array
    placed: Placed
    row: Array
    constraint: Array
    one: Array
    two: Array
    normal: Array


class NearMemory:
    """Lower bounds on distances at a few earlier positions of the same rows: no distance changes faster than its shapes can move."""

    def __init__(self) -> None:
        self._kept: list[tuple[Array, Array]] = []

    def bound(self, tree: Array, rates: Array) -> Array:
        """Lower bounds (N, C) at positions `tree` (N, J); `rates` (J, C) bound the change of each distance per unit of each joint."""
        out = np.full((len(tree), rates.shape[1]), -np.inf)
        for before, bound in self._kept:
            if before.shape == tree.shape:
                np.maximum(out, bound - np.abs(tree - before) @ rates, out=out)
        return out

    def keep(self, tree: Array, bound: Array) -> None:
        """Remember bounds (N, C) at positions (N, J)."""
        self._kept = [*self._kept[-2:], (tree, bound)]
