"""The inertia matrix from base parameters alone, coordinate-free (Yoshida 1995, eq. 2.17 and 2.62-2.64, corrected).

With M_j, R_j, J_j the mass, first moment and inertia about o_j of everything after joint j, and p the way from o_i to o_j,
i before j:
    both revolute      H_ij = z_i . (J_j z_j + p x (z_j x R_j))
    j prismatic        H_ij = z_i . ((R_j + M_j p) x z_j)
    i prismatic        H_ij = z_i . (z_j x R_j)
    both prismatic     H_ij = M_j z_i . z_j
Joints on different branches do not meet (0). A free-flyer counts as three prismatic and three revolute joints in its own frame.
Base values fix H, though not M, R and J: any parameters with these base values give the same H."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....errors import ConfigurationError
from ....robots.tree import RigidBodyTree
from ..base_form import BaseForm

Array = np.ndarray


def inertia_matrix(base_form: BaseForm, base_values: Any, q: Any) -> Array:
    """Joint-space inertia matrix (N, n, n) in kg m^2 (kg m, kg), on the joint side, from base parameters alone.

    `base_values` (b,): values of `base_form`; if it holds rotor inertias, K⁻ᵀ R K⁻¹ is included. `q` (N, n) or (n,): positions of
    the independent joints, in rad (m). A loop closure gives Wᵀ H W; a floating base comes first (6 more rows and columns: linear
    and angular velocity in its own frame). Raises ConfigurationError for a wrong shape."""
    robot = base_form.robot
    values, q = np.asarray(base_values, float), np.atleast_2d(np.asarray(q, float))
    if values.shape != (base_form.count,):
        raise ConfigurationError(f"base_values has shape {values.shape}, but the set has {base_form.count} base parameters.")
    if q.ndim != 2 or q.shape[1] != robot.n:
        raise ConfigurationError(f"q has shape {q.shape}; expected (samples, {robot.n}): {', '.join(robot.joint_names)}.")
    parameters = base_form.lift @ values
    nb, free = robot.tree.nb, 6 * robot.floating_base
    H = _tree_inertia(robot.tree, parameters[: 10 * nb].reshape(nb, 10), robot.tree_position(q))
    if not robot.loop.is_trivial:
        W = np.zeros((free + len(robot.tree_joints), free + robot.n))
        W[:free, :free], W[free:, free:] = np.eye(free), robot.loop.W
        H = np.einsum("ia,Nij,jb->Nab", W, H, W, optimize=True)
    k = robot.transmission.K_inverse
    H[:, free:, free:] += k.T @ (parameters[10 * nb :, None] * k)
    return H


def _tree_inertia(tree: RigidBodyTree, links: Array, position: Array) -> Array:
    """H (N, nv, nv) of the open tree from link parameters (nb, 10) at positions (N, joints)."""
    N, nb, first = len(position), tree.nb, int(tree.floating)
    turn, origin = np.zeros((nb, N, 3, 3)), np.zeros((nb, N, 3))
    mass, moment, inertia = links[:, 0].copy(), np.zeros((nb, N, 3)), np.zeros((nb, N, 3, 3))
    for b in range(nb):
        parent = int(tree.parent[b])
        if b < first:
            turn[b] = np.eye(3)
        else:
            before = turn[parent] if parent >= 0 else np.broadcast_to(np.eye(3), (N, 3, 3))
            origin[b] = before @ tree.translation[b] + (origin[parent] if parent >= 0 else 0.0)
            turn[b] = before @ tree.rotation[b]
            if tree.prismatic[b]:
                origin[b] += (turn[b] @ tree.axis[b]) * position[:, b - first, None]
            else:
                turn[b] = turn[b] @ _rotations(tree.axis[b], position[:, b - first])
        xx, xy, yy, xz, yz, zz = links[b, 4:]
        moment[b] = turn[b] @ links[b, 1:4]
        inertia[b] = turn[b] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ np.swapaxes(turn[b], 1, 2)
    for b in range(nb - 1, 0, -1):  # everything after a joint, about its origin
        parent = int(tree.parent[b])
        if parent < 0:
            continue
        p, R = origin[b] - origin[parent], moment[b]
        crossed = p[:, :, None] * (R + 0.5 * mass[b] * p)[:, None, :]
        size = 2 * np.einsum("Ni,Ni->N", p, R) + mass[b] * np.einsum("Ni,Ni->N", p, p)
        inertia[parent] += inertia[b] + size[:, None, None] * np.eye(3) - crossed - np.swapaxes(crossed, 1, 2)
        moment[parent] += R + mass[b] * p
        mass[parent] += mass[b]

    columns: list[tuple[int, Array, bool]] = []  # body, direction (N, 3) or (3,), prismatic
    for b in range(nb):
        if b < first:
            columns += [(0, np.broadcast_to(e, (N, 3)), slides) for slides in (True, False) for e in np.eye(3)]
        else:
            columns.append((b, turn[b] @ tree.axis[b], bool(tree.prismatic[b])))
    H = np.zeros((N, len(columns), len(columns)))
    for j, (b, z, slides) in enumerate(columns):
        linear = mass[b] * z if slides else np.cross(z, moment[b])
        angular = np.cross(moment[b], z) if slides else np.einsum("Nij,Nj->Ni", inertia[b], z)
        for i, (a, axis, prismatic) in enumerate(columns[: j + 1]):
            if not _before(tree, a, b):
                continue
            push = linear if prismatic else angular + np.cross(origin[b] - origin[a], linear)
            H[:, i, j] = H[:, j, i] = np.einsum("Ni,Ni->N", axis, push)
    return H


def _before(tree: RigidBodyTree, a: int, b: int) -> bool:
    while b > a:
        b = int(tree.parent[b])
    return a == b


def _rotations(axis: Array, angle: Array) -> Array:
    """Rotations (N, 3, 3) about one axis."""
    x, y, z = axis
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    along = np.outer(axis, axis)
    turned: Array = along + np.cos(angle)[:, None, None] * (np.eye(3) - along) + np.sin(angle)[:, None, None] * skew
    return turned
