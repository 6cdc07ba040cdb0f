"""Pseudo-inertia: a link's ten parameters as a 4 x 4 matrix that is positive definite exactly for a real body.

J = [[S, h], [h', m]] with S = tr(I)/2 E - I the second moments of mass, h the first moments (Wensing, Kim and Slotine, IEEE RA-L 2018).
Parameters are in Pinocchio's order m mx my mz Ixx Ixy Iyy Ixz Iyz Izz about the joint frame's origin."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

_PAIRS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


def _units() -> Array:
    out = np.zeros((10, 4, 4))
    out[0, 3, 3] = 1.0
    for i in range(3):
        out[1 + i, i, 3] = out[1 + i, 3, i] = 1.0
    for row, (x, y) in zip(range(4, 10), _PAIRS, strict=True):
        if x == y:
            out[row, :3, :3] = 0.5 * np.eye(3)
            out[row, x, x] = -0.5
        else:
            out[row, x, y] = out[row, y, x] = -1.0
    return out


#: J per unit parameter: (10, 4, 4).
UNITS = _units()


def pseudo_inertia(parameters: Array) -> Array:
    """Pseudo-inertias (..., 4, 4) of ten parameters (..., 10)."""
    return np.tensordot(parameters, UNITS, ([-1], [0]))


def from_pseudo_inertia(J: Array) -> Array:
    """Ten parameters (..., 10) of pseudo-inertias (..., 4, 4)."""
    S = J[..., :3, :3]
    moments = np.trace(S, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - S
    return np.stack([J[..., 3, 3], J[..., 0, 3], J[..., 1, 3], J[..., 2, 3], *(moments[..., x, y] for x, y in _PAIRS)], axis=-1)


def smallest_eigenvalues(parameters: Array) -> Array:
    """Smallest eigenvalue of each link's pseudo-inertia, scaled to unit diagonal where that is positive: (nb,), for (10 nb,).

    Positive exactly where the pseudo-inertia is positive definite; the scale makes links of unlike size comparable."""
    J = pseudo_inertia(np.asarray(parameters, float).reshape(-1, 10))
    D = 1.0 / np.sqrt(np.maximum(np.abs(np.diagonal(J, axis1=1, axis2=2)), 1e-12 * np.abs(J).max(axis=(1, 2))[:, None] + 1e-300))
    return np.linalg.eigvalsh(D[:, :, None] * J * D[:, None, :])[:, 0]


def centre_of_mass(parameters: Array) -> tuple[float, Array, Array]:
    """(mass, centre of mass (3,), inertia about it (3, 3)) of ten parameters. Raises ZeroDivisionError for zero mass."""
    m, h = float(parameters[0]), np.asarray(parameters[1:4], float)
    if m == 0.0:
        raise ZeroDivisionError("a body without mass has no centre of mass")
    c = h / m
    xx, xy, yy, xz, yz, zz = parameters[4:10]
    about_origin = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return m, c, about_origin - m * (float(c @ c) * np.eye(3) - np.outer(c, c))


def from_centre_of_mass(mass: float, com: Array, inertia: Array) -> Array:
    """Ten parameters (10,) from mass, centre of mass (3,) and inertia about it (3, 3)."""
    com = np.asarray(com, float)
    about_origin = np.asarray(inertia, float) + mass * (float(com @ com) * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, [about_origin[x, y] for x, y in _PAIRS]])


def displaced(parameters: Array, rotation: Array, translation: Array) -> Array:
    """Ten parameters (10,) of a body given in a child frame, in the parent frame: x_parent = rotation x_child + translation."""
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = rotation, translation
    return from_pseudo_inertia(T @ pseudo_inertia(np.asarray(parameters, float)) @ T.T)
