"""A tree cut into blocks of joints that share no coordinate: how motion and energy pass through each block, exactly.

A block is one joint, or, under a linear loop closure, the smallest connected part of the tree that holds all joints moved by
the same independent coordinates. Poses in a block are finite sums of trigonometric polynomials (revolute joints) and powers
(prismatic joints) of its coordinates, so their coefficients follow from as many well-placed nodes; that the nodes determine
them is checked, not assumed. Lengths are divided by the robot's typical length.

Kinetic energy is half the inner product of a body's pseudo-inertia J (4 x 4) and sym(Vᵀ V), with V the 4 x 4 twist matrix;
under a pose G the latter becomes Gᵀ sym(Vᵀ V) G. Its ten coordinates dual to a link's inertial parameters are called an
energy vector here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...robots.tree import RigidBodyTree
from .position_nodes import PRISMATIC, REVOLUTE, Nodes, node_sets

if TYPE_CHECKING:
    from ...robots.robot import Robot

Array = np.ndarray

#: Coefficients with more rounding than this are not used: ranks could not be read off them.
_MOST_NOISE = 1e-12


def _pseudo_inertia_basis() -> tuple[Array, Array]:
    """J_k (10, 4, 4): pseudo-inertia per unit of each inertial parameter; D_k (10, 4, 4) dual to them."""
    J = np.zeros((10, 4, 4))
    J[0, 3, 3] = 1.0
    for axis in range(3):
        J[1 + axis, axis, 3] = J[1 + axis, 3, axis] = 1.0
    # Second moments: S = trace(I)/2 E - I.
    for k, (a, b) in enumerate([(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)], start=4):
        if a == b:
            J[k, :3, :3] = 0.5 * np.eye(3)
            J[k, a, a] -= 1.0
        else:
            J[k, a, b] = J[k, b, a] = -1.0
    gram = np.einsum("kij,lij->kl", J, J)
    return J, np.einsum("kl,lij->kij", np.linalg.inv(gram), J)


PSEUDO_INERTIA, ENERGY_BASIS = _pseudo_inertia_basis()
_FLAT_INERTIA = PSEUDO_INERTIA.reshape(10, 16)


def energy_vector(V: Array, W: Array) -> Array:
    """Energy vectors (..., 10) of pairs of twist or pose-rate matrices (..., 4, 4): coefficient of each inertial parameter in VᵀJW."""
    Y = np.swapaxes(V, -1, -2) @ W
    vectors: Array = Y.reshape(*Y.shape[:-2], 16) @ _FLAT_INERTIA.T  # J is symmetric: the antisymmetric part of Y drops out
    return vectors


def twist_matrix(twist: Array) -> Array:
    """4 x 4 matrices (..., 4, 4) of twists (..., 6), linear part first."""
    M = np.zeros((*twist.shape[:-1], 4, 4))
    M[..., 0, 3], M[..., 1, 3], M[..., 2, 3] = twist[..., 0], twist[..., 1], twist[..., 2]
    x, y, z = twist[..., 3], twist[..., 4], twist[..., 5]
    M[..., 0, 1], M[..., 0, 2], M[..., 1, 2] = -z, y, -x
    M[..., 1, 0], M[..., 2, 0], M[..., 2, 1] = z, -y, x
    return M


def twist_vector(M: Array) -> Array:
    """Twists (..., 6) of 4 x 4 matrices (..., 4, 4)."""
    return np.stack([M[..., 0, 3], M[..., 1, 3], M[..., 2, 3], M[..., 2, 1], M[..., 0, 2], M[..., 1, 0]], axis=-1)


_UNIT_TWISTS = twist_matrix(np.eye(6))


@dataclass(frozen=True, eq=False)
class JointBlock:
    """Bodies moved by one set of coordinates, and what passes through them.

    `bodies`: in order; `entrance`: the body before, -1 for the fixed base; `coordinates`: independent coordinates of the block
    (d of them). F functions, the first of which is the constant one (unless not `exact`: then a common reference value):
    `transport` (F, 10, 10 r): energy vector at the entrance → energy vectors of the r bodies (row vectors);
    `cross` (F, 6, d, 10 r): entrance twist with coordinate rate; `own` (F, d, d, 10 r): rates among themselves;
    `carry` (F, r, 6, 6): entrance twist → twists of the bodies (row vectors); `rate` (F, r, d, 6): twist per coordinate rate.
    `scale` (d,): coordinate units in use. `exact`: coefficients were resolved, not probed. `noise`: bound on their rounding."""

    bodies: tuple[int, ...]
    entrance: int
    coordinates: tuple[int, ...]
    transport: Array
    cross: Array
    own: Array
    carry: Array
    rate: Array
    scale: Array
    exact: bool
    noise: float


def typical_length(tree: RigidBodyTree) -> float:
    """Mean distance between joints in m, those on the base left out (where the base stands does not matter); 1 if all are zero."""
    lengths = np.linalg.norm(tree.translation[tree.parent >= 0], axis=1)
    lengths = lengths[lengths > 1e-9]  # below a nanometre it is rounding of a zero
    return float(lengths.mean()) if len(lengths) else 1.0


def joint_blocks(robot: Robot, length: float) -> list[JointBlock]:
    """The blocks of a robot's tree, each after the one that holds its entrance; a free-flyer's body is in none."""
    tree, first = robot.tree, int(robot.floating_base)
    W, offset = robot.loop.W, robot.loop.offset
    plans = []
    for bodies, entrance in _partition(tree, W, first):
        rows = [b - first for b in bodies]
        coordinates = tuple(int(a) for a in np.flatnonzero(np.abs(W[rows]).sum(axis=0) > 0))
        plans.append(_Plan.make(tree, bodies, entrance, coordinates, W[np.ix_(rows, coordinates)], offset[rows], length))
    blocks: dict[int, JointBlock] = {}
    for prismatic, nodes in ((False, REVOLUTE), (True, PRISMATIC)):
        alike = [i for i, p in enumerate(plans) if len(p.bodies) == len(p.coordinates) == 1 and tree.prismatic[p.bodies[0]] == prismatic]
        blocks |= zip(alike, _blocks(tree, [plans[i] for i in alike], nodes), strict=True)
    for i, plan in enumerate(plans):
        if i not in blocks:
            for nodes in node_sets(tree, plan.bodies, plan.rates):
                (blocks[i],) = _blocks(tree, [plan], nodes)
                if blocks[i].noise < _MOST_NOISE:
                    break
    return [blocks[i] for i in range(len(plans))]


def _partition(tree: RigidBodyTree, W: Array, first: int) -> list[tuple[tuple[int, ...], int]]:
    """(bodies, entrance) of each block, in order of the first body."""
    parent = tree.parent
    group = {b: {b} for b in range(first, tree.nb)}

    def merge(bodies: set[int]) -> None:
        joined = set().union(*(group[b] for b in bodies))
        for b in joined:
            group[b] = joined

    for column in W.T:
        merge({int(j) + first for j in np.flatnonzero(column)})
    for row_body, row in enumerate(W):
        if not row.any():
            group[row_body + first] = {row_body + first}
    changed = True
    while changed:
        changed = False
        for members in {id(g): g for g in group.values()}.values():
            region = _connected(parent, members)
            if region != members:
                merge(region)
                changed = True
                break
    distinct = {id(g): g for g in group.values()}.values()
    cut = [(tuple(sorted(g)), _entrance(parent, g)) for g in distinct]
    return sorted(cut, key=lambda item: item[0][0])


def _entrance(parent: Array, members: set[int]) -> int:
    """The last body that comes before every member (-1: the base)."""

    def before(body: int) -> list[int]:
        line = []
        while body >= 0:
            body = int(parent[body])
            line.append(body)
        return line

    lines = [before(b) for b in sorted(members)]
    common = set(lines[0]).intersection(*lines[1:])
    return next(b for b in lines[0] if b in common)


def _connected(parent: Array, members: set[int]) -> set[int]:
    """The members and all bodies between them and their entrance."""
    entrance, region = _entrance(parent, members), set(members)
    for body in members:
        while body != entrance:
            region.add(body)
            body = int(parent[body])
    return region


@dataclass(frozen=True, eq=False)
class _Plan:
    """A block before its functions are resolved. `rates` (r, d): joint positions (lengths in units of `length`) per unit of the
    coordinates, which are scaled by `scale` so that the largest is one; `start` (r,): joint positions at zero."""

    bodies: tuple[int, ...]
    entrance: int
    coordinates: tuple[int, ...]
    rates: Array
    start: Array
    scale: Array
    length: float

    @classmethod
    def make(
        cls,
        tree: RigidBodyTree,
        bodies: tuple[int, ...],
        entrance: int,
        coordinates: tuple[int, ...],
        W: Array,
        offset: Array,
        length: float,
    ) -> _Plan:
        unit = np.where(tree.prismatic[list(bodies)], 1.0 / length, 1.0)
        rates = W * unit[:, None]
        scale = 1.0 / np.abs(rates).max(axis=0, initial=0.0)
        return cls(bodies, entrance, coordinates, rates * scale, offset * unit, scale, length)


def _blocks(tree: RigidBodyTree, plans: list[_Plan], nodes: Nodes) -> list[JointBlock]:
    """Blocks of the same shape (r bodies, d coordinates), from the same nodes."""
    if not plans:
        return []
    at, to_coefficients, exact = nodes
    poses = [_poses(tree, plan, at) for plan in plans]
    G, dG = np.stack([p[0] for p in poses]), np.stack([p[1] for p in poses])  # (B, M, r, 4, 4), (B, M, r, d, 4, 4)
    M, r = G.shape[1:3]
    inverse = np.zeros_like(G)
    turned = np.swapaxes(G[..., :3, :3], -1, -2)
    inverse[..., :3, :3] = turned
    inverse[..., :3, 3] = -(turned @ G[..., :3, 3, None])[..., 0]
    inverse[..., 3, 3] = 1.0
    Y = np.swapaxes(G, -1, -2)[..., None, :, :] @ ENERGY_BASIS @ G[..., None, :, :]  # (B, M, r, 10, 4, 4)
    carried = _UNIT_TWISTS @ G[..., None, :, :]  # (B, M, r, 6, 4, 4)
    values = (
        Y.reshape(*Y.shape[:-2], 16) @ _FLAT_INERTIA.T,
        energy_vector(carried[..., :, None, :, :], dG[..., None, :, :, :]),  # (B, M, r, 6, d, 10)
        energy_vector(dG[..., :, None, :, :], dG[..., None, :, :, :]),  # (B, M, r, d, d, 10)
        twist_vector(inverse[..., None, :, :] @ carried),
        twist_vector(inverse[..., None, :, :] @ dG),
    )
    amplification = np.finfo(float).eps * float(np.linalg.norm(to_coefficients, 2)) * np.sqrt(M)
    resolved = []
    for k, value in enumerate(values):
        flat = to_coefficients @ value.reshape(len(plans), M, -1)
        coefficients = flat.reshape(len(plans), len(to_coefficients), *value.shape[2:])
        if k < 3:  # (B, F, r, ..., 10) -> (B, F, ..., 10 r)
            coefficients = np.moveaxis(coefficients, 2, -2)
            coefficients = coefficients.reshape(*coefficients.shape[:-2], 10 * r)
        resolved.append(coefficients)
    largest = [max((float(np.abs(v[b]).max()) for v in values if v.size), default=0.0) for b in range(len(plans))]
    transport, cross, own, carry, rate = resolved
    return [
        JointBlock(
            plan.bodies,
            plan.entrance,
            plan.coordinates,
            transport[b],
            cross[b],
            own[b],
            carry[b],
            rate[b],
            plan.scale,
            exact,
            amplification * largest[b],
        )
        for b, plan in enumerate(plans)
    ]


def _poses(tree: RigidBodyTree, plan: _Plan, nodes: Array) -> tuple[Array, Array]:
    """Poses (M, r, 4, 4) from the entrance, and their derivatives by the coordinates (M, r, d, 4, 4)."""
    theta = plan.start + nodes @ plan.rates.T
    M, r = theta.shape
    G, dG = np.zeros((M, r, 4, 4)), np.zeros((M, r, plan.rates.shape[1], 4, 4))
    place = {body: i for i, body in enumerate(plan.bodies)}
    for i, body in enumerate(plan.bodies):
        fixed = np.eye(4)
        fixed[:3, :3], fixed[:3, 3] = tree.rotation[body], tree.translation[body] / plan.length
        u = tree.axis[body]
        moving, turning = np.zeros((M, 4, 4)), np.zeros((M, 4, 4))
        moving[:, 3, 3] = 1.0
        if tree.prismatic[body]:
            moving[:, :3, :3] = np.eye(3)
            moving[:, :3, 3] = theta[:, i, None] * u
            turning[:, :3, 3] = u
        else:
            across = np.eye(3) - u[:, None] * u
            skew = np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])
            c, s = np.cos(theta[:, i])[:, None, None], np.sin(theta[:, i])[:, None, None]
            moving[:, :3, :3] = np.eye(3) - across + c * across + s * skew
            turning[:, :3, :3] = c * skew - s * across
        local, change = fixed @ moving, fixed @ turning
        rate = plan.rates[i][:, None, None]
        before = place.get(int(tree.parent[body]))
        if before is None:
            G[:, i], dG[:, i] = local, change[:, None] * rate
        else:
            G[:, i] = G[:, before] @ local
            dG[:, i] = dG[:, before] @ local[:, None] + (G[:, before] @ change)[:, None] * rate
    return G, dG
