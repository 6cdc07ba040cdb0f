"""Kinetic energy of a tree of bodies as a quadratic form: rows per inertial parameter, and its slope against joint position.

2T = v' M(q) v is linear in the inertial parameters (per body m |l|^2 + 2 h.(l x w) + w' I w, with l and w the velocity of the joint
frame's origin and the angular velocity, h the first moment). Arrays hold components first and samples last."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..robots.tree import RigidBodyTree

Array = np.ndarray


def _cross(a: Array, b: Array) -> Array:
    """a x b, components along the second axis from the end."""
    out = np.empty(np.broadcast(a, b).shape)
    a0, a1, a2 = a[..., 0, :], a[..., 1, :], a[..., 2, :]
    b0, b1, b2 = b[..., 0, :], b[..., 1, :], b[..., 2, :]
    out[..., 0, :] = a1 * b2 - a2 * b1
    out[..., 1, :] = a2 * b0 - a0 * b2
    out[..., 2, :] = a0 * b1 - a1 * b0
    return out


def skew(u: Array) -> Array:
    """The matrix [u]x with [u]x a = u x a."""
    return np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])


class Velocities:
    """Poses (R (nb, 3, 3, N), p (nb, 3, N)) and velocities (l, w (nb, 3, N)) of every body in its own frame, for q (N, nq) and dq
    (N, nv)."""

    def __init__(self, tree: RigidBodyTree, q: Array, dq: Array) -> None:
        self.tree, self.N = tree, len(q)
        nb, N, free = tree.nb, len(q), int(tree.floating)
        self.R, self.p, self.l, self.w = np.empty((nb, 3, 3, N)), np.empty((nb, 3, N)), np.empty((nb, 3, N)), np.empty((nb, 3, N))
        if free:
            # The free-flyer's own velocity is given in its own frame; its pose never enters the kinetic energy.
            self.R[0], self.p[0], self.l[0], self.w[0] = np.eye(3)[:, :, None], np.zeros((3, N)), dq[:, :3].T, dq[:, 3:6].T
        x, rate = q[:, 7 * free :].T[:, None], dq[:, 6 * free :].T[:, None]
        R0, p0, axis = tree.rotation[free:], tree.translation[free:], tree.axis[free:]
        along = R0 @ (axis[:, :, None] * axis[:, None])
        across = R0 @ np.array([skew(u) for u in axis]).reshape(-1, 3, 3)
        turning = ~tree.prismatic[free:]
        self.R[free:] = R0[..., None]
        self.R[free:][turning] = (
            along[turning, ..., None]
            + (R0 - along)[turning, ..., None] * np.cos(x[turning, None])
            + across[turning, ..., None] * np.sin(x[turning, None])
        )
        self.p[free:] = p0[..., None]
        self.p[free:][~turning] += (R0 @ axis[..., None])[~turning] * x[~turning]
        push = axis[..., None] * rate
        zero = np.zeros((3, N))
        for i in range(free, nb):
            up = int(tree.parent[i])
            lp, wp = (zero, zero) if up < 0 else (self.l[up], self.w[up])
            self.l[i] = _turned(self.R[i], lp + _cross(wp, self.p[i]))
            self.w[i] = _turned(self.R[i], wp)
            (self.l if tree.prismatic[i] else self.w)[i] += push[i - free]


def _turned(R: Array, vectors: Array) -> Array:
    """R' v of (3, 3, N) and (3, N)."""
    return R[0] * vectors[0] + R[1] * vectors[1] + R[2] * vectors[2]


def _turned_back(R: Array, vectors: Array) -> Array:
    """R v of (3, 3, N) and (3, N)."""
    return R[:, 0] * vectors[0] + R[:, 1] * vectors[1] + R[:, 2] * vectors[2]


def energy_rows(tree: RigidBodyTree, q: Array, dq: Array) -> Array:
    """2T per unit inertial parameter: (N, 10 nb), for q (N, nq) and dq (N, nv)."""
    state = Velocities(tree, q, dq)
    linear, w = state.l, state.w
    block = np.empty((tree.nb, 10, state.N))
    block[:, 0] = (linear * linear).sum(axis=1)
    block[:, 1:4] = 2.0 * _cross(linear, w)
    for row, (x, y) in zip(range(4, 10), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), strict=True):
        block[:, row] = (1.0 if x == y else 2.0) * w[:, x] * w[:, y]
    return np.ascontiguousarray(block.reshape(10 * tree.nb, state.N).T)


def energy_gradient(tree: RigidBodyTree, inertia: Array, q: Array, dq: Array) -> Array:
    """d(2T)/dq at fixed rates: (N, joints). Moving joint i carries its whole subtree: d(2T)/dq_i = -2 h_i . (S_i x V_i),

    with V_i the body's velocity, S_i the joint's axis and h_i the momentum of the subtree, all in body i's frame."""
    state = Velocities(tree, q, dq)
    own = inertia.reshape(tree.nb, 10)
    h = own[:, 1:4, None]
    matrix = own[:, [[4, 5, 7], [5, 6, 8], [7, 8, 9]]]
    force = own[:, :1, None] * state.l + _cross(state.w, h)
    moment = _cross(h, state.l) + np.matmul(matrix, state.w)
    first = int(tree.floating)
    for i in reversed(range(first, tree.nb)):
        if (up := int(tree.parent[i])) >= 0:
            carried = _turned_back(state.R[i], force[i])
            force[up] += carried
            moment[up] += _turned_back(state.R[i], moment[i]) + _cross(state.p[i], carried)
    u = tree.axis[first:, :, None]
    fixed = tree.prismatic[first:, None]
    by_force = (force[first:] * _cross(u, np.where(fixed[:, None], state.w[first:], state.l[first:]))).sum(axis=1)
    by_moment = np.where(fixed, 0.0, (moment[first:] * _cross(u, state.w[first:])).sum(axis=1))
    return np.asarray(-2.0 * (by_force + by_moment)).T
