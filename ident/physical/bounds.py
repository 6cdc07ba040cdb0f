"""What is known of the links beside the data: bounds on mass and centre of mass, and a nominal model with a metric.

All bounds are linear (or second-order) in the links' parameters, so they join the linear matrix inequalities of consistency as they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np

from ..errors import ConfigurationError, unknown_name
from ..robots.tree import link_names
from .pseudo_inertia import from_centre_of_mass, pseudo_inertia, smallest_eigenvalues

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from .structure import InertiaStructure

Array = np.ndarray


class Metric(StrEnum):
    """How far a pseudo-inertia J is from the nominal J0 (all equal to second order: half the squared relative change).

    QUADRATIC: half |J0^-1/2 (J - J0) J0^-1/2|^2, the metric at the nominal body (Lee, Wensing and Park, IEEE T-RO 2020).
    ENTROPIC: tr(J0^-1 J) - log det(J0^-1 J) - 4, the Bregman divergence of log det (the same paper); never lets a body vanish.
    GEOMETRIC: half the squared affine-invariant distance, sum of log^2 of the eigenvalues of J0^-1 J (Lee and Park, 2018)."""

    QUADRATIC = "quadratic"
    ENTROPIC = "entropic"
    GEOMETRIC = "geometric"


@dataclass(frozen=True)
class LinkBounds:
    """Bounds on one moving link (`link`: its URDF name), in its joint frame.

    `mass`: (least, most) in kg, None for open. `com_box`: (lower (3,), upper (3,)) m. `com_hull`: corners (m, 3) of a convex hull that
    holds the centre of mass, m. `ellipsoid`: (centre (3,), semi-axes (3,)) m, axes along the joint frame, that holds it."""

    link: str
    mass: tuple[float | None, float | None] = (None, None)
    com_box: tuple[Sequence[float], Sequence[float]] | None = None
    com_hull: Sequence[Sequence[float]] | None = None
    ellipsoid: tuple[Sequence[float], Sequence[float]] | None = None


@dataclass(frozen=True)
class Bounds:
    """Bounds on the whole robot: `total_mass` (least, most) of all moving links in kg, None for open, and `links`."""

    total_mass: tuple[float | None, float | None] = (None, None)
    links: tuple[LinkBounds, ...] = ()

    def rows(self, structure: InertiaStructure) -> tuple[Array, Array]:
        """Linear bounds on all parameters x (k,): (A (m, k), c (m,)) with A x + c >= 0. Raises ConfigurationError."""
        rows: list[Array] = []
        constants: list[float] = []

        def add(row: Array, constant: float) -> None:
            rows.append(row)
            constants.append(constant)

        masses = structure.inertial[0::10]
        total = np.zeros(structure.k)
        total[masses] = 1.0
        _range(add, total, self.total_mass, "total mass")
        for bound in self.links:
            at = _body(structure, bound.link)
            unit = np.eye(structure.k)[at]
            _range(add, unit[0], bound.mass, f"mass of {bound.link}")
            if bound.com_box is not None:
                lower, upper = _triple(bound.com_box[0], bound.link), _triple(bound.com_box[1], bound.link)
                if np.any(lower > upper):
                    raise ConfigurationError(
                        f"com_box of {bound.link!r}: the lower corner {lower.tolist()} is above the upper one {upper.tolist()}."
                    )
                for i in range(3):
                    add(unit[1 + i] - lower[i] * unit[0], 0.0)
                    add(upper[i] * unit[0] - unit[1 + i], 0.0)
            if bound.com_hull is not None:
                for normal, offset in _facets(bound.com_hull, bound.link):
                    add(-normal @ unit[1:4] - offset * unit[0], 0.0)
        return np.array(rows).reshape(-1, structure.k), np.array(constants)

    def cones(self, structure: InertiaStructure) -> list[Array]:
        """Second-order cones on all parameters: matrices (4, k) whose first row x >= norm of the others x."""
        found = []
        for bound in self.links:
            if bound.ellipsoid is None:
                continue
            at = _body(structure, bound.link)
            unit = np.eye(structure.k)[at]
            centre, axes = _triple(bound.ellipsoid[0], bound.link), _triple(bound.ellipsoid[1], bound.link)
            if np.any(axes <= 0):
                raise ConfigurationError(f"ellipsoid of {bound.link!r}: the semi-axes {axes.tolist()} must be positive.")
            found.append(np.concatenate([unit[:1], (unit[1:4] - centre[:, None] * unit[0]) / axes[:, None]]))
        return found


@dataclass(frozen=True, eq=False)
class Prior:
    """A nominal model that the links should stay near to.

    `nominal` (10 nb,): the links' nominal parameters in Pinocchio's order. `metric`: see `Metric`. `spread`: relative standard deviation
    in which a change is counted: the penalty is metric / spread^2, beside the squared, whitened residuals of the fit."""

    nominal: Array
    metric: Metric = Metric.QUADRATIC
    spread: float = 0.5

    def __post_init__(self) -> None:
        object.__setattr__(self, "metric", Metric(self.metric))
        object.__setattr__(self, "nominal", np.asarray(self.nominal, float).reshape(-1))
        if not self.spread > 0:
            raise ConfigurationError(f"the spread of the prior must be positive, not {self.spread}.")

    def roots(self, structure: InertiaStructure) -> list[Array | None]:
        """For each link a lower triangular (4, 4) root of its nominal pseudo-inertia, or None where nothing nominal is known (all zero).

        Raises ConfigurationError where a nominal link is no real body."""
        nb = structure.tree.nb
        if self.nominal.shape != (10 * nb,):
            raise ConfigurationError(f"the nominal model has {self.nominal.size} parameters for {nb} moving links (ten each).")
        found: list[Array | None] = []
        for body, parameters in enumerate(self.nominal.reshape(nb, 10)):
            if not parameters.any():
                found.append(None)
                continue
            try:
                found.append(np.linalg.cholesky(pseudo_inertia(parameters)))
            except np.linalg.LinAlgError:
                raise ConfigurationError(
                    f"the nominal inertia of link {structure.body_names[body]!r} is not that of a real body"
                    " (its pseudo-inertia is not positive definite), so no distance from it is defined."
                    " Correct its <inertial>, or give another nominal model."
                ) from None
        return found


def nominal_prior(robot: Robot, metric: Metric | str = Metric.QUADRATIC, spread: float = 0.5) -> tuple[Prior | None, tuple[str, ...]]:
    """The URDF's own links as a prior, and notes: links that are no real bodies count as unknown. None where nothing is known."""
    if robot.nominal is None:
        return None, ()
    nominal = robot.nominal.copy().reshape(-1, 10)
    unreal = np.flatnonzero(nominal.any(axis=1) & (smallest_eigenvalues(nominal) <= 1e-9))
    nominal[unreal] = 0.0
    names = link_names(robot.model)
    notes = (
        (f"the URDF's own inertials of {', '.join(names[i] for i in unreal)} are no real bodies and were not used.",) if len(unreal) else ()
    )
    return (Prior(nominal.reshape(-1), Metric(metric), spread) if nominal.any() else None), notes


def reference_prior(
    robot: Robot, structure: InertiaStructure, metric: Metric | str = Metric.ENTROPIC
) -> tuple[Prior | None, tuple[str, ...]]:
    """The URDF's own links to choose among links that no torque tells apart, every one real, and notes; None where the URDF has none.

    A link that is no real body keeps its mass and centre of mass and becomes compact; one without mass becomes light."""
    if robot.nominal is None or not np.any(robot.nominal[0::10] > 0):
        return None, ()
    given = robot.nominal.reshape(-1, 10)
    real = given.any(axis=1) & (smallest_eigenvalues(given) > 1e-9)
    links = np.where(real[:, None], given, 0.0)
    distance = np.linalg.norm(structure.tree.translation, axis=1)
    length = 0.1 * float(distance[distance > 1e-6].mean()) if np.any(distance > 1e-6) else 0.05
    light = 0.01 * float(np.median(given[given[:, 0] > 0, 0]))
    changed = np.flatnonzero(~real)
    for body in changed:
        mass = given[body, 0]
        com = given[body, 1:4] / mass if mass > 0 else np.zeros(3)
        mass = mass if mass > 0 else light
        links[body] = from_centre_of_mass(mass, com, 2.0 * mass * length**2 * np.eye(3))
    names = ", ".join(structure.body_names[i] for i in changed)
    notes = (f"the URDF's inertias of {names} are no real bodies: compact bodies of the same mass stand for them.",) if names else ()
    return Prior(links.reshape(-1), Metric(metric)), notes


def _body(structure: InertiaStructure, link: str) -> Array:
    if link not in structure.body_names:
        raise unknown_name("moving link", link, structure.body_names)
    body = structure.body_names.index(link)
    return structure.inertial[10 * body : 10 * body + 10]


def _triple(values: Sequence[float], link: str) -> Array:
    array = np.asarray(values, float).reshape(-1)
    if array.shape != (3,) or not np.all(np.isfinite(array)):
        raise ConfigurationError(f"bounds of {link!r}: expected three finite numbers (m), not {list(np.atleast_1d(values))}.")
    return array


def _range(add: object, row: Array, limits: tuple[float | None, float | None], what: str) -> None:
    low, high = limits
    if low is not None and high is not None and low > high:
        raise ConfigurationError(f"{what}: the least value {low} is above the most {high}.")
    if low is not None:
        add(row, -float(low))  # type: ignore[operator]
    if high is not None:
        add(-row, float(high))  # type: ignore[operator]


def _facets(corners: Sequence[Sequence[float]], link: str) -> list[tuple[Array, float]]:
    """Facets n.x + d <= 0 of the hull of corners (m, 3)."""
    from scipy.spatial import ConvexHull, QhullError

    points = np.asarray(corners, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ConfigurationError(f"com_hull of {link!r}: expected corners of shape (m, 3), not {points.shape}.")
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        raise ConfigurationError(
            f"com_hull of {link!r}: the {len(points)} corners span no volume; give at least four that do not lie in a plane."
        ) from None
    return [(equation[:3], float(equation[3])) for equation in hull.equations]
