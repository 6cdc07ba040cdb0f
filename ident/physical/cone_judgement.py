"""The judgement of the dissertation's chapter 4: for every minor of the inertia matrix, do its coordinates lie inside its cone?

H(q; p) is positive definite where all its leading minors (or all trailing ones) are positive. Minor i is f_i(q)' x_i(p) (see `minors`):
the set is possible at the positions of a grid where F_i x_i(p) > 0 for every i, and only the rows of F_i that are extreme rays of the cone
they span have to be tried. Between the positions of the grid the source says nothing; here the lowest value over all positions is bounded
from below (see `trigonometric`), so that the verdict is one over the continuum. Reference: K. Yoshida, dissertation (1995), chapter 4."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from .cone import PolyhedralCone
from .minors import MOST_NUMBERS, Minor, MinorOrder, TooManyRaysError, minor_of, minor_rows
from .structure import InertiaStructure
from .trigonometric import Sign, grid

Array = np.ndarray

#: Positions of a single angle; more angles have what determines the minor.
_SINGLE = 36


@dataclass(frozen=True, eq=False)
class MinorVerdict:
    """One minor: rows of the `joints`, its number of `terms` and of `rays` (extreme rows of F_i), both 0 where it was not judged.

    `inside`: its coordinates are inside the cone, None where it was not judged, for the reason in `note`. `lowest`: least value of the
    minor, per root mean square, at `position` (joint -> rad); `proven` over all positions, or by that one."""

    joints: tuple[str, ...]
    terms: int
    rays: int
    inside: bool | None
    proven: bool
    lowest: float
    position: dict[str, float]
    note: str = ""

    def text(self) -> str:
        """A line for people."""
        name = self.joints[0] + (f" to {self.joints[-1]}" if len(self.joints) > 1 else "")
        if self.inside is None:
            return f"  {name}: not judged: {self.note}"
        where = ", ".join(f"{k} {v:.3f}" for k, v in self.position.items()) or "any position"
        verdict = "inside its cone" if self.inside else "outside its cone"
        return (
            f"  {name}: {verdict} (terms: {self.terms}, rays: {self.rays}), lowest {self.lowest:.3g} of its root mean square at {where}"
            + ("" if self.proven else "; not proven between positions")
        )

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "joints": list(self.joints), "terms": self.terms, "rays": self.rays, "inside": self.inside, "proven": self.proven,
            "lowest": self.lowest, "position": dict(self.position), "note": self.note,
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class ConeJudgement:
    """Verdict by the cones of the minors, in `order`. `possible`: None where no minor is outside its cone but some were not judged.

    `certified`: proven over all positions."""

    possible: bool | None
    certified: bool
    order: MinorOrder
    minors: tuple[MinorVerdict, ...]
    seconds: float

    def text(self) -> str:
        """A few lines for people."""
        verdict = {True: "possible", False: "not possible", None: "undecided"}[self.possible]
        how = " (certified)" if self.certified else ""
        return "\n".join([f"{verdict} by the cones of the {self.order.value} minors{how}", *(m.text() for m in self.minors)])

    def to_dict(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {
            "possible": self.possible,
            "certified": self.certified,
            "order": self.order.value,
            "minors": [m.to_dict() for m in self.minors],
            "seconds": self.seconds,
        }


def judge_by_cone(
    structure: InertiaStructure,
    values: Array,
    *,
    order: MinorOrder | str = MinorOrder.LEADING,
    points: int | None = None,
    most: int = MOST_NUMBERS,
) -> ConeJudgement:
    """Judge base values by the cones of the minors of the inertia matrix, over whole turns.

    Parameters
    ----------
    structure : InertiaStructure
        A revolute chain; `structure.without_rotors` judges H alone, as the source does.
    values : (b,)
        Base parameters.
    order : MinorOrder
        Leading minors, or trailing ones: the same verdict, but of fewer angles.
    points : int, optional
        Positions of each joint in F_i (default: those that determine the minor, and at least 36 of a single angle).
    most : int
        Numbers in F_i at most: a minor with more is not judged, and the verdict says with how many rays.

    Returns
    -------
    ConeJudgement
        One verdict per minor. The first that is outside its cone ends the judgement.

    Raises
    ------
    UnsupportedError
        Prismatic joints, loop closures, a floating base.
    """
    start = time.perf_counter()
    values, order = structure.check_values(values), MinorOrder(order)
    found: list[MinorVerdict] = []
    for rows in minor_rows(structure, order):
        try:
            minor = minor_of(structure, rows, most)
        except TooManyRaysError as error:
            found.append(MinorVerdict(structure.joint_names[rows.start : rows.stop], 0, 0, None, False, 0.0, {}, f"{error}."))
            continue
        found.append(judge_minor(structure, minor, values, points))
        if found[-1].inside is False:
            break
    inside = [m.inside for m in found]
    possible = False if False in inside else None if None in inside else True
    certified = possible is False or (possible is True and all(m.proven for m in found))
    return ConeJudgement(possible, certified, order, tuple(found), time.perf_counter() - start)


def cone_of(minor: Minor, points: int | None = None) -> tuple[PolyhedralCone, Array]:
    """The cone of a minor by `points` positions of every joint, and their angles (q, a)."""
    a = len(minor.joints)
    if points is None:
        points = max(minor.points, _SINGLE) if a == 1 else minor.points
    angles = grid(points, a)
    return PolyhedralCone(minor.basis.T if points == minor.points else minor.rows(angles)), angles


def judge_minor(structure: InertiaStructure, minor: Minor, values: Array, points: int | None = None) -> MinorVerdict:
    """Whether a minor's coordinates are inside its cone: first by the extreme rows of F_i, then between its positions, too."""
    x = minor.coordinates(values)
    size = float(np.linalg.norm(x))
    if size == 0.0:
        return MinorVerdict(minor.names, minor.terms, 0, False, True, 0.0, {}, "zero at every position")
    cone, angles = cone_of(minor, points)
    rays = cone.extreme_rows
    values_there = cone.rows[rays] @ (x / size)
    k = int(np.argmin(values_there))
    lowest, at, sign = float(values_there[k]), angles[rays[k]], Sign.NOT_POSITIVE
    if lowest > 0.0:
        sign, low, between = minor.polynomial(x / size).sign()
        lowest, at = (low, between) if low < lowest else (lowest, at)
    position = {structure.joint_names[j]: float(angle) for j, angle in zip(minor.joints, at, strict=True)}
    return MinorVerdict(minor.names, minor.terms, len(rays), sign != Sign.NOT_POSITIVE, sign != Sign.OPEN, lowest, position)
