"""The recursive Newton-Euler pass of one robot, written out with its own constants, so that its operations can be counted.

Every link's frame is turned so that its joint's axis is z, and its ten parameters are mass, first moments and second moments Σ = ∫ r rᵀ dm.
With U = [dω]× + [ω]×[ω]× a point r of the link accelerates by dv + U r; hence force m dv + U (m r), and moment (m r) × dv plus the
antisymmetric part of U Σ."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..errors import UnsupportedError
from ..robots.tree import RigidBodyTree
from .scalar_graph import Program, Scalar, ScalarGraph

Array = np.ndarray
Vector = list[Scalar]
#: Names of a link's ten parameters here.
MOMENTS = ("m", "mx", "my", "mz", "Sxx", "Syy", "Szz", "Sxy", "Sxz", "Syz")
#: Second moments (Sxx Syy Szz Sxy Sxz Syz) from inertia in Pinocchio's order (Ixx Ixy Iyy Ixz Iyz Izz).
_FROM_INERTIA = np.zeros((6, 6))
_FROM_INERTIA[0, [0, 2, 5]] = -0.5, 0.5, 0.5
_FROM_INERTIA[1, [0, 2, 5]] = 0.5, -0.5, 0.5
_FROM_INERTIA[2, [0, 2, 5]] = 0.5, 0.5, -0.5
_FROM_INERTIA[[3, 4, 5], [1, 3, 4]] = -1.0


@dataclass(frozen=True, eq=False)
class AlignedTree:
    """A tree all of whose joint axes are z: the `tree`, and what makes a link's parameters here, (nb, 10), of those in its own frame by
    `moments` (nb, 10, 10)."""

    tree: RigidBodyTree
    moments: Array


def aligned(tree: RigidBodyTree) -> AlignedTree:
    """Turn every link's frame so that its axis is z. Raises UnsupportedError for a floating base."""
    if tree.floating:
        raise UnsupportedError("a recursive pass is written out for robots on a fixed base.")
    turns = [_turn_to(axis) for axis in tree.axis]
    before = [np.eye(3) if parent < 0 else turns[parent] for parent in tree.parent]
    rotation = np.array([b.T @ R @ t for b, R, t in zip(before, tree.rotation, turns, strict=True)])
    translation = np.array([b.T @ p for b, p in zip(before, tree.translation, strict=True)])
    axis = np.tile([0.0, 0.0, 1.0], (tree.nb, 1))
    return AlignedTree(
        replace(tree, rotation=rotation, translation=translation, axis=axis), np.array([_moments_in(turn) for turn in turns])
    )


def _turn_to(axis: Array) -> Array:
    """A rotation whose third column is the axis; a permutation with signs where that is possible."""
    first = np.eye(3)[(int(np.argmax(np.abs(axis))) + 1) % 3]
    x = first - axis * (axis @ first)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)


def _moments_in(turn: Array) -> Array:
    """What makes the moments in a turned frame (its axes the columns of `turn`) of a link's parameters in Pinocchio's order."""
    out = np.zeros((10, 10))
    out[0, 0] = 1.0
    out[1:4, 1:4] = turn.T
    places = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    for column, (i, j) in enumerate(places):
        unit = np.zeros((3, 3))
        unit[i, j] = unit[j, i] = 1.0
        turned = turn.T @ unit @ turn
        out[4:, 4:] += np.outer([turned[a, b] for a, b in places], _FROM_INERTIA[column])
    return out


@dataclass(frozen=True, eq=False)
class RecursivePass:
    """Inverse dynamics as a program of its own for one robot and one set of link moments (nb, 10)."""

    tree: RigidBodyTree
    moments: Array
    program: Program

    @property
    def multiplications(self) -> int:
        """Products of one pass; sines and cosines are not counted."""
        return self.program.multiplications

    @property
    def additions(self) -> int:
        """Sums and differences of one pass."""
        return self.program.additions

    @property
    def operations(self) -> int:
        """Both together."""
        return self.multiplications + self.additions

    def torque(self, q: Array, dq: Array, ddq: Array) -> Array:
        """Torque (N, nb) of the open tree at positions, velocities and accelerations (N, nb) of its joints, N m (N)."""
        inputs: dict[str, Array] = {}
        for i in range(self.tree.nb):
            at = q[:, i]
            inputs |= {f"c{i}": np.cos(at), f"s{i}": np.sin(at), f"q{i}": at, f"dq{i}": dq[:, i], f"ddq{i}": ddq[:, i]}
        return np.stack(self.program.run(inputs), axis=1)


def write_pass(tree: RigidBodyTree, moments: Array) -> RecursivePass:
    """The pass for an aligned tree and its links' moments (nb, 10), of which those that are zero cost nothing."""
    graph, nb = ScalarGraph(), tree.nb
    spin: list[Vector] = []
    turning: list[list[Vector]] = []  # U
    lift: list[Vector] = []  # dv
    spin_rate: list[Vector] = []
    for i in range(nb):
        parent = int(tree.parent[i])
        still = [graph.of(0.0)] * 3
        w, dw = (spin[parent], spin_rate[parent]) if parent >= 0 else (still, still)
        dv = lift[parent] if parent >= 0 else [graph.of(-g) for g in tree.gravity]
        if parent >= 0:
            dv = _plus(dv, _times(turning[parent], _arm(graph, tree, i)))
        w, dw, dv = (_into(graph, tree, i, v) for v in (w, dw, dv))
        rate, gain = graph.input(f"dq{i}"), graph.input(f"ddq{i}")
        if tree.prismatic[i]:
            double = 2.0 * rate
            dv = [dv[0] + w[1] * double, dv[1] - w[0] * double, dv[2] + gain]
        else:
            dw = [dw[0] + w[1] * rate, dw[1] - w[0] * rate, dw[2] + gain]
            w = [w[0], w[1], w[2] + rate]
        spin.append(w)
        spin_rate.append(dw)
        lift.append(dv)
        turning.append(_turning(w, dw))
    force: list[Vector] = []
    moment: list[Vector] = []
    for i in range(nb):
        f, n = _wrench(graph, moments[i], turning[i], lift[i])
        force.append(f)
        moment.append(n)
    for i in range(nb - 1, -1, -1):
        parent = int(tree.parent[i])
        if parent >= 0:
            f, n = (_out_of(graph, tree, i, v) for v in (force[i], moment[i]))
            force[parent] = _plus(force[parent], f)
            moment[parent] = _plus(_plus(moment[parent], n), _cross(_arm(graph, tree, i), f))
    outputs = [force[i][2] if tree.prismatic[i] else moment[i][2] for i in range(nb)]
    return RecursivePass(tree, moments, Program.of(graph, outputs))


def _wrench(graph: ScalarGraph, p: Array, U: list[Vector], dv: Vector) -> tuple[Vector, Vector]:
    """Force and moment about its frame's origin that a link's motion asks for."""
    mass, first = graph.of(p[0]), [graph.of(x) for x in p[1:4]]
    xx, yy, zz, xy, xz, yz = (graph.of(x) for x in p[4:])
    f = _plus([mass * a for a in dv], _times(U, first))
    # The antisymmetric part of U S, its diagonal terms taken together: their differences are those of squares of the angular velocity.
    own = [
        (U[2][2] - U[1][1]) * yz + U[2][1] * yy - U[1][2] * zz + U[2][0] * xy - U[1][0] * xz,
        (U[0][0] - U[2][2]) * xz + U[0][2] * zz - U[2][0] * xx + U[0][1] * yz - U[2][1] * xy,
        (U[1][1] - U[0][0]) * xy + U[1][0] * xx - U[0][1] * yy + U[1][2] * xz - U[0][2] * yz,
    ]
    return f, _plus(own, _cross(first, dv))


def _turning(w: Vector, dw: Vector) -> list[Vector]:
    """U = [dω]× + [ω]×[ω]×."""
    xx, yy, zz = (a * a for a in w)
    xy, xz, yz = w[0] * w[1], w[0] * w[2], w[1] * w[2]
    return [
        [-(yy + zz), xy - dw[2], xz + dw[1]],
        [xy + dw[2], -(xx + zz), yz - dw[0]],
        [xz - dw[1], yz + dw[0], -(xx + yy)],
    ]


def _arm(graph: ScalarGraph, tree: RigidBodyTree, i: int) -> Vector:
    """From the origin of the link before to that of link i, in the frame before."""
    fixed = [graph.of(x) for x in tree.translation[i]]
    if not tree.prismatic[i]:
        return fixed
    return [a + float(z) * graph.input(f"q{i}") for a, z in zip(fixed, tree.rotation[i][:, 2], strict=True)]


def _into(graph: ScalarGraph, tree: RigidBodyTree, i: int, v: Vector) -> Vector:
    """A vector of the frame before in that of link i."""
    v = [_dot([graph.of(x) for x in column], v) for column in tree.rotation[i].T]
    if tree.prismatic[i]:
        return v
    c, s = graph.input(f"c{i}"), graph.input(f"s{i}")
    return [c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]]


def _out_of(graph: ScalarGraph, tree: RigidBodyTree, i: int, v: Vector) -> Vector:
    """A vector of the frame of link i in the one before."""
    if not tree.prismatic[i]:
        c, s = graph.input(f"c{i}"), graph.input(f"s{i}")
        v = [c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]]
    return [_dot([graph.of(x) for x in row], v) for row in tree.rotation[i]]


def _dot(a: Sequence[Scalar], b: Sequence[Scalar]) -> Scalar:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _times(M: Sequence[Vector], v: Vector) -> Vector:
    return [_dot(row, v) for row in M]


def _plus(a: Vector, b: Vector) -> Vector:
    return [x + y for x, y in zip(a, b, strict=True)]


def _cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
