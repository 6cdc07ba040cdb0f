"""URDF: the file that was fitted, with links, damping and friction changed where they stand."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..identified import Identified
from ..target import ExportOptions, ExportTarget, WrittenFile, register_target
from ..urdf import patch_urdf, source_text

Array = np.ndarray


@register_target
class UrdfTarget(ExportTarget):
    """ROS, Pinocchio, Drake, Isaac Sim's importer, PyBullet."""

    name = "urdf"
    title = "URDF, patched in place"
    suffixes = (".urdf",)

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        data, where = source_text(found.robot, options.urdf)
        dynamics, more = urdf_dynamics(found)
        patched = patch_urdf(
            data, where, found.robot, found.inertial, attached=options.attached, allow_inconsistent=options.allow_inconsistent, **dynamics
        )
        left = found.left_out()
        names = (f"not part of a URDF: {', '.join(dict.fromkeys(left))}.",) if left else ()
        law = () if found.law is None else ("the gains, limits and delay of the drive law have no place in a URDF.",)
        return WrittenFile(patched.data, (*found.notes, *patched.notes, *more, *names, *law), patched.bodies)


def urdf_dynamics(found: Identified) -> tuple[dict[str, Mapping[str, float]], tuple[str, ...]]:
    """Damping and friction per joint on the joint side, where the transmission does not couple joints, and notes."""
    robot, drive = found.robot, found.drive()
    notes: tuple[str, ...] = ()
    if np.any(drive["armature"] != 0):
        notes = ("rotor inertia has no place in a URDF: it stays with the controller or simulator (see the JSON export).",)
    if not robot.transmission.is_diagonal:
        if not (np.any(drive["damping"] != 0) or np.any(drive["frictionloss"] != 0)):
            return {}, notes
        return {}, (*notes, "friction acts on motors that share joints, which a URDF cannot express: its <dynamics> are left unchanged.")
    k = np.abs(np.diagonal(robot.transmission.K))
    has = found.identified()

    def told(key: str, values: Array) -> dict[str, float]:
        # What the model does not have, or the data did not tell, stays as the file has it.
        return {name: float(v) for name, v, here in zip(robot.joint_names, values, has[key], strict=True) if here}

    return {"damping": told("damping", drive["damping"] / k**2), "friction": told("frictionloss", drive["frictionloss"] / k)}, notes
