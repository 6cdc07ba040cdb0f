"""The kinematic tree as plain arrays: what the rigid-body kernels need, taken once from a Pinocchio model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..errors import UnsupportedError

if TYPE_CHECKING:
    import pinocchio as pin

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class RigidBodyTree:
    """A tree of one-degree-of-freedom joints, optionally on a free-flyer.

    For body i = 0 … nb-1 (topological order, parent before child; the free-flyer, if any, is body 0):
    `parent` (nb,) int, -1 for the base; `rotation` (nb, 3, 3) and `translation` (nb, 3): placement of the joint frame in the
    parent's frame at q = 0; `axis` (nb, 3): unit axis in the joint frame (zero for a free-flyer); `prismatic` (nb,) bool.
    `gravity` (3,) in the base frame, m/s². `floating`: body 0 is a free-flyer (q: position and quaternion xyzw; v: 6)."""

    parent: Array
    rotation: Array
    translation: Array
    axis: Array
    prismatic: Array
    gravity: Array
    floating: bool

    @property
    def nb(self) -> int:
        """Number of moving bodies."""
        return len(self.parent)

    @property
    def nv(self) -> int:
        """Number of velocities (rows of the regressor)."""
        return self.nb + 5 * self.floating

    @property
    def nq(self) -> int:
        """Number of position coordinates."""
        return self.nb + 6 * self.floating

    @property
    def ends(self) -> tuple[int, ...]:
        """The bodies that carry no other: one of a chain, several of a robot with two arms, with legs, or with fingers."""
        return tuple(i for i in range(self.nb) if i not in self.parent)

    @classmethod
    def from_pinocchio(cls, model: pin.Model) -> RigidBodyTree:
        """From a model whose joints are revolute or prismatic (bounded type), after an optional free-flyer."""
        parent, axis, prismatic, floating = [], [], [], False
        for i in range(1, model.njoints):
            joint = model.joints[i]
            kind = joint.shortname()
            parent.append(int(model.parents[i]) - 1)
            if kind == "JointModelFreeFlyer" and i == 1:
                floating = True
                axis.append(np.zeros(3))
                prismatic.append(False)
            elif joint.nq == 1 and joint.nv == 1 and kind.startswith(("JointModelR", "JointModelP")):
                motion = np.asarray(joint.createData().S).reshape(6)
                prismatic.append(kind.startswith("JointModelP"))
                axis.append(motion[:3] if prismatic[-1] else motion[3:])
            else:
                raise UnsupportedError(
                    f"joint {model.names[i]!r} ({kind}) is neither revolute nor prismatic; lock it or model it as a chain of such joints."
                )
        placements = list(model.jointPlacements)[1:]
        return cls(
            np.array(parent),
            np.array([m.rotation for m in placements]).reshape(-1, 3, 3),
            np.array([m.translation for m in placements]).reshape(-1, 3),
            np.array(axis).reshape(-1, 3),
            np.array(prismatic, bool),
            np.array(model.gravity.linear, float),
            floating,
        )


def link_names(model: pin.Model) -> tuple[str, ...]:
    """URDF link that each moving body is named after: the child link of its joint."""
    found = {}
    for frame in model.frames:
        if str(frame.type) == "BODY" and frame.parentJoint > 0 and frame.parentJoint not in found:
            found[frame.parentJoint] = frame.name
    return tuple(found.get(i, model.names[i]) for i in range(1, model.njoints))
