"""The robot as a report shows it: joints, links, centres of mass and inertia ellipsoids, from two sides."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..drawing.document import BlockKind, Figure, Layer, Panel, Role, Section, Text
from ..errors import IdentError
from ..exporting import Identified
from ..robots.tree import link_names

if TYPE_CHECKING:
    from ..estimate.estimate import Estimate
    from ..robots.robot import Robot
    from ..robots.tree import RigidBodyTree
    from ..simulation.trajectory import Trajectory

Array = np.ndarray
TITLE = "Links with centres of mass and inertia"
_SIDES = (("from the side", 0, 2, "x (m)", "z (m)"), ("from above", 0, 1, "x (m)", "y (m)"))
_MOMENTS = 400
_OUTLINE = np.linspace(0.0, 2.0 * np.pi, 49)


def robot_sections(estimate: Estimate) -> tuple[Section, ...]:
    """The picture of the links that the estimate stands for; a word of why, where no bodies give its parameters."""
    if estimate.model.robot.floating_base or len(estimate.values) != estimate.model.base.count:
        return ()
    try:
        identified = Identified.of(estimate)
    except IdentError as error:
        return (Text(TITLE, (f"Not drawn: {str(error).removeprefix('nothing was exported: ')}",)),)
    return (robot_figure(estimate.model.robot, identified.inertial),)


def robot_figure(robot: Robot, inertial: Array) -> Figure:
    """Links with parameters (10 nb,), all joints at zero: the chain, each centre of mass, and the body of even density that has the
    link's mass and inertia."""
    places, frames = joint_frames(robot.tree)
    reach = float(np.linalg.norm(np.diff(places, axis=0, prepend=np.zeros((1, 3))), axis=1).sum())
    shown = [(i, body) for i, body in enumerate(map(_body, inertial.reshape(-1, 10))) if body is not None and _size(body) <= reach]
    panels = []
    for title, across, up, x_label, y_label in _SIDES:
        at = [across, up]
        chain = [
            np.vstack([places[p] if p >= 0 else np.zeros(3), places[i], np.full(3, np.nan)])[:, at] for i, p in enumerate(robot.tree.parent)
        ]
        centres, outlines = [], []
        for i, (centre, spread) in shown:
            turned, moved = frames[i] @ spread @ frames[i].T, places[i] + frames[i] @ centre
            values, vectors = np.linalg.eigh(5.0 * turned[np.ix_(at, at)])
            half = vectors @ np.diag(np.sqrt(np.maximum(values, 0.0)))
            ring = moved[at] + np.column_stack([np.cos(_OUTLINE), np.sin(_OUTLINE)]) @ half.T
            outlines.append(np.vstack([ring, np.full(2, np.nan)]))
            centres.append(moved[at])
        layers = [
            Layer.of(BlockKind.LINE, Role.MEASURED, np.vstack(chain)[:, 0], np.vstack(chain)[:, 1], label="joint to joint"),
            Layer.of(BlockKind.MARKS, Role.MEASURED, *places[:, at].T),
        ]
        if shown:
            rings = np.vstack(outlines)
            layers.append(Layer.of(BlockKind.LINE, Role.AFTER, rings[:, 0], rings[:, 1], label="body of even density"))
            layers.append(Layer.of(BlockKind.MARKS, Role.BEFORE, np.array(centres)[:, 0], np.array(centres)[:, 1], label="centre of mass"))
        panels.append(Panel(title, x_label, y_label, tuple(layers), to_scale=True))
    named = ", ".join(link_names(robot.model)[i] for i in range(robot.tree.nb) if i not in {k for k, _ in shown})
    caption = (
        "All joints at zero. Among all bodies that give the identified torque, those nearest to the URDF's: masses and centres are not"
    )
    caption += " determined one by one, what they add up to is." + (
        f" Not drawn, as no bodies of this robot's size: {named}." if named else ""
    )
    return Figure("robot", TITLE, caption, tuple(panels), columns=2)


def path_figure(robot: Robot, trajectory: Trajectory) -> Figure:
    """The way of the last link's frame along a motion, from two sides, with its start."""
    model, data = robot.model, robot.model.createData()
    import pinocchio as pin

    q = trajectory.sample(np.linspace(0.0, trajectory.duration, _MOMENTS)).q
    way = np.zeros((_MOMENTS, 3))
    for k, own in enumerate(robot.tree_position(q)):
        pin.forwardKinematics(model, data, own)
        way[k] = data.oMi[model.njoints - 1].translation
    panels = tuple(
        Panel(title, x_label, y_label, (
            Layer.of(BlockKind.LINE, Role.AFTER, way[:, across], way[:, up], label="way of the last joint"),
            Layer.of(BlockKind.MARKS, Role.BEFORE, way[:1, across], way[:1, up], label="start and end"),
        ), to_scale=True)
        for title, across, up, x_label, y_label in _SIDES
    )  # fmt: skip
    return Figure("path", "Way of the last joint", "In the base frame. Look whether that room is free.", panels, columns=2)


def joint_frames(tree: RigidBodyTree) -> tuple[Array, Array]:
    """Origins (nb, 3) and rotations (nb, 3, 3) of the joint frames in the base, all joints at zero."""
    places, frames = np.zeros((tree.nb, 3)), np.zeros((tree.nb, 3, 3))
    for i, parent in enumerate(tree.parent):
        frame, place = (frames[parent], places[parent]) if parent >= 0 else (np.eye(3), np.zeros(3))
        frames[i], places[i] = frame @ tree.rotation[i], place + frame @ tree.translation[i]
    return places, frames


def _size(body: tuple[Array, Array]) -> float:
    """How far a body reaches from its joint, m."""
    centre, spread = body
    return float(np.linalg.norm(centre) + np.sqrt(5.0 * max(np.linalg.eigvalsh(spread)[-1], 0.0)))


def _body(parameters: Array) -> tuple[Array, Array] | None:
    """Centre of mass (3,) and second moments of mass about it over the mass (3, 3) of ten parameters; None for a link without mass."""
    mass = float(parameters[0])
    if mass <= 0:
        return None
    centre = parameters[1:4] / mass
    xx, xy, yy, xz, yz, zz = parameters[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    second = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    return centre, second / mass - np.outer(centre, centre)
