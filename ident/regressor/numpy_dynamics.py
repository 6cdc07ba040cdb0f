"""Rigid-body dynamics of a tree in plain NumPy: the path that works everywhere, and the check of the compiled one.

All quantities of a body are in its own joint frame. A body's motion is its angular velocity w, its angular acceleration a
and the acceleration b of the frame's origin less gravity; linear velocity is needed only at a free-flyer. With
B = [a]x + [w]x[w]x, the force and the moment about the origin are f = m b + B h and n = h x b + I a + w x I w, h the first
moment (Newton and Euler for a point that is not the centre of mass). No step divides by the mass, so any parameter vector will do.

Arrays hold components first and samples last, so that each operation runs along contiguous samples; the public arrays are
cut into chunks that fit a cache. Arguments are checked by `ident.regressor.rigid`; `threads` is there for the sake of the compiled
kernel's functions of the same names, and has no effect."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .._utils.singular_values import matrix_rank
from ..errors import ConfigurationError, DataError
from ..robots.tree import RigidBodyTree

Array = np.ndarray

#: Samples handled together: the arrays of one body stay in the second-level cache.
CHUNK = 2048


def cross(a: Array, b: Array) -> Array:
    """a x b for arrays (3, ...)."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _skew(u: Array) -> Array:
    return np.array([[0.0, -u[2], u[1]], [u[2], 0.0, -u[0]], [-u[1], u[0], 0.0]])


def into(R: Array, v: Array) -> Array:
    """Rᵀ v: a vector (3, ..., n) of the parent's frame in the child's frame, R (3, 3, n) or constant (3, 3, 1)."""
    if v.ndim == 3:
        return (R[:, :, None] * v[:, None]).sum(0)
    return (R * v[:, None]).sum(0)


def _out_of(R: Array, v: Array) -> Array:
    """R v: a vector (3, n) of the child's frame in the parent's frame."""
    return (R * v[None]).sum(1)


@dataclass(frozen=True)
class _Pose:
    """Placement of a body in its parent's frame: `R` (3, 3, n) or (3, 3, 1), `p` (3, n) or (3, 1)."""

    R: Array
    p: Array


class Chunk:
    """Poses of all bodies for the positions q (n, nq)."""

    def __init__(self, tree: RigidBodyTree, q: Array) -> None:
        self.tree = tree
        self.n = len(q)
        self.poses = [self._pose(i, q) for i in range(tree.nb)]

    def _pose(self, i: int, q: Array) -> _Pose:
        tree = self.tree
        R0, p0, u = tree.rotation[i], tree.translation[i], tree.axis[i]
        if tree.floating and i == 0:
            return _Pose(np.einsum("ij,jkn->ikn", R0, quaternion_matrix(q[:, 3:7])), p0[:, None] + R0 @ q[:, :3].T)
        angle = q[:, i + 6 * tree.floating]
        if tree.prismatic[i]:
            return _Pose(R0[:, :, None], p0[:, None] + (R0 @ u)[:, None] * angle)
        # Rodrigues' formula behind the constant placement: R0 (u u' + cos (1 - u u') + sin [u]x).
        along = R0 @ np.outer(u, u)
        R = along[:, :, None] + (R0 - along)[:, :, None] * np.cos(angle) + (R0 @ _skew(u))[:, :, None] * np.sin(angle)
        return _Pose(R, p0[:, None])

    def subspace(self, i: int) -> tuple[Array, Array]:
        """Linear and angular unit velocities of joint i in its own frame: (3, d) each, d = 6 for a free-flyer, else 1."""
        tree = self.tree
        if tree.floating and i == 0:
            return np.eye(3, 6), np.eye(3, 6, 3)
        u, zero = tree.axis[i][:, None], np.zeros((3, 1))
        return (u, zero) if tree.prismatic[i] else (zero, u)

    def rows(self, i: int) -> slice:
        """Rows of joint i among the nv velocities."""
        if not self.tree.floating:
            return slice(i, i + 1)
        return slice(0, 6) if i == 0 else slice(i + 5, i + 6)

    def motion(self, dq: Array, ddq: Array) -> Iterator[tuple[int, Array, Array, Array, Array]]:
        """(i, w, a, b, B) of every body, parents first."""
        tree = self.tree
        ground = np.zeros((3, 1))
        w: list[Array] = []
        a: list[Array] = []
        b: list[Array] = []
        B: list[Array] = []
        for i, (pose, up) in enumerate(zip(self.poses, tree.parent, strict=True)):
            rates, u = self.rows(i), tree.axis[i][:, None]
            v, dv = dq[:, rates].T, ddq[:, rates].T
            if up < 0:
                wi, ai, bi = ground, ground, into(pose.R, -tree.gravity[:, None])
            else:
                wi, ai = into(pose.R, w[up]), into(pose.R, a[up])
                bi = into(pose.R, b[up] + (B[up] * pose.p[None]).sum(1))
            if tree.floating and i == 0:
                wi, ai = v[3:], dv[3:]
                bi = bi + dv[:3] + cross(v[3:], v[:3])
            elif tree.prismatic[i]:
                bi = bi + u * dv + 2.0 * cross(wi, u) * v
            else:
                ai = ai + u * dv + cross(wi, u) * v
                wi = wi + u * v
            wi, ai, bi = (np.broadcast_to(x, (3, self.n)) for x in (wi, ai, bi))
            Bi = wi[:, None] * wi[None]
            square = Bi[0, 0] + Bi[1, 1] + Bi[2, 2]
            for k in range(3):
                Bi[k, k] -= square
                x, y = (k + 1) % 3, (k + 2) % 3
                Bi[y, x] += ai[k]
                Bi[x, y] -= ai[k]
            for kept, new in ((w, wi), (a, ai), (b, bi), (B, Bi)):
                kept.append(new)
            yield i, wi, ai, bi, Bi


def quaternion_matrix(quaternion: Array) -> Array:
    """Rotation matrices (3, 3, n) of quaternions (n, 4) in the order x y z w, normalised here."""
    x, y, z, w = quaternion.T / np.linalg.norm(quaternion, axis=1)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _chunks(n: int) -> Iterator[slice]:
    for start in range(0, n, CHUNK):
        yield slice(start, min(start + CHUNK, n))


def regressor(tree: RigidBodyTree, q: Array, dq: Array, ddq: Array, threads: int | None = None) -> Array:
    """Joint torque regressor (N, nv, 10 nb), gravity included."""
    out = np.zeros((len(q), tree.nv, 10 * tree.nb))
    for chunk in _chunks(len(q)):
        kinematics = Chunk(tree, q[chunk])
        # Per body: the unit velocities (3, d, n) of all joints on the way to the base, in the body's frame, and their rows.
        linear: list[Array] = []
        angular: list[Array] = []
        rows: list[Array] = []
        for i, w, a, b, B in kinematics.motion(dq[chunk], ddq[chunk]):
            own = kinematics.rows(i)
            l_new, s_new = (np.repeat(x[:, :, None], kinematics.n, 2) for x in kinematics.subspace(i))
            index = np.arange(own.start, own.stop)
            if (up := tree.parent[i]) >= 0:
                pose = kinematics.poses[i]
                moved = linear[up] + cross(angular[up], pose.p[:, None])
                l_new = np.concatenate([into(pose.R, moved), l_new], axis=1)
                s_new = np.concatenate([into(pose.R, angular[up]), s_new], axis=1)
                index = np.concatenate([rows[up], index])
            linear.append(l_new)
            angular.append(s_new)
            rows.append(index)
            out[chunk, index, 10 * i : 10 * i + 10] = _row_block(l_new, s_new, w, a, b, B).transpose(2, 1, 0)
    return out


def _row_block(linear: Array, s: Array, w: Array, a: Array, b: Array, B: Array) -> Array:
    """Power of unit velocities (3, d, n) against the wrench of unit parameters: (10, d, n)."""
    block = np.empty((10, *s.shape[1:]))
    w, a, b = w[:, None], a[:, None], b[:, None]
    block[0] = (linear * b).sum(0)
    block[1:4] = (B[:, :, None] * linear[:, None]).sum(0) + cross(b, s)
    c = cross(s, w)
    for row, (x, y) in zip(range(4, 10), ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), strict=True):
        block[row] = s[x] * a[y] + c[x] * w[y]
        if x != y:
            block[row] += s[y] * a[x] + c[y] * w[x]
    return block


def _inertias(tree: RigidBodyTree, inertia: Array) -> Iterator[tuple[float, Array, Array]]:
    """(m, h (3,), I (3, 3)) of every body."""
    for m, hx, hy, hz, xx, xy, yy, xz, yz, zz in inertia.reshape(tree.nb, 10):
        yield m, np.array([hx, hy, hz]), np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def inverse_dynamics(tree: RigidBodyTree, inertia: Array, q: Array, dq: Array, ddq: Array, threads: int | None = None) -> Array:
    """Joint torque (N, nv) by the recursive Newton-Euler algorithm."""
    out = np.empty((len(q), tree.nv))
    bodies = list(_inertias(tree, inertia))
    for chunk in _chunks(len(q)):
        kinematics = Chunk(tree, q[chunk])
        force, moment = [], []
        for i, w, a, b, B in kinematics.motion(dq[chunk], ddq[chunk]):
            m, h, inertia_i = bodies[i]
            force.append(m * b + (B * h[None, :, None]).sum(1))
            moment.append(cross(h, b) + inertia_i @ a + cross(w, inertia_i @ w))
        for i in reversed(range(tree.nb)):
            linear, s = kinematics.subspace(i)
            out[chunk, kinematics.rows(i)] = force[i].T @ linear + moment[i].T @ s
            if (up := tree.parent[i]) >= 0:
                pose = kinematics.poses[i]
                carried = _out_of(pose.R, force[i])
                force[up] = force[up] + carried
                moment[up] = moment[up] + _out_of(pose.R, moment[i]) + cross(pose.p, carried)
    return out


def bias_torque(tree: RigidBodyTree, inertia: Array, q: Array, dq: Array, threads: int | None = None) -> Array:
    """Coriolis, centrifugal and gravity torque (N, nv)."""
    return inverse_dynamics(tree, inertia, q, dq, np.zeros((len(q), tree.nv)))


def mass_matrix(tree: RigidBodyTree, inertia: Array, q: Array, threads: int | None = None) -> Array:
    """Joint-space mass matrix (N, nv, nv) by the composite-rigid-body algorithm, whose sums are linear in `inertia`."""
    out = np.zeros((len(q), tree.nv, tree.nv))
    for chunk in _chunks(len(q)):
        kinematics = Chunk(tree, q[chunk])
        n = kinematics.n
        composite = [
            (m, np.repeat(h[:, None], n, 1), np.repeat(inertia_i[:, :, None], n, 2)) for m, h, inertia_i in _inertias(tree, inertia)
        ]
        for i in reversed(range(tree.nb)):
            m, h, inertia_i = composite[i]
            own, (linear, s) = kinematics.rows(i), kinematics.subspace(i)
            linear, s = linear[:, :, None], s[:, :, None]
            # Wrench (3, d, n) that accelerates the bodies from i on along joint i.
            force = m * linear + cross(s, h[:, None])
            moment = cross(h[:, None], linear) + (inertia_i[:, :, None] * s[None]).sum(1)
            j = i
            while True:
                linear, s = kinematics.subspace(j)
                block = np.einsum("kr,kdn->nrd", linear, force) + np.einsum("kr,kdn->nrd", s, moment)
                out[chunk, kinematics.rows(j), own] = block
                out[chunk, own, kinematics.rows(j)] = block.transpose(0, 2, 1)
                if tree.parent[j] < 0:
                    break
                pose = kinematics.poses[j]
                force = (pose.R[:, :, None] * force[None]).sum(1)
                moment = (pose.R[:, :, None] * moment[None]).sum(1) + cross(pose.p[:, None], force)
                j = tree.parent[j]
            if (up := tree.parent[i]) >= 0:
                composite[up] = tuple(x + y for x, y in zip(composite[up], _carried(kinematics.poses[i], m, h, inertia_i), strict=True))
    return out


def _carried(pose: _Pose, m: float, h: Array, inertia_i: Array) -> tuple[float, Array, Array]:
    """Inertial parameters about the parent's origin and in its frame (parallel axes, first moment instead of centre of mass)."""
    R, p = pose.R, np.broadcast_to(pose.p, h.shape)
    h = _out_of(R, h)
    turned = (R[:, :, None] * inertia_i[None]).sum(1)
    turned = (turned[:, None] * R[None]).sum(2)
    outer = h[:, None] * p[None]
    shift = -(outer + outer.transpose(1, 0, 2)) - m * p[:, None] * p[None]
    diagonal = 2.0 * (h * p).sum(0) + m * (p * p).sum(0)
    for k in range(3):
        shift[k, k] += diagonal
    return m, h + m * p, turned + shift


def forward_dynamics(
    tree: RigidBodyTree, inertia: Array, q: Array, dq: Array, tau: Array, added: Array, threads: int | None = None
) -> Array:
    """Joint acceleration (N, nv) from (M + added) ddq = tau - bias. LU with pivoting: M need not be positive definite."""
    matrix = mass_matrix(tree, inertia, q) + added
    right = tau - bias_torque(tree, inertia, q, dq)
    try:
        return np.linalg.solve(matrix, right[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        ranks = matrix_rank(matrix)
        raise singular(int(np.argmin(ranks))) from None


class NumpyDynamics:
    """Forward dynamics of one tree with fixed parameters; see `rigid.dynamics`."""

    def __init__(self, tree: RigidBodyTree, inertia: Array, added: Array) -> None:
        self._tree, self._inertia, self._added = tree, inertia, added

    def forward(self, q: Array, dq: Array, tau: Array, threads: int = 1) -> Array:
        """Acceleration (nv,) for one state, or (N, nv) for a batch. Raises DataError where M is singular or a value not finite."""
        tree, lead = self._tree, q.shape[:-1]
        q, dq, tau = fitting(lead, q=(q, tree.nq), dq=(dq, tree.nv), tau=(tau, tree.nv))
        if not all(np.isfinite(x).all() for x in (q, dq, tau)):
            raise not_finite()
        out = forward_dynamics(tree, self._inertia, np.atleast_2d(q), np.atleast_2d(dq), np.atleast_2d(tau), self._added)
        return out.reshape(dq.shape)

    def terms(self, q: Array, dq: Array, threads: int = 1) -> tuple[Array, Array]:
        """Mass matrix (nv, nv), `added` not included, and bias (nv,) for one state; (N, nv, nv) and (N, nv) for a batch."""
        tree, lead = self._tree, q.shape[:-1]
        q, dq = fitting(lead, q=(q, tree.nq), dq=(dq, tree.nv))
        mass = mass_matrix(tree, self._inertia, np.atleast_2d(q))
        return mass.reshape(*lead, tree.nv, tree.nv), bias_torque(tree, self._inertia, np.atleast_2d(q), np.atleast_2d(dq)).reshape(
            dq.shape
        )


def fitting(lead: tuple[int, ...], **given: tuple[Array, int]) -> list[Array]:
    """Arrays, each given with its width, as contiguous float64 of shape (*lead, width). Raises ConfigurationError."""
    arrays = []
    for name, (values, width) in given.items():
        array = np.ascontiguousarray(values, dtype=np.float64)
        if array.shape != (*lead, width):
            raise ConfigurationError(f"{name}: expected shape {(*lead, width)}, but it is {array.shape}.")
        arrays.append(array)
    return arrays


def not_finite() -> DataError:
    """The error for a state from which no motion follows."""
    return DataError(
        "forward dynamics: the state or the torque is not finite. A simulation that diverged needs smaller steps or a possible model."
    )


def singular(sample: int) -> DataError:
    """The error for a mass matrix that cannot be inverted."""
    return DataError(
        f"the mass matrix is singular at sample {sample}: some joint moves no inertia with these parameters."
        " Give the rotor inertia through `added`, or parameters from a possible model."
    )


#: What `kernel()` calls it in either kernel.
fixed_dynamics = NumpyDynamics
