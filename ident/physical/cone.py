"""Polyhedral cones {x: F x >= 0}: their extreme rays, those of the cone that the rows of F span, and the nearest point of the border.

What a row of F forbids is a half-space; the rows that no others span with weights above zero are the extreme rays of the dual cone, and
suffice for every test. The cone's own extreme rays are where as many independent rows as it has dimensions, less one, are zero. By the
upper bound theorem (P. McMullen, Mathematika 17, 1970) there are at most as many as a cyclic polytope has vertices, which curves such
as 1, cos, sin, cos 2q, sin 2q reach: 594 in five dimensions with 36 rows, and 1e17 in 25 dimensions with 169."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import comb

import numpy as np

from .._utils.short_repr import ShortRepr
from .._utils.singular_values import svd
from .conic import InfeasibleError, SolverError
from .minors import TooManyRaysError

Array = np.ndarray

#: Extreme rays of a cone that are listed.
MOST_RAYS = 50_000
#: Numbers in F up to which its extreme rows are sought.
_MOST_REDUCED = 20_000
_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class PolyhedralCone(ShortRepr):
    """{x (t,): rows (q, t) @ x >= 0}.

    Examples
    --------
    >>> import numpy as np
    >>> from ident.physical.cone import PolyhedralCone
    >>> cone = PolyhedralCone(np.array([[1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]))
    >>> len(cone.extreme_rows), len(cone.rays())
    (2, 2)
    >>> cone.border(np.array([-1.0, 2.0])).tolist()
    [0.0, 2.0]
    """

    rows: Array

    @property
    def terms(self) -> int:
        """Dimension t."""
        return self.rows.shape[1]

    def lowest(self, x: Array) -> tuple[float, int]:
        """Smallest of rows @ x and its row: test (4.49) is that it is above zero."""
        values = self.rows @ x
        k = int(np.argmin(values))
        return float(values[k]), k

    def with_rows(self, rows: Array) -> PolyhedralCone:
        """The cone that these rows bound, too."""
        return PolyhedralCone(np.concatenate([self.rows, rows]))

    @cached_property
    def extreme_rows(self) -> Array:
        """Indices of the rows that are extreme rays of the cone they all span; of equal ones the first. All where there are very many."""
        size = np.linalg.norm(self.rows, axis=1)
        kept = [int(k) for k in np.flatnonzero(size > 1e-12 * max(float(size.max(initial=0.0)), 1e-300))]
        if self.rows.size > _MOST_REDUCED:
            return np.array(kept, int)
        units = self.rows / np.where(size > 0, size, 1.0)[:, None]
        # The later of two equal rows goes first.
        for k in reversed(list(kept)):
            others = [i for i in kept if i != k]
            if others and _distance(units[others], units[k]) < 1e-7:
                kept.remove(k)
        return np.array(kept, int)

    @property
    def most_rays(self) -> int:
        """What the upper bound theorem allows: extreme rays of a pointed cone of this dimension with so many rows."""
        q, d = len(self.rows), self.terms - 1
        if d < 1 or q <= d:
            return 1 if d < 1 else q
        return comb(q - (d + 1) // 2, q - d) + comb(q - (d + 2) // 2, q - d)

    def rays(self, most: int = MOST_RAYS) -> Array:
        """Extreme rays (r, t) of the cone, of length one. Raises TooManyRaysError where there may be more than `most`."""
        if self.most_rays > most:
            raise TooManyRaysError(
                f"a cone of {self.terms} dimensions and {len(self.rows):,} rows can have {float(self.most_rays):.2g} extreme rays"
                f" (at most {most:,} are listed)"
            )
        centre = self.interior()
        rows = self.rows / (self.rows @ centre)[:, None]
        if self.terms == 1:
            return np.sign(rows[:1])
        # The rows as points of the plane row @ centre = 1: facets of their hull are the extreme rays.
        Z = svd(centre[None])[2][1:].T
        points = rows @ Z
        if self.terms == 2:
            low, high = float(points.min()), float(points.max())
            facets = np.array([[-1.0, low], [1.0, -high]])
        else:
            facets = _hull(points)
        rays = -(facets[:, :-1] @ Z.T + facets[:, -1:] * centre)
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        return rays[np.unique(np.round(rays, 9), axis=0, return_index=True)[1]]

    def interior(self) -> Array:
        """A point of the cone far from its border: the mean row where that is inside, else that of the largest ball in the unit cube."""
        mean = self.rows.mean(axis=0)
        if self.lowest(mean)[0] > 0.1 * float(mean @ mean):
            return np.asarray(mean / np.linalg.norm(mean))
        from scipy.optimize import linprog

        size = np.linalg.norm(self.rows, axis=1)
        t = self.terms
        # Largest radius r of a ball about x with rows @ x >= r |row|.
        cost, bounds = -np.eye(t + 1)[t], [(-1.0, 1.0)] * t + [(0.0, 1.0)]
        found = linprog(cost, A_ub=np.concatenate([-self.rows, size[:, None]], axis=1), b_ub=np.zeros(len(size)), bounds=bounds)
        if found.x is None or found.x[t] <= _TOLERANCE:
            raise InfeasibleError("no base parameters at all make this minor positive at every position.")
        return np.asarray(found.x[:t] / np.linalg.norm(found.x[:t]))

    def border(self, x: Array) -> Array:
        """The nearest point of the cone: x itself inside, else the nearest point of its border.

        x less its nearest point is opposed by the rows that bind there (J.-J. Moreau): weights of the rows by nonnegative least
        squares."""
        return x + self.rows.T @ _weights(self.rows, -x)


def _weights(rows: Array, wanted: Array) -> Array:
    """Weights (q,) >= 0 with rows.T @ weights nearest to wanted (t,)."""
    from scipy.optimize import nnls

    size = max(float(np.linalg.norm(wanted)), 1e-300)
    try:
        return np.asarray(nnls(rows.T, wanted / size, maxiter=30 * sum(rows.shape) + 1000)[0]) * size
    except RuntimeError as error:
        raise SolverError(f"the nearest point of a cone of {rows.shape[1]} dimensions was not found: {error}.") from None


def _distance(rows: Array, x: Array) -> float:
    """Distance of x (t,) from the cone that rows span."""
    return float(np.linalg.norm(rows.T @ _weights(rows, x) - x))


def _hull(points: Array) -> Array:
    """Facets (r, d + 1), outward normals and offsets, of the hull of points (q, d)."""
    from scipy.spatial import ConvexHull

    return np.asarray(ConvexHull(points).equations)
