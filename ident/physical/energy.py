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
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def skew(u: Array) -> Array:
    """The matrix [u]x with [u]x a = u x a."""
    return np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])


class Velocities:
    """Poses (R (3, 3, N), p (3, N)) and velocities (l, w (3, N)) of every body in its own frame, for q (N, nq) and dq (N, nv)."""

    def __init__(self, tree: RigidBodyTree, q: Array, dq: Array) -> None:
        self.tree, self.N = tree, len(q)
        self.R: list[Array] = []
        self.p: list[Array] = []
        self.l: list[Array] = []
        self.w: list[Array] = []
        zero = np.zeros((3, self.N))
        for i in range(tree.nb):
            R0, p0, u = tree.rotation[i], tree.translation[i], tree.axis[i]
            up = int(tree.parent[i])
            if tree.floating and i == 0:
                # The free-flyer's own velocity is given in its own frame; its pose never enters the kinetic energy.
                self.R.append(np.repeat(np.eye(3)[:, :, None], self.N, 2))
                self.p.append(zero)
                self.l.append(dq[:, :3].T)
                self.w.append(dq[:, 3:6].T)
                continue
            x, rate = q[:, i + 6 * tree.floating], dq[:, i + 5 * tree.floating]
            if tree.prismatic[i]:
                R = np.repeat(R0[:, :, None], self.N, 2)
                p = p0[:, None] + (R0 @ u)[:, None] * x
            else:
                along = R0 @ np.outer(u, u)
                R = along[:, :, None] + (R0 - along)[:, :, None] * np.cos(x) + (R0 @ skew(u))[:, :, None] * np.sin(x)
                p = np.repeat(p0[:, None], self.N, 1)
            lp, wp = (zero, zero) if up < 0 else (self.l[up], self.w[up])
            linear = (R * (lp + _cross(wp, p))[:, None]).sum(0)
            angular = (R * wp[:, None]).sum(0)
            push = u[:, None] * rate
            self.R.append(R)
            self.p.append(p)
            self.l.append(linear + push if tree.prismatic[i] else linear)
            self.w.append(angular if tree.prismatic[i] else angular + push)


def energy_rows(tree: RigidBodyTree, q: Array, dq: Array) -> Array:
    """2T per unit inertial parameter: (N, 10 nb), for q (N, nq) and dq (N, nv)."""
    state = Velocities(tree, q, dq)
    out = np.empty((state.N, 10 * tree.nb))
    for i, (linear, w) in enumerate(zip(state.l, state.w, strict=True)):
        block = out[:, 10 * i : 10 * i + 10].T
        block[0] = (linear * linear).sum(0)
        block[1:4] = 2.0 * _cross(linear, w)
        for row, (x, y) in zip(range(4, 10), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), strict=True):
            block[row] = (1.0 if x == y else 2.0) * w[x] * w[y]
    return out


def energy_gradient(tree: RigidBodyTree, inertia: Array, q: Array, dq: Array) -> Array:
    """d(2T)/dq at fixed rates: (N, joints). Moving joint i carries its whole subtree: d(2T)/dq_i = -2 h_i . (S_i x V_i),

    with V_i the body's velocity, S_i the joint's axis and h_i the momentum of the subtree, all in body i's frame."""
    state = Velocities(tree, q, dq)
    force, moment = [], []
    for i, (linear, w) in enumerate(zip(state.l, state.w, strict=True)):
        m, h = inertia[10 * i], inertia[10 * i + 1 : 10 * i + 4, None]
        xx, xy, yy, xz, yz, zz = inertia[10 * i + 4 : 10 * i + 10]
        matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        force.append(m * linear + _cross(w, h))
        moment.append(_cross(h, linear) + matrix @ w)
    first = int(tree.floating)
    out = np.zeros((state.N, tree.nb - first))
    for i in reversed(range(first, tree.nb)):
        u = tree.axis[i][:, None]
        turn = (force[i] * _cross(u, state.w[i])).sum(0) if tree.prismatic[i] else (
            (force[i] * _cross(u, state.l[i])).sum(0) + (moment[i] * _cross(u, state.w[i])).sum(0)
        )  # fmt: skip
        out[:, i - first] = -2.0 * turn
        if (up := int(tree.parent[i])) >= 0:
            carried = (state.R[i] * force[i][None]).sum(1)
            force[up] = force[up] + carried
            moment[up] = moment[up] + (state.R[i] * moment[i][None]).sum(1) + _cross(state.p[i], carried)
    return out
