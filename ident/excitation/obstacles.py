"""Meshes of the surroundings: obstacles as convex parts, a workspace as walls."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .._utils.singular_values import singular_values, svd
from ..errors import ConfigurationError

Array = np.ndarray
#: Digits to which corners of triangles are one, share of a hull's volume that a convex mesh may lack, most walls, and the size (m) beyond
#: which nobody means metres.
_DIGITS, _DENT, _MOST_WALLS, _HUGE = 6, 0.01, 400, 100.0


def read_mesh(path: str | Path, scale: float) -> tuple[Array, Array]:
    """Corners (V, 3) in m, each once, and triangles (T, 3). Raises ConfigurationError for a file that holds none."""
    import coal

    file = Path(path)
    if not file.is_file():
        raise ConfigurationError(f"mesh {file}: there is no such file.")
    try:
        mesh = coal.MeshLoader().load(str(file), np.full(3, scale))
    except (ValueError, RuntimeError) as error:
        raise ConfigurationError(
            f"mesh {file}: cannot be read ({str(error).strip().splitlines()[0]}); give STL, OBJ, PLY or DAE."
        ) from None
    corners = np.array(mesh.vertices(), float).reshape(-1, 3)
    triangles = np.array([[mesh.tri_indices(i)[k] for k in range(3)] for i in range(mesh.num_tris)], int).reshape(-1, 3)
    if not len(triangles) or not np.isfinite(corners).all():
        raise ConfigurationError(f"mesh {file}: holds no triangles.")
    size = float(np.ptp(corners, axis=0).max())
    if size > _HUGE:
        raise ConfigurationError(f"mesh {file}: is {size:.3g} m wide; if it is in millimetres, give its scale (--mesh-scale 0.001).")
    _, first, number = np.unique(corners.round(_DIGITS), axis=0, return_index=True, return_inverse=True)
    return corners[first], number.reshape(-1)[triangles]


def convex_parts(path: str | Path, scale: float) -> list[Any]:
    """The convex hull of each connected part of a mesh, as shapes of coal."""
    import coal
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    corners, triangles = read_mesh(path, scale)
    edges = np.concatenate([triangles[:, :2], triangles[:, 1:]])
    links = coo_array((np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(len(corners),) * 2)
    count, part = connected_components(links, directed=False)
    out = []
    for k in range(count):
        own = corners[part == k]
        if len(own) < 3:
            continue
        flat = singular_values(own - own.mean(axis=0))
        if flat[-1] < 1e-6 * max(flat[0], 1e-12):  # a sheet: as thick as nothing, but a body
            own = np.concatenate([own, own + 1e-4 * svd(own - own.mean(axis=0))[2][-1]])
        points = coal.StdVec_Vec3s()
        points.extend(list(own))
        out.append(coal.Convex.convexHull(points, True, "Qt"))
    return out


def walls_of(path: str | Path, scale: float) -> list[tuple[Array, float]]:
    """The walls of a closed convex mesh as (outward direction (3,), limit in m). Raises ConfigurationError for another one."""
    from scipy.spatial import ConvexHull

    corners, triangles = read_mesh(path, scale)
    sides, times = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0, return_counts=True)
    if np.any(times != 2):
        raise ConfigurationError(f"workspace {path}: is not closed ({int((times != 2).sum())} of {len(sides)} edges are open); close it.")
    a, b, c = (corners[triangles[:, k]] for k in range(3))
    volume = abs(float(np.einsum("ti,ti->", a, np.cross(b, c)))) / 6.0
    hull = ConvexHull(corners)
    if volume < (1.0 - _DENT) * hull.volume:
        raise ConfigurationError(
            f"workspace {path}: is not convex (it fills {100 * volume / hull.volume:.0f} % of its hull). Give its hull, and what"
            " stands inside it as obstacles (--obstacle)."
        )
    planes = np.unique(hull.equations.round(_DIGITS), axis=0)
    if len(planes) > _MOST_WALLS:
        raise ConfigurationError(f"workspace {path}: has {len(planes)} walls; give one of at most {_MOST_WALLS} (a coarser mesh).")
    # Rounded directions and limits never widen the room by more than rounding; they are normalised again.
    return [(row[:3] / np.linalg.norm(row[:3]), float(-row[3] / np.linalg.norm(row[:3]))) for row in planes]
