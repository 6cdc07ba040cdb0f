"""Kinetic energy of a tree of bodies as a quadratic form: rows per inertial parameter, and its slope against joint position.

2T = v' M(q) v is linear in the inertial parameters (per body m |l|^2 + 2 h.(l x w) + w' I w, with l and w the velocity of the joint
frame's origin and the angular velocity, h the first moment). A velocity is (l, w) as one vector, and so is a momentum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from ..robots.tree import RigidBodyTree

Array = np.ndarray


def skew(u: Array) -> Array:
    """The matrices (…, 3, 3) [u]x with [u]x a = u x a, for u (…, 3)."""
    out = np.zeros((*u.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i, j], out[..., j, i] = -u[..., k], u[..., k]
    return out


class Velocities:
    """Velocities of every body in its own frame, for q (N, nq) and dq (N, nv): `V` (nb, N, 6), linear and angular.

    `X` (nb, N, 6, 6): V_i = X_i V_parent + S_i rate. Momenta go back by their transposes."""

    def __init__(self, tree: RigidBodyTree, q: Array, dq: Array) -> None:
        self.tree, self.N = tree, len(q)
        nb, N, free = tree.nb, len(q), int(tree.floating)
        self.X, self.V = np.zeros((nb, N, 6, 6)), np.zeros((nb, N, 6))
        if free:
            # The free-flyer's own velocity is given in its own frame; its pose never enters the kinetic energy.
            self.V[0] = dq[:, :6]
        x, rate = q[:, 7 * free :].T[:, :, None], dq[:, 6 * free :].T[:, :, None]
        R0, axis, fixed = tree.rotation[free:], tree.axis[free:], tree.prismatic[free:, None, None]
        along = R0 @ (axis[:, :, None] * axis[:, None])
        across = R0 @ skew(axis)
        angle = np.where(fixed, 0.0, x)[..., None]
        R = along[:, None] + (R0 - along)[:, None] * np.cos(angle) + across[:, None] * np.sin(angle)
        p = tree.translation[free:, None] + (R0 @ axis[..., None])[:, None, :, 0] * np.where(fixed, x, 0.0)
        back = R.swapaxes(2, 3)
        self.X[free:, :, :3, :3] = self.X[free:, :, 3:, 3:] = back
        # R' (w x p): each row is p x a column of R.
        (x0, x1, x2), (b0, b1, b2) = np.moveaxis(p, 2, 0)[..., None], np.moveaxis(R, 2, 0)
        for c, (p1, b2_, p2, b1_) in enumerate(((x1, b2, x2, b1), (x2, b0, x0, b2), (x0, b1, x1, b0))):
            self.X[free:, :, :3, 3 + c] = p1 * b2_ - p2 * b1_
        push = axis[:, None] * rate
        own = np.where(fixed, np.concatenate([push, 0.0 * push], axis=2), np.concatenate([0.0 * push, push], axis=2))
        for i in range(free, nb):
            up, V = int(tree.parent[i]), own[i - free]
            self.V[i] = V if up < 0 else V + np.matmul(self.X[i], self.V[up][:, :, None])[:, :, 0]

    @property
    def l(self) -> Array:  # noqa: E743
        """Linear velocities (nb, 3, N) of the frames' origins."""
        return np.moveaxis(self.V[:, :, :3], 2, 1)

    @property
    def w(self) -> Array:
        """Angular velocities (nb, 3, N)."""
        return np.moveaxis(self.V[:, :, 3:], 2, 1)


def energy_rows(tree: RigidBodyTree, q: Array, dq: Array) -> Array:
    """2T per unit inertial parameter: (N, 10 nb), for q (N, nq) and dq (N, nv)."""
    state = Velocities(tree, q, dq)
    l, w = (np.moveaxis(x, 1, 0) for x in (state.l, state.w))  # noqa: E741
    block = np.empty((tree.nb, 10, state.N))
    block[:, 0] = (l * l).sum(axis=0)
    for row, (x, y) in enumerate(((1, 2), (2, 0), (0, 1)), 1):
        block[:, row] = 2.0 * (l[x] * w[y] - l[y] * w[x])
    for row, (x, y) in zip(range(4, 10), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), strict=True):
        block[:, row] = (1.0 if x == y else 2.0) * w[x] * w[y]
    return np.ascontiguousarray(block.reshape(10 * tree.nb, state.N).T)


def energy_gradient(tree: RigidBodyTree, inertia: Array, q: Array, dq: Array) -> Array:
    """d(2T)/dq at fixed rates: (N, joints). Moving joint i carries its whole subtree: d(2T)/dq_i = -2 h_i . (S_i x V_i),

    with V_i the body's velocity, S_i the joint's axis and h_i the momentum of the subtree, all in body i's frame."""
    state = Velocities(tree, q, dq)
    momentum = np.matmul(state.V, _spatial(inertia.reshape(tree.nb, 10)))
    first = int(tree.floating)
    for i in reversed(range(first, tree.nb)):
        if (up := int(tree.parent[i])) >= 0:
            momentum[up] += np.matmul(momentum[i][:, None], state.X[i])[:, 0]
    # S x V: a slide moves the momentum's line of action, a turn both of its parts.
    turned = np.matmul(state.V[first:].reshape(-1, state.N, 2, 3), skew(tree.axis[first:, None]).swapaxes(2, 3))
    fixed = tree.prismatic[first:, None]
    by_force = np.einsum("bnc,bnc->bn", momentum[first:, :, :3], np.where(fixed[..., None], turned[:, :, 1], turned[:, :, 0]))
    by_moment = np.where(fixed, 0.0, np.einsum("bnc,bnc->bn", momentum[first:, :, 3:], turned[:, :, 1]))
    return np.asarray(-2.0 * (by_force + by_moment)).T


def _spatial(own: Array) -> Array:
    """Inertia (nb, 6, 6) of bodies with parameters (nb, 10): momentum of a velocity, both as (linear, angular)."""
    out = np.zeros((len(own), 6, 6))
    out[:, :3, :3] = own[:, 0, None, None] * np.eye(3)
    out[:, 3:, 3:] = own[:, [[4, 5, 7], [5, 6, 8], [7, 8, 9]]]
    out[:, 3:, :3] = skew(own[:, 1:4])
    out[:, :3, 3:] = out[:, 3:, :3].swapaxes(1, 2)
    return out
