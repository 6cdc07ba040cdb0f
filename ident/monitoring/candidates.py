"""What may have changed since a fit: the parameters of its own effects, joint by joint."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..effects.rigid_body import RigidBody
from .stages.candidates import Candidate

if TYPE_CHECKING:
    from ..effects.base import Effect
    from ..model import Model
    from ..robots.parameters import Parameter
    from ..robots.robot import Robot

#: Goes into the names of a change's parameters, so that they stay apart from those of the model.
LABEL = "+"


@dataclass(frozen=True)
class Place:
    """One of the model's own effects on one joint: its parameters as the model names them."""

    effect: Effect
    parameters: tuple[Parameter, ...]


def own_changes(model: Model) -> dict[Candidate, Place]:
    """For each effect of a model beside the rigid body, and each joint it sits on, the change of its parameters there."""
    robot = model.robot
    found: dict[Candidate, Place] = {}
    for effect in model.effects:
        if isinstance(effect, RigidBody):
            continue
        for part in _parts(effect, robot):
            changed = dataclasses.replace(part, label=part.label + LABEL)
            found[Candidate(effect.name, part.joints or (), (changed,))] = Place(effect, part.parameters(robot))
    return found


def _parts(effect: Effect, robot: Robot) -> list[Effect]:
    if not type(effect).per_joint:
        return [effect]
    return [dataclasses.replace(effect, joints=(robot.joint_names[j],)) for j in effect.at(robot)]
