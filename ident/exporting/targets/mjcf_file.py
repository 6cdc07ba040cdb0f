"""MJCF (MuJoCo, and what reads its files): bodies, joints with armature, damping, friction loss and springs, couplings."""

from __future__ import annotations

import numpy as np

from ..actuation import Actuation
from ..identified import Identified
from ..mjcf import mjcf_text
from ..omitted import omissions
from ..target import ExportOptions, ExportTarget, Expressed, WrittenFile, register_target

Array = np.ndarray
JOINTS = frozenset({Expressed.ARMATURE, Expressed.DAMPING, Expressed.DRY_FRICTION, Expressed.COUPLING})


@register_target
class MjcfTarget(ExportTarget):
    """Joints without actuators: for programs that command torque of their own."""

    name = "mjcf"
    title = "MJCF: bodies and joints"
    suffixes = (".xml", ".mjcf")
    expresses = JOINTS

    def written(self, found: Identified, options: ExportOptions) -> WrittenFile:
        springs, expresses = spring_attributes(Actuation.of(found)), self.expresses
        if springs:
            expresses = expresses | {Expressed.SPRING}
        text, notes = mjcf_text(found.robot, found.inertial, found.drive(), {**found.beside(), **springs})
        return WrittenFile(text, (*found.notes, *notes, *omissions(found, expresses, options)))


def spring_attributes(law: Actuation) -> dict[str, Array]:
    """Stiffness and rest position of the joints' springs; a constant torque beside a spring moves the rest position. Nothing where there
    are no springs, or where they couple joints."""
    stiffness = np.diag(law.spring)
    if not stiffness.any() or np.any(law.spring != np.diag(stiffness)):
        return {}
    rest = np.divide(-law.offset, stiffness, out=np.zeros(len(stiffness)), where=stiffness > 0)
    return {"stiffness": np.where(stiffness > 0, stiffness, 0.0), "springref": rest}
