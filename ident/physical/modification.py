"""The modification of the dissertation's chapter 4: Steps 1 to 4, from a set that is not possible to a possible one near it.

For every minor whose coordinates x_i(p) lie outside their cone (see `minors`, `cone`):
Step 1: the nearest point of the cone's border; Step 2: a point inside the cone on the line from x_i through it.
No base parameters need have exactly these coordinates, for x_i(p) are fewer than all x. So
Step 3: a hypercube about the estimate, its sides in proportion to the standard deviations, that grows; Step 4: a search in it for
base parameters p (a base vector) whose coordinates come nearest to the points of Step 2, until all are inside their cones.
What is found is possible, and near; nothing says that it is nearest (`cuts` finds that: H is linear in p, and no minors are needed).
Reference: K. Yoshida, dissertation (1995), chapter 4."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .._utils.short_repr import ShortRepr
from .cone import PolyhedralCone
from .cone_judgement import cone_of
from .conic import InfeasibleError, SolverError
from .minors import MOST_NUMBERS, Minor, MinorOrder, TooManyRaysError, minor_of, minor_rows
from .structure import InertiaStructure
from .trigonometric import Sign, grid

Array = np.ndarray

#: Half side of the first hypercube in standard deviations, how much the next is larger, and how many there are.
_FIRST = 0.25
_GROWTH = 1.4
_CUBES = 60
#: Searches in one hypercube: from the estimate, from what the last hypercube gave, and from random points in it.
_STARTS = 4
#: Rounds in which positions between those of F_i join them.
_ROUNDS = 30
_EVALUATIONS = 60
_TOLERANCE = 1e-7


@dataclass(frozen=True, eq=False, repr=False)
class MinorTarget(ShortRepr):
    """Steps 1 and 2 of one minor: its `estimate` coordinates (t,), the nearest `border` point and the `inner` point on their line.

    The estimate itself three times where it is inside. `cone`: with the positions that Step 1 added."""

    minor: Minor
    cone: PolyhedralCone
    estimate: Array
    border: Array
    inner: Array

    @property
    def outside(self) -> bool:
        """Whether the estimate was outside, or nearer to the border than the margin."""
        return self.inner is not self.estimate


@dataclass(frozen=True, eq=False, repr=False)
class Modification(ShortRepr):
    """`values` (b,) that Step 4 found in a hypercube of half side `side` standard deviations, the `cubes`-th; `targets` of Steps 1, 2."""

    values: Array
    side: float
    cubes: int
    targets: tuple[MinorTarget, ...]
    seconds: float

    def text(self) -> str:
        """What was done, in words."""
        outside = sum(t.outside for t in self.targets)
        if not outside:
            return "Steps 1 to 4 by cones of minors (all inside: nothing to change)"
        return (
            f"Steps 1 to 4 by cones of minors ({outside} of {len(self.targets)} outside or at the border; found in hypercube {self.cubes},"
            f" {self.side:.3g} standard deviations to either side)"
        )


def modify_by_cone(
    structure: InertiaStructure,
    values: Array,
    std: Array,
    *,
    order: MinorOrder | str = MinorOrder.LEADING,
    margin: float = 1e-2,
    most: int = MOST_NUMBERS,
    seed: int = 0,
) -> Modification:
    """Modify base values (b,) with standard deviations (b,) by Steps 1 to 4.

    `margin`: least value of each minor, per root mean square. A value without standard deviation stays. Raises TooManyRaysError for
    structures with cones beyond `most` numbers, InfeasibleError or SolverError where no hypercube holds a possible set."""
    start = time.perf_counter()
    values, order = structure.check_values(values), MinorOrder(order)
    try:
        # The largest first: a request that cannot be met is refused at once.
        minors = [minor_of(structure, rows, most) for rows in reversed(minor_rows(structure, order))]
    except TooManyRaysError as error:
        raise TooManyRaysError(f"repair method 'cone': {error}. Use 'possible' or 'stepwise', which need no cone.") from None
    targets = [target_of(minor, values, margin) for minor in reversed(minors)]
    free = np.flatnonzero((std > 0) & np.any([np.abs(t.minor.matrices).max(axis=(0, 2, 3)) > 0 for t in targets], axis=0))
    if not any(t.outside for t in targets):
        return Modification(values, 0.0, 0, tuple(targets), time.perf_counter() - start)
    rng = np.random.default_rng(seed)
    search = _CubeSearch(values, std, free, targets, margin)
    best = np.zeros(len(free))
    side = _FIRST
    for cube in range(1, _CUBES + 1):
        nearest = search.nearest(best, side)
        for begin in (np.zeros(len(free)), nearest, *rng.uniform(-side, side, (_STARTS - 2, len(free)))):
            candidate = search.values_of(search.feasible(begin, side))
            if search.inside(candidate):
                return Modification(candidate, side, cube, tuple(targets), time.perf_counter() - start)
        best = nearest
        side *= _GROWTH
    raise SolverError(
        f"repair method 'cone': no possible set was found within {side / _GROWTH:.3g} standard deviations of the estimate; use 'possible'."
    )


def target_of(minor: Minor, values: Array, margin: float) -> MinorTarget:
    """Steps 1 and 2 for one minor."""
    x = minor.coordinates(values)
    if not minor.terms:
        raise InfeasibleError(
            f"the minor of {', '.join(minor.names)} is zero whatever the base parameters; no change makes the set possible."
        )
    cone, _ = cone_of(minor)
    if _well_inside(minor, x, margin):
        return MinorTarget(minor, cone, x, x, x)
    cone, border = nearest_border_point(minor, cone, x)
    return MinorTarget(minor, cone, x, border, inner_point(cone, x, border, margin))


def nearest_border_point(minor: Minor, cone: PolyhedralCone, x: Array) -> tuple[PolyhedralCone, Array]:
    """Step 1: the nearest point of the cone's border to x (t,), with positions added to F_i until it is that of all positions."""
    size = float(np.linalg.norm(x))
    a = len(minor.joints)
    fine = grid({0: 1, 1: 720, 2: 6 * minor.points}.get(a, 2 * minor.points), a)
    border = cone.border(x)
    for _ in range(_ROUNDS):
        low = minor.polynomial(border).both(fine)[0]
        if low.min() >= -_TOLERANCE * size:
            break
        worst = np.argsort(low)[: 2 * minor.terms]
        cone = cone.with_rows(minor.rows(fine[worst[low[worst] < 0]]))
        border = cone.border(x)
    return cone, border


def inner_point(cone: PolyhedralCone, x: Array, border: Array, margin: float) -> Array:
    """Step 2: the first point inside the cone, by `margin` of its length, on the line from x through its border point.

    Where that line only touches the cone (at an edge, or at the apex), the line from the border point to the middle of the cone."""
    centre = cone.interior()
    size = max(float(np.linalg.norm(border)), float(np.linalg.norm(x)))
    through = border - x
    steps = 0.01 * 1.3 ** np.arange(30)
    for direction in (through / max(float(np.linalg.norm(through)), 1e-300), centre - border / size):
        for step in steps:
            point = border + step * size * direction
            if cone.lowest(point)[0] >= 2.0 * margin * np.linalg.norm(point):
                return np.asarray(point)
    return np.asarray(size * centre)


def _well_inside(minor: Minor, x: Array, margin: float) -> bool:
    size = float(np.linalg.norm(x))
    if size == 0.0:
        return False
    polynomial = minor.polynomial(x / size)
    if polynomial.both(grid(minor.points, len(minor.joints)))[0].min() < margin:
        return False
    sign, lowest, _ = polynomial.sign()
    return sign == Sign.POSITIVE and lowest >= margin


class _CubeSearch:
    """Step 4: base parameters in a hypercube, in units of their standard deviations about the estimate."""

    def __init__(self, values: Array, std: Array, free: Array, targets: list[MinorTarget], margin: float) -> None:
        self.values, self.std, self.free, self.targets, self.margin = values, std, free, targets, margin
        self.sizes = [float(np.linalg.norm(t.inner)) for t in targets]

    def values_of(self, step: Array) -> Array:
        """Base values (b,) of a step (free,)."""
        out = self.values.copy()
        out[self.free] += step * self.std[self.free]
        return out

    def nearest(self, begin: Array, side: float) -> Array:
        """The step in the hypercube of that half side whose coordinates are nearest to the inner points, from one start."""
        return self._least(self._apart, begin, side)

    def feasible(self, begin: Array, side: float) -> Array:
        """The step in the hypercube whose minors are least below the margin at the positions of F_i, from one start."""
        return self._least(self._below, begin, side)

    def _least(self, parts: Callable[[MinorTarget, Array, Array, float], tuple[Array, Array]], begin: Array, side: float) -> Array:
        from scipy.optimize import least_squares

        last: list[Array] = []

        def both(step: Array) -> list[Array]:
            """Residuals and slope, kept for the second of the two questions at a step."""
            if not last or not np.array_equal(last[0], step):
                values = self.values_of(step)
                found = []
                for target, size in zip(self.targets, self.sizes, strict=True):
                    x, change = target.minor.linear(values)
                    found.append(parts(target, x / size, change[:, self.free] * self.std[self.free] / size, size))
                last[:] = [step.copy(), np.concatenate([f[0] for f in found]), np.concatenate([f[1] for f in found])]
            return last

        def misses(step: Array) -> Array:
            return both(step)[1]

        def slope(step: Array) -> Array:
            return both(step)[2]

        begin = np.clip(begin, -0.999 * side, 0.999 * side)
        found = least_squares(misses, begin, jac=slope, bounds=(-side, side), max_nfev=_EVALUATIONS, xtol=1e-9, ftol=1e-9)  # type: ignore[arg-type]
        return np.asarray(found.x)

    def _apart(self, target: MinorTarget, x: Array, change: Array, size: float) -> tuple[Array, Array]:
        return x - target.inner / size, change

    def _below(self, target: MinorTarget, x: Array, change: Array, size: float) -> tuple[Array, Array]:
        lack = target.cone.rows @ x - 1.5 * self.margin
        return np.minimum(lack, 0.0), (lack < 0)[:, None] * (target.cone.rows @ change)

    def inside(self, values: Array) -> bool:
        """Whether all minors are inside their cones, at all positions; a position between those of F_i that shows otherwise joins them."""
        for k, target in enumerate(self.targets):
            x = target.minor.coordinates(values)
            size = float(np.linalg.norm(x))
            if size == 0.0 or target.cone.lowest(x)[0] <= 0.0:
                return False
            sign, lowest, at = target.minor.polynomial(x / size).sign()
            if sign != Sign.POSITIVE or lowest < 0.1 * self.margin:
                self.targets[k] = replace(target, cone=target.cone.with_rows(target.minor.rows(at[None])))
                return False
        return True
