"""The swept motion to look at: the robot's shapes along it in one page that needs nothing else, and drawings from three sides."""

from __future__ import annotations

import json
from html import escape
from importlib import resources
from typing import TYPE_CHECKING, Any

import numpy as np

from ..drawing.document import BlockKind, Figure, Layer, Panel, Role
from ..robots.bodies import Bodies
from .obstacles import convex_parts
from .placements import ShapePlacements, corners_of
from .surroundings import GROUND, Surroundings

if TYPE_CHECKING:
    from ..robots.robot import Robot
    from ..simulation.trajectory import Trajectory

Array = np.ndarray
#: Frames a second of the page and at most, postures of the drawings, and points about a ball.
_FRAMES_HZ, _MOST_FRAMES, _POSTURES, _BALL = 20.0, 600, 40, 10
#: Digits of lengths (m) and of rotations.
_DIGITS = 4


def swept_page(robot: Robot, trajectory: Trajectory, surroundings: Surroundings | None) -> str:
    """One HTML page: the shapes that were checked along a trajectory, to turn and to play."""
    room = Surroundings(ground=None) if surroundings is None else surroundings
    bodies = Bodies.of(robot, room.link_radius)
    placements = ShapePlacements(bodies)
    t = np.linspace(0.0, trajectory.duration, int(min(_MOST_FRAMES, max(2, trajectory.duration * _FRAMES_HZ))))
    placed = placements.at(robot.tree_position(trajectory.sample(t).q))
    frames = np.concatenate([placed.R.reshape(*placed.p.shape[:2], 9), placed.p], axis=2).reshape(len(t), -1).round(_DIGITS)
    shapes = [
        {**_mesh(shape.geometry), "moves": bool(joint >= 0)}
        for shape, joint in zip(bodies.shapes.geometryObjects, placements.joint, strict=True)
    ]
    obstacles = [_mesh(part) for file in room.obstacles for part in convex_parts(file, room.mesh_scale)]
    ground = next((limit for name, _, limit in room.planes if name == GROUND), None)
    low, high = placed.p.min(axis=(0, 1)), placed.p.max(axis=(0, 1))
    data = {
        "shapes": shapes,
        "frames": frames.tolist(),
        "obstacles": obstacles,
        "path": placed.p[:, placements.last].round(_DIGITS).tolist(),
        "walls": _edges(room),
        "ground": None if ground is None else -ground,
        "duration": trajectory.duration,
        "middle": (0.5 * (low + high)).round(_DIGITS).tolist(),
        "size": round(0.6 * float((high - low).max()) + 0.2, _DIGITS),
    }
    title = f"Designed motion of {robot.name}: {trajectory.duration:.1f} s"
    note = "Shapes as they are checked: hulls, and capsules where the URDF has no shape. Grey: fixed. Orange: in the way. Drag to turn."
    page = resources.files(__package__).joinpath("view.html").read_text(encoding="utf-8")
    for key, value in (("title", escape(title)), ("note", note), ("data", json.dumps(data, separators=(",", ":")))):
        page = page.replace("{" + key + "}", value)
    return page


def _mesh(geometry: Any) -> dict[str, list[Any]]:
    """The hull of a shape as corners `v` and triangles `f`, flat."""
    from scipy.spatial import ConvexHull

    corners, radius = corners_of(geometry)
    if radius > 0:
        a, b = np.meshgrid(np.linspace(0, 2 * np.pi, _BALL, endpoint=False), np.linspace(-np.pi / 2, np.pi / 2, _BALL // 2 + 1))
        ball = radius * np.stack([np.cos(a) * np.cos(b), np.sin(a) * np.cos(b), np.sin(b)], axis=-1).reshape(-1, 3)
        corners = (corners[:, None] + ball).reshape(-1, 3)
    hull = ConvexHull(corners, qhull_options="QJ")
    kept, number = np.unique(hull.simplices, return_inverse=True)
    return {"v": corners[kept].round(_DIGITS).reshape(-1).tolist(), "f": number.reshape(-1).tolist()}


def _edges(room: Surroundings) -> list[list[float]]:
    """Ends of the edges of a workspace's walls, two by two."""
    if room.box is None:
        return []
    corner = np.array(np.meshgrid(*room.box, indexing="ij")).reshape(3, -1).T
    pairs = [(a, b) for a in range(8) for b in range(a + 1, 8) if (a ^ b).bit_count() == 1]
    return [corner[k].tolist() for pair in pairs for k in pair]


def swept_figure(robot: Robot, trajectory: Trajectory, surroundings: Surroundings | None) -> Figure:
    """The robot's joints and the end of its last shape in postures along a trajectory, from the side (x, z), from the front (y, z) and
    from above (x, y)."""
    bodies = Bodies.of(robot, None if surroundings is None else surroundings.link_radius)
    placements = ShapePlacements(bodies)
    q = trajectory.sample(np.linspace(0.0, trajectory.duration, _POSTURES)).q
    placed = placements.at(robot.tree_position(q))
    fine = placements.at(robot.tree_position(trajectory.sample(np.linspace(0.0, trajectory.duration, 400)).q))
    last = placements.last
    middle = placements.ends[last].mean(axis=0)

    def ends(own: Any) -> Array:
        return own.p[:, last] + own.R[:, last] @ middle

    chains = [_chain(placements, placed, i, ends(placed)[i]) for i in range(len(q))]
    ground = None if surroundings is None else next((-limit for name, _, limit in surroundings.planes if name == GROUND), None)
    panels = []
    for title, x, y in (("from the side", 0, 2), ("from the front", 1, 2), ("from above", 0, 1)):
        lines = np.concatenate([np.vstack([c[:, [x, y]], [[np.nan, np.nan]]]) for c in chains])
        path = ends(fine)[:, [x, y]]
        layers = [
            Layer.of(BlockKind.LINE, Role.FLOOR, lines[:, 0], lines[:, 1], label="robot"),
            Layer.of(BlockKind.LINE, Role.AFTER, path[:, 0], path[:, 1], label="path of the last shape"),
        ]
        if ground is not None and y == 2:
            wide = (float(np.nanmin(lines[:, 0])), float(np.nanmax(lines[:, 0])))
            layers.append(Layer.of(BlockKind.LINE, Role.BEFORE, wide, (ground, ground), label="ground"))
        panels.append(Panel(title, f"{'xyz'[x]} (m)", f"{'xyz'[y]} (m)", tuple(layers)))
    caption = f"Joints in {_POSTURES} postures at equal times, approach included; shapes are wider than these lines."
    return Figure("swept", "Swept motion", caption, tuple(panels), columns=3)


def _chain(placements: ShapePlacements, placed: Any, i: int, end: Array) -> Array:
    """Joint origins from the base to the last joint, and the end, (K, 3)."""
    joints, joint = [], int(placements.joint[placements.last])
    while joint >= 0:
        joints.append(placed.origin[i, joint])
        joint = int(placements.tree.parent[joint])
    return np.array([np.zeros(3), *joints[::-1], end])
