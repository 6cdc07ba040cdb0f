"""What a designed motion is to keep clear of, and how well it does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import ConfigurationError
from .obstacles import walls_of

Array = np.ndarray
#: What messages call the plane below.
GROUND = "the ground"


@dataclass(frozen=True)
class Surroundings:
    """What a motion keeps clear of: the robot itself always, the ground and the walls of a workspace where they are given.

    `ground`: height (m, in the base frame) below which nothing that moves may reach, None: no ground; by default, "base", that of the
    base frame, unless links are below it in every posture: then it cannot be the ground, which is said. `box`: ((x, x), (y, y), (z, z))
    m, within which all that moves must stay, None: no walls; `workspace`: file of a closed convex mesh, the same; `obstacles`: files of
    meshes, each connected part of which is taken as its convex hull; meshes are in the base frame, in metres after `mesh_scale`.
    `clearance`: m, kept from everything; `link_radius`: m, of links whose shape is not known.

    Examples
    --------
    >>> from ident.excitation import Surroundings
    >>> Surroundings(ground=None, clearance=0.05).planes
    ()
    """

    ground: float | Literal["base"] | None = "base"
    box: tuple[tuple[float, float], tuple[float, float], tuple[float, float]] | None = None
    clearance: float = 0.02
    link_radius: float | None = None
    obstacles: Sequence[str | Path] = ()
    workspace: str | Path | None = None
    mesh_scale: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "obstacles", tuple(self.obstacles))
        if not self.mesh_scale > 0:
            raise ConfigurationError(f"surroundings: the scale of meshes must be positive, not {self.mesh_scale!r}.")
        if not (np.isfinite(self.clearance) and self.clearance >= 0):
            raise ConfigurationError(f"surroundings: the clearance must be 0 m or more, not {self.clearance!r}.")
        if self.link_radius is not None and not self.link_radius > 0:
            raise ConfigurationError(f"surroundings: the radius of links must be positive, not {self.link_radius!r}.")
        if self.box is not None:
            box = np.asarray(self.box, float)
            if box.shape != (3, 2) or not np.all(box[:, 0] < box[:, 1]):
                raise ConfigurationError("surroundings: a workspace has a lower and an upper bound, in this order, for each of x, y and z.")

    @classmethod
    def within(cls, bounds: Sequence[float], **others: Any) -> Surroundings:
        """With a workspace given as six numbers: x from, x to, y from, y to, z from, z to (m)."""
        if len(bounds) != 6:
            raise ConfigurationError(f"surroundings: a workspace is six numbers (x from, to, y from, to, z from, to), not {len(bounds)}.")
        x, y, z = ((float(bounds[i]), float(bounds[i + 1])) for i in (0, 2, 4))
        return cls(box=(x, y, z), **others)

    @property
    def planes(self) -> tuple[tuple[str, Array, float], ...]:
        """Walls as (name, outward direction (3,), limit in m): what moves has direction · x ≤ limit."""
        out: list[tuple[str, Array, float]] = []
        if self.ground is not None:
            out.append((GROUND, np.array([0.0, 0.0, -1.0]), 0.0 if self.ground == "base" else -float(self.ground)))
        for i, bounds in enumerate(self.box or ()):
            for sign, bound in zip((-1.0, 1.0), bounds, strict=True):
                out.append((f"the wall at {'xyz'[i]} = {bound:g} m", sign * np.eye(3)[i], sign * bound))
        if self.workspace is not None:
            name = Path(self.workspace).name
            out += [(f"the wall of {name}", direction, limit) for direction, limit in walls_of(self.workspace, self.mesh_scale)]
        return tuple(out)


@dataclass(frozen=True)
class Safety:
    """How clear a motion keeps, and what was not looked at.

    `nearest`: what comes nearest to what, how near (m) and when (s), the nearest first; `certified`: the clearance holds between samples
    too, by a bound on the speed of every point; `touching`: pairs that never are as far apart as the clearance, which are only kept from
    touching; `unchecked`: pairs whose shapes overlap nearly always, which are not checked; `invented`: links that stand as capsules;
    `approached`: the way from the present posture is part of what was checked."""

    clearance: float
    nearest: tuple[tuple[str, float, float], ...]
    certified: bool
    touching: tuple[str, ...] = ()
    unchecked: tuple[str, ...] = ()
    invented: tuple[str, ...] = ()
    radius: float = 0.0
    notes: tuple[str, ...] = ()
    approached: bool = False

    def to_dict(self) -> dict[str, Any]:
        """JSON form."""
        return {
            "clearance_m": self.clearance,
            "certified_between_samples": self.certified,
            "nearest": [{"what": what, "distance_m": near, "time_s": t} for what, near, t in self.nearest],
            "only_kept_from_touching": list(self.touching),
            "not_checked": list(self.unchecked),
            "capsules": {"links": list(self.invented), "radius_m": self.radius},
            "notes": list(self.notes),
        }

    def lines(self) -> list[str]:
        """For people."""
        how = "between samples too" if self.certified else "at samples"
        if not self.nearest:
            out = ["nothing to keep clear of: no two bodies that could meet, no ground and no walls"]
        else:
            out = [f"keeps {1000 * self.clearance:.3g} mm clear ({how}); nearest:"]
        out += [f"  {what}: {1000 * near:.0f} mm at {t:.2f} s" for what, near, t in self.nearest[:4]]
        if self.touching:
            out.append(f"never that far apart, kept from touching only: {'; '.join(self.touching)}")
        if self.unchecked:
            out.append(f"NOT checked, shapes overlap in nearly every posture: {'; '.join(self.unchecked)}")
        if self.invented:
            out.append(
                f"no <collision> in the URDF, taken as a capsule of {1000 * self.radius:.0f} mm radius: {', '.join(self.invented)}"
                " (--link-radius; look whether that covers them)"
            )
        out += [f"note: {note}" for note in self.notes]
        out.append(
            "NOT checked: cables, tools and loads that the URDF does not have, objects that were not given,"
            f"{'' if self.approached else ' the way to the first posture,'} and how far the robot strays from the motion"
        )
        return out
