"""How far two sets of inertial parameters are from one another, in units that mean the same for every link.

A change of the pseudo-inertia P = [[Σ, h], [hᵀ, m]] of a link is measured by ‖L⁻¹ dP L⁻ᵀ‖ with P = L Lᵀ at the nominal value:
the second-order form of the entropic (log-determinant) distance, which does not depend on units or frames
(Lee, Wensing & Park, IEEE T-RO 36, 2020)."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError
from ..problem.information import triangle

if TYPE_CHECKING:
    from ..robots.robot import Robot

Array = np.ndarray

#: Share of a solid ball of the link's mass and size that is mixed into the nominal link: needles, plates and massless links
#: would otherwise be infinitely stiff in some direction.
_BALL = 0.05


def link_sizes(robot: Robot) -> tuple[Array, Array]:
    """Characteristic mass (nb,) kg and length (nb,) m of every moving body, from the geometry and the nominal masses."""
    tree = robot.tree
    nominal = np.zeros((tree.nb, 10)) if robot.nominal is None else np.asarray(robot.nominal, float).reshape(-1, 10)
    span = np.linalg.norm(tree.translation, axis=1)
    length = np.zeros(tree.nb)
    for i, parent in enumerate(tree.parent):
        if parent >= 0:
            length[parent] = max(length[parent], span[i])
    mass = np.abs(nominal[:, 0])
    with np.errstate(divide="ignore", invalid="ignore"):
        centre = np.where(mass > 0, np.linalg.norm(nominal[:, 1:4], axis=1) / mass, 0.0)
        gyration = np.sqrt(np.where(mass > 0, np.abs(nominal[:, [4, 6, 9]]).max(axis=1) / mass, 0.0))
    length = np.maximum(length, np.maximum(centre, gyration))
    typical = float(length[length > 0].mean()) if np.any(length > 0) else 0.1
    heavy = float(mass.sum()) / tree.nb if mass.any() else 1.0
    return np.maximum(mass, 0.02 * heavy), np.maximum(length, 0.2 * typical)


def pseudo_inertia(link: Array) -> Array:
    """Pseudo-inertia (4, 4) of a link's ten parameters `m mx my mz Ixx Ixy Iyy Ixz Iyz Izz` about the joint frame's origin."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = link
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    out = np.empty((4, 4))
    out[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    out[:3, 3] = out[3, :3] = hx, hy, hz
    out[3, 3] = m
    return out


def _entropic(link: Array, mass: float, length: float) -> Array:
    nominal = pseudo_inertia(link)
    least = _BALL * mass * np.array([length**2 / 5.0] * 3 + [1.0])
    scale = np.sqrt(least)
    # In units of the ball: raise what is below it, so that the reference link is possible.
    values, vectors = np.linalg.eigh(nominal / np.outer(scale, scale))
    reference = (vectors * np.maximum(values, 1.0)) @ vectors.T * np.outer(scale, scale)
    lower = np.linalg.cholesky(reference)
    columns = []
    for unit in np.eye(10):
        half = np.linalg.solve(lower, pseudo_inertia(unit))
        columns.append(np.linalg.solve(lower, half.T).ravel())
    return triangle(np.stack(columns, axis=1))


def _scale(link: Array, mass: float, length: float) -> Array:
    return np.diag(1.0 / (mass * np.array([1.0] + [length] * 3 + [length**2] * 6)))


METRICS: dict[str, Callable[[Array, float, float], Array]] = {"entropic": _entropic, "scale": _scale}


def nominal_root(robot: Robot, metric: str) -> Array:
    """Upper triangular L (10 nb, 10 nb), block by link: ‖L (π − π₀)‖ is the distance from the nominal parameters π₀."""
    if robot.nominal is None:
        raise ConfigurationError(f"robot {robot.name!r} has no nominal inertial parameters to measure a distance from.")
    links = np.asarray(robot.nominal, float).reshape(-1, 10)
    out = np.zeros((links.size, links.size))
    for i, (link, mass, length) in enumerate(zip(links, *link_sizes(robot), strict=True)):
        part = slice(10 * i, 10 * i + 10)
        out[part, part] = METRICS[metric](link, float(mass), float(length))
    return out
